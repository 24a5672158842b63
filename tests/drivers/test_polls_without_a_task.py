"""A poll that is begun without a task: what its answer gives at once, and what is left to `read`."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest

from drivers.errors import AnswerTimeout, ConnectionLost, ControllerException, HeartbeatStopped
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryDevice, exception, hang_up, silence
from drivers.model import LiftReading
from register_maps import frames
from register_maps.codec import Codec
from register_maps.words import Table
from tests.drivers.linked import now, virtual
from tests.drivers.rig import SIGNALS
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse
from tests.support.written_maps import written_map

ANSWER_S = 0.01
ALIVE, FLOOR = 0, 1


@dataclass
class Made:
    """A lift that was read once, and whose alive counter counts while it is read."""

    device: MemoryDevice
    link: Link
    lift: ModbusLift
    first: LiftReading
    answers: list[LiftReading | None] = field(default_factory=list)

    def set(self, address: int, value: int) -> None:
        self.device.values[Table.HOLDING][address] = value

    @property
    def requests(self) -> int:
        return len(self.device.received)

    async def begin(self, wait_s: float = 2 * ANSWER_S) -> None:
        assert self.lift.begin_read(self.answers.append)
        await elapse(wait_s)


@asynccontextmanager
async def read_once(codec: Codec | None = None, settings: LinkSettings | None = None) -> AsyncIterator[Made]:
    codec = codec or compiled("generic-registers")
    device = MemoryDevice(delay_s=ANSWER_S)
    device.values[Table.HOLDING].update({1: 1, 2: 1, 3: 1, 4: 1, 5: 0b101})
    link = Link(device.wire, settings, name="plc")
    lift = ModbusLift(codec, link, LiftSettings(name="lift", floors={"L1": 1, "L2": 2}, control=False))
    running = asyncio.ensure_future(link.run())
    await link.wait_up()
    if "alive" in codec.signals:
        with pytest.raises(HeartbeatStopped):  # its counter has to change first
            await lift.read()
        device.values[Table.HOLDING][ALIVE] = 1
    try:
        yield Made(device, link, lift, await lift.read())
    finally:
        await link.close()
        await running


@virtual
async def test_a_poll_that_repeats_the_one_before_is_given_at_once() -> None:
    async with read_once() as made:
        await elapse(0.5)
        began = now()
        await made.begin()
        assert made.answers == [made.first._replace(at=began)]
        assert made.answers[0] is not None
        assert made.answers[0].values is made.first.values


@virtual
async def test_a_counter_that_counts_repeats_the_poll_before_and_keeps_the_lift_live() -> None:
    async with read_once() as made:
        for count in range(2, 12):
            made.set(ALIVE, count)
            await made.begin(1.0)
        assert all(reading is not None and reading.values is made.first.values for reading in made.answers)
        (alive,) = [signal for signal in made.lift.signals(now()) if signal.name == "alive"]
        assert alive.raw == 11


@virtual
async def test_a_counter_that_stands_still_for_too_long_is_left_to_read() -> None:
    async with read_once() as made:
        await elapse(3.1)
        await made.begin()
        assert made.answers == [None]
        with pytest.raises(HeartbeatStopped):
            await made.lift.read()


@virtual
async def test_news_is_left_to_read_which_requests_nothing_more() -> None:
    async with read_once() as made:
        made.set(FLOOR, 2)
        began, before = now(), made.requests
        await made.begin()
        assert made.answers == [None]
        reading = await made.lift.read()
        assert (reading.values.floor, reading.at, made.requests) == ("L2", began, before + 1)
        await made.begin()
        assert made.answers[-1] is not None


@virtual
async def test_an_answer_is_taken_by_one_read_alone() -> None:
    async with read_once() as made:
        made.set(FLOOR, 2)
        await made.begin()
        await made.lift.read()
        before = made.requests
        assert (await made.lift.read()).at == pytest.approx(now() - ANSWER_S)
        assert made.requests == before + 1


@virtual
async def test_news_that_nobody_took_is_dropped_by_the_next_poll() -> None:
    async with read_once() as made:
        made.set(FLOOR, 2)
        await made.begin()
        made.set(FLOOR, 1)
        await made.begin()
        assert made.answers[-1] is not None
        before = made.requests
        assert (await made.lift.read()).values.floor == "L1"
        assert made.requests == before + 1


@virtual
async def test_a_poll_that_is_not_answered_in_time_fails_in_read() -> None:
    async with read_once() as made:
        made.device.fail_next(silence())
        before = made.requests
        await made.begin(1.0)
        assert made.answers == [None]
        with pytest.raises(AnswerTimeout):
            await made.lift.read()
        assert (made.requests, made.link.stats.timeouts) == (before + 1, 1)


@virtual
async def test_an_exception_is_explained_by_read() -> None:
    async with read_once() as made:
        made.device.fail_next(exception(4))
        await made.begin()
        assert made.answers == [None]
        with pytest.raises(ControllerException):
            await made.lift.read()


@virtual
async def test_a_poll_that_is_answered_with_busy_is_repeated_as_any_other() -> None:
    async with read_once() as made:
        made.device.fail_next(exception(6), times=2)
        await made.begin(0.5)
        assert [reading is not None for reading in made.answers] == [True]


@virtual
async def test_a_poll_whose_connection_ends_fails_in_read() -> None:
    async with read_once() as made:
        made.device.fail_next(hang_up())
        await made.begin()
        assert made.answers == [None]
        with pytest.raises(ConnectionLost):
            await made.lift.read()


@virtual
async def test_an_answer_of_an_earlier_connection_counts_no_more() -> None:
    async with read_once() as made:
        made.set(FLOOR, 2)
        await made.begin()
        made.device.disconnect()
        await elapse(1.0)
        with pytest.raises(ConnectionLost):
            await made.lift.read()


@virtual
async def test_nothing_is_begun_over_a_connection_that_was_not_read() -> None:
    async with read_once() as made:
        made.device.disconnect()
        assert not made.lift.begin_read(made.answers.append)
        await elapse(1.0)
        assert not made.lift.begin_read(made.answers.append)
        with pytest.raises(HeartbeatStopped):
            await made.lift.read()
        assert made.lift.begin_read(made.answers.append)


@virtual
async def test_nothing_is_begun_while_another_request_is_in_flight_or_has_just_ended() -> None:
    async with read_once(settings=LinkSettings(min_gap_s=0.1)) as made:
        await elapse(0.2)
        other = asyncio.ensure_future(made.link.read(frames.read(Table.HOLDING, 20)))
        for wait_s in (0.0, 2 * ANSWER_S):
            await elapse(wait_s)
            assert not made.lift.begin_read(made.answers.append)
        await other
        await elapse(0.1)
        assert made.lift.begin_read(made.answers.append)


@virtual
async def test_a_poll_of_several_blocks_is_not_begun() -> None:
    async with read_once(written_map(SIGNALS)) as made:
        before = made.requests
        await made.lift.read()
        assert made.requests == before + 2
        assert not made.lift.begin_read(made.answers.append)
