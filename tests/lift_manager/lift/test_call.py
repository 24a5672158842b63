"""One call from the request to the arrival, on hand-made observations."""

from dataclasses import replace

import pytest

from drivers.model import Capabilities, Command, CommandKind, LiftValues, Outcome, Result
from lift_manager.lift import call as calls
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.observation import Observation
from register_maps.words import Door, Mode, Motion, Side

ABLE = Capabilities(
    commands=frozenset({"go_to"}),
    signals=frozenset({"car_floor", "destination", "call_accepted", "motion", "door.front"}),
    doors=(Side.FRONT,),
    one_block=True,
    evidence="motion_stopped",
    evidence_for_s=0.0,
    max_age_s=1.0,
    requires={},
    granted_within_s=600.0,
    arrive_within_s=120.0,
    until={},
    held_commands=frozenset(),
    max_hold_s={},
    released_after_s={},
    excludes={},
    needs_occupancy=False,
    door_opens_within_s=10.0,
    door_closes_within_s=10.0,
    open_contacts=frozenset(),
    watched=False,
    same_floor_call=False,
    not_visible={},
    map_name="by-hand",
    map_hash="1f",
    printed={},
    trust="template",
)
CONFIRMED = Outcome(Command(CommandKind.GO_TO, "L2"), Result.CONFIRMED)
UNCONFIRMED = Outcome(Command(CommandKind.GO_TO, "L2"), Result.UNCONFIRMED, "nothing showed")


def observed(
    floor: str | None, *, door: Door = Door.CLOSED, motion: Motion = Motion.STOPPED, destination: str | None = None
) -> Observation:
    values = LiftValues(floor=floor, destination=destination, motion=motion, mode=Mode.NORMAL, doors={Side.FRONT: door})
    standing = floor is not None and motion is Motion.STOPPED
    return Observation(values, 1, 0.0, 0.0, evidence_since=0.0, is_standing=standing, is_agreed=True, is_settled=True)


def confirmed() -> Call:
    return calls.call_answered(calls.press_call(calls.request_call(None, "L2", 0.0), 1, 0.0), CONFIRMED, 1.0)


def test_a_repeat_of_a_pending_or_confirmed_call_changes_nothing() -> None:
    pending = calls.press_call(calls.request_call(None, "L2", 0.0), 1, 0.0)
    assert calls.request_call(pending, "L2", 5.0) is pending
    call = confirmed()
    assert calls.request_call(call, "L2", 5.0) is call


def test_another_floor_is_a_new_call() -> None:
    assert calls.request_call(confirmed(), "L3", 5.0) == Call("L3", CallPhase.REQUESTED, 5.0)


@pytest.mark.parametrize(("failures", "pause"), [(0, 2.0), (1, 4.0), (2, 8.0), (3, 16.0), (4, 30.0), (9, 30.0)])
def test_the_pause_before_a_failed_call_is_pressed_again_doubles_up_to_half_a_minute(
    failures: int, pause: float
) -> None:
    call = calls.call_answered(Call("L2", CallPhase.PRESSED, 0.0, failures=failures), UNCONFIRMED, 10.0)
    assert call.phase is CallPhase.FAILED
    assert calls.request_call(call, "L2", 10.0 + pause - 0.01).phase is CallPhase.FAILED
    assert calls.request_call(call, "L2", 10.0 + pause).phase is CallPhase.REQUESTED


def test_arrival_forgives_earlier_failures() -> None:
    call = calls.follow_call(Call("L2", CallPhase.CONFIRMED, 0.0, failures=3), observed("L2"), ABLE, 9.0)
    assert (call.phase, call.failures) == (CallPhase.ARRIVED, 0)


def test_a_call_that_failed_has_no_reason_any_more_once_the_car_is_there() -> None:
    call = calls.call_failed(confirmed(), "the call disappeared", 1.0)
    assert call.reason == "the call disappeared"
    assert calls.follow_call(call, observed("L2"), ABLE, 2.0).reason == ""


def test_a_call_that_disappears_is_lost_after_a_few_readings_but_not_after_one() -> None:
    call = confirmed()
    for _ in range(calls.LOST_AFTER_READINGS - 1):
        call = calls.follow_call(call, observed("L1"), ABLE, 2.0)
        assert call.phase is CallPhase.CONFIRMED
    assert calls.follow_call(call, observed("L1", destination="L2"), ABLE, 2.0).missing == 0
    assert calls.follow_call(call, observed("L1"), ABLE, 2.0).phase is CallPhase.FAILED


