"""What robots report of themselves, and what callers and people decide about a ride."""

from dataclasses import replace

import pytest

from lift_manager.lift.events import Advised
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Advice
from lift_manager.rides.record import Clearing, RideRecord
from lift_manager.rides.ride import Guidance, Phase, RideWord
from lift_manager.rides.step import Step
from tests.lift_manager.rides.by_hand import (
    CLOSE,
    CLOSE_LEFT,
    HOLDER,
    OFFLINE,
    STATE,
    Sight,
    alarms,
    away,
    cancel,
    go_to,
    here,
    report,
    ride,
    session,
    sight,
    take,
)
from tests.support.rows import each_row

OPEN_AT_START = sight(here("L1"), session("L1", Occupancy.MAY_BOARD, there=True))
SHUT_AT_START = sight(here("L1", RobotDoor.MOVING), session("L1", Occupancy.MAY_BOARD))
OFFLINE_AT_START = sight(OFFLINE, session("L1", Occupancy.MAY_BOARD))
UNDER_WAY = sight(away(), session("L3", Occupancy.ABOARD))
CLEARING = Clearing(Phase.CANCELLED, "withdrawn by its caller: no order")


def taken(record: RideRecord, word: RideWord, seen: Sight) -> Step:
    done = report(record, word, seen)
    assert done.reply is None
    return done


def refused(record: RideRecord, word: RideWord, seen: Sight) -> str:
    done = report(record, word, seen)
    assert done.reply is not None
    assert (done.reply.code, done.actions) == (Refusal.NOT_NOW, ())
    return done.reply.message


def changes_nothing(done: Step, record: RideRecord) -> bool:
    return (done.record, done.actions, done.events, done.saves) == (record, (), (), ())


@each_row("seen", [OPEN_AT_START, SHUT_AT_START, OFFLINE_AT_START])
@each_row("phase", [Phase.CALLED, Phase.BOARDING])
def test_a_robot_may_say_that_it_entered_whenever_it_could_have_whatever_the_door_does_now(
    phase: Phase, seen: Sight
) -> None:
    after = taken(ride(phase), RideWord.ENTERED, seen).record
    assert (after.phase, after.phase_since, after.has_entered) == (Phase.RIDING, seen.now, True)
    assert (after.guidance, after.maybe_aboard) == (Guidance.STAY, True)


@pytest.mark.parametrize(("phase", "seen"), [(Phase.QUEUED, sight()), (Phase.CALLED, sight(away(), session("L1")))])
def test_no_robot_entered_a_car_that_has_not_stood_open_for_it(phase: Phase, seen: Sight) -> None:
    assert "has not stood open" in refused(ride(phase), RideWord.ENTERED, seen)


def test_entered_twice_is_once() -> None:
    record = ride(Phase.RIDING)
    assert changes_nothing(taken(record, RideWord.ENTERED, UNDER_WAY), record)


def test_a_robot_that_turns_out_to_be_inside_a_cancelled_ride_is_known_to_be_there() -> None:
    after = taken(ride(Phase.CLEARING, clearing=CLEARING), RideWord.ENTERED, SHUT_AT_START).record
    assert (after.phase, after.has_entered) == (Phase.CLEARING, True)


def test_a_robot_that_left_at_its_destination_is_done() -> None:
    after = taken(ride(Phase.ALIGHTING, could_exit_at="L3"), RideWord.LEFT, sight(here("L3")))
    assert after.actions == (CLOSE_LEFT,)
    assert (after.record.phase, after.record.guidance, after.record.maybe_aboard) == (Phase.DONE, Guidance.DONE, False)


def test_a_robot_that_left_elsewhere_is_not_done() -> None:
    after = taken(ride(Phase.RIDING, could_exit_at="L1"), RideWord.LEFT, OPEN_AT_START)
    assert after.actions == (CLOSE_LEFT,)
    assert (after.record.phase, after.record.reason) == (Phase.GAVE_UP, "the robot left at L1, and not at L3")
    assert after.record.advice is None


def test_no_robot_left_through_a_shut_door() -> None:
    assert "has not stood open" in refused(ride(Phase.RIDING), RideWord.LEFT, UNDER_WAY)


def test_a_robot_that_was_brought_out_of_a_dead_lift_may_say_so() -> None:
    after = taken(ride(Phase.RIDING), RideWord.LEFT, sight(OFFLINE, session("L3", Occupancy.ABOARD)))
    assert after.actions == (CLOSE_LEFT,)
    assert after.record.phase is Phase.GAVE_UP


@pytest.mark.parametrize("phase", [Phase.CALLED, Phase.BOARDING])
def test_a_robot_that_stays_outside_ends_its_ride_with_the_word_that_it_left(phase: Phase) -> None:
    after = taken(ride(phase, maybe_aboard=True), RideWord.LEFT, SHUT_AT_START)
    assert (after.record.phase, after.actions) == (Phase.CANCELLED, (CLOSE_LEFT,))


@pytest.mark.parametrize("phase", [Phase.QUEUED, Phase.CALLED])
def test_no_robot_left_a_car_that_it_cannot_have_entered(phase: Phase) -> None:
    assert "cancel it" in refused(ride(phase), RideWord.LEFT, sight())


