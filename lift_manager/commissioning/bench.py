"""Runs the link, units and writer of the driver against a device in memory that records what it receives."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice, MemoryWire, Reply
from drivers.modbus.read_plan import plan_poll
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
    """Name of a further device; empty for the controller itself."""
    body: bytes
    """The frame after its transaction id."""
    request: Request


class Bench:
    """Sends what a lift of this map would send, one step at a time, and returns the requests."""

    def __init__(self, codec: Codec, units: Units, received: list[ReceivedRequest]) -> None:
        """The devices of `units` append to `received`."""
        link = codec.map.link
        settings = LiftSettings(
            name=codec.map.name,
            floors={},
            control=True,
            max_registers_per_read=link.max_registers_per_read,
            max_bits_per_read=link.max_bits_per_read,
        )
        self.poll_blocks = plan_poll(codec, max_registers=link.max_registers_per_read, max_bits=link.max_bits_per_read)
        self._units = units
        self._writer = Writer(codec, codec.commands, units, settings)
        self._received = received
        self._devices = ("", *codec.map.endpoints)

    @property
    def output_blocks(self) -> tuple[Block, ...]:
        """The blocks to read for the state of all outputs."""
        return tuple(self._writer.read_blocks(self._devices))

    async def read(self, block: Block) -> list[ReceivedRequest]:
        """Read a block."""
        await self._units.cells([block])
        return self._take_received()

    async def write(self, step: Step, cells: Mapping[Cell, int]) -> list[ReceivedRequest]:
        """Carry out the write of a step, with the read before it if the map needs one."""
        await self._writer.write(step, cells, _allow_all, _ignore)
        return self._take_received()

    async def read_back(self, step: Step) -> tuple[bool, list[ReceivedRequest]]:
        """Read back after a step; returns whether the driver needs that, and the requests."""
        is_read_back = await self._writer.read_back(step) is not None
        return is_read_back, self._take_received()

    def _take_received(self) -> list[ReceivedRequest]:
        received = self._received.copy()
        self._received.clear()
        return received


@asynccontextmanager
async def open_bench(codec: Codec) -> AsyncIterator[Bench]:
    """Set up one device in memory for the controller and one for each further device of the map."""
    received: list[ReceivedRequest] = []
    unit_ids = {"": codec.map.link.unit_id, **{name: part.unit_id for name, part in codec.map.endpoints.items()}}
    units = {name: Unit(_link(name, unit_id, received), unit_id) for name, unit_id in unit_ids.items()}
    running = [asyncio.ensure_future(unit.link.run()) for unit in units.values()]
    try:
        for unit in units.values():
            await unit.link.wait_up()
        controller = units.pop("")
        yield Bench(codec, Units(controller, units), received)
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)


def _link(endpoint: str, unit: int, received: list[ReceivedRequest]) -> Link:
    answer = _recording_device(endpoint, MemoryDevice(unit=unit, timed_coils=True), received)
    return Link(lambda: MemoryWire(answer), name=endpoint or "controller")


def _recording_device(
    endpoint: str, device: MemoryDevice, received: list[ReceivedRequest]
) -> Callable[[bytes], list[Reply]]:
    def answer(frame: bytes) -> list[Reply]:
        received.append(ReceivedRequest(endpoint, frame[2:], frames.parse_request(frame, timed_coils=True)))
        return device.answer(frame)

    return answer


def _ignore(_: Request) -> None:
    """Ignore an answer: what counts is what the device has received."""


def _allow_all() -> None:
    """Allow every write: a plan assumes that all conditions of the map are met."""
    return
