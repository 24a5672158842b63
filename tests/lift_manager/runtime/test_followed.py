"""What becomes of each request within a session, down to every way in which it may fail."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from drivers.model import Proof, Result
from lift_manager.lift.commands import COMMANDS, DOOR_WITHIN_S, CommandState, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.events import CommandFollowed
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Door
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.scripted import PERMITTING, PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

CLOSING = replace(PLAIN, commands=PLAIN.commands | {"close_door.front"})


async def called(made: Bench, floor: str = "L1") -> SessionInfo:
    """Open a session and let the car arrive."""
    session = made.opened()
    made.taken(session, CommandType.GO_TO, floor)
    await elapse(0.5)
    await made.car(None, Door.CLOSED)
    await made.car(floor, Door.OPEN, enter=True)
    assert made.read(session).arrived
    return session


async def boarded(made: Bench) -> SessionInfo:
    session = await called(made)
    assert (await made.done(session, CommandType.ROBOT_IN_PLACE)).proof is Proof.NONE
    return session


def ends(followed: CommandStatus) -> tuple[CommandState, str]:
    return followed.state, followed.reason


@pytest.mark.parametrize(
    ("result", "status"), [(Result.REJECTED, CommandState.REJECTED), (Result.UNCONFIRMED, CommandState.UNCONFIRMED)]
)
def test_a_call_that_fails_says_how_and_is_not_pressed_again_at_once(result: Result, status: CommandState) -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.driver.answers["go_to"] = result
        went = made.taken(session, CommandType.GO_TO, "L1")
        assert went.state is CommandState.PENDING
        assert ends(await made.ended(session, went)) == (status, "as told")
        again = made.taken(session, CommandType.GO_TO, "L1")
        assert again.state is CommandState.REJECTED
        assert "it may be pressed again in" in again.reason
        assert made.presses == ["go_to L1"]
        await elapse(2)
        made.driver.answers.clear()
        assert (await made.ended(session, made.taken(session, CommandType.GO_TO, "L1"))).state is CommandState.CONFIRMED
        assert made.presses == ["go_to L1"] * 2

    on_bench(check, PLAIN)


def test_a_call_to_where_the_car_stands_is_confirmed_by_that() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        assert (await made.done(session, CommandType.GO_TO, "L2")).proof is Proof.EFFECT
        assert made.presses == []

    on_bench(check, PLAIN)


def test_a_call_that_another_one_takes_the_place_of_is_rejected_before_its_press_and_unconfirmed_after() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.driver.delay_s = 1.0
        pressed = made.taken(session, CommandType.GO_TO, "L1")
        await elapse(0.2)
        second = made.taken(session, CommandType.GO_TO, "L3")
        assert ends(made.now(session, pressed)) == (CommandState.UNCONFIRMED, "another request took its place")
        assert (await made.ended(session, second)).state is CommandState.CONFIRMED

    on_bench(check, PLAIN, poll_s=0.2)

    async def unpressed(made: Bench) -> None:
        session = made.opened()
        waiting = made.taken(session, CommandType.GO_TO, "L1")
        made.taken(session, CommandType.GO_TO, "L3")
        assert ends(made.now(session, waiting)) == (CommandState.REJECTED, "another request took its place")
        assert made.presses == []

    needs = replace(PLAIN, requires={"go_to": frozenset({"ready"})}, signals=PLAIN.signals | {"robot_mode_on"})
    on_bench(unpressed, needs, poll_s=0.2)


def test_a_repeat_of_a_call_shares_its_fate_and_presses_nothing() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        first, second = made.taken(session, CommandType.GO_TO, "L1"), made.taken(session, CommandType.GO_TO, "L1")
        assert first.id != second.id
        assert (await made.ended(session, first)).state is CommandState.CONFIRMED
        assert (await made.ended(session, second)).state is CommandState.CONFIRMED
        assert made.presses == ["go_to L1"]

    on_bench(check, PLAIN)


def test_a_call_that_the_lift_does_not_grant_ends_with_its_session_as_rejected() -> None:
    able = replace(PLAIN, requires={"go_to": frozenset({"robot_mode_on"})}, granted_within_s=20.0)

    async def check(made: Bench) -> None:
        session = made.opened()
        went = made.taken(session, CommandType.GO_TO, "L1")
        assert "robot_mode_on for go_to" in went.reason
        status, reason = ends(await made.ended(session, went))
        assert (status, "was not granted within 20 s" in reason) == (CommandState.REJECTED, True)

    on_bench(check, able)


def test_a_hold_fails_with_the_call_that_it_waits_for() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.taken(session, CommandType.GO_TO, "L1", hold=False)
        await elapse(0.5)
        hold = made.taken(session, CommandType.HOLD_DOOR)
        assert hold.state is CommandState.PENDING
        within_s = made.driver.capabilities.arrive_within_s + 5
        status, reason = ends(await made.ended(session, hold, within_s))
        assert status is CommandState.REJECTED
        assert "the call to L1 failed" in reason

    on_bench(check, PLAIN)


def test_a_hold_that_is_never_seen_on_ends_unconfirmed() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await made.done(session, CommandType.RELEASE_DOOR)
        made.driver.unseen = True
        hold = made.taken(session, CommandType.HOLD_DOOR)
        status, reason = ends(await made.ended(session, hold, DOOR_WITHIN_S + 1))
        assert (status, "did not show within 10 s that the door is held" in reason) == (CommandState.UNCONFIRMED, True)

    on_bench(check, PLAIN)


def test_a_door_that_is_never_seen_let_go_ends_unconfirmed_and_close_is_not_pressed_then() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await made.done(session, CommandType.ROBOT_LEFT)
        made.driver.unseen = True
        let_go = made.taken(session, CommandType.RELEASE_DOOR)
        status, reason = ends(await made.ended(session, let_go, DOOR_WITHIN_S + 1))
        assert (status, "the release is repeated until it does" in reason) == (CommandState.UNCONFIRMED, True)
        close = made.taken(session, CommandType.CLOSE_DOOR)
        status, reason = ends(await made.ended(session, close, DOOR_WITHIN_S + 1))
        assert (status, "did not show within 10 s that the door is released" in reason) == (CommandState.REJECTED, True)
        assert "close_door.front" not in made.presses

    on_bench(check, CLOSING)


@pytest.mark.parametrize(
    ("result", "status"), [(Result.REJECTED, CommandState.REJECTED), (Result.UNCONFIRMED, CommandState.UNCONFIRMED)]
)
def test_a_close_button_ends_as_its_press_does(result: Result, status: CommandState) -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await made.done(session, CommandType.ROBOT_LEFT)
        made.driver.answers["close_door.front"] = result
        close = made.taken(session, CommandType.CLOSE_DOOR)
        assert ends(await made.ended(session, close)) == (status, "as told")
        assert made.presses[-1] == "close_door.front"

    on_bench(check, CLOSING)


def test_a_close_is_not_pressed_once_the_car_has_left() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await made.done(session, CommandType.ROBOT_LEFT)
        made.driver.unseen = True
        close = made.taken(session, CommandType.CLOSE_DOOR)
        await made.car("L3", Door.CLOSED)
        made.driver.unseen = False
        await elapse(1)
        answer = made.now(session, close)
        assert answer.state is not CommandState.CONFIRMED
        assert "close_door.front" not in made.presses

    on_bench(check, CLOSING)


def test_a_word_that_the_lift_takes_is_confirmed_by_its_press_and_one_it_has_no_signal_for_at_once() -> None:
    async def words(made: Bench) -> None:
        session = await called(made)
        placed = made.taken(session, CommandType.ROBOT_IN_PLACE)
        assert placed.state is CommandState.PENDING
        assert (await made.ended(session, placed)).state is CommandState.CONFIRMED
        assert made.presses == ["call L1", "robot_in_place"]
        assert made.taken(session, CommandType.ROBOT_IN_PLACE).state is CommandState.CONFIRMED
        made.taken(session, CommandType.GO_TO, "L3")
        await elapse(0.5)
        await made.car(None, Door.CLOSED)
        await made.car("L3", Door.OPEN, leave=True)
        await made.done(session, CommandType.ROBOT_LEFT)
        assert made.presses[-1] == "robot_left"
        assert made.read(session).robot is Occupancy.EXITED
        assert made.closed(session, RobotWord.LEFT).robot is Occupancy.EXITED

    on_bench(words, PERMITTING)

    async def none(made: Bench) -> None:
        session = await called(made)
        answer = made.taken(session, CommandType.ROBOT_IN_PLACE)
        assert (answer.state, answer.proof) == (CommandState.CONFIRMED, Proof.NONE)
        assert made.read(session).robot is Occupancy.ABOARD

    on_bench(none, PLAIN)


@pytest.mark.parametrize(
    ("result", "status"), [(Result.REJECTED, CommandState.REJECTED), (Result.UNCONFIRMED, CommandState.UNCONFIRMED)]
)
def test_a_word_that_the_lift_does_not_take_ends_as_its_press_does(result: Result, status: CommandState) -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        made.driver.answers["robot_in_place"] = result
        placed = made.taken(session, CommandType.ROBOT_IN_PLACE)
        assert ends(await made.ended(session, placed)) == (status, "as told")
        again = made.taken(session, CommandType.ROBOT_IN_PLACE)
        assert "it may be pressed again in" in again.reason

    on_bench(check, PERMITTING)


def test_a_word_takes_the_place_of_the_other_one() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        made.driver.delay_s = 2.0
        placed = made.taken(session, CommandType.ROBOT_IN_PLACE)
        await made.car("L1", Door.OPEN, enter=True, leave=True)
        made.taken(session, CommandType.ROBOT_LEFT)
        assert ends(made.now(session, placed)) == (CommandState.UNCONFIRMED, "another request took its place")

    on_bench(check, PERMITTING)


def test_a_floor_that_the_robot_may_have_boarded_for_is_refused_until_it_says_where_it_is() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        refused = made.refused_within(session, CommandType.GO_TO, "L3")
        assert refused.code is Refusal.OCCUPANCY_UNKNOWN
        assert made.refused_within(session, CommandType.GO_TO, "L9").code is Refusal.UNKNOWN_FLOOR
        await made.done(session, CommandType.ROBOT_IN_PLACE)
        await made.done(session, CommandType.GO_TO, "L3")

    on_bench(check, PERMITTING)


def test_a_hold_that_was_spent_is_not_taken_up_again_at_this_floor() -> None:
    async def check(made: Bench) -> None:
        session = await called(made)
        await elapse(31)
        assert not made.read(session).door_held
        assert made.refused_within(session, CommandType.HOLD_DOOR).code is Refusal.NOT_NOW
        await made.done(session, CommandType.RELEASE_DOOR)
        assert made.refused_within(session, CommandType.HOLD_DOOR).code is Refusal.NOT_NOW

    on_bench(check, PLAIN, max_session_hold_s=30.0)


def test_a_hold_without_a_floor_makes_no_sense() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        assert made.refused_within(session, CommandType.HOLD_DOOR).code is Refusal.NOT_NOW
        assert made.taken(session, CommandType.RELEASE_DOOR).state is CommandState.CONFIRMED

    on_bench(check, PLAIN)


async def by_its_holder(made: Bench, session: SessionInfo) -> None:
    made.closed(session)


async def by_a_person(made: Bench, session: SessionInfo) -> None:
    made.site.force_release("lift", "M. Weber", "it blocks the lift")


async def by_time(made: Bench, session: SessionInfo) -> None:
    await elapse(41)


@pytest.mark.parametrize("over", [by_its_holder, by_a_person, by_time])
def test_the_end_of_a_session_ends_whatever_is_pending_in_it(
    over: Callable[[Bench, SessionInfo], Awaitable[None]],
) -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        went = made.taken(session, CommandType.GO_TO, "L1")
        hold = made.taken(session, CommandType.HOLD_DOOR)
        await over(made, session)
        why = made.read(session).over
        assert why is not None
        for one in (went, hold):
            status, reason = ends(made.now(session, one))
            assert status is CommandState.REJECTED
            assert reason == f"the session is over: {why.text}"
        assert made.presses == []

    able = replace(PLAIN, requires={"go_to": frozenset({"robot_mode_on"})}, granted_within_s=3000.0)
    on_bench(check, able, max_session_s=40.0)


def test_what_was_pressed_is_unconfirmed_once_the_session_is_over() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        made.driver.delay_s = 1.0
        went = made.taken(session, CommandType.GO_TO, "L1")
        await elapse(0.2)
        made.closed(session)
        assert made.now(session, went).state is CommandState.UNCONFIRMED

    on_bench(check, PLAIN, poll_s=0.2)


def test_a_request_that_many_came_after_is_not_left_pending_for_whoever_waits() -> None:
    async def check(made: Bench) -> None:
        session = made.opened()
        for _ in range(COMMANDS + 1):
            made.taken(session, CommandType.GO_TO, "L1")
        events = only(await heard(made.heard), CommandFollowed)
        ended = [event.status for event in events if event.status.state is CommandState.REJECTED]
        assert [one.reason for one in ended] == [f"more than {COMMANDS} requests came after it"]

    on_bench(check, replace(PLAIN, requires={"go_to": frozenset({"robot_mode_on"})}))


def test_every_request_is_told_twice_once_taken_and_once_ended() -> None:
    async def check(made: Bench) -> None:
        session = await boarded(made)
        told = only(await heard(made.heard), CommandFollowed)
        of = {
            event.status.id: [other.status.state for other in told if other.status.id == event.status.id]
            for event in told
        }
        assert list(of.values()) == [[CommandState.PENDING, CommandState.CONFIRMED]] * 2
        assert session.id not in str(told)

    on_bench(check, PLAIN)
