"""One simulated lift that any Modbus tool can read and command."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from rich.console import Console
from rich.table import Table as Grid

from lift_manager.app import stop_on_signals
from lift_manager.lab.plant import default_floors, simulated_lift
from register_maps.codec import Codec, compile_map
from register_maps.schema import RegisterMap
from simulator.server import SimulatedController


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
    console.print("Ctrl-C ends it.")
