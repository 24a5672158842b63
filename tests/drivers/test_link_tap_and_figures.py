"""Who looks at a link hears every frame, and finds what it counts."""

import asyncio
from contextlib import ExitStack

import pytest

from drivers.modbus.histogram import BOUNDS_S, Histogram
from drivers.modbus.link import LinkSettings
from drivers.modbus.memory import MemoryDevice, MemoryWire, exception, late, silence
from drivers.modbus.wire import OnBytes
from register_maps import frames
from register_maps.words import Table
from tests.drivers.linked import linked, now, outcome, virtual
from tests.support.virtual_time import elapse

READ = frames.read(Table.HOLDING, 0)
PRESS = frames.write_coil(9, True)
ANSWER = frames.answer(READ, 1, b"\0\0")


def counted(histogram: Histogram) -> int:
    return sum(histogram.counts)


@virtual
async def test_each_listener_hears_what_leaves_and_what_comes_once_and_in_order() -> None:
    heard: list[list[tuple[bool, bytes]]] = [[], []]
    async with linked(MemoryDevice()) as link:
        with link.tap(lambda sent, frame: heard[0].append((sent, frame))):
            await link.read(READ)
            with link.tap(lambda sent, frame: heard[1].append((sent, frame))):
                await link.write(PRESS)
            await link.read(READ)
        await link.read(READ)
    told = [
        (True, frames.frame(READ, 1)),
        (False, frames.answer(READ, 1, b"\0\0")),
        (True, frames.frame(PRESS, 2)),
        (False, frames.answer(PRESS, 2)),
        (True, frames.frame(READ, 3)),
        (False, frames.answer(READ, 3, b"\0\0")),
    ]
    assert heard == [told, told[2:4]]


@virtual
async def test_a_listener_hears_late_and_foreign_answers_and_the_next_connection_as_well() -> None:
    device, came = MemoryDevice(), list[bytes]()
    stray = frames.answer(READ, 999, b"\0\0")
    async with linked(device) as link:
        with link.tap(lambda sent, frame: None if sent else came.append(frame)):
            device.fail_next(late(0.6))
            await outcome(link.read(READ))
            await elapse(0.5)
            assert came == [ANSWER]
            device.send_unrequested(stray)
            assert came[1:] == [stray]
            assert await link.wait_up() == 2
            await link.read(READ)
            assert len(came) == 3


class Kept(MemoryDevice):
    """Remembers its wires; `hears` listens to each of them before the link does."""

    def __init__(self, hears: OnBytes | None = None) -> None:
        super().__init__()
        self.wires: list[MemoryWire] = []
        self._hears = hears

    def wire(self) -> MemoryWire:
        made = super().wire()
        made.on_bytes = self._hears
        self.wires.append(made)
        return made


@virtual
async def test_while_nobody_listens_the_wire_tells_nobody() -> None:
    device = Kept()
    async with linked(device) as link:
        with link.tap(lambda _sent, _frame: None):
            assert device.wires[-1].on_bytes is not None
        assert device.wires[-1].on_bytes is None


@virtual
async def test_whoever_listened_to_a_wire_before_hears_it_beside_a_listener_of_the_link() -> None:
    own, tapped = list[bytes](), list[bytes]()
    async with linked(Kept(lambda _sent, frame: own.append(frame))) as link:
        with link.tap(lambda _sent, frame: tapped.append(frame)):
            await link.read(READ)
        await link.read(READ)
    assert own[:2] == tapped
    assert len(own) == 4


@virtual
async def test_every_answer_is_counted_by_how_long_it_took_exceptions_and_late_ones_included() -> None:
    device = MemoryDevice(delay_s=0.02)
    async with linked(device) as link:
        for _ in range(7):
            await link.read(READ)
        device.fail_next(exception(2))
        await outcome(link.read(READ))
        device.fail_next(late(0.7))
        await outcome(link.read(READ))
        await elapse(0.5)
        device.fail_next(silence())
        await outcome(link.read(READ))
        trips = link.stats.round_trips
        assert link.stats.transactions == counted(trips) + 1
        assert trips.counts[BOUNDS_S.index(0.025)] == 8
        assert trips.counts[BOUNDS_S.index(1.0)] == 1
        assert trips.total_s == pytest.approx(8 * 0.02 + 0.72)


@virtual
async def test_a_duration_on_a_bound_is_in_its_range_and_a_longer_one_beyond_the_last() -> None:
    histogram = Histogram()
    for took_s in (0.0, BOUNDS_S[0], BOUNDS_S[-1], 3.0):
        histogram.add(took_s)
    assert histogram.counts == [2, *[0] * (len(BOUNDS_S) - 2), 1, 1]


@virtual
async def test_each_request_is_counted_in_its_lane_by_how_long_it_waited_for_its_turn() -> None:
    async with linked(MemoryDevice(delay_s=0.02)) as link, asyncio.TaskGroup() as group:
        for _ in range(3):
            group.create_task(link.read(READ))
        await elapse(0.01)
        assert (link.in_flight, link.waiting) == (True, (2, 0))
        group.create_task(link.write(PRESS))
        await elapse(0.0)
        assert link.waiting == (2, 1)
        await elapse(0.2)
        assert (link.in_flight, link.waiting) == (False, (0, 0))
        reads, commands = link.stats.read_waits, link.stats.command_waits
        assert (counted(reads), counted(commands)) == (3, 1)
        assert reads.counts[0] == 1
        assert reads.total_s == pytest.approx(0.04 + 0.06)
        assert commands.total_s == pytest.approx(0.01)


@virtual
async def test_a_read_that_was_answered_with_busy_waits_again_and_one_behind_it_too() -> None:
    device = MemoryDevice()
    async with linked(device, LinkSettings(busy_pause_s=0.05)) as link, asyncio.TaskGroup() as group:
        device.fail_next(exception(6))
        group.create_task(link.read(READ))
        await elapse(0.01)
        group.create_task(link.read(READ))
        await elapse(0.2)
        waits = link.stats.read_waits
        assert counted(waits) == 3
        assert waits.total_s == pytest.approx(0.05 + 0.04, abs=0.001)


@virtual
async def test_the_newest_answer_is_told_and_silence_is_none() -> None:
    device = MemoryDevice()
    async with linked(device) as link:
        assert link.stats.answered_at is None
        await link.read(READ)
        answered_at = now()
        assert link.stats.answered_at == pytest.approx(answered_at)
        await elapse(3.0)
        device.fail_next(silence())
        await outcome(link.read(READ))
        assert link.stats.answered_at == pytest.approx(answered_at)


@virtual
async def test_a_listener_that_goes_leaves_the_others() -> None:
    heard: list[bytes] = []

    def hear(_sent: bool, frame: bytes) -> None:
        heard.append(frame)

    async with linked(MemoryDevice()) as link:
        with ExitStack() as first, link.tap(hear):
            first.enter_context(link.tap(hear))
            first.close()
            await link.read(READ)
    assert len(heard) == 2
