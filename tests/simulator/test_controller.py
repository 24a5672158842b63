"""The controller behaves as a lift does for the people, robots and firemen who use it."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from register_maps.words import Door, Mode, Motion, Side
from simulator import controller, shaft
from simulator.controller import Inputs, Parameters, Picture, SameFloorCall, State
from simulator.modes import Key

FRONT, REAR = frozenset({Side.FRONT}), frozenset({Side.REAR})
BOTH = FRONT | REAR
SCAN_S = 0.05
BUILDING = shaft.Parameters(heights_m=shaft.even_heights(5), doors_at=(FRONT, BOTH, REAR, FRONT, FRONT))
PLAIN = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(5)))


def floors(*indices: int) -> frozenset[int]:
    return frozenset(indices)


@dataclass
class Lift:
    """One lift on a bench: inputs stay as they are set until they are set again."""

    parameters: Parameters = PLAIN
    at: int = 0
    key: Key = Key.NORMAL
    inputs: Inputs = field(init=False)
    state: State = field(init=False)

    def __post_init__(self) -> None:
        self.state = controller.initial(self.parameters, floor_index=self.at, key=self.key)
        self.inputs = Inputs(key=self.key)

    def run(self, duration_s: float, **inputs: Any) -> Picture:
        """Set inputs, let time pass, look."""
        self.inputs = replace(self.inputs, **inputs)
        self.state = controller.step(self.state, self.inputs, duration_s, self.parameters)
        return self.see()

    def see(self) -> Picture:
        return controller.picture(self.state, self.parameters)

    def press(self, *, car: frozenset[int] = frozenset(), landing: frozenset[int] = frozenset()) -> Picture:
        """Press buttons for two scans and let go."""
        self.run(2 * SCAN_S, car_buttons=car, landing_buttons=landing)
        return self.run(2 * SCAN_S, car_buttons=frozenset(), landing_buttons=frozenset())

    def watch(self, duration_s: float, **inputs: Any) -> list[Picture]:
        return [self.run(SCAN_S, **inputs) for _ in range(round(duration_s / SCAN_S))]

    def stops(self, duration_s: float) -> list[int]:
        """Floors at which the doors come to be fully open, in order."""
        seen = [self.see().door_open_floor, *(picture.door_open_floor for picture in self.watch(duration_s))]
        return [now for before, now in pairwise(seen) if now is not None and now != before]


def opened(lift: Lift, *sides: Side) -> bool:
    return all(lift.see().doors[side] is Door.OPEN for side in sides)


def all_closed(picture: Picture) -> bool:
    return all(door is Door.CLOSED for door in picture.doors.values())


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


# -- the watchdog of the network

WATCHED = replace(PLAIN, hold_watchdog_s=2.0, robot_mode_delay_s=0.2)


def test_a_hold_that_is_not_renewed_is_let_go_by_the_watchdog() -> None:
    lift = Lift(WATCHED)
    lift.run(1.9, hold_door=FRONT, writes=1)
    assert lift.see().doors[Side.FRONT] is Door.OPENING
    lift.run(3.4)
    assert lift.see().doors[Side.FRONT] is Door.CLOSING
    assert all_closed(lift.run(60))


def test_a_hold_renewed_in_time_lasts() -> None:
    lift = Lift(WATCHED)
    for write in range(20):
        lift.run(1.8, hold_door=FRONT, writes=write)
    assert opened(lift, Side.FRONT)


def test_a_write_after_the_watchdog_has_let_go_brings_the_hold_back() -> None:
    lift = Lift(WATCHED)
    assert all_closed(lift.run(60, hold_door=FRONT, writes=1))
    assert lift.run(2 * SCAN_S, writes=2).doors[Side.FRONT] is Door.OPENING


def test_the_watchdog_runs_on_real_time_however_fast_the_lift_is() -> None:
    lift = Lift(replace(WATCHED, speed=20.0))
    assert lift.run(1.9, hold_door=FRONT, writes=1).doors[Side.FRONT] is Door.OPEN
    assert all_closed(lift.run(0.5))


def test_the_watchdog_ends_robot_mode_too_but_not_that_of_the_key() -> None:
    by_request, by_key = Lift(WATCHED), Lift(WATCHED, key=Key.ROBOT)
    assert by_request.run(1, robot_mode_request=True, writes=1).robot_mode_on
    assert not by_request.run(1.2).robot_mode_on
    assert by_key.run(60).robot_mode_on


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


@pytest.mark.parametrize(
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


@pytest.mark.parametrize(
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


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"scan_s": -1.0}, {"fire_floor": 5}])
def test_settings_that_cannot_be_are_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        replace(PLAIN, **wrong)


@pytest.mark.parametrize("wrong", [-1, 5])
def test_a_lift_cannot_start_at_a_floor_it_does_not_have(wrong: Any) -> None:
    with pytest.raises(ValueError, match="0 to 4"):
        controller.initial(PLAIN, floor_index=wrong)


# -- whatever happens

some_floors = st.frozensets(st.integers(0, 4), max_size=3)
some_sides = st.frozensets(st.sampled_from(Side))
any_inputs = st.builds(
    Inputs,
    car_buttons=some_floors,
    landing_buttons=some_floors,
    hold_door=some_sides,
    close_door=some_sides,
    obstruction=some_sides,
    robot_mode_request=st.booleans(),
    key=st.sampled_from([Key.NORMAL, *Key]),
    fire=st.sampled_from([False, False, False, True]),
    emergency=st.sampled_from([False, False, False, True]),
    writes=st.integers(0, 2),
)
scripts = st.lists(st.tuples(any_inputs, st.floats(0.01, 8.0)), min_size=1, max_size=8)
any_parameters = st.builds(
    Parameters,
    shaft=st.just(BUILDING),
    speed=st.sampled_from([0.5, 1.0, 7.0]),
    scan_s=st.sampled_from([0.02, 0.05, 0.3]),
    hold_watchdog_s=st.sampled_from([None, 2.0]),
    same_floor_call=st.sampled_from(SameFloorCall),
    fire_floor=st.integers(0, 4),
)
QUICK = settings(max_examples=15, deadline=None, derandomize=True)


@given(parameters=any_parameters, script=scripts)
@QUICK
def test_whatever_happens_the_car_does_not_jump_and_doors_open_only_where_they_may(
    parameters: Parameters, script: list[tuple[Inputs, float]]
) -> None:
    lift = Lift(parameters)
    scan_s = parameters.scan_s * parameters.speed
    before = lift.see()
    for inputs, duration_s in script:
        lift.inputs = inputs
        for _ in range(int(duration_s / parameters.scan_s)):
            after = lift.run(parameters.scan_s)
            assert abs(after.speed_m_s - before.speed_m_s) <= 0.8 * scan_s + 1e-9
            assert abs(after.position_m - before.position_m) <= 1.0 * scan_s + 1e-5
            ajar = {side for side, door in after.doors.items() if door is not Door.CLOSED}
            if ajar:
                assert after.motion is Motion.STOPPED
                assert after.level_floor is not None
                assert ajar <= parameters.doors_at[after.level_floor]
            before = after


@given(parameters=any_parameters, script=scripts, slices=st.lists(st.integers(1, 30), min_size=8, max_size=8))
@QUICK
def test_it_does_not_matter_how_time_is_sliced(
    parameters: Parameters, script: list[tuple[Inputs, float]], slices: list[int]
) -> None:
    whole, sliced = Lift(parameters), Lift(parameters)
    for (inputs, duration_s), parts in zip(script, slices, strict=False):
        whole.inputs = sliced.inputs = inputs
        whole.run(duration_s)
        for _ in range(parts):
            sliced.run(duration_s / parts)
        assert sliced.see() == whole.see()


@given(
    start=st.integers(0, 4),
    presses=st.lists(st.tuples(some_floors, some_floors, st.integers(0, 40)), min_size=1, max_size=6),
    same_floor_call=st.sampled_from(SameFloorCall),
)
@QUICK
def test_every_call_registered_in_normal_mode_is_served(
    start: int, presses: list[tuple[frozenset[int], frozenset[int], int]], same_floor_call: SameFloorCall
) -> None:
    lift = Lift(Parameters(shaft=BUILDING, same_floor_call=same_floor_call), at=start)
    owed: set[int] = set()
    for car, landing, pause in [*presses, (floors(), floors(), 600)]:
        lift.run(2 * SCAN_S, car_buttons=car, landing_buttons=landing)
        for _ in range(pause):
            picture = lift.run(4 * SCAN_S, car_buttons=floors(), landing_buttons=floors())
            owed |= picture.car_calls | picture.landing_calls
            owed.discard(-1 if picture.door_open_floor is None else picture.door_open_floor)
    assert not owed
    assert lift.see().destination is None
    assert all_closed(lift.see())
