"""The controller's scans, calls and doors: what people who use the lift see."""

from dataclasses import replace
from typing import Any

import pytest

from register_maps.words import Door, Motion, Side
from simulator import controller
from simulator.controller import Parameters, SameFloorCall
from tests.simulator.bench import BOTH, BUILDING, FRONT, PLAIN, REAR, SCAN_S, Lift, all_closed, floors, opened

# -- scans


def test_a_pulse_that_falls_between_two_scans_is_missed() -> None:
    lift = Lift()
    lift.run(0.01)
    lift.run(0.03, car_buttons=floors(2))
    assert not lift.run(5, car_buttons=floors()).car_calls


def test_a_pulse_as_long_as_a_scan_is_always_seen() -> None:
    for late_by in (0.0, 0.01, 0.025, 0.049):
        lift = Lift()
        lift.run(late_by)
        lift.run(SCAN_S, car_buttons=floors(2))
        assert lift.run(SCAN_S, car_buttons=floors()).car_calls == floors(2)


def test_speed_does_not_make_the_scan_any_faster() -> None:
    lift = Lift(replace(PLAIN, speed=50.0))
    lift.run(0.01)
    lift.run(0.03, car_buttons=floors(2))
    assert not lift.run(1.01, car_buttons=floors()).car_calls
    assert not lift.run(0.04, car_buttons=floors(3)).car_calls
    assert lift.run(0.01).car_calls == floors(3)


def test_at_ten_times_the_speed_the_same_trip_takes_a_tenth_of_the_time() -> None:
    usual, fast = Lift(), Lift(replace(PLAIN, speed=10.0))
    usual.run(SCAN_S, car_buttons=floors(3))
    fast.run(SCAN_S, car_buttons=floors(3))
    usual_s = next(n for n in range(10_000) if usual.run(SCAN_S).door_open_floor == 3) * SCAN_S
    fast_s = next(n for n in range(10_000) if fast.run(SCAN_S).door_open_floor == 3) * SCAN_S
    assert fast_s == pytest.approx(usual_s / 10, abs=2 * SCAN_S)


def test_a_fast_lift_still_waits_its_dwell() -> None:
    lift = Lift(replace(PLAIN, speed=20.0))
    lift.press(car=floors(1))
    seen = lift.watch(2)
    open_for_s = sum(picture.door_open_floor == 1 for picture in seen) * SCAN_S
    assert open_for_s == pytest.approx(3.0 / 20, abs=SCAN_S)


def test_an_idle_day_changes_nothing() -> None:
    lift = Lift()
    before = lift.run(1)
    assert lift.run(24 * 3600) == before
    assert lift.press(car=floors(2)).destination == 2


def test_time_does_not_run_backwards() -> None:
    with pytest.raises(ValueError, match="backwards"):
        Lift().run(-1)


# -- calls


def test_a_car_call_brings_the_car_opens_its_doors_and_closes_them_again() -> None:
    lift = Lift()
    lift.press(car=floors(2))
    assert lift.see().car_calls == floors(2)
    assert lift.see().destination == 2
    assert lift.stops(15) == [2]
    resting = lift.run(10)
    assert (resting.level_floor, resting.destination, resting.motion) == (2, None, Motion.STOPPED)
    assert all_closed(resting)
    assert not resting.car_calls


def test_a_landing_call_is_served_and_its_lamp_goes_out_on_arrival() -> None:
    lift = Lift()
    assert lift.press(landing=floors(3)).landing_calls == floors(3)
    for picture in lift.watch(20):
        assert (picture.landing_calls == floors(3)) == (picture.level_floor != 3)


def test_calls_ahead_are_served_in_passing_and_those_behind_after_turning() -> None:
    lift = Lift(at=2)
    lift.press(car=floors(4))
    lift.press(landing=floors(0, 3), car=floors(1))
    assert lift.stops(90) == [3, 4, 1, 0]


def test_a_call_too_near_to_stop_for_is_served_on_the_way_back() -> None:
    lift = Lift()
    lift.press(car=floors(3))
    while lift.see().position_m < PLAIN.shaft.heights_m[1] - 0.3:
        lift.run(SCAN_S)
    lift.press(landing=floors(1))
    assert lift.stops(60) == [3, 1]


def test_a_car_whose_direction_is_free_goes_to_the_nearest_call_first() -> None:
    lift = Lift(at=1)
    lift.press(landing=floors(0, 4))
    assert lift.stops(60) == [0, 4]


def test_a_button_held_down_does_not_call_again_until_it_is_let_go() -> None:
    lift = Lift()
    lift.run(SCAN_S, car_buttons=floors(2))
    assert lift.stops(60) == [2]
    assert all_closed(lift.see())
    lift.run(SCAN_S, car_buttons=floors(0, 2))
    assert lift.stops(60) == [0]
    assert (lift.see().level_floor, lift.see().destination) == (0, None)
    lift.run(SCAN_S, car_buttons=floors())
    assert lift.run(SCAN_S, car_buttons=floors(2)).car_calls == floors(2)


def test_a_button_of_a_floor_that_does_not_exist_does_nothing() -> None:
    lift = Lift()
    assert lift.press(car=floors(-1, 9), landing=floors(5)).destination is None


