"""What a step makes known, what it saves, and how a ride goes on after a reply or an event of its lift."""

from dataclasses import replace

import pytest

from drivers.model import Proof
from lift_manager.lift.commands import REPLACED, CommandState, CommandStatus, CommandType
from lift_manager.lift.events import Alarm, CommandFollowed
from lift_manager.lift.inputs import LiftRequest
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import Accepted, Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.rides.inputs import (
    BeginAgain,
    FoundOutside,
    LiftReply,
    RideChanged,
    SettleOthers,
    TakeLift,
    row_of,
)
from lift_manager.rides.ride import Guidance, Phase, RideWord
from lift_manager.rides.step import TICK_S, at_moment, begin
from tests.lift_manager.rides.by_hand import (
    ANY,
    CLOSE,
    CLOSE_LEFT,
    HOLDER,
    NOON,
    OFFLINE,
    OPEN,
    OTHER,
    RENEW,
    REQUEST,
    SESSION,
    STATE,
    at,
    away,
    cancel,
    go_to,
    here,
    kept_out,
    report,
    ride,
    session,
    sight,
    take,
    tick,
    to_lift,
)

OPENED = LiftReply(OPEN.request, SessionBegun(SESSION, is_new=True))
IN_CAR = kept_out(maybe_aboard=HOLDER)
TOLD_LEFT = to_lift(LiftRequest(HOLDER, "L2", hold_door=False, robot=RobotWord.LEFT))


def followed(
    kind: CommandType = CommandType.GO_TO, state: CommandState = CommandState.REJECTED, reason: str = "no answer"
) -> CommandFollowed:
    status = CommandStatus(
        id="c1",
        lift="A",
        holder=HOLDER,
        kind=kind,
        floor="L1",
        state=state,
        reason=reason,
        proof=Proof.NONE,
        requested_at=NOON,
        ended_at=None,
    )
    return CommandFollowed("A", status, is_recorded=True)


# -- what is made known and saved


def test_a_ride_begins_in_the_queue_of_its_lift_and_everybody_is_told() -> None:
    done = begin(REQUEST, "A", "r1", at(5.0))
    (changed,) = done.events
    assert isinstance(changed, RideChanged)
    assert (changed.lift, changed.before, changed.ride.phase) == ("A", None, Phase.QUEUED)
    assert (done.saves, done.record.present_at, done.wake_at) == (("A",), 5.0, 5.0 + TICK_S)
    unnamed = begin(replace(REQUEST, robot=""), "A", "r1", at(5.0))
    assert unnamed.record.present_at < 0, "nobody knows what a robot without a name knows"


def test_a_ride_that_was_begun_from_afar_waits_for_a_report_of_its_robot() -> None:
    done = begin(REQUEST, "A", "r1", at(5.0), is_remote=True)
    assert (done.record.silent_since, done.record.present_at < 0) == (5.0, True)
    (begun,) = done.events
    assert isinstance(begun, RideChanged)
    row = row_of(begun)
    assert row is not None
    assert row.text == "ride r1 of amr-7 from L1 to L3 is queued: begun through the hub"
    waiting = tick(done.record, sight(now=6.0))
    assert (waiting.actions, waiting.record.reason) == (
        (),
        "waits for a report of the robot: it has to send `here` within 29 s to keep its place",
    )
    assert tick(report(waiting.record, RideWord.HERE, sight(now=7.0)).record, sight(now=7.0)).actions == (OPEN,)


def test_a_step_that_changes_nothing_tells_nobody_and_saves_nothing() -> None:
    first = tick(ride(), sight(ahead=1))
    again = tick(first.record, sight(ahead=1, now=2.0))
    assert (first.saves, len(first.events)) == ((), 1)
    assert (again.saves, again.events) == ((), ())


def test_a_change_that_a_restart_has_to_know_is_saved() -> None:
    assert take(ride(), OPENED, sight()).saves == ("A",)
    moved = tick(ride(Phase.BOARDING), sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True)))
    assert (moved.record.could_exit_at, moved.saves) == ("L1", ("A",))


def test_people_hear_of_an_alarm_after_the_change_that_it_is_about() -> None:
    done = tick(ride(Phase.RIDING), sight(OFFLINE, session("L3", Occupancy.ABOARD), now=200.0))
    assert [type(event) for event in done.events] == [RideChanged, Alarm]


def test_a_ride_that_is_over_needs_no_tick() -> None:
    assert tick(ride(Phase.DONE), sight()).wake_at == float("inf")


def test_the_journal_has_a_row_of_each_phase_and_none_of_guidance() -> None:
    (begun,) = begin(REQUEST, "A", "r1", at(0.0)).events
    assert isinstance(begun, RideChanged)
    row = row_of(begun)
    assert row is not None
    assert (row.text, row.caller) == ("ride r1 of amr-7 from L1 to L3 is queued", "ride:fleet")
    (waits,) = tick(ride(), sight(ahead=1)).events
    assert isinstance(waits, RideChanged)
    assert row_of(waits) is None


# -- replies


def test_a_lift_that_is_held_or_queued_for_did_not_turn_the_ride_away_for_a_reason_of_its_own() -> None:
    own = take(ride(), LiftReply(OPEN.request, Refused(Refusal.OUTSIDE_HOURS, "its hours are over")), sight())
    assert (own.lift_refusal, own.record.failure) == ("its hours are over", "its hours are over")
    held = take(ride(), LiftReply(OPEN.request, Refused(Refusal.HELD, "A is held by rmf:tiny")), sight())
    assert (held.lift_refusal, held.record.failure) == ("", "A is held by rmf:tiny")


