"""A car in which a robot may have been left keeps other robots out, over restarts too, until somebody knows better."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from lift_manager.lift.events import Alarm, Cause
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.runtime.recorder import MemoryRecorder, SavedLift
from register_maps.words import Door, Motion
from simulator.controller import Inputs
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.phases import door_held, just_accepted, travelling
from tests.lift_manager.runtime.scripted import (
    OTHER,
    PERMITTING,
    PLAIN,
    ROBOT,
    Bench,
    CountingRecorder,
    boarded,
    on_bench,
)
from tests.support.refusals import refusal
from tests.support.session_calls import saved
from tests.support.spine import OTHER as OTHER_FACE
from tests.support.spine import WORKSHOP, Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

IN_PLACE, LEFT = RobotWord.IN_PLACE, RobotWord.LEFT


def long_ago(memory: MemoryRecorder) -> None:
    """Let the session be over by the next start, and leave everything else as it was."""
    memory.keep("lift", SavedLift(replace(saved(memory), session=None)))


async def riding(made: Spine) -> None:
    await door_held(made)
    made.accept("L3")
    await made.until(lambda state: state.motion is Motion.UP)


@pytest.mark.parametrize("phase", [door_held, riding])
@pytest.mark.parametrize("orderly", [True, False])
def test_after_a_restart_in_the_middle_of_a_ride_only_its_holder_may_go_on(
    phase: Callable[[Spine], Awaitable[None]], *, orderly: bool
) -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await phase(made)
            if orderly:
                await made.life.stop()
        async with spine(recorder=memory) as made:
            assert made.state.restrictions.maybe_aboard == WORKSHOP
            refused = made.refuse("L2", holder=OTHER_FACE)
            assert refused.code is Refusal.HELD
            assert "its robot may be in the car" in refused.message
            assert "`lift-manager release lift --by NAME" in refused.message
            async with asyncio.timeout(60):
                while made.state.robot_door is not RobotDoor.OPEN:
                    made.accept("L3")
                    await elapse(1)
            made.accept("L3", hold=False)
            made.accept("L2", holder=OTHER_FACE)
            assert made.site.durable("lift").occupied is None

    run_virtual(main)


@pytest.mark.parametrize("phase", [just_accepted, travelling])
def test_a_restart_before_the_door_stood_open_leaves_the_lift_to_everybody(
    phase: Callable[[Spine], Awaitable[None]],
) -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await phase(made)
        async with spine(recorder=memory) as made:
            made.accept("L2", holder=OTHER_FACE)

    run_virtual(main)


def test_a_ride_that_was_released_leaves_the_lift_to_everybody() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await riding(made)
            await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
            assert saved(memory).occupied is not None
            made.accept("L3", hold=False)
            assert saved(memory).occupied is None
        async with spine(recorder=memory) as made:
            made.accept("L2", holder=OTHER_FACE)

    run_virtual(main)


def test_a_person_who_has_looked_frees_the_lift() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await door_held(made)
        async with spine(recorder=memory) as made:
            refused = refusal(made.site.acknowledge, "lift", "M. Weber")
            assert "a person ends that session with `lift-manager release lift --by NAME" in refused.message
            released = made.site.force_release("lift", "M. Weber", "nobody comes for it")
            assert released.maybe_aboard
            said = made.site.acknowledge("lift", "M. Weber")
            assert said.causes == (Cause.OCCUPIED,)
            made.accept("L2", holder=OTHER_FACE)
        assert saved(memory).acknowledged == said

    run_virtual(main)


def test_its_holder_frees_the_lift_after_a_restart_by_saying_that_the_robot_left() -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await made.called_to("L1")

    async def after(made: Bench) -> None:
        made.accept("L2", LEFT, hold=False, holder=OTHER)
        assert made.refuse("L3", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        made.accept("L2", LEFT, hold=False)
        made.accept("L3", holder=OTHER)

    on_bench(before, PLAIN, recorder=memory)
    long_ago(memory)
    on_bench(after, PLAIN, recorder=memory)


def test_its_holder_without_words_frees_the_lift_after_a_restart_by_asking_again_and_letting_go() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await door_held(made)
        async with spine(recorder=memory) as made:
            here = made.state.floor or ""
            made.accept(here)
            assert made.state.restrictions.maybe_aboard == WORKSHOP
            made.accept(here, hold=False)
            made.accept("L2", holder=OTHER_FACE)

    run_virtual(main)


def test_what_a_client_posts_for_an_idle_lift_says_nothing_about_a_robot_in_the_car() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        made.people(Inputs(fire=True))
        await elapse(1)
        made.people(Inputs())
        for _ in range(10):
            await elapse(1)
            made.accept(made.state.floor or "", hold=False)
        assert made.state.restrictions.maybe_aboard == WORKSHOP
        said = made.site.acknowledge("lift", "M. Weber")
        assert said.causes == (Cause.FIRE, Cause.OCCUPIED)

    on_spine(check)


async def rides_on_without_a_hold(made: Bench) -> None:
    """The holder of a doubt asks for L3 and no hold, and gets there behind a shut door."""
    made.accept("L3", hold=False)
    await made.car(None, Door.CLOSED)
    await made.car("L3", Door.CLOSED)
    await elapse(3)
    assert made.state.holder is None
    assert made.refuse("L2", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN


def test_a_doubt_is_carried_through_the_next_ride_without_a_hold() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(31)
        assert made.refuse("L2", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        await rides_on_without_a_hold(made)

    on_bench(check, PLAIN, lease_s=30)


def test_a_ride_that_is_taken_up_after_a_restart_without_a_hold_leaves_a_doubt() -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", hold=False)
        await made.car(None, Door.CLOSED)
        assert made.state.restrictions.maybe_aboard == ROBOT

    memory = MemoryRecorder()
    on_bench(before, PLAIN, recorder=memory)
    on_bench(rides_on_without_a_hold, PLAIN, recorder=memory)


def test_a_caller_without_words_whose_robot_was_boarding_at_a_restart_is_taken_along_after_all() -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L1")

    async def after(made: Bench) -> None:
        await made.car("L1", Door.OPEN, enter=True)
        assert "request L1, where the car is" in made.refuse("L3").message
        made.accept("L1")
        await elapse(3)
        assert "its door has stood open for" in made.refuse("L3").message
        await elapse(3)
        made.accept("L3")
        await elapse(1)
        assert made.presses[-2:] == ["robot_in_place", "go L3"]

    memory = MemoryRecorder()
    on_bench(before, PERMITTING, recorder=memory, infer=True)
    long_ago(memory)
    on_bench(after, PERMITTING, recorder=memory, infer=True)


def test_a_lease_that_ends_with_the_door_open_leaves_a_doubt_and_an_alarm() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(31)
        assert made.state.holder is None
        (alarm,) = only(await heard(made.heard), Alarm)
        assert alarm.text.startswith(
            "maybe_occupied: the session of api:fleet/robot1 is over (the lease of 30 s ran out)"
        )
        assert alarm.holder == ROBOT
        assert made.refuse("L3", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        made.site.acknowledge("lift", "M. Weber")
        made.accept("L3", holder=OTHER)

    on_bench(check, PLAIN, lease_s=30)


def test_a_ride_that_ended_on_arrival_without_a_hold_leaves_a_doubt_but_no_alarm() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", hold=False)
        await made.car(None, Door.CLOSED)
        await made.car("L3", Door.CLOSED)
        await elapse(3)
        assert made.state.holder is None
        assert only(await heard(made.heard), Alarm) == []
        made.accept("L3", hold=False)
        assert made.refuse("L2", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        made.accept("L3", LEFT, hold=False)
        made.accept("L2", holder=OTHER)

    on_bench(check, PLAIN)


def test_a_car_that_was_merely_sent_somewhere_leaves_no_doubt() -> None:
    async def check(made: Bench) -> None:
        made.accept("L3", hold=False)
        await made.car(None, Door.CLOSED)
        await made.car("L3", Door.OPEN, enter=True)
        await elapse(3)
        assert made.state.holder is None
        made.accept("L2", holder=OTHER)

    on_bench(check, PLAIN)


def test_nothing_is_acknowledged_while_the_holder_rides_on() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        assert made.state.restrictions.maybe_aboard == ROBOT
        refused = refusal(made.site.acknowledge, "lift", "M. Weber")
        assert refused.code is Refusal.NOTHING_TO_ACKNOWLEDGE
        assert made.state.restrictions.maybe_aboard == ROBOT

    on_bench(check, PLAIN)


def on_two_benches(first: Callable[[Bench], Awaitable[None]], second: Callable[[Bench], Awaitable[None]]) -> None:
    """Run a manager, and another one that remembers what it knew, the session apart."""
    memory = MemoryRecorder()
    on_bench(first, PERMITTING, recorder=memory)
    long_ago(memory)
    on_bench(second, PERMITTING, recorder=memory)


def test_a_robot_aboard_is_still_aboard_after_a_restart_and_the_lift_is_told_anew() -> None:
    async def after(made: Bench) -> None:
        assert made.refuse("L1", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        made.accept("L3")
        await elapse(1)
        assert made.presses == ["robot_in_place", "go L3"]
        await made.ridden_to("L3")
        made.accept("L3", LEFT, hold=False)
        await elapse(1)
        assert made.presses[-1] == "robot_left"
        made.accept("L1", holder=OTHER)

    on_two_benches(boarded, after)


def test_after_a_restart_with_the_door_open_the_car_is_not_sent_off_before_somebody_says_who_is_aboard() -> None:
    async def before(made: Bench) -> None:
        await made.called_to("L1")

    async def after(made: Bench) -> None:
        assert made.state.floor == "L2"
        refused = made.refuse("L3")
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert (
            "report that it is in place or has left, request L2, where the car is, or a person must look"
            in refused.message
        )
        made.accept("L3", IN_PLACE)
        await elapse(1)
        assert made.presses == ["robot_in_place", "go L3"]

    async def stays(made: Bench) -> None:
        made.accept("L2")
        await elapse(5)
        assert "may have entered the car at L2" in made.refuse("L3").message

    async def says_left(made: Bench) -> None:
        made.accept("L3", LEFT)
        await elapse(1)
        assert made.presses == ["call L3"]

    on_two_benches(before, after)
    on_two_benches(before, stays)
    on_two_benches(before, says_left)


def test_what_is_remembered_is_written_at_every_step_of_a_ride_and_not_at_every_reading() -> None:
    async def main() -> None:
        memory = CountingRecorder()
        async with spine(recorder=memory) as made:
            await riding(made)
            await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
            await elapse(20)
            made.accept("L3", hold=False)
            await elapse(5)
        # asked, pressed, door proven, arrived and held, maybe boarded, asked again, pressed again, arrived and held again, over
        assert memory.kept <= 13
        assert asyncio.get_running_loop().time() > 20

    run_virtual(main)
