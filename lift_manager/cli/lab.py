"""`lift-manager demo` and `simulate`: run simulated lifts."""

from __future__ import annotations

from typing import Annotated

import typer

from lift_manager.cli.common import (
    Floors,
    MapName,
    fail,
    load_map_or_exit,
    out,
    read_floors,
)
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.lab.demo import run_demo
from lift_manager.lab.simulate import run_simulation
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.server import listen

Speed = Annotated[
    float, typer.Option(min=0.1, max=100, help="How much faster than real the simulated car and doors move.")
]


def demo(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the manager; 0 takes any free one.")] = 5003,
    speed: Speed = 1.0,
    log_format: LogOption = LogFormat.HUMAN,
) -> None:
    """Run three simulated lifts and a manager, with nothing to configure."""
    log_to_stderr(log_format)
    raise_file_limit()
    try:
        sock = listen("127.0.0.1", port)
    except ListenError as error:
        raise fail(str(error)) from error
    if not run(run_demo(sock, speed=speed, console=out)):
        raise typer.Exit(1)


def simulate(
    map_name: MapName,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the simulated controller; 0 takes any free one.")
    ] = 5020,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    floors: Floors = "",
    speed: Speed = 1.0,
) -> None:
    """Serve one simulated lift that any Modbus/TCP tool can read and command."""
    source = load_map_or_exit(map_name).map
    try:
        run(run_simulation(source, host=host, port=port, floors=read_floors(floors), speed=speed, console=out))
    except ValueError as error:
        raise fail(str(error)) from error
    except OSError as error:
        advice = "give an address of this machine with --host, or another port with --port"
        raise fail(f"cannot listen on {host}:{port}: {error.strerror or error}; {advice}") from error
