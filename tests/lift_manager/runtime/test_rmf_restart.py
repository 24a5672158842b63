"""The manager is killed within the grace of an END, and who is in the car after one."""

from collections.abc import Awaitable, Callable
from datetime import timedelta

import pytest

from drivers.model import LiftValues
from lift_manager.lift.journal import RowKind
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.runtime.rmf_words import (
    HOLD,
    NEXT,
    RMF,
    WITH_MODE,
    arrived,
    coming,
    ends,
    is_refused,
    open_for_it,
    riding,
    stands_open,
    under_way,
    wants,
)
from tests.lift_manager.runtime.scripted import FRONT, OTHER, PERMITTING, PLAIN, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import AT, fixed, held_by, restarted
from tests.support.session_calls import saved
from tests.support.spine import spine
from tests.support.virtual_time import elapse, run_virtual

Phase = Callable[[Bench], Awaitable[None]]
MOVING = LiftValues(
    floor=None, mode=Mode.NORMAL, motion=Motion.UP, doors={FRONT: Door.CLOSED}, flags={"robot_mode_on": True}
)
OPEN_AT_L3 = LiftValues(
    floor="L3", mode=Mode.NORMAL, motion=Motion.STOPPED, doors={FRONT: Door.OPEN}, flags={"may_leave": True}
)


def ending_after(phase: Phase) -> Phase:
    """The manager is killed a second into the grace."""

    async def before(made: Bench) -> None:
        await phase(made)
        ends(made, 30)
        await elapse(1)
        assert held_by(made) == RMF

    return before


def maybe_aboard(made: Bench) -> Holder | None:
    return made.state.restrictions.maybe_aboard


@pytest.mark.parametrize("phase", [coming, open_for_it, arrived])
def test_a_session_that_was_ended_does_not_come_back_after_a_restart(phase: Phase) -> None:
    async def after(made: Bench) -> None:
        assert held_by(made) is None
        assert maybe_aboard(made) is None
        await elapse(5)
        assert made.driver.log == []
        assert HOLD not in made.driver.adopted
        wants(made, "L1", holder=NEXT)

    restarted(ending_after(phase), after, left_on=frozenset({HOLD}))


def test_a_session_that_went_on_within_the_grace_comes_back_after_a_restart() -> None:
    async def before(made: Bench) -> None:
        await ending_after(open_for_it)(made)
        wants(made, "L1")

    async def after(made: Bench) -> None:
        assert held_by(made) == RMF
        assert made.driver.adopted == {HOLD}
        assert made.driver.log == []

    restarted(before, after, left_on=frozenset({HOLD}))


def test_a_robot_that_may_ride_is_remembered_though_its_session_was_ended_just_before_a_kill() -> None:
    async def after(made: Bench) -> None:
        assert held_by(made) is None
        assert maybe_aboard(made) == RMF
        assert is_refused(made, "L1", holder=NEXT).code is Refusal.OCCUPANCY_UNKNOWN
        wants(made, "L3")
        await elapse(1)
        assert made.presses == ["go_to L3"]

    restarted(ending_after(riding), after, found=MOVING)


def test_robot_mode_of_a_car_under_way_outlasts_an_end_and_a_kill() -> None:
    async def before(made: Bench) -> None:
        made.grants_robot_mode()
        await ending_after(riding)(made)

    async def after(made: Bench) -> None:
        assert made.driver.adopted == {"robot_mode"}
        await elapse(20)
        assert made.driver.on == {"robot_mode"}
        made.driver.values = OPEN_AT_L3
        await elapse(0.5)
        assert made.driver.on == set()

    restarted(before, after, WITH_MODE, found=MOVING, left_on=frozenset({"robot_mode"}))


async def _nobody_holds(made: Bench) -> None:
    assert held_by(made) is None


def test_a_lift_is_told_after_a_kill_that_the_robot_left_where_its_end_has_said_so() -> None:
    async def after(made: Bench) -> None:
        await elapse(2)
        assert made.presses == ["robot_left"]
        assert maybe_aboard(made) is None

    memory = MemoryRecorder()
    on_bench(ending_after(_ridden), PERMITTING, recorder=memory, infer=True)
    on_bench(after, PERMITTING, recorder=memory, infer=True, found=OPEN_AT_L3)


async def _ridden(made: Bench) -> None:
    """The robot was taken to L3, as far as its requests tell, and the door stands open for it."""
    wants(made, "L1")
    await elapse(0.5)
    await made.car("L1", Door.OPEN, enter=True)
    await elapse(6)
    wants(made, "L3")
    await elapse(1)
    await made.ridden_to("L3")


def test_an_end_at_the_destination_tells_the_lift_that_the_robot_left_once_the_grace_is_over() -> None:
    async def check(made: Bench) -> None:
        await _ridden(made)
        ends(made)
        await elapse(2.9)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]
        assert "go" in made.driver.on
        await elapse(1)
        assert made.presses[3:] == ["robot_left"]
        assert made.driver.on == set()
        assert maybe_aboard(made) is None

    on_bench(check, PERMITTING, infer=True)


