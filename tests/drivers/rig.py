"""A lift on devices in memory, polled every 0.2 s, for tests of what it writes."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from drivers.errors import DriverError
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice
from drivers.modbus.units import Unit
from drivers.model import Command, CommandKind, LiftReading
from register_maps.codec import Codec
from register_maps.words import Side, Table
from tests.drivers.by_hand import LogByHand
from tests.drivers.caller import Caller
from tests.support.virtual_time import elapse, run_virtual
from tests.support.written_maps import HEAD, written_map

HOLD_FRONT = Command(CommandKind.HOLD_DOOR, side=Side.FRONT)
CLOSE_FRONT = Command(CommandKind.CLOSE_DOOR, side=Side.FRONT)
HOLD = "action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}"
SIGNALS = 'signals: {car_floor: {at: "input:1", as: floor, unknown: [0]}, door.front: {at: "discrete:1"}}\n'


def allowed() -> None:
    return None


@dataclass
class Rig:
    """A lift, its devices in memory, and a poll every 0.2 s."""

    lift: Caller
    devices: Mapping[str, MemoryDevice]
    links: Mapping[str, Link]
    readings: list[LiftReading] = field(default_factory=list)
    errors: list[DriverError] = field(default_factory=list)

    @property
    def device(self) -> MemoryDevice:
        return self.devices[""]

    def writes(self, endpoint: str = "") -> list[str]:
        return [str(request) for request in self.devices[endpoint].writes]

    def cells(self, table: Table, *addresses: int) -> list[int]:
        return [self.device.values[table].get(address, 0) for address in addresses]


@asynccontextmanager
async def rig(
    codec: Codec,
    devices: Mapping[str, MemoryDevice] | None = None,
    floors: Mapping[str, int] | None = None,
    log: LogByHand | None = None,
    first: Callable[[Caller], None] | None = None,
) -> AsyncIterator[Rig]:
    """`first` is called with the lift before anything runs."""
    made_of = {"": MemoryDevice(timed_coils=True)} if devices is None else devices
    made_of[""].values[Table.INPUT].setdefault(1, 1)
    links = {name: Link(device.wire, LinkSettings(), name=name or "plc") for name, device in made_of.items()}
    settings = LiftSettings(
        name="lift", floors=floors or {"L1": 1, "L2": 2}, control=True, unit_id=codec.map.link.unit_id
    )
    lines = {name: Unit(link, 1) for name, link in links.items() if name}
    made = Rig(Caller(ModbusLift(codec, links[""], settings, lines), log), made_of, links)
    if first is not None:
        first(made.lift)

    async def poll() -> None:
        while True:
            try:
                made.readings.append(await made.lift.read())
            except DriverError as error:
                made.errors.append(error)
            await elapse(0.2)

    work = (*(link.run() for link in links.values()), made.lift.run(), poll())
    running = [asyncio.ensure_future(part) for part in work]
    await elapse(1.0)
    try:
        yield made
    finally:
        await ended(running)


async def ended(running: Sequence[asyncio.Future[None]]) -> None:
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)


def on_rig(
    check: Callable[[Rig], Awaitable[None]],
    text: str,
    devices: Mapping[str, MemoryDevice] | None = None,
    head: str = HEAD,
    log: LogByHand | None = None,
    first: Callable[[Caller], None] | None = None,
    floors: Mapping[str, int] | None = None,
) -> None:
    async def main() -> None:
        async with rig(written_map(text, head), devices, floors, log=log, first=first) as made:
            await check(made)

    run_virtual(main, limit_s=600)