def test_a_renewal_does_not_hide_why_the_request_before_it_failed() -> None:
    failed = ride(Phase.CALLED, failure="go_to rejected: no answer")
    assert take(failed, LiftReply(RENEW.request, SESSION), sight(now=3.0)).record.failure == failed.failure
    refused = take(failed, LiftReply(RENEW.request, Refused(Refusal.SESSION_OVER, "over")), sight(now=3.0)).record
    assert (refused.failure, refused.requested_at) == ("over", 3.0)


def test_once_the_lift_knows_that_the_robot_is_out_the_holders_earlier_rides_are_settled() -> None:
    done = take(ride(Phase.DONE), LiftReply(CLOSE_LEFT.request, SESSION), sight(STATE))
    assert done.actions == (SettleOthers(),)


def test_a_lift_that_still_doubts_is_told_once_more_that_the_robot_left_and_then_a_person_must_look() -> None:
    over = ride(Phase.DONE)
    closed = take(over, LiftReply(CLOSE_LEFT.request, SESSION), sight(IN_CAR))
    assert closed.actions == (TOLD_LEFT,)
    settled = take(over, LiftReply(TOLD_LEFT.request, Accepted()), sight(STATE))
    assert settled.actions == (SettleOthers(),)
    doubted = take(over, LiftReply(TOLD_LEFT.request, Accepted()), sight(IN_CAR))
    assert (doubted.actions, doubted.record.maybe_aboard) == ((), True)
    assert doubted.record.reason.startswith("the lift has not shown how the robot got out; a person must look")
    held = take(over, LiftReply(CLOSE_LEFT.request, SESSION), sight(replace(IN_CAR, holder=OTHER)))
    assert (held.actions, held.record.maybe_aboard) == ((), True)


def test_a_session_that_is_given_back_without_a_word_of_the_robot_settles_nothing() -> None:
    assert take(ride(Phase.CANCELLED), LiftReply(CLOSE.request, SESSION), sight()).actions == ()


# -- events of the lift


@pytest.mark.parametrize(
    ("event", "failure"),
    [
        (followed(), "go_to rejected: no answer"),
        (followed(state=CommandState.UNCONFIRMED), "go_to unconfirmed: no answer"),
        (followed(CommandType.ROBOT_IN_PLACE), "robot_in_place rejected: no answer"),
        (followed(CommandType.HOLD_DOOR), ""),
        (followed(state=CommandState.CONFIRMED), ""),
        (followed(reason=REPLACED), ""),
    ],
)
def test_a_command_that_came_to_nothing_is_why_the_car_does_not_come(event: CommandFollowed, failure: str) -> None:
    record = take(ride(Phase.CALLED), event, sight(away(), session("L1"))).record
    assert record.failure == failure
    shown = at_moment(record, sight(away(), session("L1")).seen, at(1.0))
    assert shown.reason == (failure or "the car is on its way to L1")


def test_a_ride_whose_robot_was_found_outside_keeps_everything_else() -> None:
    over = ride(Phase.GAVE_UP, maybe_aboard=True, reason="too late")
    done = take(over, FoundOutside(), sight())
    assert done.record == replace(over, maybe_aboard=False)
    assert (len(done.events), done.saves) == (1, ("A",))


# -- another lift, another try


def test_a_ride_that_takes_another_lift_waits_there_with_what_it_sees_there() -> None:
    waiting = replace(ride(failure="A takes robots 06:00 to 20:00", offline_since="11:00:00"), request=ANY)
    done = take(waiting, TakeLift("B"), sight(replace(STATE, lift="B"), ahead=2, now=4.0))
    assert (done.record.lift, done.record.reason, done.record.ahead) == ("B", "2 wait before it", 2)
    assert (done.saves, done.actions) == (("B", "A"), ())
    offline = take(waiting, TakeLift("B"), sight(replace(OFFLINE, lift="B", holder=None), now=4.0))
    assert offline.record.reason == "B is offline since 11:59:55"


def test_a_request_that_is_repeated_with_its_key_stands_for_its_robot_after_a_restart() -> None:
    assert take(ride(silent_since=0.0), BeginAgain(), sight()).record.silent_since is None


def test_a_word_that_makes_no_sense_still_shows_that_the_robot_is_there() -> None:
    done = report(ride(silent_since=0.0), RideWord.ENTERED, sight())
    assert done.reply is not None
    assert done.record == ride()


def test_the_caller_speaks_for_its_robot_and_an_operator_does_not() -> None:
    silent = ride(Phase.RIDING, silent_since=0.0, stands=("L2", -5.0))
    seen = sight(here("L2", RobotDoor.CLOSED), session("L3", Occupancy.ABOARD))
    by_caller = cancel(silent, seen)
    assert (by_caller.record.silent_since, by_caller.actions) == (None, (go_to("L2"),))
    by_operator = cancel(silent, seen, by_operator=True)
    assert (by_operator.record.silent_since, by_operator.actions) == (0.0, ())


def test_a_ride_is_shown_with_news_that_no_step_has_taken_yet() -> None:
    seen = sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True), now=2.0)
    shown = at_moment(ride(Phase.CALLED), seen.seen, seen.moment)
    assert (shown.phase, shown.guidance, shown.phase_ends_in_s) == (Phase.BOARDING, Guidance.ENTER, 120.0)
