"""Who waits for a lift comes first when it is free, in the order in which they came, and nobody else is hindered."""

from lift_manager.lift.commands import CommandType
from lift_manager.lift.inputs import JoinQueue
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.queue import LAPSES_AFTER_S
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import EndReason, Holder
from lift_manager.runtime.errors import RequestRefused
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.session_calls import ROBOT, SECOND
from tests.support.spine import OTHER, WORKSHOP, Spine, on_spine
from tests.support.virtual_time import elapse

RIDE, LATER = Holder("ride", "amr-1"), Holder("ride", "amr-2")
RMF_SECOND = Holder("rmf", "fleet/robot2")


def ahead(refused: RequestRefused) -> int | None:
    assert refused.code is Refusal.QUEUED, refused
    assert refused.blocking is not None
    return refused.blocking.ahead


def test_one_that_asks_again_gets_the_lift_though_rides_come_one_after_another() -> None:
    async def check(made: Spine) -> None:
        session = made.opened(RIDE)
        assert made.refuse("L2", holder=WORKSHOP).code is Refusal.HELD
        made.actor.handle(JoinQueue(LATER))
        made.closed(session)
        assert made.open_refused(LATER).code is Refusal.QUEUED
        made.accept("L2", holder=WORKSHOP)

    on_spine(check)


def test_a_free_lift_is_refused_to_everybody_but_the_first_in_line() -> None:
    async def check(made: Spine) -> None:
        made.actor.handle(JoinQueue(RIDE))
        made.actor.handle(JoinQueue(LATER))
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
        await elapse(LAPSES_AFTER_S + 1)
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
        await made.done(session, CommandType.GO_TO, "L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.site.force_release("lift", "M. Weber", "it blocks the lift", at_once=True)
        made.actor.handle(JoinQueue(RIDE))
        assert made.open_refused(RIDE).code is Refusal.OCCUPANCY_UNKNOWN
        again = made.opened(ROBOT)
        assert made.state.waiting == 1
        await made.done(again, CommandType.ROBOT_LEFT)
        made.closed(again, RobotWord.LEFT)
        assert made.open_refused(ROBOT).code is Refusal.QUEUED
        made.opened(RIDE)

    on_spine(check)


def test_a_session_that_goes_on_is_not_kept_waiting() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2", holder=WORKSHOP)
        made.actor.handle(JoinQueue(RIDE))
        made.accept("L3", holder=WORKSHOP)

    on_spine(check)


def test_a_silent_holder_makes_way_for_the_first_in_line_alone() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.actor.handle(JoinQueue(RIDE))
        await elapse(35)
        assert made.open_refused(SECOND).code is Refusal.HELD
        assert made.read(session).over is None
        assert "silent_holder" in (await made.alarms())[-1]
        made.opened(RIDE)
        over = made.read(session).over
        assert over is not None
        assert over.reason is EndReason.TAKEN_OVER

    on_bench(check, PLAIN, takeover_after_s=30.0)
