"""Serves one simulated lift, or the recording of a real one, to any Modbus tool."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import AsyncExitStack
from socket import socket

from rich.console import Console
from rich.table import Table as Grid

from lift_manager.commissioning.trace.recording import Recording
from lift_manager.lab import tryout
from lift_manager.lab.panel.app import panel_on
from lift_manager.lab.panel.lift import PanelLift
from lift_manager.lab.panel.registers import wire_text
from lift_manager.lab.plant import blind_spots, default_floors
from lift_manager.lab.replay import Replay, serve_replay
from lift_manager.plain.signals import stop_on_signals
from register_maps.codec import Codec, compile_map
from register_maps.schema import LinkDefaults, RegisterMap


async def run_simulation(
    source: RegisterMap,
    *,
    host: str,
    port: int,
    floors: Mapping[str, int] | None,
    speed: float,
    console: Console,
    panel: socket | None = None,
) -> None:
    """Serve one lift until SIGTERM or Ctrl-C, with a panel on a listening socket if there is one.

    Raises OSError for a port in use, and ValueError for a floor that the map cannot express.
    """
    stop = asyncio.Event()
    stop_on_signals(stop)
    codec = compile_map(source)
    named = dict(floors) if floors else default_floors(source)
    async with AsyncExitStack() as stack:
        lift = PanelLift(source.name, codec, named, speed=speed)
        ports = await stack.enter_async_context(lift.running(host=host, port=port))
        address = None if panel is None else await stack.enter_async_context(panel_on(panel, [lift]))
        _describe(console, codec, named, {name: f"{host}:{number}" for name, number in ports.items()})
        if address is not None:
            console.print(f"Press its buttons, turn its key, make faults: {address}", highlight=False, soft_wrap=True)
        console.print("Ctrl-C ends it.")
        await stop.wait()


async def run_replay(recording: Recording, *, host: str, port: int, loop: bool, console: Console) -> None:
    """Answer like a recorded controller until SIGTERM or Ctrl-C. Raises OSError for a port in use, and NothingRecorded."""
    stop = asyncio.Event()
    stop_on_signals(stop)

    def report(line: str) -> None:
        console.print(line, highlight=False, soft_wrap=True, markup=False)

    replay = Replay(recording, loop=loop, report=report)
    async with serve_replay(replay, host=host, port=port) as listening:
        at_end = "begins again" if loop else "repeats the last answers"
        report(f"{recording.header.link} of {recording.header.began:%Y-%m-%d %H:%M:%S %Z} on {host}:{listening}")
        report(f"It answers for {replay.lasts_s:.1f} s, from the first request on, and then {at_end}. Ctrl-C ends it.")
        await stop.wait()


def _describe(console: Console, codec: Codec, floors: Mapping[str, int], where: Mapping[str, str]) -> None:
    source = codec.map
    title = [source.title]
    for name, place in where.items():
        title.append(f"{name + ' on ' if name else ''}{place}, unit {source.unit_of(name)}")
    grid = Grid(title="\n".join(title), title_justify="left")
    for heading in ("name", "as printed", "on the wire", "values"):
        grid.add_column(heading)
    for name, signal in codec.signals.items():
        values = source.signals[name].values
        text = ", ".join(f"{code} {word}" for code, word in values.items()) if values else source.signals[name].note
        grid.add_row(name, ", ".join(source.signals[name].addresses), wire_text(signal.points), text)
    grid.add_section()
    for name, command in codec.commands.items():
        wire = wire_text(command.points)
        if command.read_points and command.read_points != command.points:
            wire += f"; read back at {wire_text(command.read_points)}"
        grid.add_row(f"[bold]{name}[/bold]", ", ".join(command.spec.addresses), wire, command.spec.note)
    console.print(grid)
    console.print("Floors: " + ", ".join(f"{name} = {code}" for name, code in floors.items()))
    if blind := blind_spots(codec):
        lift = f"There is a lift behind these registers, but they do not show {' or '.join(blind)}"
        console.print(f"{lift}: its outputs can be written and read back, but their effect cannot be seen.")
    for line in (*_limits(source.link), *tryout.lines(codec, floors, where)):
        console.print(line, highlight=False, soft_wrap=True, markup=False)


def _limits(link: LinkDefaults) -> Iterator[str]:
    """Yield what the controller demands of its clients."""
    if link.max_connections is not None:
        yield f"It serves {link.max_connections} client{'' if link.max_connections == 1 else 's'} at once: a further connection is reset (max_connections)."
    if link.min_gap_s:
        yield f"It loses a request that comes sooner than {link.min_gap_s:g} s after its last answer (min_gap_s)."
    if link.idle_timeout_s is not None:
        yield f"It closes a connection without a request for {link.idle_timeout_s:g} s (idle_timeout_s)."
