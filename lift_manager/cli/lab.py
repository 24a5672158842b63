"""`lift-manager demo` and `simulate`: run simulated lifts."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from socket import socket
from typing import Annotated

import typer

from lift_manager.cli.common import (
    Floors,
    fail,
    load_map_or_exit,
    out,
    read_floors,
)
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.commissioning.trace.recording import RecordingUnusable, read_recording
from lift_manager.lab.demo import run_demo
from lift_manager.lab.replay import NothingRecorded
from lift_manager.lab.simulate import run_replay, run_simulation
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.server import listen, listen_error_text

PANEL_PORT = 5004
"""Where the panel is unless that port is taken. Chosen: beside the manager of the demo."""

PanelPort = Annotated[
    int | None,
    typer.Option(
        "--panel",
        min=0,
        max=65535,
        metavar="PORT",
        help=f"Port of the panel that presses buttons and makes faults, on this computer only; by default {PANEL_PORT}, or any free"
        " one if that is taken.",
        show_default=False,
    ),
]
NoPanel = Annotated[bool, typer.Option("--no-panel", help="Run without the panel.")]
Speed = Annotated[
    float, typer.Option(min=0.1, max=100, help="How much faster than real the simulated car and doors move.")
]


def demo(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the manager; 0 takes any free one.")] = 5003,
    speed: Speed = 1.0,
    log_format: LogOption = LogFormat.HUMAN,
    panel: PanelPort = None,
    *,
    no_panel: NoPanel = False,
) -> None:
    """Run three simulated lifts and a manager.

    Nothing has to be configured. It prints where the page and the panel are, and what to try. Ctrl-C ends it.

    Example: lift-manager demo --speed 10
    """
    log_to_stderr(log_format)
    raise_file_limit()
    try:
        sock = listen("127.0.0.1", port)
    except ListenError as error:
        raise fail(str(error)) from error
    with sock:
        if not run(run_demo(sock, speed=speed, console=out, panel=_panel_socket(panel, no_panel=no_panel))):
            raise typer.Exit(1)


def simulate(  # noqa: PLR0913  the options of the command
    map_name: Annotated[
        str,
        typer.Argument(
            metavar="MAP",
            help="A shipped map by name, or the path of a map file; none with --replay.",
            show_default=False,
        ),
    ] = "",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the simulated controller; 0 takes any free one.")
    ] = 5020,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    floors: Floors = "",
    speed: Speed = 1.0,
    replay: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Answer like the controller in a recording of `trace record`, instead of a lift."
        ),
    ] = None,
    *,
    loop: Annotated[
        bool,
        typer.Option("--loop", help="With --replay: begin again at its end, instead of repeating the last answers."),
    ] = False,
    panel: PanelPort = None,
    no_panel: NoPanel = False,
) -> None:
    """Serve one simulated lift, or replay a recorded controller.

    Any Modbus/TCP tool can read and command it. It has the registers of the map, and prints them.

    Example: lift-manager simulate generic-registers --floors G=1,L1=2,L2=3

    Example: lift-manager simulate --replay door-problem.jsonl
    """
    if bool(map_name) == (replay is not None):
        raise typer.BadParameter("give a map, or --replay with a recording", param_hint="MAP")
    if loop and replay is None:
        raise typer.BadParameter("only a recording has an end", param_hint="--loop")
    if panel is not None and replay is not None:
        raise typer.BadParameter("a recording has nothing to press", param_hint="--panel")
    try:
        if replay is not None:
            run(run_replay(read_recording(replay), host=host, port=port, loop=loop, console=out))
            return
        source, named = load_map_or_exit(map_name).map, read_floors(floors)
        panel_socket = _panel_socket(panel, no_panel=no_panel)
        with panel_socket or nullcontext():
            run(
                run_simulation(source, host=host, port=port, floors=named, speed=speed, console=out, panel=panel_socket)
            )
    except RecordingUnusable as error:
        raise fail(str(error)) from error
    except NothingRecorded as error:
        raise fail(f"{replay}: {error}") from error
    except ValueError as error:
        raise fail(str(error)) from error
    except OSError as error:
        raise fail(listen_error_text(error, host, port)) from error


def _panel_socket(port: int | None, *, no_panel: bool) -> socket | None:
    """Listen for the panel, or return None without one. Prints a sentence and exits with 1 if its port is taken."""
    if no_panel:
        if port is not None:
            raise typer.BadParameter("give either --panel or --no-panel", param_hint="--panel")
        return None
    try:
        return listen("127.0.0.1", PANEL_PORT if port is None else port)
    except ListenError as error:
        if port is None:
            return listen("127.0.0.1", 0)
        problem, _, _ = str(error).partition(";")  # what follows names options of `serve`
        raise fail(f"{problem}; give another port with --panel, or leave the panel out with --no-panel") from error
