"""The controller's modes: robots, keys, firemen, failures."""

from typing import Any

import pytest

from register_maps.words import Door, Mode, Motion, Side
from simulator.modes import Key
from tests.simulator.bench import FRONT, SCAN_S, Lift, all_closed, floors
from tests.support.rows import each_row

# -- robot mode


def test_robot_mode_is_granted_to_an_idle_lift_after_its_delay() -> None:
    lift = Lift()
    assert not lift.run(0.2, robot_mode_request=True).robot_mode_on
    assert lift.run(0.1).robot_mode_on
    assert lift.see().mode is Mode.ROBOT


def test_robot_mode_waits_until_the_calls_before_it_are_served_and_the_car_stands() -> None:
    lift = Lift()
    lift.press(car=floors(2), landing=floors(3))
    lift.run(SCAN_S, robot_mode_request=True)
    seen = lift.watch(60)
    granted = next(n for n, picture in enumerate(seen) if picture.robot_mode_on)
    assert seen[granted].level_floor == 3
    assert not any(picture.robot_mode_on for picture in seen[:granted])


def test_robot_mode_does_not_wait_for_landing_calls_made_after_it_and_drops_them() -> None:
    lift = Lift()
    lift.press(car=floors(2))
    lift.run(SCAN_S, robot_mode_request=True)
    assert lift.press(landing=floors(4)).landing_calls == floors(4)
    lift.run(20)
    assert lift.see().robot_mode_on
    assert (lift.see().level_floor, lift.see().landing_calls) == (2, frozenset())


def test_robot_mode_serves_car_calls_and_registers_no_landing_calls() -> None:
    lift = Lift(key=Key.ROBOT)
    picture = lift.press(car=floors(2), landing=floors(1))
    assert (picture.car_calls, picture.landing_calls) == (floors(2), frozenset())
    assert lift.stops(30) == [2]


def test_robot_mode_taken_back_while_travelling_lasts_until_the_car_stands() -> None:
    lift = Lift()
    lift.run(1, robot_mode_request=True)
    lift.press(car=floors(3))
    assert lift.run(1).motion is Motion.UP
    for picture in lift.watch(20, robot_mode_request=False):
        assert picture.robot_mode_on == (picture.motion is Motion.UP)
    assert lift.see().mode is Mode.NORMAL


def test_a_request_taken_back_before_the_grant_starts_from_the_beginning() -> None:
    lift = Lift()
    for _ in range(10):
        lift.run(0.2, robot_mode_request=True)
        assert not lift.run(SCAN_S, robot_mode_request=False).robot_mode_on


# -- other modes


@each_row(
    ("inputs", "mode"),
    [
        ({}, Mode.ROBOT),
        ({"key": Key.INDEPENDENT}, Mode.INDEPENDENT),
        ({"key": Key.OUT_OF_SERVICE}, Mode.OUT_OF_SERVICE),
        ({"key": Key.OUT_OF_SERVICE, "emergency": True}, Mode.EMERGENCY),
        ({"key": Key.OUT_OF_SERVICE, "emergency": True, "fire": True}, Mode.FIRE),
        ({"key": Key.INSPECTION, "emergency": True, "fire": True}, Mode.INSPECTION),
    ],
)
def test_of_several_reasons_the_highest_sets_the_mode(inputs: dict[str, Any], mode: Mode) -> None:
    lift = Lift()
    lift.run(1, robot_mode_request=True)
    assert lift.run(2 * SCAN_S, **inputs).mode is mode


@each_row(
    ("key", "mode"),
    [
        (Key.NORMAL, Mode.NORMAL),
        (Key.ROBOT, Mode.ROBOT),
        (Key.INDEPENDENT, Mode.INDEPENDENT),
        (Key.INSPECTION, Mode.INSPECTION),
        (Key.OUT_OF_SERVICE, Mode.OUT_OF_SERVICE),
    ],
)
def test_a_lift_starts_level_and_closed_in_the_mode_of_its_key(key: Key, mode: Mode) -> None:
    lift = Lift(at=3, key=key)
    for picture in (lift.see(), lift.run(1)):
        assert (picture.mode, picture.level_floor, picture.floor) == (mode, 3, 3)
        assert all_closed(picture)


def test_independent_service_ignores_landings_and_leaves_the_doors_open() -> None:
    lift = Lift(key=Key.INDEPENDENT)
    picture = lift.press(car=floors(2), landing=floors(1))
    assert (picture.car_calls, picture.landing_calls) == (floors(2), frozenset())
    assert lift.run(120).door_open_floor == 2


@pytest.mark.parametrize("word_to_go", [{"close_door": FRONT}, {"car_buttons": floors(0)}])
def test_in_independent_service_a_close_button_or_a_car_call_closes_the_doors(word_to_go: dict[str, Any]) -> None:
    lift = Lift(key=Key.INDEPENDENT)
    lift.press(car=floors(2))
    lift.run(60)
    assert lift.run(4 * SCAN_S, **word_to_go).doors[Side.FRONT] is Door.CLOSING


def test_inspection_stops_the_car_where_it_is_and_drops_all_calls() -> None:
    lift = Lift()
    lift.press(car=floors(4), landing=floors(2))
    lift.run(2)
    stopped = lift.run(10, key=Key.INSPECTION)
    assert (stopped.motion, stopped.level_floor, stopped.destination) == (Motion.STOPPED, None, None)
    assert not stopped.car_calls | stopped.landing_calls
    assert lift.press(car=floors(1)) == stopped
    assert lift.run(30, hold_door=FRONT) == stopped


