"""A socket that is dead but open: how soon the link knows, when it connects anew, and when the lift counts as offline."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.latency import SPARE_S
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings, LinkState
from drivers.modbus.memory import MemoryDevice
from drivers.model import Command, CommandKind, Result
from lift_manager.lift.state import Quality
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Table
from tests.drivers.caller import Caller
from tests.drivers.linked import now, virtual
from tests.support.lift_configs import front_door_config
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.virtual_time import elapse

POLL_S, ANSWER_S, MAX_AGE_S = 0.2, 0.02, 1.0
STEP_S = 0.01
"""How finely the test looks."""
FLOORS = {"L1": 0, "L2": 1}


@dataclass
class Made:
    device: MemoryDevice
    link: Link
    lift: ModbusLift
    actor: LiftActor

    async def until(self, true: Callable[[], bool]) -> float:
        """Wait for it; returns how long that took."""
        began = now()
        async with asyncio.timeout(60):
            while not true():
                await elapse(STEP_S)
        return now() - began

    @property
    def is_offline(self) -> bool:
        return self.actor.state().quality is Quality.OFFLINE


@asynccontextmanager
async def polled(settings: LinkSettings) -> AsyncIterator[Made]:
    """A lift that is polled five times a second by a controller that answers within 20 ms."""
    device = MemoryDevice(delay_s=ANSWER_S)
    device.values[Table.DISCRETE].update({1: 1, 2: 1, 4: 1})
    link = Link(device.wire, settings, name="plc")
    lift = ModbusLift(compiled("two-stop-agv"), link, LiftSettings(name="lift", floors=FLOORS, control=True))
    config = front_door_config(lift, FLOORS, poll_s=POLL_S)
    bus: Bus[Event] = Bus()
    actor = LiftActor(lift, config, bus, MemoryRecorder())
    running = [asyncio.ensure_future(part) for part in (link.run(), lift.run(), LiftPoll(actor).run())]
    try:
        yield Made(device, link, lift, actor)
    finally:
        for part in running:
            part.cancel()
        await asyncio.gather(*running, return_exceptions=True)


def vanishes(device: MemoryDevice) -> None:
    device.go_half_open()


def falls_silent(device: MemoryDevice) -> None:
    device.fall_silent(3600)


GOES = each_row("goes", [vanishes, falls_silent])
AT = each_row("after_s", [5.0, 5.01, 5.05, 5.1, 5.19])
"""Moments between two polls."""


@GOES
@AT
@virtual
async def test_the_link_knows_within_one_poll_and_one_time_out_and_presses_nothing(
    goes: Callable[[MemoryDevice], None], after_s: float
) -> None:
    async with polled(LinkSettings()) as made:
        await elapse(after_s)
        goes(made.device)
        took_s = await made.until(lambda: made.link.in_doubt)
        assert took_s <= POLL_S + ANSWER_S + SPARE_S + 2 * STEP_S
        assert made.link.reason == "the controller did not answer the last request"
        outcome = await Caller(made.lift).press(Command(CommandKind.GO_TO, "L2"), lambda: None)
        # at once, or with the connection where the next request was in flight already
        assert outcome.result is Result.REJECTED
        assert "did not answer the last request" in outcome.reason or "twice in a row" in outcome.reason
        assert [request for request in made.device.writes if any(request.values)] == []


@GOES
@AT
@virtual
async def test_a_second_silence_makes_a_new_connection(goes: Callable[[MemoryDevice], None], after_s: float) -> None:
    async with polled(LinkSettings()) as made:
        await elapse(after_s)
        goes(made.device)
        took_s = await made.until(lambda: made.link.state is LinkState.DOWN)
        # the second request is waited for twice as long as the first
        assert took_s <= 2 * POLL_S + 3 * (ANSWER_S + SPARE_S) + 2 * STEP_S
        assert "twice in a row" in made.link.reason
        assert await made.until(lambda: made.link.epoch == 2) == pytest.approx(0.2, abs=2 * STEP_S)


@GOES
@virtual
async def test_without_transaction_ids_the_first_silence_does(goes: Callable[[MemoryDevice], None]) -> None:
    async with polled(LinkSettings(tid_echo=False)) as made:
        await elapse(5)
        goes(made.device)
        took_s = await made.until(lambda: made.link.state is LinkState.DOWN)
        assert took_s <= POLL_S + ANSWER_S + 0.5 + 2 * STEP_S
        assert await made.until(lambda: made.link.epoch == 2) == pytest.approx(0.2, abs=2 * STEP_S)


@each_row("tid_echo", [True, False])
@AT
@virtual
async def test_a_silent_lift_is_offline_when_its_last_reading_is_too_old(after_s: float, tid_echo: bool) -> None:
    async with polled(LinkSettings(tid_echo=tid_echo)) as made:
        await elapse(after_s)
        assert not made.is_offline
        made.device.fall_silent(3600)
        assert await made.until(lambda: made.is_offline) <= MAX_AGE_S + STEP_S


@virtual
async def test_a_peer_that_vanished_without_a_word_is_read_again_over_a_new_connection() -> None:
    async with polled(LinkSettings()) as made:
        await elapse(5)
        made.device.go_half_open()
        await made.until(lambda: made.link.state is LinkState.DOWN)
        assert await made.until(lambda: made.link.epoch == 2 and not made.is_offline) <= 0.2 + POLL_S + 0.1


@virtual
async def test_a_controller_that_speaks_again_is_read_again_within_the_longest_time_out() -> None:
    async with polled(LinkSettings()) as made:
        await elapse(5)
        made.device.fall_silent(120)
        await elapse(120)
        assert await made.until(lambda: not made.is_offline) <= 2.0 + 2 * POLL_S + 0.2
