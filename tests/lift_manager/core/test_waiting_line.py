"""Who waits for a lift comes first when it is free, in the order in which they came, and nobody else is hindered."""

import pytest

from drivers.sparing import CALLERS
from lift_manager.core.waiting import HEARD_WITHIN_S, WaitingLine
from lift_manager.domain.asking import Accepted, Refusal, Refused, RobotWord
from lift_manager.domain.rmf import rmf_holder
from lift_manager.domain.service import EndReason
from lift_manager.domain.session_requests import Do
from lift_manager.domain.state import Holder, RobotDoor
from tests.lift_manager.core.scripted import PLAIN, Bench, on_bench
from tests.support.session_calls import ROBOT, SECOND
from tests.support.spine import OTHER, WORKSHOP, Spine, on_spine
from tests.support.virtual_time import elapse

RIDE, LATER = Holder("ride", "amr-1"), Holder("ride", "amr-2")
RMF_SECOND = Holder("rmf", "fleet/robot2")


def ahead(refused: Refused) -> int | None:
    assert refused.code is Refusal.QUEUED, refused
    assert refused.blocking is not None
    return refused.blocking.ahead


def test_first_come_first_served_and_joining_twice_changes_nothing() -> None:
    line = WaitingLine("lift")
    for holder in (RIDE, LATER, RIDE):
        line.join(holder, 0.0)
    assert (line.length(0.0), line.ahead(RIDE, 0.0), line.ahead(LATER, 0.0), line.ahead(ROBOT, 0.0)) == (2, 0, 1, 2)
    line.leave(RIDE)
    line.leave(RIDE)
    assert (line.ahead(LATER, 1e6), line.length(1e6)) == (0, 1)


def test_a_face_that_asks_again_is_one_entry_and_lapses_when_it_is_heard_no_more() -> None:
    line = WaitingLine("lift")
    held = Refused(Refusal.HELD, "held")
    line.refused(OTHER, held, 0.0)
    line.join(RIDE, 1.0)
    line.refused(RMF_SECOND, held, 4.0)
    assert (line.length(4.0), line.ahead(RMF_SECOND, 4.0), line.ahead(RIDE, 4.0)) == (2, 0, 1)
    assert line.ahead(RIDE, 4.0 + HEARD_WITHIN_S) == 1
    assert line.ahead(RIDE, 4.1 + HEARD_WITHIN_S) == 0
    assert line.length(4.1 + HEARD_WITHIN_S) == 1


@pytest.mark.parametrize("code", sorted(set(Refusal) - {Refusal.HELD, Refusal.QUEUED}))
def test_whoever_is_refused_for_another_reason_does_not_wait(code: Refusal) -> None:
    line = WaitingLine("lift")
    line.refused(OTHER, Refused(code, "no"), 0.0)
    assert line.length(0.0) == 0


def test_each_rmf_waits_as_one() -> None:
    line = WaitingLine("lift")
    first, second = rmf_holder("fleet/robot1", ""), rmf_holder("fleet/robot1", "5")
    for holder in (first, second, rmf_holder("fleet/robot2", "5")):
        line.refused(holder, Refused(Refusal.HELD, "held"), 0.0)
    assert (line.length(0.0), line.ahead(second, 0.0), line.first(0.0)) == (2, 1, "rmf")


def test_workshop_waits_as_one_and_each_caller_of_a_session_for_itself_for_as_long_as_they_ask() -> None:
    line = WaitingLine("lift")
    for holder in (WORKSHOP, Holder("workshop", "other"), ROBOT, SECOND, ROBOT):
        line.refused(holder, Refused(Refusal.HELD, "held"), 0.0)
    assert [line.ahead(holder, 0.0) for holder in (WORKSHOP, ROBOT, SECOND)] == [0, 1, 2]
    assert (line.length(0.0), line.first(0.0), line.left) == (3, "workshop", 0)
    line.refused(SECOND, Refused(Refusal.HELD, "held"), 3.0)
    assert (line.length(1.0 + HEARD_WITHIN_S), line.first(1.0 + HEARD_WITHIN_S), line.left) == (1, SECOND, 2)


def test_whoever_makes_up_names_does_not_fill_the_line() -> None:
    line = WaitingLine("lift")
    for number in range(2 * CALLERS):
        line.refused(Holder("api", f"amr-{number}"), Refused(Refusal.HELD, "held"), 0.0)
    assert line.length(0.0) == CALLERS
    line.join(RIDE, 0.0)
    assert line.ahead(RIDE, 0.1 + HEARD_WITHIN_S) == 0