def test_a_lamp_behind_the_button_shows_the_call() -> None:
    lamps = replace(ABLE, signals=frozenset({"car_floor", "calls_registered"}))
    lit = observed("L1")
    lit = replace(lit, values=replace(lit.values, calls=frozenset({"L2", "L3"})))
    call = confirmed()
    for _ in range(2 * calls.LOST_AFTER_READINGS):
        call = calls.follow_call(call, lit, lamps, 2.0)
    assert call.phase is CallPhase.CONFIRMED
    for _ in range(calls.LOST_AFTER_READINGS):
        call = calls.follow_call(call, observed("L1"), lamps, 2.0)
    assert call.reason == "the call disappeared"


def test_a_call_that_no_signal_shows_cannot_be_lost() -> None:
    blind = replace(ABLE, signals=frozenset({"car_floor"}))
    call = confirmed()
    for _ in range(50):
        call = calls.follow_call(call, observed("L1"), blind, 2.0)
    assert call.phase is CallPhase.CONFIRMED


def test_a_car_that_does_not_come_in_time_is_a_failed_call() -> None:
    call = calls.follow_call(confirmed(), observed("L1", destination="L2"), ABLE, 122.0)
    assert call.phase is CallPhase.FAILED
    assert "did not arrive within 120 s" in call.reason


def test_re_levelling_with_the_door_open_is_not_leaving() -> None:
    arrived = calls.follow_call(confirmed(), observed("L2", door=Door.OPEN), ABLE, 9.0)
    assert (
        calls.follow_call(arrived, observed("L2", door=Door.OPEN, motion=Motion.UP), ABLE, 9.5).phase
        is CallPhase.ARRIVED
    )
    assert (
        calls.follow_call(arrived, observed(None, door=Door.OPEN, motion=Motion.UP), ABLE, 9.5).phase
        is CallPhase.ARRIVED
    )
    assert calls.follow_call(arrived, observed("L1"), ABLE, 20.0).reason == "the car was taken away"
    assert calls.follow_call(arrived, observed(None, motion=Motion.DOWN), ABLE, 20.0).reason == "the car was taken away"


def test_where_the_car_stands_nothing_is_pressed() -> None:
    wanted = calls.request_call(None, "L2", 0.0)
    assert not calls.may_press_call(wanted, observed("L2"), ABLE, 1.0)
    assert calls.may_press_call(wanted, observed("L2", motion=Motion.UP), ABLE, 1.0)
    assert calls.may_press_call(wanted, observed("L1"), ABLE, 1.0)


def test_a_car_that_stopped_off_level_is_called_after_a_while() -> None:
    wanted = calls.request_call(None, "L2", 0.0)
    assert calls.may_press_call(wanted, observed("L2"), ABLE, calls.SETTLES_WITHIN_S)


def test_a_command_waits_for_its_own_requirements_and_an_unread_one_is_not_given() -> None:
    able = replace(ABLE, requires={"call": frozenset({"robot_mode_on"}), "go": frozenset({"robot_mode_on", "level"})})
    seen = observed("L1")
    assert calls.flags_missing(seen, able, "go") == {"robot_mode_on", "level"}
    seen = replace(seen, values=replace(seen.values, flags={"robot_mode_on": True, "level": False}))
    assert calls.flags_missing(seen, able, "call") == set()
    assert calls.flags_missing(seen, able, "go") == {"level"}
    assert calls.flags_missing(seen, able, "robot_in_place") == set()


def test_a_lift_that_opens_for_a_call_is_called_where_it_stands_with_its_door_shut() -> None:
    opens = replace(ABLE, same_floor_call=True)
    wanted = calls.request_call(None, "L2", 0.0)
    assert calls.follow_call(wanted, observed("L2"), opens, 0.1) is wanted
    assert calls.may_press_call(wanted, observed("L2"), opens, 1.0)
    assert calls.follow_call(wanted, observed("L2", door=Door.OPEN), opens, 0.1).phase is CallPhase.ARRIVED


HOLDS = replace(ABLE, evidence="door_open", signals=frozenset({"car_floor", "door.front"}), same_floor_call=True)
"""The open door is the evidence that the car stands, and a call keeps it open."""


def stands_open() -> Observation:
    return observed("L2", door=Door.OPEN)


def shows_shut() -> Observation:
    return replace(observed("L2"), is_standing=False)


