"""`lift-manager demo`, `simulate` and `check`: for whoever has no lift at hand, or a file that may have mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import (
    Floors,
    MapName,
    fail,
    loaded_map,
    out,
    read_floors,
    refused,
    say,
)
from lift_manager.cli.logs import LogFormat, LogOption, log_to_stderr
from lift_manager.cli.loop import run
from lift_manager.cli.rmf_names import check_names
from lift_manager.cli.servable import obstacles
from lift_manager.config.load import check_file
from lift_manager.lab.demo import run_demo
from lift_manager.lab.simulate import run_simulation
from lift_manager.web.errors import ListenError
from lift_manager.web.limits import raise_file_limit
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

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


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A site file or a register map.")],
    building_map: Annotated[
        Path | None,
        typer.Option(
            "--building-map",
            metavar="FILE",
            help="Open-RMF's .building.yaml: are its lifts and levels called as the site says?",
            show_default=False,
        ),
    ] = None,
    nav_graph: Annotated[
        list[Path],
        typer.Option(
            "--nav-graph",
            metavar="FILE",
            help="With --building-map: a navigation graph made of it; can be repeated.",
            show_default=False,
        ),
    ] = [],  # noqa: B006 - typer makes a new list of it
) -> None:
    """Find every mistake in a site file or a register map; exits 2 if there is one."""
    if nav_graph and building_map is None:
        raise typer.BadParameter(
            "give the building map that it was made of, too, with --building-map", param_hint="--nav-graph"
        )
    try:
        say(check_file(file, obstacles, for_rmf=building_map is not None))
        if building_map is not None:
            check_names(file, building_map, nav_graph)
    except MapFileError as error:
        raise refused(error) from error


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
    source = loaded_map(map_name).map
    try:
        run(run_simulation(source, host=host, port=port, floors=read_floors(floors), speed=speed, console=out))
    except ValueError as error:
        raise fail(str(error)) from error
    except OSError as error:
        advice = "give an address of this machine with --host, or another port with --port"
        raise fail(f"cannot listen on {host}:{port}: {error.strerror or error}; {advice}") from error
