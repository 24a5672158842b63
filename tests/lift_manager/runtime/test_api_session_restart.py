"""A session of its holder's own outlives the manager in every phase, and nothing is pressed before its holder is heard."""

from collections.abc import Awaitable, Callable

import pytest

from drivers.model import LiftValues
from lift_manager.lift.commands import CommandState, CommandType, SessionInfo
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import EndReason
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.scripted import FRONT, OTHER, PERMITTING, PLAIN, Bench
from tests.lift_manager.runtime.test_followed import boarded, called
from tests.lift_manager.runtime.test_session_restart import HOLD, OPEN_AT_L1, UNDER_WAY, WITH_MODE, restarted
from tests.support.refusals import refusal
from tests.support.session_calls import ROBOT, SECOND
from tests.support.virtual_time import elapse

TTL_S = 45.0
AT_L1 = LiftValues(floor="L1", mode=Mode.NORMAL, doors={FRONT: Door.CLOSED})

Before = Callable[[Bench], Awaitable[SessionInfo]]
After = Callable[[Bench, SessionInfo], Awaitable[None]]


def over_a_restart(before: Before, after: After, *given: object, **more: object) -> MemoryRecorder:
    """As `restarted`, with the session that was opened before."""
    kept: list[SessionInfo] = []

    async def first(made: Bench) -> None:
        kept.append(await before(made))

    async def second(made: Bench) -> None:
        await after(made, kept[0])

    return restarted(first, second, *given, **more)  # type: ignore[arg-type]  # those of restarted


async def opened(made: Bench) -> SessionInfo:
    return made.opened(key="one", ttl_s=TTL_S)


async def asked(made: Bench) -> SessionInfo:
    session = await opened(made)
    made.taken(session, CommandType.GO_TO, "L1")
    await elapse(0.5)
    assert made.presses == ["go_to L1"]
    return session


async def arrived(made: Bench) -> SessionInfo:
    session = await asked(made)
    await made.car(None, Door.CLOSED)
    await made.car("L1", Door.OPEN, enter=True)
    assert made.read(session).door_held
    return session


async def aboard(made: Bench) -> SessionInfo:
    session = await arrived(made)
    await made.done(session, CommandType.ROBOT_IN_PLACE)
    return session


PHASES: list[tuple[Before, LiftValues, Occupancy]] = [
    (opened, AT_L1, Occupancy.OUTSIDE),
    (asked, UNDER_WAY, Occupancy.OUTSIDE),
    (arrived, OPEN_AT_L1, Occupancy.MAY_BOARD),
    (aboard, OPEN_AT_L1, Occupancy.ABOARD),
]


@pytest.mark.parametrize(("before", "found", "robot"), PHASES)
def test_it_is_the_same_session_and_nothing_is_pressed_before_its_holder_is_heard(
    before: Before, found: LiftValues, robot: Occupancy
) -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        await elapse(15)
        assert made.driver.log == []
        info = made.read(session)
        assert (info.id, info.holder, info.restored, info.over) == (session.id, ROBOT, True, None)
        assert info.robot in (robot, Occupancy.MAY_BOARD if found is OPEN_AT_L1 else robot)
        assert info.lease_ends_in_s is not None
        assert info.lease_ends_in_s <= TTL_S - 15
        assert made.opened(key="one", ttl_s=TTL_S).id == session.id
        assert made.open_refused(key="one").code is Refusal.KEY_REUSED
        assert refusal(made.site.session, "lift", session.id, SECOND).code is Refusal.NO_SUCH_SESSION
        await elapse(TTL_S)
        over = made.read(session).over
        assert over is not None
        assert (over.reason, over.text) == (EndReason.LEASE, "the lease of 45 s ran out")

    over_a_restart(before, after, PLAIN, found=found)


def test_a_renewal_makes_it_go_on() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        await elapse(10)
        assert made.driver.log == []
        renewed = made.site.renew_session("lift", session.id, ROBOT, TTL_S)
        assert not renewed.restored
        assert renewed.lease_ends_in_s == pytest.approx(TTL_S)
        await elapse(1)
        assert made.driver.log == [f"hold {HOLD}"]

    over_a_restart(arrived, after, PLAIN)


def test_a_renewal_of_one_that_was_asked_for_no_floor_presses_robot_mode_alone() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        await elapse(10)
        assert made.driver.log == []
        made.site.renew_session("lift", session.id, ROBOT, None)
        await elapse(5)
        assert made.driver.log == ["hold robot_mode"]

    over_a_restart(opened, after, WITH_MODE, found=AT_L1)


def test_a_request_makes_it_go_on_and_a_door_that_was_let_go_stays_so() -> None:
    async def before(made: Bench) -> SessionInfo:
        session = await arrived(made)
        await made.done(session, CommandType.RELEASE_DOOR)
        return session

    async def after(made: Bench, session: SessionInfo) -> None:
        await elapse(5)
        assert made.driver.log == []
        await made.done(session, CommandType.ROBOT_IN_PLACE)
        await elapse(2)
        assert made.driver.log == []
        went = made.taken(session, CommandType.GO_TO, "L3")
        assert (await made.ended(session, went)).state is CommandState.CONFIRMED
        assert made.presses == ["go_to L3"]

    over_a_restart(before, after, PLAIN)


def test_one_that_ran_out_meanwhile_says_so_and_its_robot_may_still_say_that_it_left() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        over = made.read(session).over
        assert over is not None
        assert over.reason is EndReason.LEASE
        assert made.state.restrictions.maybe_aboard == ROBOT
        made.closed(session, RobotWord.LEFT)
        assert made.state.restrictions.maybe_aboard is None

    over_a_restart(arrived, after, PLAIN, off_s=TTL_S + 11)


def test_a_session_without_a_floor_keeps_what_is_known_of_its_robot_over_a_restart() -> None:
    async def before(made: Bench) -> SessionInfo:
        first = await called(made)
        made.site.force_release("lift", "M. Weber", "it blocks the lift", at_once=True)
        assert made.read(first).robot is Occupancy.MAY_BOARD
        return made.opened()

    async def after(made: Bench, session: SessionInfo) -> None:
        assert made.read(session).robot is Occupancy.MAY_BOARD
        made.closed(session)
        assert made.state.restrictions.maybe_aboard == ROBOT
        assert made.open_refused(OTHER).code == "occupancy_unknown"

    over_a_restart(before, after, PERMITTING)


def test_a_robot_aboard_goes_on_without_being_announced_twice() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        assert made.read(session).robot is Occupancy.ABOARD
        await made.done(session, CommandType.GO_TO, "L3")
        assert made.presses == ["go L3"]

    over_a_restart(boarded_in_words, after, PERMITTING)


async def boarded_in_words(made: Bench) -> SessionInfo:
    session = await called(made)
    await made.done(session, CommandType.ROBOT_IN_PLACE)
    return session


def test_another_caller_gets_a_lift_whose_holder_was_not_heard_since_a_restart() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        second = made.opened(SECOND)
        over = made.read(session).over
        assert over is not None
        assert over.reason is EndReason.UNCLAIMED
        assert made.read(second).over is None

    over_a_restart(asked, after, PLAIN, found=UNDER_WAY)


def test_whose_robot_may_be_in_the_car_is_kept_after_a_restart_though_unclaimed() -> None:
    async def after(made: Bench, session: SessionInfo) -> None:
        assert made.open_refused(SECOND).code == "held"
        assert made.read(session).over is None

    over_a_restart(boarded, after, PLAIN)
