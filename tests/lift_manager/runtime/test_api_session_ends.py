"""How long a session of its holder's own lasts, and what it says of its end in each phase."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from lift_manager.lift.commands import CommandState, CommandType, SessionInfo
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.session import Advice, EndReason
from register_maps.words import Door, Mode, Motion
from simulator.controller import Inputs
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.lift_manager.runtime.test_followed import boarded, called
from tests.support.session_calls import ROBOT
from tests.support.spine import Spine, on_spine
from tests.support.virtual_time import elapse

Phase = Callable[[Spine, SessionInfo], Awaitable[None]]


async def opened(made: Spine, session: SessionInfo) -> None:
    assert made.read(session).floor is None


async def asked(made: Spine, session: SessionInfo) -> None:
    made.taken(session, CommandType.GO_TO, "L3")


async def under_way(made: Spine, session: SessionInfo) -> None:
    await made.done(session, CommandType.GO_TO, "L3")
    await made.until(lambda state: state.motion is Motion.UP)


async def open_there(made: Spine, session: SessionInfo) -> None:
    await made.done(session, CommandType.GO_TO, "L2")
    await made.until(lambda state: state.robot_door is RobotDoor.OPEN)


async def aboard(made: Spine, session: SessionInfo) -> None:
    await open_there(made, session)
    await made.done(session, CommandType.ROBOT_IN_PLACE)
    await made.done(session, CommandType.GO_TO, "L3")


PHASES: list[Phase] = [opened, asked, under_way, open_there, aboard]


async def fire(made: Spine) -> EndReason:
    made.people(Inputs(fire=True))
    return EndReason.FIRE


async def lockout(made: Spine) -> EndReason:
    made.site.lock_out("lift", "M. Weber", "ropes", at_once=True)
    return EndReason.LOCKOUT


async def forced(made: Spine) -> EndReason:
    made.site.force_release("lift", "M. Weber", "it blocks the lift", at_once=True)
    return EndReason.FORCED


ENDS: list[Callable[[Spine], Awaitable[EndReason]]] = [fire, lockout, forced]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("phase", PHASES)
def test_people_end_a_session_in_every_phase_and_it_says_why(
    phase: Phase, end: Callable[[Spine], Awaitable[EndReason]]
) -> None:
    async def check(made: Spine) -> None:
        session = made.opened()
        await phase(made, session)
        reason = await end(made)
        await elapse(2)
        info = made.read(session)
        assert info.over is not None
        assert (info.over.reason, info.over.advice) != (reason, None)
        assert info.over.reason is reason
        assert info.over.text
        assert (info.lease_ends_in_s, info.ends_in_s, info.door_held, info.hold_door) == (None, None, False, False)
        refused = made.refused_within(session, CommandType.GO_TO, "L1")
        assert info.over.text in refused.message
        may_be_in = phase in (open_there, aboard)
        assert (info.robot in (Occupancy.MAY_BOARD, Occupancy.ABOARD)) is may_be_in
        assert made.state.restrictions.maybe_aboard == (ROBOT if may_be_in else None)
        if phase is open_there:
            made.closed(session, RobotWord.LEFT)
            assert made.read(session).robot is Occupancy.EXITED
            assert made.state.restrictions.maybe_aboard is None

    on_spine(check)


def test_a_robot_behind_a_shut_door_is_told_to_stay_aboard() -> None:
    async def check(made: Bench) -> None:
        session = await boarded(made)
        made.taken(session, CommandType.GO_TO, "L3")
        await elapse(0.5)
        await made.car(None, Door.CLOSED)
        await made.mode(Mode.FIRE)
        over = made.read(session).over
        assert over is not None
        assert (over.reason, over.advice) == (EndReason.FIRE, Advice.STAY_ABOARD)

    on_bench(check, PLAIN)


def test_the_lease_is_what_its_holder_asks_for_between_three_times_clear_s_and_the_sites() -> None:
    async def check(made: Bench) -> None:
        for ttl_s, lease_s in ((None, 12.0), (1000.0, 12.0), (8.0, 8.0), (2.0, 6.0)):
            session = made.opened(ttl_s=ttl_s)
            assert made.read(session).lease_ends_in_s == pytest.approx(lease_s)
            await elapse(lease_s - 1)
            assert made.read(session).over is None
            renewed = made.site.renew_session("lift", session.id, ROBOT, ttl_s)
            assert renewed.lease_ends_in_s == pytest.approx(lease_s)
            await elapse(lease_s + 0.5)
            over = made.read(session).over
            assert over is not None
            assert (over.reason, over.text) == (EndReason.LEASE, f"the lease of {lease_s:g} s ran out")

    on_bench(check, PLAIN, lease_s=12.0, clear_s=2.0)


@pytest.mark.parametrize(("asked_s", "given_s"), [(None, 40.0), (50.0, 50.0), (5.0, 30.0), (500.0, 60.0)])
def test_a_renewal_keeps_the_length_of_the_lease_unless_it_asks_for_another(
    asked_s: float | None, given_s: float
) -> None:
    async def check(made: Bench) -> None:
        session = made.opened(ttl_s=40.0)
        await elapse(5)
        renewed = made.site.renew_session("lift", session.id, ROBOT, asked_s)
        assert renewed.lease_ends_in_s == pytest.approx(given_s)

    on_bench(check, PLAIN, lease_s=60.0)


def test_a_session_that_is_renewed_again_and_again_ends_where_the_site_says() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        while (info := made.read(session)).over is None:
            assert info.ends_in_s is not None
            assert info.ends_in_s <= 40
            made.site.renew_session("lift", session.id, ROBOT, None)
            await elapse(5)
        assert info.over.reason is EndReason.MAX_SESSION
        assert info.over.advice is not None

    on_bench(check, PLAIN, max_session_s=40.0)


def test_a_manager_that_stops_takes_no_more_requests() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await made.life.stop()
        over = made.read(session).over
        assert over is not None
        assert over.reason is EndReason.STOPPING
        assert made.open_refused().code == "stopping"

    on_bench(check, PLAIN)


def test_a_request_that_is_pending_when_the_manager_stops_says_what_became_of_it() -> None:
    async def unsent(made: Bench) -> None:
        session = made.opened()
        followed = made.taken(session, CommandType.GO_TO, "L1")
        assert followed.state is CommandState.PENDING
        await made.life.stop()
        after = made.now(session, followed)
        assert after.state is CommandState.REJECTED
        assert after.reason.startswith("the manager is stopping: nothing was sent for it; the session continues when")

    async def sent(made: Bench) -> None:
        session = await called(made)
        made.driver.unseen = True
        followed = made.taken(session, CommandType.RELEASE_DOOR)
        assert followed.state is CommandState.PENDING
        await made.life.stop()
        after = made.now(session, followed)
        assert after.state is CommandState.UNCONFIRMED
        assert after.reason.startswith("the manager is stopping: it was sent to the lift, and nobody watches")

    on_bench(unsent, replace(PLAIN, requires={"go_to": frozenset({"robot_mode_on"})}))
    on_bench(sent, PLAIN)


def test_an_orderly_close_gives_no_advice_and_lets_everything_go() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        pending = made.taken(session, CommandType.GO_TO, "L1")
        assert pending.state is CommandState.CONFIRMED
        over = made.closed(session, RobotWord.LEFT).over
        assert over is not None
        assert (over.reason, over.advice) == (EndReason.RELEASED, None)
        assert made.closed(session).over == over
        assert made.driver.on == set()

    on_bench(check, PLAIN)
