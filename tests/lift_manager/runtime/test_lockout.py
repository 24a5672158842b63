"""A technician's word keeps robots off: at once, with name and reason, and over restarts."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from drivers.model import Command, CommandKind, LiftValues
from lift_manager.lift.events import (
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
)
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.lift.state import Quality
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode, Motion
from simulator.faults import PowerLoss
from simulator.state import Inputs
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.phases import PHASES, door_held, outputs, travelling
from tests.lift_manager.runtime.scripted import FRONT, PERMITTING, PLAIN, Bench, boarded, on_bench
from tests.lift_manager.runtime.test_what_cannot_be_read import WITH_MODE
from tests.support.refusals import refusal
from tests.support.spine import WORKSHOP, Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)
LOCKOUT = Restriction(RestrictionKind.LOCKOUT, "M. Weber", "new ropes", AT)
TEXT = "locked out by M. Weber since 2026-03-02 21:30: new ropes"


def locked_out(made: Spine) -> Restriction:
    return made.site.lock_out("lift", "M. Weber", "new ropes", at_once=True)


@pytest.mark.parametrize("phase", PHASES)
def test_a_lockout_ends_the_session_and_lets_everything_go_but_robot_mode_under_way(
    phase: Callable[[Spine], Awaitable[None]],
) -> None:
    async def check(made: Spine) -> None:
        await phase(made)
        await elapse(0.1)
        mode_was_on = made.face.picture.robot_mode_on
        locked_out(made)
        assert made.state.holder is None
        pressed = len(made.presses())
        await elapse(0.1)
        call, hold, *_ = outputs(made)
        assert (call, hold) == (0, 0)
        while made.face.picture.motion is not Motion.STOPPED:
            assert made.face.picture.robot_mode_on == mode_was_on
            await elapse(0.05)
        await elapse(5)
        assert outputs(made) == [0, 0, 0, 0]
        assert len(made.presses()) == pressed

    on_spine(check, poll_s=0.2)


def test_a_lockout_is_told_to_the_robot_and_to_everybody_who_asks() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        with made.bus.listen() as listener:
            lockout = locked_out(made)
            events = await heard(listener)
        assert lockout == LOCKOUT
        assert only(events, RestrictionBegun) == [RestrictionBegun("lift", lockout)]
        (ended,) = only(events, SessionEnded)
        assert (ended.holder, ended.reason, ended.advice) == (WORKSHOP, EndReason.LOCKOUT, Advice.CLEAR_DOORWAY)
        assert ended.text == "locked out by M. Weber: new ropes"
        refused = made.refuse("L3")
        assert refused.code is Refusal.LOCKED_OUT
        assert refused.message == f"lift is {TEXT}; a person ends it with `lift-manager lockout lift --by NAME --end`"
        assert made.state.restrictions.lockout == TEXT.removeprefix("locked out ")
        made.accept("L2", hold=False)

    on_spine(check, clock=lambda: AT)


def test_a_lockout_survives_restarts_until_somebody_ends_it() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory, clock=lambda: AT) as made:
            await travelling(made)
            locked_out(made)
        async with spine(recorder=memory, clock=lambda: AT) as made:
            assert TEXT in made.refuse("L2").message
            await elapse(5)
            assert made.device.writes == []
            with made.bus.listen() as listener:
                ended = made.site.end_lockout("lift", "A. Beck")
                assert only(await heard(listener), RestrictionEnded) == [
                    RestrictionEnded("lift", "A. Beck", AT, LOCKOUT)
                ]
            assert isinstance(ended, RestrictionEnded)
            made.accept("L2")
        async with spine(recorder=memory) as made:
            assert made.state.restrictions.lockout == ""

    run_virtual(main)


def test_a_second_lockout_does_not_cover_up_the_first_and_none_cannot_be_ended() -> None:
    async def check(made: Spine) -> None:
        nothing = refusal(made.site.end_lockout, "lift", "A. Beck")
        assert nothing.code is Refusal.NOT_LOCKED_OUT
        locked_out(made)
        second = refusal(made.site.lock_out, "lift", "A. Beck", "cleaning")
        assert second.code is Refusal.LOCKED_OUT
        assert "by M. Weber" in second.message
        assert made.site.durable("lift").restriction(RestrictionKind.LOCKOUT) == LOCKOUT

    on_spine(check, clock=lambda: AT)


def test_a_lift_that_is_only_watched_or_offline_can_be_locked_out_too() -> None:
    async def watched(made: Spine) -> None:
        locked_out(made)
        assert made.refuse("L2").code is Refusal.LOCKED_OUT
        await elapse(2)
        assert made.device.writes == []

    async def offline(made: Spine) -> None:
        made.device.silent = True
        await made.until(lambda state: state.quality is Quality.OFFLINE)
        locked_out(made)
        assert made.refuse("L2").code is Refusal.LOCKED_OUT

    on_spine(watched, control=False)
    on_spine(offline)


def test_a_press_that_is_on_its_way_when_the_word_comes_is_not_sent() -> None:
    async def check(made: Spine) -> None:
        made.device.delay_s = 0.2
        made.accept("L3")
        while not made.face.picture.robot_mode_on:
            await elapse(0.01)
        locked_out(made)
        await elapse(5)
        assert made.presses() == []

    on_spine(check)


def test_a_robot_that_left_is_reported_to_the_lift_only_once_the_lockout_is_over() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.driver.delay_s = 1.0
        made.accept("L3", RobotWord.LEFT, hold=False)
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(10)
        assert made.driver.on == set()
        assert "robot_left" not in made.presses
        made.site.end_lockout("lift", "M. Weber")
        await elapse(5)
        assert made.presses[-1] == "robot_left"

    on_bench(check)


def test_robot_mode_of_a_car_under_way_stays_permitted_in_a_lockout_until_the_car_stands() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, flags={"robot_mode_on": True})
        made.accept("L1")
        await elapse(0.5)
        made.driver.values = replace(made.driver.values, floor=None, motion=Motion.UP)
        await elapse(0.5)
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(5)
        assert made.driver.on == {"robot_mode"}
        assert made.driver.above.blocked_by(Command(CommandKind.ROBOT_MODE), None) is None
        made.driver.values = replace(made.driver.values, floor="L1", motion=Motion.STOPPED)
        await elapse(5)
        assert made.driver.on == set()

    on_bench(check, WITH_MODE)


def test_the_open_door_of_a_lift_that_is_locked_out_invites_nobody() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        locked_out(made)
        assert Door.OPEN in made.state.doors.values()
        for _ in range(30):
            assert made.state.robot_door is not RobotDoor.OPEN
            await elapse(0.1)

    on_spine(check, poll_s=0.2)


REPORTING = replace(
    PERMITTING,
    commands=PERMITTING.commands | {"robot_mode"},
    signals=PERMITTING.signals | {"robot_mode_on"},
    held_commands=PERMITTING.held_commands | {"robot_mode"},
)
"""A lift with a robot mode that is told when a robot left."""


async def ridden(made: Bench) -> None:
    """The robot stands at L3 with the door open."""
    made.grants_robot_mode()
    await boarded(made)
    await made.ridden_to("L3")
    assert "robot_mode" in made.driver.on


def test_robot_mode_does_not_wait_in_a_lockout_for_a_word_that_may_not_be_given() -> None:
    async def check(made: Bench) -> None:
        await ridden(made)
        made.accept("L3", RobotWord.LEFT, hold=False)
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(1)
        assert made.driver.on == set()

    on_bench(check, REPORTING)


def test_robot_mode_waits_for_a_word_that_cannot_be_given_while_the_lift_cannot_be_read() -> None:
    async def check(made: Bench) -> None:
        await ridden(made)
        made.driver.silent = True
        await elapse(3)
        made.accept("L3", RobotWord.LEFT, hold=False)
        await elapse(5)
        assert made.driver.on == {"robot_mode"}
        made.driver.silent = False
        await elapse(5)
        assert made.presses[-1] == "robot_left"
        assert made.driver.on == set()

    on_bench(check, REPORTING)


def withdraw_by_lockout(made: Spine | Bench) -> EndReason:
    made.site.lock_out("lift", "M. Weber", "new ropes")
    return EndReason.LOCKOUT


def withdraw_by_release(made: Spine | Bench) -> EndReason:
    released = made.site.force_release("lift", "M. Weber", "it blocks the lift")
    assert released.clear_s == 10.0
    assert "its door is released in 10 s" in released.text
    return EndReason.FORCED


@pytest.mark.parametrize("withdraw", [withdraw_by_lockout, withdraw_by_release])
def test_a_person_withdraws_open_at_once_and_the_door_is_released_clear_s_later(
    withdraw: Callable[[Spine], EndReason],
) -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        with made.bus.listen() as listener:
            reason = withdraw(made)
            assert made.state.robot_door is RobotDoor.MOVING
            assert made.state.releases_in_s == pytest.approx(10.0)
            for _ in range(98):
                await elapse(0.1)
                assert outputs(made)[1] == 1
                assert made.state.robot_door is RobotDoor.MOVING
            pressed = len(made.presses())
            assert made.refuse("L3").code in (Refusal.LOCKED_OUT, Refusal.SESSION_OVER)
            await elapse(0.4)
            assert outputs(made)[:2] == [0, 0]
            assert made.state.holder is None
            assert len(made.presses()) == pressed
            (ended,) = only(await heard(listener), SessionEnded)
        assert ended.reason is reason

    on_spine(check, poll_s=0.2)


def test_a_robot_in_the_door_has_clear_s_though_the_hold_was_not_answered_a_moment_ago() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert made.robot_door() is RobotDoor.OPEN
        made.driver.unseen = True
        await elapse(0.5)
        assert made.robot_door() is RobotDoor.MOVING
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(9.0)
        assert made.driver.on == {"hold_door.front"}
        await elapse(2.0)
        assert made.driver.on == set()

    on_bench(check, PLAIN, poll_s=0.2)


def test_a_robot_in_the_door_has_clear_s_though_a_restart_does_not_know_yet_where_the_car_stands() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await made.called_to("L1")
        assert made.robot_door() is RobotDoor.OPEN

    async def after(made: Bench) -> None:
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(9.0)
        assert made.driver.log == []
        await elapse(2.0)
        assert made.driver.log == ["let go hold_door.front"]

    on_bench(before, PLAIN, recorder=memory, poll_s=0.2)
    nobody_knows = LiftValues(floor=None, mode=Mode.NORMAL, doors={FRONT: Door.OPEN}, flags={"may_enter": True})
    on_bench(after, PLAIN, recorder=memory, found=nobody_knows, left_on=frozenset({"hold_door.front"}), poll_s=0.2)


@pytest.mark.parametrize("withdraw", [withdraw_by_lockout, withdraw_by_release])
def test_a_robot_in_the_door_has_clear_s_from_a_persons_word_also_over_a_crash(
    withdraw: Callable[[Bench], EndReason],
) -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await made.called_to("L1")
        assert made.robot_door() is RobotDoor.OPEN
        withdraw(made)
        await elapse(4)
        assert made.driver.on == {"hold_door.front"}

    async def after(made: Bench) -> None:
        assert made.robot_door() is not RobotDoor.OPEN
        await elapse(5)
        assert made.driver.log == []
        await elapse(2)
        assert made.driver.log == ["let go hold_door.front"]
        assert made.state.holder is None

    on_bench(before, PLAIN, recorder=memory, clock=lambda: AT, poll_s=0.2)
    at_l1 = LiftValues(floor="L1", mode=Mode.NORMAL, doors={FRONT: Door.OPEN}, flags={"may_enter": True})
    at = AT + timedelta(seconds=4)
    on_bench(
        after, PLAIN, recorder=memory, clock=lambda: at, found=at_l1, left_on=frozenset({"hold_door.front"}), poll_s=0.2
    )


@pytest.mark.parametrize("withdraw", [withdraw_by_lockout, withdraw_by_release])
def test_a_hold_that_the_controller_loses_after_a_persons_word_is_not_pressed_again(
    withdraw: Callable[[Spine], EndReason],
) -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        withdraw(made)
        await elapse(1)
        assert "hold_door.front" in made.face.commands
        lost = PowerLoss()
        made.face.begin(lost, asyncio.get_running_loop().time())
        made.device.silent = True
        await elapse(1)
        made.face.end(lost, asyncio.get_running_loop().time())
        made.device.silent = False
        await made.until(lambda state: state.quality is Quality.LIVE)
        for _ in range(30):
            assert not {"hold_door.front", "robot_mode"} & set(made.face.commands)
            await elapse(0.1)
        assert made.state.quality is Quality.LIVE

    on_spine(check, poll_s=0.2)


@pytest.mark.parametrize("withdraw", [withdraw_by_lockout, withdraw_by_release])
def test_a_session_that_a_person_ends_is_not_said_to_be_ended_by_its_holder(
    withdraw: Callable[[Spine], EndReason],
) -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        withdraw(made)
        await elapse(1)
        # an adapter of RMF would not bring the END of its fleet for a session that its holder has ended already
        assert not made.state.ending

    on_spine(check)


@pytest.mark.parametrize("withdraw", [withdraw_by_lockout, withdraw_by_release])
def test_its_holder_may_still_let_go_of_the_door_before_it_is_released(withdraw: Callable[[Spine], EndReason]) -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        withdraw(made)
        await elapse(1)
        made.accept("L2", hold=False)
        await elapse(0.5)
        assert outputs(made)[1] == 0
        assert made.state.holder is None

    on_spine(check)


def test_a_request_at_the_moment_of_the_end_does_not_put_it_off() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        loop, ends_at = asyncio.get_running_loop(), asyncio.get_running_loop().time() + made.actor.config.clear_s
        holders: list[Holder | None] = []

        def repeat() -> None:
            made.refuse("L1")
            holders.append(made.state.holder)

        loop.call_at(ends_at, repeat)  # before the timer of the end, as on a busy machine
        made.site.lock_out("lift", "M. Weber", "new ropes")
        await elapse(made.actor.config.clear_s)
        assert holders == [None]

    on_bench(check, PLAIN, poll_s=0.9)


def test_a_fire_does_not_wait_for_a_door_that_a_person_has_withdrawn() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        withdraw_by_lockout(made)
        await elapse(1)
        made.people(Inputs(fire=True))
        await elapse(0.5)
        assert outputs(made)[1] == 0

    on_spine(check)


def test_a_second_word_neither_shortens_nor_prolongs_the_time_that_a_robot_was_given() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        withdraw_by_release(made)
        await elapse(4)
        withdraw_by_lockout(made)
        assert made.state.releases_in_s == pytest.approx(6.0)
        await elapse(5.8)
        assert outputs(made)[1] == 1
        await elapse(0.5)
        assert outputs(made)[1] == 0

    on_spine(check)
