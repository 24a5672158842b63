"""Polls that repeat the one before: they end in the answer's own callback, and wake no task."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import pytest

from drivers.driver import OnAnswer
from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link
from drivers.modbus.memory import MemoryDevice, silence
from drivers.model import LiftReading
from lift_manager.lift.state import Quality
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Table
from tests.drivers.linked import virtual
from tests.support.lift_configs import front_door_config
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse

POLL_S, ANSWER_S = 0.2, 0.02
FLOORS = {"L1": 0, "L2": 1}
CAR_AT_L2 = 2
"""The discrete input that says so."""


class Lift(ModbusLift):
    """Counts what needs a task, and fails on demand."""

    reads = 0
    bug: Exception | None = None

    async def read(self) -> LiftReading:
        self.reads += 1
        return await super().read()

    def begin_read(self, on_answer: OnAnswer) -> bool:
        if self.bug is not None:
            raise self.bug
        return super().begin_read(on_answer)


class Actor(LiftActor):
    """Fails on demand."""

    bug: Exception | None = None

    def take_repetition(self, reading: LiftReading, now: float) -> bool:
        if self.bug is not None:
            raise self.bug
        return super().take_repetition(reading, now)


@dataclass
class Made:
    device: MemoryDevice
    lift: Lift
    actor: Actor
    poll: LiftPoll
    running: asyncio.Future[None]


@asynccontextmanager
async def polled() -> AsyncIterator[Made]:
    """A lift that is polled five times a second, and has been for two seconds."""
    device = MemoryDevice(delay_s=ANSWER_S)
    device.values[Table.DISCRETE].update({1: 1, 2: 1, 4: 1})
    link = Link(device.wire, name="plc")
    lift = Lift(compiled("two-stop-agv"), link, LiftSettings(name="lift", floors=FLOORS, control=False))
    config = front_door_config(lift, FLOORS, poll_s=POLL_S, control=False)
    bus: Bus[Event] = Bus()
    actor = Actor(lift, config, bus, MemoryRecorder())
    poll = LiftPoll(actor)
    connected = asyncio.ensure_future(link.run())
    running = asyncio.ensure_future(poll.run())
    await elapse(2.0)
    try:
        yield Made(device, lift, actor, poll, running)
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError, ArithmeticError):
            await running
        await link.close()
        await connected


@virtual
async def test_polls_without_news_are_counted_and_keep_the_lift_young_without_a_task() -> None:
    async with polled() as made:
        reads, polls = made.lift.reads, made.poll.polls
        for _ in range(100):
            await elapse(0.1)
            age_s = made.actor.state().age_s
            assert age_s is not None
            assert age_s <= POLL_S + 2 * ANSWER_S
        assert made.lift.reads == reads
        assert made.poll.polls - polls == pytest.approx(50, abs=1)


@virtual
async def test_one_poll_with_news_needs_the_task_and_the_next_does_not() -> None:
    async with polled() as made:
        reads, received = made.lift.reads, len(made.device.received)
        before = made.actor.record
        made.device.values[Table.DISCRETE][CAR_AT_L2] = 0
        await elapse(10.0)
        assert made.actor.record is not before
        assert made.lift.reads == reads + 1
        assert len(made.device.received) - received == pytest.approx(50, abs=1)


@virtual
async def test_a_poll_that_fails_is_followed_by_one_that_heals() -> None:
    async with polled() as made:
        made.device.fail_next(silence())
        await elapse(0.6)
        assert made.actor.record.fault
        await elapse(0.6)
        assert not made.actor.record.fault
        assert made.actor.state().quality is not Quality.OFFLINE


@pytest.mark.parametrize("where", ["lift", "actor"])
def test_a_bug_is_raised_by_the_task_of_the_poll(where: str) -> None:
    @virtual
    async def check() -> None:
        async with polled() as made:
            broken = made.lift if where == "lift" else made.actor
            broken.bug = ZeroDivisionError("a bug")
            await elapse(0.5)
            assert made.running.done()
            with pytest.raises(ZeroDivisionError):
                await made.running

    check()


@virtual
async def test_an_answer_after_the_end_of_the_polls_changes_nothing() -> None:
    async with polled() as made:
        received = len(made.device.received)
        while len(made.device.received) == received:
            await elapse(0.005)
        polls, read_at = made.poll.polls, made.actor.moment.read_at
        made.running.cancel()
        await elapse(5.0)
        assert (made.poll.polls, made.actor.moment.read_at) == (polls, read_at)
        assert len(made.device.received) == received + 1