def test_after_inspection_the_car_goes_to_the_nearest_floor_and_serves_again() -> None:
    lift = Lift()
    lift.press(car=floors(4))
    lift.run(2)
    lift.run(10, key=Key.INSPECTION)
    lift.run(20, key=Key.NORMAL)
    assert lift.see().level_floor is not None
    lift.press(car=floors(3))
    assert lift.stops(40) == [3]


def test_out_of_service_ends_the_trip_at_the_nearest_floor_with_doors_closed() -> None:
    lift = Lift()
    lift.press(car=floors(4), landing=floors(3))
    lift.run(2)
    assert not lift.run(SCAN_S, key=Key.OUT_OF_SERVICE).car_calls
    for picture in lift.watch(30):
        assert all_closed(picture)
    assert lift.see().level_floor == 1
    assert lift.press(car=floors(2), landing=floors(2)).destination is None


def test_out_of_service_still_lets_people_out_with_the_open_button() -> None:
    lift = Lift(key=Key.OUT_OF_SERVICE)
    assert lift.run(3, hold_door=FRONT).door_open_floor == 0
    assert all_closed(lift.run(10, hold_door=frozenset()))


def test_fire_takes_the_car_without_stops_to_the_fire_floor_and_keeps_it_open_there() -> None:
    lift = Lift(at=3)
    lift.press(car=floors(2, 4), landing=floors(1))
    lift.run(SCAN_S, fire=True)
    assert not lift.see().car_calls | lift.see().landing_calls
    assert lift.stops(60) == [0]
    closing = {"close_door": FRONT, "robot_mode_request": True, "car_buttons": floors(3)}
    assert lift.run(600, **closing).door_open_floor == 0
    assert lift.see().mode is Mode.FIRE


def test_fire_turns_a_car_that_is_going_the_other_way_without_opening_its_doors() -> None:
    lift = Lift(at=1)
    lift.press(car=floors(4))
    lift.run(3)
    assert lift.see().motion is Motion.UP
    lift.run(SCAN_S, fire=True)
    seen = lift.watch(60)
    assert max(picture.floor for picture in seen) == 2
    assert {picture.door_open_floor for picture in seen} == {None, 0}


def test_fire_closes_held_doors_elsewhere_but_not_on_an_obstruction() -> None:
    lift = Lift(at=2)
    lift.run(10, hold_door=FRONT)
    assert lift.run(2 * SCAN_S, fire=True).doors[Side.FRONT] is Door.CLOSING
    assert lift.run(30, obstruction=FRONT).door_open_floor == 2
    lift.run(60, obstruction=frozenset())
    assert lift.see().door_open_floor == 0


def test_after_fire_the_doors_close_and_nothing_is_remembered() -> None:
    lift = Lift(at=2)
    lift.press(car=floors(4))
    lift.run(60, fire=True)
    after = lift.run(20, fire=False)
    assert (after.mode, after.level_floor, after.destination) == (Mode.NORMAL, 0, None)
    assert all_closed(after)


def test_a_call_button_held_through_a_fire_does_not_call_afterwards() -> None:
    lift = Lift()
    lift.run(10, fire=True, car_buttons=floors(3))
    assert lift.run(30, fire=False).destination is None


def test_emergency_stops_at_the_nearest_floor_and_opens() -> None:
    lift = Lift()
    lift.press(car=floors(4), landing=floors(3))
    lift.run(2)
    lift.run(60, emergency=True)
    assert (lift.see().door_open_floor, lift.see().mode) == (1, Mode.EMERGENCY)
    assert not lift.press(car=floors(2)).car_calls
    assert lift.run(60, close_door=FRONT).door_open_floor == 1


def test_a_fault_takes_the_lift_out_of_service_and_shows() -> None:
    lift = Lift()
    lift.press(car=floors(4))
    lift.run(2)
    assert not lift.run(SCAN_S, fault=True).car_calls
    resting = lift.run(30)
    assert (resting.mode, resting.fault, resting.level_floor) == (Mode.OUT_OF_SERVICE, True, 1)
    assert lift.press(car=floors(2)).destination is None
    assert lift.run(SCAN_S, fault=False).mode is Mode.NORMAL


def test_fire_goes_before_a_fault() -> None:
    lift = Lift(at=2)
    assert lift.run(SCAN_S, fault=True, fire=True).mode is Mode.FIRE
    assert lift.stops(30) == [0]


def test_an_overloaded_car_keeps_its_door_open_and_does_not_start() -> None:
    lift = Lift()
    lift.press(car=floors(0))
    lift.run(2.2)
    lift.press(car=floors(3))
    waiting = lift.run(60, overload=True, close_door=FRONT)
    assert (waiting.door_open_floor, waiting.overload, waiting.motion) == (0, True, Motion.STOPPED)
    assert lift.run(SCAN_S, overload=False, close_door=frozenset()).car_calls == floors(3)
    assert lift.stops(30) == [3]


def test_an_overload_with_the_door_closed_opens_it_and_one_on_the_way_stops_nothing() -> None:
    standing, moving = Lift(), Lift()
    assert standing.run(3, overload=True).door_open_floor == 0
    moving.press(car=floors(1))
    moving.run(1)
    assert moving.run(SCAN_S, overload=True).motion is Motion.UP
    assert moving.run(60).door_open_floor == 1