def test_a_ride_is_not_in_line_because_it_was_refused() -> None:
    line = WaitingLine("lift")
    line.refused(RIDE, Refused(Refusal.HELD, "held"), 0.0)
    assert line.length(0.0) == 0


def test_one_that_asks_again_gets_the_lift_though_rides_come_one_after_another() -> None:
    async def check(made: Spine) -> None:
        session = made.opened(RIDE)
        assert made.refuse("L2", holder=WORKSHOP).code is Refusal.HELD
        made.task.line.join(LATER, 0.0)
        made.closed(session)
        assert made.open_refused(LATER).code is Refusal.QUEUED
        made.accept("L2", holder=WORKSHOP)

    on_spine(check)


def test_a_free_lift_is_refused_to_everybody_but_the_first_in_line() -> None:
    async def check(made: Spine) -> None:
        now = 0.0
        made.task.line.join(RIDE, now)
        made.task.line.join(LATER, now)
        assert made.state.waiting == 2
        assert ahead(made.refuse("L2", holder=WORKSHOP)) == 2
        assert ahead(made.open_refused(ROBOT)) == 3
        assert ahead(made.open_refused(LATER)) == 1
        session = made.opened(RIDE)
        assert made.state.waiting == 3
        assert made.open_refused(LATER).code is Refusal.HELD
        made.closed(session)
        assert ahead(made.open_refused(RIDE)) == 3
        made.opened(LATER)
        assert made.state.waiting == 2

    on_spine(check)


def test_an_empty_line_hinders_nobody() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2", holder=WORKSHOP)
        await elapse(1)
        made.accept("L3", holder=WORKSHOP)

    on_spine(check)


def test_rmf_waits_once_for_all_its_robots_while_it_is_heard() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        for holder in (OTHER, RMF_SECOND):
            assert made.refuse("L2", holder=holder).code is Refusal.HELD
        assert made.state.waiting == 1
        made.closed(session)
        assert ahead(made.open_refused(SECOND)) == 1
        assert ahead(made.refuse("L2", holder=WORKSHOP)) == 2
        made.accept("L2", holder=RMF_SECOND)
        assert made.state.waiting == 2
        assert made.refuse("L2", holder=OTHER).code is Refusal.HELD
        assert made.state.waiting == 3
        await elapse(HEARD_WITHIN_S + 1)
        assert made.state.waiting == 0

    on_spine(check)


def test_a_release_by_rmf_is_no_wish_for_the_lift() -> None:
    async def check(made: Spine) -> None:
        made.opened()
        assert made.refuse(made.state.floor or "", hold=False, holder=OTHER).code is Refusal.HELD
        assert made.state.waiting == 0

    on_spine(check)


def test_a_holder_whose_robot_may_be_in_the_car_is_never_kept_out_by_the_line() -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await made.done(session, Do.GO_TO, "L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.task.force_release("M. Weber", "it blocks the lift", at_once=True)
        made.task.line.join(RIDE, 0.0)
        assert made.open_refused(RIDE).code is Refusal.OCCUPANCY_UNKNOWN
        again = made.opened(ROBOT)
        assert made.state.waiting == 1
        await made.done(again, Do.ROBOT_LEFT)
        made.closed(again, RobotWord.LEFT)
        assert made.open_refused(ROBOT).code is Refusal.QUEUED
        made.opened(RIDE)

    on_spine(check)


def test_a_session_that_goes_on_is_not_kept_waiting() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2", holder=WORKSHOP)
        made.task.line.join(RIDE, 0.0)
        assert made.ask("L3", holder=WORKSHOP) == Accepted()

    on_spine(check)


def test_a_silent_holder_makes_way_for_the_first_in_line_alone() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.task.line.join(RIDE, 0.0)
        await elapse(35)
        assert made.open_refused(SECOND).code is Refusal.HELD
        assert made.read(session).over is None
        assert "silent_holder" in (await made.alarms())[-1]
        made.opened(RIDE)
        over = made.read(session).over
        assert over is not None
        assert over.reason is EndReason.TAKEN_OVER

    on_bench(check, PLAIN, takeover_after_s=30.0)