def test_an_open_door_does_not_fulfil_a_call_that_has_to_hold_it_before_that_call_is_pressed() -> None:
    wanted = calls.request_call(None, "L2", 0.0)
    assert calls.follow_call(wanted, stands_open(), HOLDS, 0.1, is_hold=True) is wanted
    assert calls.may_press_call(wanted, stands_open(), HOLDS, 0.1, is_hold=True)
    assert calls.may_press_call(wanted, stands_open(), replace(HOLDS, same_floor_call=False), 0.1, is_hold=True)
    failed = calls.call_failed(wanted, "lost", 1.0)
    assert calls.follow_call(failed, stands_open(), HOLDS, 9.0, is_hold=True) is failed
    assert (
        calls.follow_call(calls.press_call(wanted, 1, 0.1), stands_open(), HOLDS, 0.2, is_hold=True).phase
        is CallPhase.ARRIVED
    )
    assert calls.follow_call(wanted, stands_open(), HOLDS, 0.1).phase is CallPhase.ARRIVED


def test_a_door_that_shuts_where_it_is_the_evidence_is_found_by_more_than_one_reading() -> None:
    arrived = calls.follow_call(confirmed(), stands_open(), HOLDS, 9.0)
    glimpsed = calls.follow_call(arrived, shows_shut(), HOLDS, 10.0)
    still = calls.follow_call(glimpsed, shows_shut(), HOLDS, 10.0 + HOLDS.max_age_s)
    assert still.phase is CallPhase.ARRIVED
    assert calls.follow_call(still, shows_shut(), HOLDS, 10.1 + HOLDS.max_age_s).reason == "the door shut"
    reopened = calls.follow_call(still, stands_open(), HOLDS, 10.5)
    assert calls.follow_call(reopened, shows_shut(), HOLDS, 10.1 + HOLDS.max_age_s).phase is CallPhase.ARRIVED
    closing = calls.follow_call(
        still, replace(shows_shut(), values=observed("L2", door=Door.CLOSING).values), HOLDS, 10.5
    )
    assert calls.follow_call(closing, shows_shut(), HOLDS, 10.1 + HOLDS.max_age_s).phase is CallPhase.ARRIVED


def test_a_call_is_reached_until_its_car_leaves_whatever_becomes_of_the_call() -> None:
    lost = calls.call_failed(calls.follow_call(confirmed(), stands_open(), HOLDS, 9.0), "lost", 9.5)
    assert not confirmed().reached
    assert calls.follow_call(lost, shows_shut(), HOLDS, 10.0, is_hold=True).reached
    assert not calls.follow_call(lost, observed("L1"), HOLDS, 10.0, is_hold=True).reached


def test_a_call_that_is_dropped_again_and_again_is_pressed_more_and_more_rarely() -> None:
    call, at, pauses = confirmed(), 10.0, []
    for _ in range(6):
        call = calls.follow_call(call, stands_open(), HOLDS, at, is_hold=True)
        call = calls.call_failed(call, "dropped", at + 1)
        pauses.append(call.not_before - at - 1)
        at = call.not_before
        call = calls.press_call(calls.request_call(call, "L2", at), 1, at)
    assert pauses == [2, 4, 8, 16, 30, 30]
    arrived = calls.follow_call(call, stands_open(), HOLDS, at, is_hold=True)
    assert calls.follow_call(arrived, stands_open(), HOLDS, at + 31, is_hold=True).failures == 0


def test_a_call_that_a_restart_finds_off_is_pressed_by_the_next_request_without_a_pause() -> None:
    found_off = calls.call_found_off(calls.call_after_restart("L2", 5.0, pressed=True), "off", 5.0)
    assert calls.request_call(found_off, "L2", 5.0).phase is CallPhase.REQUESTED


def test_a_map_says_how_long_its_door_may_take_to_open() -> None:
    slow = replace(ABLE, same_floor_call=True, door_opens_within_s=25.0)
    arrived = Call("L2", CallPhase.ARRIVED, 0.0)
    assert calls.follow_call(arrived, observed("L2"), slow, 25.0) is arrived
    assert calls.follow_call(arrived, observed("L2"), slow, 25.1).phase is CallPhase.FAILED


def test_a_lift_that_opens_for_a_call_is_called_again_only_after_its_door_shut() -> None:
    opens = replace(ABLE, same_floor_call=True)
    arrived = calls.follow_call(
        calls.press_call(calls.request_call(None, "L2", 0.0), 1, 0.0), observed("L2"), opens, 1.0
    )
    assert arrived.phase is CallPhase.ARRIVED
    still = calls.follow_call(arrived, observed("L2"), opens, 1.0 + opens.door_opens_within_s)
    assert still is arrived
    shut = calls.follow_call(arrived, observed("L2"), opens, 1.1 + opens.door_opens_within_s)
    assert shut.reason == "the door shut"
    assert calls.follow_call(shut, observed("L2"), opens, shut.not_before) is shut
    assert calls.request_call(shut, "L2", shut.not_before).phase is CallPhase.REQUESTED