def test_a_call_for_the_floor_the_car_stands_at_opens_the_doors() -> None:
    lift = Lift(at=1)
    lift.press(landing=floors(1))
    assert lift.stops(3) == [1]


def test_a_call_for_the_same_floor_turns_a_closing_door_round() -> None:
    lift = Lift(at=1)
    lift.press(car=floors(1))
    while lift.see().doors[Side.FRONT] is not Door.CLOSING:
        lift.run(SCAN_S)
    lift.run(1)
    lift.press(landing=floors(1))
    assert lift.see().doors[Side.FRONT] is Door.OPENING


def test_where_same_floor_calls_are_silent_nothing_at_all_happens() -> None:
    lift = Lift(replace(PLAIN, same_floor_call=SameFloorCall.SILENT), at=1)
    lift.run(SCAN_S, car_buttons=floors(1), landing_buttons=floors(1))
    for picture in lift.watch(5):
        assert all_closed(picture)
        assert not picture.car_calls | picture.landing_calls
    assert lift.press(car=floors(2)).car_calls == floors(2)


def test_the_floor_shown_is_never_the_destination_before_its_door_zone_is_reached() -> None:
    lift = Lift()
    lift.press(car=floors(4))
    floor_seen = [0]
    for picture in lift.watch(30):
        if picture.floor == 4:
            assert picture.in_door_zone
        floor_seen.append(picture.floor)
    assert list(dict.fromkeys(floor_seen)) == [0, 1, 2, 3, 4]


# -- doors


def test_only_the_doors_of_the_floor_open() -> None:
    lift = Lift(Parameters(shaft=BUILDING))
    for floor, doors in ((1, BOTH), (2, REAR), (3, FRONT)):
        lift.press(car=floors(floor))
        seen = lift.watch(20)
        assert floor in {picture.door_open_floor for picture in seen}
        assert {side for picture in seen for side, door in picture.doors.items() if door is Door.OPEN} == doors


def test_a_hold_opens_the_door_of_a_standing_car_and_keeps_it_open() -> None:
    lift = Lift(Parameters(shaft=BUILDING), at=1)
    held = lift.run(600, hold_door=REAR)
    assert (held.doors[Side.REAR], held.doors[Side.FRONT]) == (Door.OPEN, Door.CLOSED)
    assert held.door_open_floor is None  # one of the two doors of this floor is closed
    lift.run(3 - 2 * SCAN_S, hold_door=frozenset())
    assert opened(lift, Side.REAR)
    assert all_closed(lift.run(3))


def test_a_hold_keeps_the_car_from_leaving() -> None:
    lift = Lift()
    lift.run(5, hold_door=FRONT)
    lift.press(car=floors(3, 4))
    waiting = lift.run(60)
    assert (waiting.door_open_floor, waiting.destination) == (0, 3)
    lift.run(SCAN_S, hold_door=frozenset())
    assert lift.stops(60) == [3, 4]


def test_a_hold_pressed_while_travelling_acts_where_the_car_stops() -> None:
    lift = Lift()
    lift.press(car=floors(2))
    assert lift.run(2, hold_door=FRONT).motion is Motion.UP
    assert lift.run(60).door_open_floor == 2


@pytest.mark.parametrize("cause", [{"hold_door": FRONT}, {"obstruction": FRONT}])
def test_a_closing_door_opens_again_for_a_hold_or_an_obstruction(cause: dict[str, Any]) -> None:
    lift = Lift()
    lift.press(car=floors(0))
    while lift.see().doors[Side.FRONT] is not Door.CLOSING:
        lift.run(SCAN_S)
    lift.run(1)
    lift.run(2 * SCAN_S, **cause)
    assert lift.see().doors[Side.FRONT] is Door.OPENING
    assert lift.run(60).doors[Side.FRONT] is Door.OPEN


def test_an_obstruction_is_shown_and_does_not_open_a_closed_door() -> None:
    lift = Lift()
    seen = lift.run(5, obstruction=FRONT)
    assert seen.obstruction == FRONT
    assert all_closed(seen)
    assert not seen.nudging


def test_the_close_button_ends_the_dwell() -> None:
    lift = Lift()
    lift.press(car=floors(0))
    lift.run(2.2)
    assert opened(lift, Side.FRONT)
    assert lift.run(2 * SCAN_S, close_door=FRONT).doors[Side.FRONT] is Door.CLOSING


@pytest.mark.parametrize("cause", [{"hold_door": FRONT}, {"obstruction": FRONT}])
def test_the_close_button_gives_way_to_a_hold_and_to_an_obstruction(cause: dict[str, Any]) -> None:
    lift = Lift()
    lift.press(car=floors(0))
    lift.run(2.2)
    assert lift.run(30, close_door=FRONT, **cause).doors[Side.FRONT] is Door.OPEN


# -- settings


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"scan_s": -1.0}, {"fire_floor": 5}])
def test_settings_that_cannot_be_are_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        replace(PLAIN, **wrong)


@pytest.mark.parametrize("wrong", [-1, 5])
def test_a_lift_cannot_start_at_a_floor_it_does_not_have(wrong: Any) -> None:
    with pytest.raises(ValueError, match="0 to 4"):
        controller.initial(PLAIN, floor_index=wrong)
