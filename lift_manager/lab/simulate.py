"""One simulated lift that any Modbus tool can read and command."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from rich.console import Console
from rich.table import Table as Grid

from lift_manager.app import stop_on_signals
from lift_manager.lab.plant import default_floors, simulated_lift
from register_maps.codec import Codec, CommandCodec, compile_map
from register_maps.schema import RegisterMap
from register_maps.words import Table
from simulator.registers import WATCHDOG_REFRESHES
from simulator.server import SimulatedController

_MBPOLL_TYPE = {Table.COIL: 0, Table.DISCRETE: 1, Table.INPUT: 3, Table.HOLDING: 4}
"""mbpoll's -t option."""


async def run_simulation(
    source: RegisterMap, *, host: str, port: int, floors: Mapping[str, int] | None, speed: float, console: Console
) -> None:
    """Serve one lift until SIGTERM or Ctrl-C. Raises OSError for a port that is taken, ValueError for a floor that does not fit."""
    stop = asyncio.Event()
    stop_on_signals(stop)
    codec = compile_map(source)
    named = dict(floors) if floors else default_floors(source)
    controller = SimulatedController(
        {source.link.unit_id: simulated_lift(codec, named, speed=speed)}, host=host, port=port
    )
    await controller.start()
    try:
        _describe(console, codec, named, f"{host}:{controller.port}")
        await stop.wait()
    finally:
        await controller.stop()


def _describe(console: Console, codec: Codec, floors: Mapping[str, int], where: str) -> None:
    source = codec.map
    grid = Grid(title=f"{source.title}\n{where}, unit {source.link.unit_id}", title_justify="left")
    for heading in ("name", "as printed", "on the wire", "values"):
        grid.add_column(heading)
    for name, signal in codec.signals.items():
        wire = ", ".join(f"{p.table} {p.address}" + ("" if p.whole else f".{p.low}") for p in signal.points)
        values = source.signals[name].values
        text = ", ".join(f"{code} {word}" for code, word in values.items()) if values else source.signals[name].note
        grid.add_row(name, ", ".join(source.signals[name].addresses), wire, text)
    grid.add_section()
    for name, command in codec.commands.items():
        wire = ", ".join(f"{p.table} {p.address}" for p in command.points)
        grid.add_row(f"[bold]{name}[/bold]", ", ".join(command.spec.addresses), wire, command.spec.note)
    console.print(grid)
    console.print("Floors: " + ", ".join(f"{name} = {code}" for name, code in floors.items()))
    for line in _try_it(codec, where):
        console.print(line, highlight=False, soft_wrap=True)
    console.print("Ctrl-C ends it.")


def _try_it(codec: Codec, where: str) -> list[str]:
    """Return a first line for mbpoll, and one for every command that is a single register or coil."""
    host, _, port = where.rpartition(":")
    tool = f"mbpoll -m tcp -a {codec.map.link.unit_id} -p {port} -0"
    lines = ["", "Read what it says, or give a command, with any Modbus tool; with mbpoll for example:"]
    for table in dict.fromkeys(point.table for point in codec.signal_points):
        addresses = [point.address for point in codec.signal_points if point.table is table]
        count = max(addresses) - min(addresses) + 1
        lines.append(f"  {tool} -1 -t {_MBPOLL_TYPE[table]} -r {min(addresses)} -c {count} {host}")
    for name, command in codec.commands.items():
        if len(command.points) == 1:
            point = command.points[0]
            value = "FLOOR" if command.is_call else command.spec.on
            line = f"  {tool} -t {_MBPOLL_TYPE[point.table]} -r {point.address} {host} {value}"
            lines.append(f"{line}   # {name}{_conditions(command)}")
    return lines


def _conditions(command: CommandCodec) -> str:
    spec = command.spec
    needs = f", only while {' and '.join(spec.requires)} is on" if spec.requires else ""
    falls = spec.on_link_loss == "device_watchdog" and spec.refresh_s is not None
    return needs + (f", falls {WATCHDOG_REFRESHES * (spec.refresh_s or 0):g} s after the last write" if falls else "")