@pytest.mark.parametrize("ending", [Phase.CANCELLED, Phase.GAVE_UP])
def test_a_robot_that_was_let_out_ends_its_ride_as_was_meant(ending: Phase) -> None:
    clearing = ride(Phase.CLEARING, has_entered=True, could_exit_at="L2", clearing=Clearing(ending, "why"))
    after = taken(clearing, RideWord.LEFT, sight(here("L2"), session("L2", Occupancy.ABOARD, there=True)))
    assert (after.record.phase, after.record.reason, after.record.maybe_aboard) == (ending, "why", False)
    assert after.actions == (CLOSE_LEFT,)


def test_a_word_after_the_end_clears_the_car_once() -> None:
    over = ride(Phase.GAVE_UP, maybe_aboard=True, reason="too late")
    after = taken(over, RideWord.LEFT, sight())
    assert (after.record.phase, after.record.maybe_aboard) == (Phase.GAVE_UP, False)
    assert after.actions == (CLOSE_LEFT,)
    assert refused(after.record, RideWord.LEFT, sight()) == "the ride is over, it is gave_up: too late"


def test_a_robot_that_repeats_its_last_word_learns_that_it_was_taken() -> None:
    over = ride(Phase.DONE, has_entered=True, could_exit_at="L3")
    after = taken(over, RideWord.LEFT, sight())
    assert (after.record, after.actions) == (over, ())


@each_row("word", [RideWord.ENTERED, RideWord.HERE])
@each_row("phase", [Phase.DONE, Phase.CANCELLED, Phase.GAVE_UP])
def test_other_words_after_the_end_make_no_sense(phase: Phase, word: RideWord) -> None:
    assert "is over" in refused(ride(phase, maybe_aboard=True), word, sight())


@each_row("word", RideWord)
def test_every_word_of_a_robot_lets_its_ride_go_on_after_a_restart(word: RideWord) -> None:
    unheard = ride(Phase.ALIGHTING, could_exit_at="L3", silent_since=0.0)
    after = taken(unheard, word, sight(here("L3"), session("L3", Occupancy.ABOARD, there=True)))
    assert after.record.silent_since is None


def test_a_ride_that_waits_is_cancelled_at_once() -> None:
    after = cancel(ride(), sight())
    assert (after.record.phase, after.record.guidance, after.record.reason, after.actions) == (
        Phase.CANCELLED,
        Guidance.DONE,
        "withdrawn by its caller: no order",
        (),
    )


def test_a_ride_whose_car_is_on_its_way_gives_the_lift_back() -> None:
    after = cancel(ride(Phase.CALLED), sight(away(), session("L1")))
    assert (after.record.phase, after.actions) == (Phase.CANCELLED, (CLOSE,))


@each_row("phase", [Phase.CALLED, Phase.BOARDING, Phase.RIDING, Phase.ALIGHTING])
@each_row("seen", [OPEN_AT_START, OFFLINE_AT_START])
def test_a_ride_whose_robot_may_be_inside_lets_it_out_first(phase: Phase, seen: Sight) -> None:
    after = cancel(ride(phase), seen)
    assert (after.record.phase, after.record.maybe_aboard) == (Phase.CLEARING, True)
    assert alarms(after) == []
    assert CLOSE not in after.actions
    again = cancel(after.record, seen, "once more", by_operator=True)
    assert changes_nothing(again, after.record)


def test_people_are_told_when_an_operator_cancels_a_ride_with_its_robot_inside() -> None:
    after = cancel(ride(Phase.RIDING), UNDER_WAY, "fire drill", by_operator=True)
    assert ["withdrawn by an operator: fire drill" in text for text in alarms(after)] == [True]
    boarding = cancel(ride(Phase.BOARDING), OPEN_AT_START, "fire drill", by_operator=True)
    assert alarms(boarding) == []


def test_a_cancelled_ride_holds_the_door_open_where_the_car_still_stands() -> None:
    at_start = ride(Phase.RIDING, stands=("L1", -5.0))
    seen = sight(here("L1", RobotDoor.CLOSED), session("L3", Occupancy.ABOARD))
    after = cancel(at_start, seen)
    assert after.actions == (go_to("L1"),)


@each_row("phase", [Phase.DONE, Phase.CANCELLED, Phase.GAVE_UP])
def test_a_ride_that_is_over_is_not_cancelled_again(phase: Phase) -> None:
    assert changes_nothing(cancel(ride(phase), sight()), ride(phase))


def test_the_advice_of_a_fire_reaches_the_robot_before_its_session_ends() -> None:
    told = Advised("A", HOLDER, Advice.STAY_ABOARD, "there is a fire")
    after = take(ride(Phase.RIDING), told, sight(STATE)).record
    assert (after.phase, after.guidance, after.advice) == (Phase.GAVE_UP, Guidance.GAVE_UP, Advice.STAY_ABOARD)
    over = replace(after, reason="before")
    assert take(over, told, sight(STATE)).record == over
