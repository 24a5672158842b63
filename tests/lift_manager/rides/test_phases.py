"""How a ride goes on by what is seen, phase by phase."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.rides.inputs import LiftReply
from lift_manager.rides.observation import RideInDoubt
from lift_manager.rides.phases import REPEAT_S
from lift_manager.rides.record import RESTORED_FOR_S, Clearing, published
from lift_manager.rides.ride import Guidance, Phase
from lift_manager.rides.step import at_moment
from register_maps.words import Door, Mode, Side
from tests.lift_manager.rides.by_hand import (
    CLOSE,
    END,
    HOLDER,
    IN_PLACE,
    NOON,
    OFFLINE,
    OPEN,
    RENEW,
    REQUEST,
    SESSION,
    STATE,
    Sight,
    alarms,
    at,
    away,
    ended,
    go_to,
    here,
    kept_out,
    ride,
    session,
    sight,
    take,
    tick,
)
from tests.support.rows import each_row

GOING_ON = [Phase.QUEUED, Phase.CALLED, Phase.BOARDING, Phase.RIDING, Phase.ALIGHTING, Phase.CLEARING]
WITH_SESSION = GOING_ON[1:]
NOT_NOW = Refused(Refusal.OUTSIDE_HOURS, "A takes robots 06:00 to 20:00")
CLEARING = Clearing(Phase.CANCELLED, "withdrawn by its caller: no order")


def test_a_ride_whose_lift_is_free_takes_it_at_once() -> None:
    after = tick(ride(), sight())
    assert after.actions == (OPEN,)
    told = (after.record.guidance, after.record.reason, after.record.ahead)
    assert told == (Guidance.WAIT, "its turn has come: requests A", 0)


@each_row(
    ("state", "ahead", "reason", "shown_ahead"),
    [
        (replace(STATE, holder=Holder("rmf", "tiny")), 0, "A is held by rmf:tiny", 1),
        (STATE, 2, "2 wait before it", 2),
        (replace(OFFLINE, holder=None), 0, "A is offline since 11:59:52", 0),
        (kept_out(lockout="by Ana since noon: oil"), 0, "A is locked out by Ana since noon: oil", 0),
        (kept_out(fire_latched=True), 0, "there was a fire", 0),
        (replace(STATE, mode=Mode.INSPECTION), 0, "the mode of A is inspection", 0),
        (kept_out(maybe_aboard=Holder("rmf", "tiny")), 0, "a robot of rmf:tiny may be in the car", 0),
    ],
)
def test_a_ride_that_cannot_begin_waits_and_says_for_what(
    state: LiftState, ahead: int, reason: str, shown_ahead: int
) -> None:
    after = tick(ride(), sight(state, ahead=ahead))
    assert after.actions == ()
    assert after.record.phase is Phase.QUEUED
    assert after.record.reason.startswith(reason)
    assert after.record.ahead == shown_ahead


def test_the_robot_that_may_be_in_the_car_may_take_it_up_again() -> None:
    assert tick(ride(), sight(kept_out(maybe_aboard=HOLDER))).actions == (OPEN,)


def test_a_lift_that_refused_is_asked_again_after_a_while_and_the_ride_says_why_it_waits() -> None:
    refused = take(ride(), LiftReply(OPEN.request, NOT_NOW), sight(now=10.0)).record
    soon = tick(refused, sight(now=10.0 + REPEAT_S - 0.1))
    assert (soon.actions, soon.record.reason) == ((), NOT_NOW.message)
    assert tick(refused, sight(now=10.0 + REPEAT_S)).actions == (OPEN,)


def test_a_ride_with_its_session_calls_the_car_to_the_robot() -> None:
    called = take(ride(), LiftReply(OPEN.request, SessionBegun(SESSION, is_new=True)), sight(now=2.0)).record
    assert (called.phase, called.phase_since, called.session, called.ahead) == (Phase.CALLED, 2.0, "s1", None)
    assert tick(called, sight(here("L2", RobotDoor.CLOSED), session(None))).actions == (go_to("L1"),)
    under_way = tick(replace(called, requested_at=2.0), sight(away(), session("L1"), now=3.0))
    assert (under_way.actions, under_way.record.reason) == ((), "the car is on its way to L1")


def test_a_car_that_does_not_come_is_asked_for_again() -> None:
    late = sight(away(), session("L1"), now=REPEAT_S)
    assert tick(ride(Phase.CALLED), late).actions == (go_to("L1"),)


OPEN_AT_START = sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True))


def test_the_robot_is_told_to_enter_while_the_door_stands_open_for_it() -> None:
    after = tick(ride(Phase.CALLED), OPEN_AT_START)
    assert (after.record.phase, after.record.guidance, after.record.reason) == (Phase.BOARDING, Guidance.ENTER, "")
    assert after.record.maybe_aboard


def _but(seen: Sight, **more: object) -> Sight:
    """The same, but for some words of the state."""
    return replace(seen, state=replace(seen.state, **more))  # type: ignore[arg-type]  # fields of LiftState


def _with(seen: Sight, **more: object) -> Sight:
    """The same, but for some words of the session."""
    assert seen.session is not None
    return replace(seen, session=replace(seen.session, **more))  # type: ignore[arg-type]  # fields of SessionInfo


NOT_OPEN: dict[str, Callable[[Sight], Sight]] = {
    "offline": lambda seen: _but(seen, quality=Quality.OFFLINE),
    "another floor": lambda seen: _but(seen, floor="L2"),
    "no floor": lambda seen: _but(seen, floor=None),
    "not standing": lambda seen: _but(seen, standing=False),
    "door closing": lambda seen: _but(seen, robot_door=RobotDoor.MOVING, doors={Side.FRONT: Door.CLOSING}),
    "door shut": lambda seen: _but(seen, robot_door=RobotDoor.CLOSED, doors={Side.FRONT: Door.CLOSED}),
    "open and not for robots": lambda seen: _but(seen, robot_door=RobotDoor.MOVING),
    "not its own": lambda seen: _but(seen, holder=Holder("rmf", "tiny")),
    "free": lambda seen: _but(seen, holder=None),
    "not arrived": lambda seen: _with(seen, arrived=False),
    "not held": lambda seen: _with(seen, door_held=False),
    "wanted elsewhere": lambda seen: _with(seen, floor="L2"),
    "not known": lambda seen: replace(seen, session=None),
}


@each_row("fault", NOT_OPEN)
def test_nothing_but_an_open_held_door_of_its_own_lets_a_robot_in_or_out(fault: str) -> None:
    at_start = NOT_OPEN[fault](OPEN_AT_START)
    boarding = tick(ride(Phase.BOARDING), at_start).record
    assert (boarding.phase, boarding.guidance) == (Phase.BOARDING, Guidance.WAIT)
    assert boarding.reason
    there = NOT_OPEN[fault](sight(here("L3"), session("L3", Occupancy.ABOARD, there=True)))
    for phase in (Phase.RIDING, Phase.ALIGHTING):
        inside = tick(ride(phase), there).record
        assert (inside.phase, inside.guidance) == (phase, Guidance.STAY)
        assert inside.reason
    clearing = tick(ride(Phase.CLEARING, has_entered=True, clear_at="L3", clearing=CLEARING), there).record
    assert (clearing.phase, clearing.guidance) == (Phase.CLEARING, Guidance.STAY)
    assert clearing.reason.startswith("withdrawn by its caller: no order; ")


def test_a_lift_that_does_not_permit_it_lets_no_robot_in_though_its_door_is_open() -> None:
    seen = _but(OPEN_AT_START, permissions={"may_enter": False, "may_leave": True})
    after = tick(ride(Phase.BOARDING), seen).record
    assert (after.guidance, after.reason) == (Guidance.WAIT, "the lift does not give `may_enter`")


def test_the_reason_says_since_when_the_lift_is_offline_and_does_not_count_seconds() -> None:
    first = tick(ride(Phase.RIDING), sight(OFFLINE, session("L3", Occupancy.ABOARD), now=3.0)).record
    assert first.reason == "A is offline since 11:59:54"
    assert tick(first, sight(OFFLINE, session("L3", Occupancy.ABOARD), now=4.0)).record.changed_at == first.changed_at


def test_words_that_differ_in_their_seconds_only_are_no_change() -> None:
    waits = replace(session("L1"), waiting_for="the lift, for 3 s")
    first = tick(ride(Phase.CALLED), sight(away(), waits, now=1.0)).record
    then = tick(first, sight(away(), replace(waits, waiting_for="the lift, for 4 s"), now=2.0)).record
    assert (then.reason, then.changed_at) == (first.reason, first.changed_at)


def test_a_robot_inside_is_reported_before_the_car_is_sent_on() -> None:
    just_in = ride(Phase.RIDING)
    assert tick(just_in, sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True))).actions == (
        IN_PLACE,
        go_to("L3"),
    )
    assert tick(just_in, sight(away(), session("L3", Occupancy.ABOARD))).actions == ()


def test_what_was_refused_is_not_asked_for_again_at_once() -> None:
    seen = sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True), now=1.0)
    refused = take(ride(Phase.RIDING), LiftReply(IN_PLACE.request, NOT_NOW), seen).record
    waiting = tick(refused, replace(seen, now=2.0))
    assert (waiting.actions, waiting.record.reason) == ((), NOT_NOW.message)
    assert tick(refused, replace(seen, now=1.0 + REPEAT_S)).actions == (IN_PLACE, go_to("L3"))


def test_the_robot_is_told_to_leave_once_the_door_stands_open_at_its_destination() -> None:
    after = tick(ride(Phase.RIDING), sight(here("L3"), session("L3", Occupancy.ABOARD, there=True))).record
    assert (after.phase, after.guidance, after.could_exit_at) == (Phase.ALIGHTING, Guidance.LEAVE, "L3")


def test_a_lease_is_renewed_before_it_ends() -> None:
    there = replace(session("L3", Occupancy.ABOARD, there=True), lease_ends_in_s=60.0)
    assert tick(ride(Phase.ALIGHTING), sight(here("L3"), there, now=9.0)).actions == ()
    assert tick(ride(Phase.ALIGHTING), sight(here("L3"), there, now=10.0)).actions == (RENEW,)
    short = replace(there, lease_ends_in_s=1.5)
    assert tick(ride(Phase.ALIGHTING), sight(here("L3"), short, now=1.5)).actions == (RENEW,)
    offline = sight(OFFLINE, there, now=10.0)
    assert tick(ride(Phase.ALIGHTING), offline).actions == (RENEW,)


@each_row("phase", WITH_SESSION)
def test_nothing_is_asked_after_a_restart_before_the_robot_is_heard(phase: Phase) -> None:
    unheard = ride(phase, silent_since=0.0, clearing=CLEARING)
    after = tick(unheard, sight(away(), session("L2", Occupancy.MAY_BOARD), now=50.0))
    assert after.actions == ()
    assert "waits for a report of the robot" in after.record.reason


def test_a_queued_ride_takes_no_lift_after_a_restart_before_its_robot_is_heard() -> None:
    unheard = ride(silent_since=0.0)
    waits = "waits for a report of the robot: it has to send `here`"
    after = tick(unheard, sight(replace(STATE, holder=Holder("rmf", "tiny")), ahead=2, now=5.0))
    assert (after.actions, after.record.reason) == ((), f"{waits} within 25 s to keep its place")
    assert at_moment(after.record, sight(now=7.0).seen, at(7.0)).reason == f"{waits} within 23 s to keep its place"
    assert at_moment(after.record, sight(now=7.0).seen, at(7.0)).changed_at == after.record.changed_at
    late = tick(unheard, sight(now=RESTORED_FOR_S))
    assert (late.actions, late.record.reason) == ((), f"{waits}; it has lost its place in the queue")


DOUBT = RideInDoubt("r0", "A", 50.0)


@each_row(
    ("robot", "present_at", "doubt", "words"),
    [
        (
            "amr-7",
            49.0,
            DOUBT,
            "your robot may be in the car of A: send `left` for ride r0, or begin another ride from",
        ),
        ("amr-7", 50.0, DOUBT, ""),
        ("amr-7", -math.inf, replace(DOUBT, lift="B"), "your robot may be in the car of B"),
        ("", 49.0, DOUBT, "cannot be distinguished: give each its name with `robot`; send `left` for ride r0"),
        ("", 51.0, DOUBT, ""),
        ("", 51.0, replace(DOUBT, since=math.inf), "waits until that ride is over"),
    ],
)
def test_a_ride_of_before_a_doubt_does_not_start_by_the_name_of_its_holder(
    robot: str, present_at: float, doubt: RideInDoubt, words: str
) -> None:
    waiting = replace(ride(present_at=present_at), request=replace(REQUEST, robot=robot))
    in_car = kept_out(maybe_aboard=waiting.holder)
    after = tick(waiting, replace(sight(in_car, now=60.0), doubt=doubt))
    assert bool(after.actions) is not bool(words)
    assert words in after.record.reason


def test_a_robot_that_may_be_inside_passes_the_line_while_nobody_holds_the_lift() -> None:
    inside = sight(kept_out(maybe_aboard=HOLDER), ahead=2)
    assert tick(ride(), inside).actions == (OPEN,)
    held = replace(inside, state=replace(inside.state, holder=Holder("rmf", "tiny")))
    assert tick(ride(), held).actions == ()


def test_a_robot_that_may_be_inside_boards_only_once_the_door_has_stood_open_in_this_ride() -> None:
    shut = sight(here("L1", RobotDoor.CLOSED), session("L1", Occupancy.MAY_BOARD))
    called = tick(ride(Phase.CALLED), shut).record
    assert (called.phase, called.maybe_aboard) == (Phase.CALLED, True)
    assert tick(called, OPEN_AT_START).record.phase is Phase.BOARDING


@pytest.mark.parametrize("seen_elsewhere", [False, True])
def test_a_robot_could_leave_no_longer_once_the_car_moves_with_its_door_shut_or_is_elsewhere(
    *, seen_elsewhere: bool
) -> None:
    riding = ride(Phase.RIDING, could_exit_at="L1")
    between = sight(away(), session("L3", Occupancy.ABOARD))
    still_open = replace(between, state=replace(between.state, doors={Side.FRONT: Door.OPEN}))
    assert tick(riding, still_open).record.could_exit_at == "L1"
    elsewhere = sight(here("L2", RobotDoor.CLOSED), session("L3", Occupancy.ABOARD))
    assert tick(riding, elsewhere if seen_elsewhere else between).record.could_exit_at is None


def test_a_car_that_is_open_and_not_held_yet_says_that_it_waits_for_the_hold() -> None:
    unheld = _but(_with(OPEN_AT_START, door_held=False), robot_door=RobotDoor.MOVING)
    assert tick(ride(Phase.BOARDING), unheld).record.reason.endswith("is open, and is not held yet: waits for the hold")


@each_row(
    ("more", "words"),
    [
        ({"permissions": {"may_enter": False, "may_leave": True}}, "and the lift does not give `may_enter`"),
        (
            {"permissions": {"may_enter": True, "may_leave": False}, "mode": Mode.INDEPENDENT},
            "and the lift is not in a mode for robots (its mode is independent)",
        ),
        ({"restrictions": Restrictions(lockout="M. Weber: cleaning")}, "and robots are locked out"),
    ],
)
def test_an_open_door_that_invites_nobody_says_what_is_missing(more: dict[str, object], words: str) -> None:
    barred = _but(OPEN_AT_START, robot_door=RobotDoor.MOVING, **more)
    assert tick(ride(Phase.BOARDING), barred).record.reason == f"the door at L1 is open, {words}"


def test_an_open_door_that_only_the_next_reading_can_confirm_waits_for_it() -> None:
    seen_once = _but(OPEN_AT_START, robot_door=RobotDoor.MOVING)
    reason = tick(ride(Phase.BOARDING), seen_once).record.reason
    assert reason == "the door at L1 is open; waits for a reading that confirms it"


def test_a_ride_that_ends_with_its_robot_perhaps_inside_speaks_to_it() -> None:
    shut = sight(here("L1", RobotDoor.CLOSED), session("L1", Occupancy.MAY_BOARD))
    after = tick(ride(Phase.CLEARING, clearing=CLEARING), shut).record
    assert after.guidance is Guidance.WAIT
    assert after.reason.endswith("if the robot is inside, stay there until the door opens; send `entered` or `left`")


def test_people_are_told_that_nothing_is_pressed_for_a_robot_that_is_not_heard() -> None:
    after = tick(ride(Phase.RIDING, silent_since=100.0), sight(OFFLINE, session("L3", Occupancy.ABOARD), now=200.0))
    (text,) = alarms(after)
    assert text.endswith("nothing is pressed before the robot sends a report: look into the car")


@each_row("phase", WITH_SESSION)
@each_row("reason", [EndReason.FIRE, EndReason.MODE, EndReason.LOCKOUT, EndReason.FORCED, EndReason.LEASE])
def test_a_ride_whose_session_somebody_ended_gives_up_and_hands_on_the_advice(phase: Phase, reason: EndReason) -> None:
    over = ended(reason, "there is a fire", Advice.STAY_ABOARD)
    after = tick(ride(phase, clearing=CLEARING), sight(STATE, over))
    assert after.actions == ()
    told = (after.record.phase, after.record.guidance, after.record.reason, after.record.advice)
    assert told == (Phase.GAVE_UP, Guidance.GAVE_UP, "there is a fire", Advice.STAY_ABOARD)
    assert after.record.maybe_aboard is (phase is not Phase.CALLED)


@each_row("phase", WITH_SESSION)
def test_a_ride_waits_through_the_end_of_the_manager(phase: Phase) -> None:
    over = ended(EndReason.STOPPING, "the manager is stopping", Advice.CLEAR_DOORWAY)
    after = tick(ride(phase), sight(STATE, over, now=5000.0))
    assert (after.record.phase, after.actions) == (phase, ())
    assert after.record.guidance in (Guidance.WAIT, Guidance.STAY)


@each_row("phase", WITH_SESSION)
def test_a_ride_whose_session_nobody_knows_gives_up(phase: Phase) -> None:
    after = tick(ride(phase), sight(gone="its session is over: the lease ran out")).record
    assert (after.phase, after.reason) == (Phase.GAVE_UP, "its session is over: the lease ran out")
    assert after.ended_at == 1.0
    if phase is not Phase.CALLED:
        assert after.advice is Advice.STAY_ABOARD


def test_a_ride_that_waits_too_long_gives_up_with_what_it_waited_for() -> None:
    after = tick(ride(offline_since="11:59:52"), sight(replace(OFFLINE, holder=None), now=600.0))
    assert (after.record.phase, after.actions) == (Phase.GAVE_UP, ())
    assert after.record.reason == "it waited for 600 s: A is offline since 11:59:52"
    assert after.record.advice is None


def test_a_ride_whose_time_ran_out_before_a_restart_says_what_it_waits_for_now() -> None:
    called = tick(ride(Phase.CALLED, offline_since="11:59:52"), sight(OFFLINE, session("L1"), now=300.0)).record
    assert called.reason == "the car did not stand open at L1 within 300 s: A is offline since 11:59:52"
    riding = tick(ride(Phase.RIDING, offline_since="11:59:52"), sight(OFFLINE, session("L3"), now=900.0)).record
    assert "the car did not stand open at L3 within 200 s: A is offline since 11:59:52" in riding.reason


def test_a_car_that_does_not_come_in_time_is_given_back() -> None:
    after = tick(ride(Phase.CALLED), sight(away(), session("L1"), now=300.0))
    assert (after.record.phase, after.actions) == (Phase.GAVE_UP, (CLOSE,))
    assert not after.record.maybe_aboard


@each_row(
    ("phase", "limit_s", "warns"),
    [(Phase.BOARDING, 120.0, False), (Phase.RIDING, 200.0, True), (Phase.ALIGHTING, 100.0, True)],
)
def test_a_robot_that_may_be_inside_when_time_is_up_is_let_out(phase: Phase, limit_s: float, *, warns: bool) -> None:
    seen = sight(OFFLINE, session("L1", Occupancy.MAY_BOARD), now=limit_s - 0.1)
    assert tick(ride(phase), seen).record.phase is phase
    after = tick(ride(phase), replace(seen, now=limit_s))
    assert (after.record.phase, after.record.phase_since) == (Phase.CLEARING, limit_s)
    assert after.record.clearing is not None
    assert after.record.clearing.ending is Phase.GAVE_UP
    assert bool(alarms(after)) is warns
    assert CLOSE not in after.actions


@pytest.mark.parametrize("stands_open", [True, False])
def test_a_robot_that_has_to_get_out_is_not_reported_as_in_place_while_the_door_stands_open_for_it(
    *, stands_open: bool
) -> None:
    seen = OPEN_AT_START if stands_open else _but(OPEN_AT_START, robot_door=RobotDoor.MOVING)
    after = tick(ride(Phase.CLEARING, has_entered=True, clearing=CLEARING, clear_at="L1"), seen)
    assert (IN_PLACE not in after.actions) == stands_open


def test_a_robot_that_is_not_heard_to_leave_is_given_up_with_an_alarm_and_its_car_is_not_given_away() -> None:
    clearing = ride(Phase.CLEARING, has_entered=True, clearing=Clearing(Phase.GAVE_UP, "too late"), clear_at="L3")
    after = tick(clearing, sight(OFFLINE, session("L3", Occupancy.ABOARD), now=100.0))
    (text,) = alarms(after)
    assert text.startswith("ride_given_up: a robot of ride:fleet/amr-7 is in the car of A")
    assert after.actions == (END,)
    assert (after.record.phase, after.record.maybe_aboard) == (Phase.GAVE_UP, True)
    assert after.record.advice is Advice.CLEAR_DOORWAY


@each_row(
    ("state", "clear_at", "stands_s", "wanted"),
    [
        (here("L1", RobotDoor.CLOSED), None, 5.0, "L1"),
        (away(), None, None, "L3"),
        (away("L2"), "L1", None, "L3"),
        (here("L2", RobotDoor.CLOSED), "L3", 5.0, "L2"),
        (here("L2", RobotDoor.CLOSED), "L3", 0.5, "L3"),
        (OFFLINE, "L3", None, "L3"),
    ],
)
def test_a_robot_inside_is_let_out_where_the_car_stands_or_stops_next(
    state: LiftState, clear_at: str | None, stands_s: float | None, wanted: str
) -> None:
    stands = None if stands_s is None or state.floor is None else (state.floor, 20.0 - stands_s)
    clearing = ride(Phase.CLEARING, has_entered=True, clearing=CLEARING, clear_at=clear_at, stands=stands)
    after = tick(clearing, sight(state, session("L3", Occupancy.ABOARD), now=20.0))
    assert after.record.clear_at == wanted


def test_a_robot_that_said_nothing_is_let_out_where_it_may_have_gone_in() -> None:
    clearing = ride(Phase.CLEARING, clearing=CLEARING)
    away_then = tick(clearing, sight(away("L2"), session("L1", Occupancy.MAY_BOARD), now=9.0))
    assert away_then.actions == (go_to("L1"),)
    assert away_then.record.guidance is Guidance.WAIT
    there = tick(clearing, sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True)))
    assert there.record.guidance is Guidance.LEAVE


@each_row("phase", [Phase.DONE, Phase.CANCELLED, Phase.GAVE_UP])
def test_a_ride_that_is_over_stays_as_it_is(phase: Phase) -> None:
    over = ride(phase, maybe_aboard=True)
    assert tick(over, OPEN_AT_START).record == over
    assert published(over, 0.0).phase_ends_in_s is None


def test_a_change_has_its_time_of_day() -> None:
    after = tick(ride(), sight(now=7.0, ahead=1)).record
    assert (after.changed_at - NOON).total_seconds() == 7.0
