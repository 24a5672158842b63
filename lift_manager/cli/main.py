"""The command line: parses words and calls lab, app, config or commissioning."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli import audit, keys, maps, network, operate, scenario, serving
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
from lift_manager.cli.loop import log_to_stderr, run
from lift_manager.config.load import check_file
from lift_manager.lab.demo import run_demo
from lift_manager.lab.simulate import run_simulation
from lift_manager.web.errors import ListenError
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Connect robots to real lifts over Modbus/TCP.",
)
app.add_typer(keys.app, name="keys")
app.add_typer(maps.app, name="maps")
app.add_typer(scenario.app, name="scenario")
app.command()(serving.serve)
app.command()(operate.ack)
app.command()(operate.lockout)
app.command()(operate.release)
app.command()(audit.audit)
app.command("network")(network.show)

Speed = Annotated[
    float, typer.Option(min=0.1, max=100, help="How much faster than real the simulated car and doors move.")
]


@app.command()
def demo(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the manager; 0 takes any free one.")] = 5003,
    speed: Speed = 1.0,
) -> None:
    """Run three simulated lifts and a manager, with nothing to configure."""
    log_to_stderr()
    try:
        sock = listen("127.0.0.1", port)
    except ListenError as error:
        raise fail(str(error)) from error
    if not run(run_demo(sock, speed=speed, console=out)):
        raise typer.Exit(1)


@app.command()
def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="A site file or a register map.")]) -> None:
    """Find every mistake in a site file or a register map; exits 2 if there is one."""
    try:
        say(check_file(file))
    except MapFileError as error:
        raise refused(error) from error


@app.command()
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
