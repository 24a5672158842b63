"""A lift that has not taken the word that a robot left is told over restarts, and a person can end it."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from drivers.model import Result
from lift_manager.lift.events import Cause
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.scripted import FRONT, OTHER, PERMITTING, Bench, boarded, on_bench
from tests.support.refusals import refusal
from tests.support.session_calls import saved
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import elapse

LEFT = RobotWord.LEFT
AT = datetime(2026, 3, 2, 12, tzinfo=UTC)


async def at_its_floor(made: Bench, answer: Result) -> None:
    await boarded(made)
    await made.ridden_to("L3")
    made.driver.answers["robot_left"] = answer


async def released(made: Bench) -> None:
    """The robot is out, and the manager ends before the lift has been told."""
    await at_its_floor(made, Result.CONFIRMED)
    made.accept("L3", LEFT, hold=False)
    assert "robot_left" not in made.presses


async def released_in_vain(made: Bench) -> None:
    await at_its_floor(made, Result.REJECTED)
    made.accept("L3", LEFT, hold=False)
    await elapse(1)


async def released_offline_and_stopped(made: Bench) -> None:
    await at_its_floor(made, Result.CONFIRMED)
    made.driver.silent = True
    await elapse(3)
    made.accept("L3", LEFT, hold=False)
    await elapse(3)
    await made.life.stop()


async def stopped_as_it_was_pressed(made: Bench) -> None:
    await at_its_floor(made, Result.CONFIRMED)
    made.driver.delay_s = 1.0
    made.accept("L3", LEFT, hold=False)
    await elapse(0.5)
    await made.life.stop()


async def keeps_the_door(made: Bench) -> None:
    """The robot is out and wants the door held; its session is over by the next start."""
    await at_its_floor(made, Result.REJECTED)
    made.accept("L3", LEFT)
    await elapse(1)


@pytest.mark.parametrize(
    ("before", "off_s"),
    [
        (released, 2),
        (released_in_vain, 2),
        (released_offline_and_stopped, 2),
        (stopped_as_it_was_pressed, 2),
        (keeps_the_door, 400),
    ],
)
def test_a_lift_that_was_not_told_that_the_robot_left_is_told_after_the_start(
    before: Callable[[Bench], Awaitable[None]], off_s: float
) -> None:
    memory = MemoryRecorder()

    async def after(made: Bench) -> None:
        await elapse(1)
        assert made.state.holder is None
        assert made.presses == ["robot_left"]
        assert saved(memory).robot_left_pending_since is None
        made.accept("L1", holder=OTHER)
        await elapse(10)
        assert made.presses == ["robot_left", "call L1"]

    on_bench(before, recorder=memory, clock=lambda: AT)
    assert saved(memory).robot_left_pending_since == AT
    on_bench(after, recorder=memory, clock=lambda: AT + timedelta(seconds=off_s))


def test_it_is_told_again_until_it_takes_it_after_a_second_start_too() -> None:
    memory = MemoryRecorder()

    def refuses(made: Bench) -> None:
        made.driver.answers["robot_left"] = Result.UNCONFIRMED

    async def in_vain(made: Bench) -> None:
        await elapse(20)
        assert made.presses == ["robot_left"] * 4
        assert [text for text in await made.alarms() if "robot_left was not taken" in text]

    async def taken(made: Bench) -> None:
        assert made.presses == ["robot_left"]

    on_bench(released, recorder=memory)
    on_bench(in_vain, recorder=memory, at_once=refuses)
    on_bench(taken, recorder=memory)
    assert saved(memory).robot_left_pending_since is None


@pytest.mark.parametrize("waiting", [False, True])
def test_a_person_who_has_seen_to_the_lift_ends_it(*, waiting: bool) -> None:
    async def check(made: Bench) -> None:
        await released_in_vain(made)
        await made.car("L3", Door.CLOSED)
        if waiting:
            made.accept("L1", holder=OTHER)
            await elapse(1)
            assert "a person has seen to the lift" in made.state.restrictions.waiting_for
        told = len(made.presses)
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.OCCUPIED,)
        assert made.site.durable("lift").robot_left_pending_since is None
        made.accept("L1", holder=OTHER)
        await elapse(10)
        assert made.presses[told:] == ["call L1"]
        assert refusal(made.site.acknowledge, "lift", "M. Weber").code is Refusal.NOTHING_TO_ACKNOWLEDGE

    on_bench(check)


def test_a_fire_that_is_acknowledged_leaves_it_to_be_told() -> None:
    async def check(made: Bench) -> None:
        await released_in_vain(made)
        await made.mode(Mode.FIRE)
        made.driver.answers.clear()
        await made.mode(Mode.NORMAL)
        await elapse(10)
        told = len(made.presses)
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.FIRE,)
        await elapse(10)
        assert made.presses[told:] == ["robot_left"]

    on_bench(check)


def test_a_lockout_puts_it_off() -> None:
    async def check(made: Bench) -> None:
        await at_its_floor(made, Result.CONFIRMED)
        made.driver.delay_s = 1.0
        made.accept("L3", LEFT, hold=False)
        await elapse(0.5)
        made.site.lock_out("lift", "M. Weber", "ropes")
        await elapse(10)
        assert "robot_left" not in made.presses
        made.site.end_lockout("lift", "M. Weber")
        await elapse(10)
        assert made.presses[-1] == "robot_left"
        assert made.site.durable("lift").robot_left_pending_since is None

    on_bench(check)


def test_a_lift_without_that_word_is_owed_none() -> None:
    able = replace(PERMITTING, commands=PERMITTING.commands - {"robot_left"}, until={"call": "robot_in_place"})
    memory = MemoryRecorder()

    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.driver.values.doors == {FRONT: Door.OPEN}
        assert saved(memory).robot_left_pending_since is None

    on_bench(check, able, recorder=memory)


async def ridden(lift: Spine) -> str:
    """A robot stands in the open car at its floor, which is returned."""
    first, last = lift.actor.config.floors[:2]
    lift.accept(first)
    await lift.until(lambda state: state.robot_door is RobotDoor.OPEN)
    lift.accept(last, RobotWord.IN_PLACE)
    await lift.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == last)
    assert "go" in lift.face.commands
    return last


def test_a_person_who_ends_the_word_ends_the_call_that_was_on_until_then() -> None:
    async def check(lift: Spine) -> None:
        floor = await ridden(lift)
        lift.device.refuses = True
        lift.accept(floor, RobotWord.LEFT, hold=False)
        await elapse(1)
        lift.device.refuses = False
        lift.site.acknowledge("lift", "A. Novak")
        await elapse(8)
        assert "go" not in lift.face.commands

    on_spine(check, "seer-siemens-chengdu")


def test_a_word_on_its_way_for_the_first_time_is_nothing_to_acknowledge_and_the_lift_hears_it() -> None:
    async def check(lift: Spine) -> None:
        floor = await ridden(lift)
        lift.accept(floor, RobotWord.LEFT, hold=False)
        answer = refusal(lift.site.acknowledge, "lift", "A. Novak")
        assert answer.code is Refusal.NOTHING_TO_ACKNOWLEDGE
        await elapse(12)
        lift.accept(lift.actor.config.floors[0])
        await lift.until(lambda state: state.robot_door is RobotDoor.OPEN)

    on_spine(check, "seer-siemens-chengdu")
