"""A controller that is not there: the driver's own link, lines and writer at a device in memory that writes down what it hears."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply
from drivers.modbus.plan import plan_poll
from drivers.modbus.steps import Step
from drivers.modbus.units import Unit, Units
from drivers.modbus.writer import Writer
from register_maps import frames
from register_maps.codec import Block, Cell, Codec
from register_maps.frames import Request


@dataclass(frozen=True, slots=True)
class ReceivedRequest:
    """One request as it reached a device."""

    endpoint: str
    """Name of the second device; empty for the controller itself."""
    body: bytes
    """The frame after its transaction id."""
    request: Request


class Bench:
    """What a lift of this map would send, one occasion at a time."""

    def __init__(self, codec: Codec, lines: Units, heard: list[ReceivedRequest]) -> None:
        """`heard` is what the devices at the end of `lines` add to."""
        link = codec.map.link
        settings = LiftSettings(
            name=codec.map.name,
            floors={},
            control=True,
            max_registers_per_read=link.max_registers_per_read,
            max_bits_per_read=link.max_bits_per_read,
        )
        self.poll_blocks = plan_poll(codec, max_registers=link.max_registers_per_read, max_bits=link.max_bits_per_read)
        self._lines = lines
        self._writer = Writer(codec, codec.commands, lines, settings)
        self._heard = heard
        self._devices = ("", *codec.map.endpoints)

    @property
    def output_blocks(self) -> tuple[Block, ...]:
        """What is read to see what all outputs hold."""
        return tuple(self._writer.read_blocks(self._devices))

    async def read(self, block: Block) -> list[ReceivedRequest]:
        """Read a block."""
        await self._lines.cells([block])
        return self._taken()

    async def write(self, step: Step, cells: Mapping[Cell, int]) -> list[ReceivedRequest]:
        """Carry out the write of a step, with the read before it where the map asks for one."""
        async for _ in self._writer.write(step, cells, _allowed):
            pass
        return self._taken()

    async def look(self, step: Step) -> tuple[bool, list[ReceivedRequest]]:
        """Look afterwards; returns whether the driver cares, and what it read."""
        looked = await self._writer.read_back(step) is not None
        return looked, self._taken()

    def _taken(self) -> list[ReceivedRequest]:
        heard = self._heard.copy()
        self._heard.clear()
        return heard


@asynccontextmanager
async def bench(codec: Codec) -> AsyncIterator[Bench]:
    """Set up one device in memory for the controller and one for each further device of the map."""
    heard: list[ReceivedRequest] = []
    units = {"": codec.map.link.unit_id, **{name: part.unit_id for name, part in codec.map.endpoints.items()}}
    lines = {name: Unit(_link(name, unit, heard), unit) for name, unit in units.items()}
    running = [asyncio.ensure_future(line.link.run()) for line in lines.values()]
    try:
        for line in lines.values():
            await line.link.wait_up()
        controller = lines.pop("")
        yield Bench(codec, Units(controller, lines), heard)
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)


def _link(endpoint: str, unit: int, heard: list[ReceivedRequest]) -> Link:
    answer = _written_down(endpoint, MemoryDevice(unit=unit, timed_coils=True), heard)
    return Link(lambda: MemoryWire(answer), name=endpoint or "controller")


def _written_down(endpoint: str, device: MemoryDevice, heard: list[ReceivedRequest]) -> Callable[[bytes], list[Reply]]:
    def answer(frame: bytes) -> list[Reply]:
        heard.append(ReceivedRequest(endpoint, frame[2:], frames.parse_request(frame, timed_coils=True)))
        return device.answer(frame)

    return answer


def _allowed() -> None:
    """Nothing is refused here: a plan shows what is sent where everything that the map requires is given."""
    return