def test_an_end_on_the_way_says_nothing_of_a_robot_though_the_door_opens_within_the_grace() -> None:
    async def check(made: Bench) -> None:
        await made.car("L2", Door.CLOSED)
        wants(made, "L1")
        await elapse(0.5)
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(6)
        wants(made, "L3")
        await elapse(1)
        await under_way(made)
        ends(made)
        await stands_open(made, "L3")
        await elapse(4)
        assert made.presses == ["call L1", "robot_in_place", "go L3"]
        assert maybe_aboard(made) == RMF

    on_bench(check, PERMITTING, infer=True)


def test_where_nothing_is_inferred_an_end_at_the_destination_leaves_no_doubt() -> None:
    async def check(made: Bench) -> None:
        await arrived(made)
        ends(made, 0)
        assert maybe_aboard(made) is None
        wants(made, "L1", holder=NEXT)

    on_bench(check, PLAIN)


@pytest.mark.parametrize("phase", [coming, open_for_it])
def test_an_end_before_the_robot_was_sent_anywhere_leaves_no_doubt(phase: Phase) -> None:
    async def check(made: Bench) -> None:
        await phase(made)
        ends(made, 0)
        assert maybe_aboard(made) is None

    on_bench(check, PLAIN)


@pytest.mark.parametrize("grace_s", [0.0, 3.0])
def test_an_end_on_the_way_of_a_robot_that_may_have_boarded_leaves_a_doubt_until_it_or_a_person_says_more(
    grace_s: float,
) -> None:
    async def check(made: Bench) -> None:
        await riding(made)
        ends(made, grace_s)
        await elapse(grace_s + 0.1)
        assert maybe_aboard(made) == RMF
        assert [text for text in await made.alarms() if text.startswith("maybe_occupied")]
        assert is_refused(made, "L1", holder=NEXT).code is Refusal.OCCUPANCY_UNKNOWN
        assert made.refuse("L1", holder=OTHER).code is Refusal.OCCUPANCY_UNKNOWN
        ends(made)
        assert maybe_aboard(made) == RMF, "END of nobody's session says nothing of a robot"
        wants(made, "L3")
        await stands_open(made, "L3")
        ends(made, 0)
        assert maybe_aboard(made) is None
        wants(made, "L1", holder=NEXT)

    on_bench(check, PLAIN)


def test_a_person_who_has_looked_ends_the_doubt_of_an_end() -> None:
    async def check(made: Bench) -> None:
        await riding(made)
        ends(made, 0)
        made.site.acknowledge("lift", "M. Weber")
        wants(made, "L1", holder=NEXT)

    on_bench(check, PLAIN)


def test_a_robot_that_was_sent_on_while_the_door_still_stood_open_may_be_in_the_car() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        wants(made, "L3")
        ends(made, 0)
        assert maybe_aboard(made) == RMF

    on_bench(check, PLAIN)


def test_the_doubt_of_a_session_that_came_back_stays_until_its_door_stood_open() -> None:
    async def check(made: Bench) -> None:
        await riding(made)
        ends(made, 0)
        wants(made, "L3")
        await elapse(1)
        ends(made, 0)
        assert maybe_aboard(made) == RMF
        wants(made, "L1")
        await stands_open(made, "L1")
        ends(made, 0)
        assert maybe_aboard(made) is None

    on_bench(check, PLAIN)


def test_a_session_from_before_a_restart_may_be_ended_before_it_is_heard_otherwise() -> None:
    async def after(made: Bench) -> None:
        assert held_by(made) == RMF
        ends(made)
        await elapse(2.9)
        assert held_by(made) == RMF
        assert made.driver.on == {HOLD}
        await elapse(0.2)
        assert held_by(made) is None
        assert made.driver.on == set()
        assert maybe_aboard(made) is None

    restarted(open_for_it, after, left_on=frozenset({HOLD}))


def test_a_stop_within_the_grace_leaves_no_session_for_the_next_start() -> None:
    async def before(made: Bench) -> None:
        await ending_after(open_for_it)(made)
        await made.life.stop()

    memory = MemoryRecorder()
    on_bench(before, PLAIN, recorder=memory, clock=fixed(AT))
    assert saved(memory).session is None
    on_bench(_nobody_holds, PLAIN, recorder=memory, clock=fixed(AT + timedelta(seconds=2)))


def test_the_journal_has_the_end_when_it_is_said_and_when_it_happens() -> None:
    journal = MemoryRecorder()

    async def main() -> None:
        async with spine(recorder=journal, poll_s=0.2) as made:
            made.site.request("lift", RMF, "L3", hold_door=True, stays=True)
            for _ in range(20):
                made.site.end_session("lift", RMF, 3)
                await elapse(0.1)
            await elapse(2)

    run_virtual(main)
    texts = [row.text for row in journal.rows if row.kind in (RowKind.REQUEST, RowKind.SESSION)]
    assert texts == [
        "requests L3, hold the door there",
        "rmf:fleet/amr-7 holds the lift, to L3",
        "requests: end its session in 3 s",
        "the session of rmf:fleet/amr-7 is over: released",
    ]
