"""The command line: parses words and calls lab, app, config or commissioning."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from socket import socket
from typing import Annotated, Any, TypeVar

import typer

from drivers.errors import ControllerTaken
from lift_manager import app as running
from lift_manager.cli import maps, operate, scenario
from lift_manager.cli.common import (
    Floors,
    MapName,
    SiteFile,
    fail,
    loaded_map,
    loaded_site,
    out,
    read_floors,
    refused,
    say,
)
from lift_manager.config.load import LoadedSite, check_file
from lift_manager.lab.demo import run_demo
from lift_manager.lab.simulate import run_simulation
from lift_manager.store.errors import StateUnusable
from lift_manager.store.place import state_path
from lift_manager.store.state_file import StateFile, opened
from lift_manager.web.errors import ListenError
from lift_manager.web.server import listen
from register_maps.errors import MapFileError

try:
    import uvloop
except ImportError:  # there is none for Windows; asyncio's own loop serves as well, with twice the work per poll
    _new_loop: Callable[[], asyncio.AbstractEventLoop] | None = None
else:
    _new_loop = uvloop.new_event_loop

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Connect robots to real lifts over Modbus/TCP.",
)
app.add_typer(maps.app, name="maps")
app.add_typer(scenario.app, name="scenario")
app.command()(operate.ack)
app.command()(operate.lockout)

T = TypeVar("T")

Speed = Annotated[
    float, typer.Option(min=0.1, max=100, help="How much faster than real the simulated car and doors move.")
]


@app.command()
def demo(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the manager; 0 takes any free one.")] = 5003,
    speed: Speed = 1.0,
) -> None:
    """Run three simulated lifts and a manager, with nothing to configure."""
    _log_to_stderr()
    try:
        sock = listen("127.0.0.1", port)
    except ListenError as error:
        raise fail(str(error)) from error
    if not _run(run_demo(sock, speed=speed, console=out)):
        raise typer.Exit(1)


@app.command()
def serve(
    site: SiteFile,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Listen here instead of the site file's port.")
    ] = None,
) -> None:
    """Run the lift manager for a site."""
    _log_to_stderr()
    loaded = loaded_site(site)
    for line in loaded.cautions():
        logging.getLogger("lift_manager").warning("%s", line)
    api = loaded.site.api
    memory = _state(loaded)
    try:
        sock = listen(api.host, api.port if port is None else port)
    except ListenError as error:
        raise fail(str(error)) from error
    try:
        released = _run(_serve(loaded, sock, memory))
    except* ControllerTaken as group:
        raise fail(str(group.exceptions[0])) from group
    if not released:
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
        _run(run_simulation(source, host=host, port=port, floors=read_floors(floors), speed=speed, console=out))
    except ValueError as error:
        raise fail(str(error)) from error
    except OSError as error:
        advice = "give an address of this machine with --host, or another port with --port"
        raise fail(f"cannot listen on {host}:{port}: {error.strerror or error}; {advice}") from error


def _state(loaded: LoadedSite) -> StateFile:
    """Open what outlived the last manager of this site, or say why that cannot be relied on and exit with 1."""
    site = loaded.site
    try:
        return opened(state_path(site.name, site.state, loaded.path, os.environ), site.name, site.lifts.keys())
    except StateUnusable as error:
        raise fail(str(error)) from error


async def _serve(loaded: LoadedSite, sock: socket, memory: StateFile) -> bool:
    stop = asyncio.Event()
    running.stop_on_signals(stop)
    host, port = sock.getsockname()[:2]

    def ready() -> None:
        out.print(f"{loaded.site.name}: {len(loaded.site.lifts)} lift(s) on http://{host}:{port}/docs", highlight=False)

    return await running.run(loaded, sock, stop=stop, ready=ready, memory=memory)


def _run(main: Coroutine[Any, Any, T]) -> T:
    with asyncio.Runner(loop_factory=_new_loop) as runner:
        return runner.run(main)


def _log_to_stderr() -> None:
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S"
    )
    logging.getLogger("pymodbus").setLevel(logging.ERROR)
