"""What the machine does wrong, or other than expected, while it is told to, and that it stops when it is told no more."""

from collections.abc import Callable
from itertools import groupby, pairwise

import pytest

from register_maps.words import Door, Mode, Motion, Side, Table
from simulator import handshake, machine_faults, shaft
from simulator.controller import Inputs, Parameters, ShownState
from simulator.faults import (
    CallsCancelled,
    Homing,
    InMode,
    MachineFault,
    NudgingDoor,
    Overload,
    Relevelling,
    ReopeningDoor,
    RobotModeWithdrawn,
    StuckDoor,
    WrongFloor,
)
from simulator.modes import Key
from tests.simulator.bench import BUILDING, FRONT, SCAN_S, Lift, all_closed, floors, opened
from tests.simulator.faces import faced
from tests.support.rows import each_row
from tests.support.written_maps import written_map

NONE: frozenset[MachineFault] = frozenset()


def these(*faults: MachineFault) -> frozenset[MachineFault]:
    return frozenset(faults)


def until(lift: Lift, true: Callable[[ShownState], bool], within_s: float = 60.0) -> ShownState:
    for _ in range(round(within_s / SCAN_S)):
        if true(lift.see()):
            return lift.see()
        lift.run(SCAN_S)
    raise AssertionError(f"not within {within_s} s: {lift.see()}")


def open_at(floor: int, parameters: Parameters | None = None) -> Lift:
    """A lift that has just opened its doors fully at a floor."""
    lift = Lift(parameters or Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(5))), at=floor)
    lift.press(car=floors(floor))
    until(lift, lambda picture: picture.door_open_floor == floor)
    return lift


def front(pictures: list[ShownState]) -> list[Door]:
    """The words of the front door, each once for as long as it lasts."""
    return [word for word, _ in groupby(picture.doors[Side.FRONT] for picture in pictures)]


# -- doors


@pytest.mark.parametrize("for_s", [0.0, 1.0], ids=["closed", "half open"])
def test_a_stuck_door_stays_where_it_is_and_moves_again_when_it_is_free(for_s: float) -> None:
    lift = Lift()
    lift.run(for_s, car_buttons=floors(0))
    before = lift.see().doors[Side.FRONT]
    assert {picture.doors[Side.FRONT] for picture in lift.watch(30, faults=these(StuckDoor()))[1:]} == {before}
    lift.run(SCAN_S, car_buttons=floors(), faults=NONE)
    assert front(lift.watch(20))[-3:] == [Door.OPEN, Door.CLOSING, Door.CLOSED]


def test_a_car_whose_door_is_stuck_open_stays_whatever_is_called() -> None:
    lift = open_at(1)
    lift.run(SCAN_S, faults=these(StuckDoor()))
    lift.press(car=floors(4), landing=floors(3))
    for picture in lift.watch(60):
        assert (picture.door_open_floor, picture.motion) == (1, Motion.STOPPED)
    assert lift.see().car_calls == floors(4)
    lift.run(SCAN_S, faults=NONE)
    assert lift.stops(60)[-2:] == [3, 4]


def test_one_stuck_door_leaves_the_other_alone_and_holds_the_car() -> None:
    lift = open_at(1, Parameters(shaft=BUILDING))
    lift.run(SCAN_S, faults=these(StuckDoor(Side.REAR)))
    lift.press(car=floors(3))
    until(lift, lambda picture: picture.doors[Side.FRONT] is Door.CLOSED)
    assert opened(lift, Side.REAR)
    assert lift.run(20).level_floor == 1


def test_a_door_that_reopens_never_shuts_and_the_car_never_leaves() -> None:
    lift = open_at(1)
    lift.run(SCAN_S, faults=these(ReopeningDoor()))
    lift.press(car=floors(3))
    words = front(lift.watch(60))
    assert words.count(Door.CLOSING) >= 4
    assert words.count(Door.OPENING) >= 4
    assert Door.CLOSED not in words
    lift.run(SCAN_S, faults=NONE)
    assert lift.stops(60)[-1] == 3


def test_a_door_that_is_shut_does_not_reopen() -> None:
    lift = Lift()
    assert all(all_closed(picture) for picture in lift.watch(20, faults=these(ReopeningDoor())))


def closing_time_s(lift: Lift) -> float:
    until(lift, lambda picture: picture.doors[Side.FRONT] is Door.CLOSING)
    seen = lift.watch(20)
    return sum(picture.doors[Side.FRONT] is Door.CLOSING for picture in seen) * SCAN_S


def test_a_nudging_door_takes_three_times_as_long_to_close() -> None:
    plain, nudging = open_at(1), open_at(1)
    nudging.run(SCAN_S, faults=these(NudgingDoor()))
    assert closing_time_s(plain) == pytest.approx(2.5, abs=3 * SCAN_S)
    assert closing_time_s(nudging) == pytest.approx(7.5, abs=3 * SCAN_S)


@pytest.mark.parametrize("what", ["hold_door", "obstruction"])
def test_a_nudging_door_reverses_for_nobody_and_says_that_it_nudges(what: str) -> None:
    lift = open_at(1)
    assert not lift.see().nudging
    assert lift.run(SCAN_S, faults=these(NudgingDoor()), **{what: FRONT}).nudging
    assert front(lift.watch(20)) == [Door.OPEN, Door.CLOSING, Door.CLOSED]
    picture = lift.run(2 * SCAN_S, faults=NONE, obstruction=frozenset(), hold_door=FRONT)
    assert not picture.nudging
    assert picture.doors[Side.FRONT] is Door.OPENING


def test_a_call_does_not_reopen_a_nudging_door_and_is_served_when_it_is_shut() -> None:
    lift = open_at(1)
    lift.run(SCAN_S, faults=these(NudgingDoor()))
    until(lift, lambda picture: picture.doors[Side.FRONT] is Door.CLOSING)
    assert lift.press(landing=floors(1)).landing_calls == floors(1)
    words = front(lift.watch(15))
    assert words[:3] == [Door.CLOSING, Door.CLOSED, Door.OPENING]
    assert lift.see().landing_calls == floors()


def test_too_much_load_holds_a_nudging_door() -> None:
    lift = open_at(1)
    assert lift.run(30, faults=these(NudgingDoor(), Overload())).door_open_floor == 1


# -- where the car goes


@each_row(
    ("call", "by", "arrives"),
    [(2, 1, 3), (2, -1, 1), (4, 1, 3), (0, -1, 1), (1, 2, 3), (3, 2, 1), (2, 3, 4), (4, 3, 1)],
)
def test_the_car_is_sent_to_another_floor_and_takes_the_call_as_served(call: int, by: int, arrives: int) -> None:
    lift = Lift(at=2 if arrives != 2 else 0)
    lift.run(SCAN_S, faults=these(WrongFloor(by)))
    assert lift.press(car=floors(call)).car_calls == floors(call)
    assert lift.see().destination == arrives
    assert lift.stops(60) == [arrives]
    assert lift.see().car_calls == floors()


def test_a_call_that_was_not_served_yet_goes_right_once_the_fault_is_gone() -> None:
    lift = Lift()
    lift.run(SCAN_S, faults=these(WrongFloor()))
    lift.press(car=floors(1))
    lift.run(SCAN_S, faults=NONE)
    assert lift.stops(30) == [1]


def test_a_robot_is_told_to_get_in_at_the_wrong_floor() -> None:
    lift = Lift(Parameters(shaft=BUILDING, handshake=handshake.Rules()))
    lift.run(SCAN_S, faults=these(WrongFloor()))
    lift.run(2 * SCAN_S, commands={"call": 2})
    picture = until(lift, lambda picture: picture.may_enter)
    assert (picture.floor, picture.door_open_floor) == (3, 3)


def test_fire_recalls_to_the_right_floor_whatever_floor_calls_go_to() -> None:
    lift = Lift(at=3)
    assert lift.run(60, fire=True, faults=these(WrongFloor())).door_open_floor == 0


@each_row("by", [1, -1, 2, -5, 40])
@each_row("count", [2, 3, 5])
def test_a_wrong_floor_is_always_a_floor_and_never_the_right_one(by: int, count: int) -> None:
    for call in range(count):
        assert machine_faults.sent_to(call, by, count) in set(range(count)) - {call}


# -- re-levelling


def relevelled(lift: Lift, duration_s: float, fault: Relevelling) -> list[ShownState]:
    return lift.watch(duration_s, hold_door=FRONT, faults=these(fault))


def test_an_open_car_sinks_and_drives_back_level_with_its_doors_open_again_and_again() -> None:
    lift = open_at(1)
    seen = relevelled(lift, 11, Relevelling(every_s=2.0, sinks_m=0.012))
    assert {picture.doors[Side.FRONT] for picture in seen} == {Door.OPEN}
    moves = [motion for motion, _ in groupby(picture.motion for picture in seen)]
    assert moves == [Motion.STOPPED, Motion.UP] * (len(moves) // 2) + [Motion.STOPPED] * (len(moves) % 2)
    assert moves.count(Motion.UP) == 4
    assert min(picture.position_m for picture in seen) == pytest.approx(3.2 - 0.012)
    assert max(picture.position_m for picture in seen) == 3.2


def test_the_car_is_not_level_while_it_is_out_of_the_tolerance_or_moves() -> None:
    for picture in relevelled(open_at(1), 11, Relevelling()):
        near = abs(picture.position_m - 3.2) <= 0.005
        assert (picture.level_floor == 1) == (near and picture.motion is Motion.STOPPED)
        assert picture.door_open_floor == picture.level_floor
        assert (picture.floor, picture.in_door_zone, picture.destination) == (1, True, None)


def test_it_creeps_and_stays_in_the_door_zone_however_far_it_is_told_to_sink() -> None:
    seen = relevelled(open_at(1), 20, Relevelling(every_s=1.0, sinks_m=5.0))
    assert min(picture.position_m for picture in seen) == pytest.approx(3.1)
    assert 0.09 < max(picture.speed_m_s for picture in seen) <= 0.1 + 1e-9


def test_a_car_with_its_doors_shut_does_not_sink() -> None:
    for picture in Lift(at=1).watch(20, faults=these(Relevelling(every_s=0.5))):
        assert (picture.level_floor, picture.position_m) == (1, 3.2)


@each_row("after_s", [0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_taken_away_at_any_moment_the_car_comes_level_and_stays(after_s: float) -> None:
    lift = open_at(1)
    relevelled(lift, 2.1 + after_s, Relevelling(every_s=2.0))
    lift.run(1.0, faults=NONE)
    assert {(picture.level_floor, picture.motion) for picture in lift.watch(10)} == {(1, Motion.STOPPED)}


def test_calls_are_served_between_the_runs() -> None:
    lift = Lift()
    lift.run(SCAN_S, faults=these(Relevelling(every_s=0.3)))
    lift.press(car=floors(2, 4))
    assert list(dict.fromkeys(lift.stops(60))) == [2, 4]
    assert not lift.see().car_calls


def test_the_doors_close_and_the_car_leaves_though_it_is_out_of_level() -> None:
    lift = open_at(1, Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(5), door_close_s=0.1)))
    relevelled(lift, 2.2, Relevelling(every_s=2.0, sinks_m=0.1))
    assert lift.see().level_floor is None
    lift.press(car=floors(3))
    lift.run(2 * SCAN_S, hold_door=frozenset(), close_door=FRONT)
    lift.run(SCAN_S, close_door=frozenset(), faults=NONE)
    assert lift.stops(30)[-1] == 3


def test_in_inspection_the_car_stops_where_it_is_with_its_doors_open() -> None:
    lift = open_at(1)
    relevelled(lift, 1.9, Relevelling(every_s=0.3, sinks_m=0.1))
    until(lift, lambda picture: picture.motion is Motion.UP)
    lift.run(0.3, key=Key.INSPECTION, faults=NONE)
    assert {picture.motion for picture in lift.watch(10)} == {Motion.STOPPED}
    lift.run(2.0, key=Key.NORMAL)
    assert lift.see().level_floor == 1


# -- what the program forgets, refuses and does not know


def test_homing_drives_to_the_lowest_floor_with_its_doors_shut_and_then_takes_calls() -> None:
    lift = Lift(at=3)
    seen = lift.watch(20, faults=these(Homing()))
    home = next(n for n, picture in enumerate(seen) if picture.floor_known)
    assert not any(picture.floor_known for picture in seen[:home])
    assert all(picture.floor_known for picture in seen[home:])
    assert seen[home].level_floor == 0
    assert all(all_closed(picture) for picture in seen)
    assert {picture.last_known_floor for picture in seen[:home]} == {3}
    assert seen[home].last_known_floor == 0
    lift.press(car=floors(2))
    assert lift.stops(30) == [2]


def test_homing_forgets_calls_and_takes_none_before_it_is_done() -> None:
    lift = Lift(at=3)
    lift.press(car=floors(4), landing=floors(2))
    lift.run(SCAN_S, faults=these(Homing()))
    lift.press(car=floors(1), landing=floors(2))
    for picture in lift.watch(30, car_buttons=floors(3)):
        assert (picture.car_calls, picture.landing_calls) == (floors(), floors())
    assert lift.see().level_floor == 0


def test_homing_shuts_an_open_door_first_unless_somebody_stands_in_it() -> None:
    lift = open_at(3)
    lift.run(20, faults=these(Homing()), obstruction=FRONT)
    assert not lift.see().floor_known
    assert opened(lift, Side.FRONT)
    lift.run(20, obstruction=frozenset(), hold_door=FRONT)
    assert (lift.see().floor_known, lift.see().level_floor) == (True, 0)


def test_homing_at_the_lowest_floor_is_over_at_once() -> None:
    assert Lift().run(2 * SCAN_S, faults=these(Homing())).floor_known


def test_homing_taken_away_on_the_way_leaves_a_lift_that_takes_calls() -> None:
    lift = Lift(at=4)
    assert not lift.run(3, faults=these(Homing())).floor_known
    assert lift.run(SCAN_S, faults=NONE).floor_known
    lift.press(car=floors(4))
    assert lift.stops(30) == [4]


def test_a_lift_that_homes_obeys_the_recall_afterwards_and_inspection_at_once() -> None:
    lift = Lift(Parameters(shaft=BUILDING, fire_floor=2), at=4)
    lift.run(1, faults=these(Homing()), fire=True)
    assert lift.see().destination == 0
    lift.run(0.5, key=Key.INSPECTION)
    lift.run(2)
    assert (lift.see().motion, lift.see().floor_known) == (Motion.STOPPED, False)
    assert lift.run(60, key=Key.NORMAL).door_open_floor == 2


FLOOR_MAP = """\
signals:
  car_floor: {at: "input:0", as: floorUNKNOWN}
  door.front: {at: "discrete:20"}
commands:
  go_to: {at: "holding:100", as: floor, action: pulse, width_s: 0.5, rest: 999, confirm: {any_of: [effect], within_s: 30}}
"""


@pytest.mark.parametrize(("unknown", "says"), [(", unknown: [77]", 77), ("", 4)])
def test_while_it_homes_the_map_says_that_the_floor_is_unknown_or_else_the_last_one(unknown: str, says: int) -> None:
    lift = faced(written_map(FLOOR_MAP.replace("UNKNOWN", unknown)), (1, 2, 3, 4), start=3)
    lift.people(Inputs(faults=these(Homing())))
    lift.after(6)
    assert lift.face.picture.floor < 3
    assert lift.read(Table.INPUT, 0) == [says]
    lift.after(20)
    assert lift.read(Table.INPUT, 0) == [1]


def test_calls_are_cancelled_once_at_the_moment_this_begins() -> None:
    lift = Lift()
    lift.press(car=floors(4), landing=floors(2))
    picture = lift.run(2 * SCAN_S, faults=these(CallsCancelled()))
    assert (picture.car_calls, picture.landing_calls) == (floors(), floors())
    lift.run(5)
    assert lift.press(car=floors(3)).car_calls == floors(3)
    assert lift.stops(30) == [3]
    lift.press(car=floors(1))
    lift.run(SCAN_S, faults=NONE)
    assert lift.stops(30) == [1]


def test_a_moving_car_whose_calls_are_cancelled_stops_at_a_floor_with_its_doors_shut() -> None:
    lift = Lift()
    lift.press(car=floors(4))
    lift.run(3)
    lift.run(SCAN_S, faults=these(CallsCancelled()))
    seen = lift.watch(30)
    assert seen[-1].level_floor is not None
    assert all(all_closed(picture) for picture in seen)


def test_cancelled_calls_of_a_robot_are_forgotten_too() -> None:
    lift = Lift(Parameters(shaft=BUILDING, handshake=handshake.Rules()))
    lift.run(2 * SCAN_S, commands={"call": 2})
    lift.run(SCAN_S, faults=these(CallsCancelled()))
    assert not any(picture.may_enter for picture in lift.watch(30))


def test_robot_mode_is_taken_away_and_refused_until_it_is_allowed_again() -> None:
    lift = Lift()
    assert lift.run(1, robot_mode_request=True).robot_mode_on
    for picture in lift.watch(10, faults=these(RobotModeWithdrawn())):
        assert picture.mode is Mode.NORMAL
    assert lift.run(1, faults=NONE).robot_mode_on


def test_robot_mode_is_taken_away_from_a_moving_car_too() -> None:
    lift = Lift()
    lift.run(1, robot_mode_request=True)
    lift.press(car=floors(4))
    assert lift.run(2).motion is Motion.UP
    assert not lift.run(SCAN_S, faults=these(RobotModeWithdrawn())).robot_mode_on
    assert lift.stops(30) == [4]


# -- modes and load


@each_row("mode", [Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT, Mode.OUT_OF_SERVICE])
def test_a_mode_holds_for_as_long_as_the_fault_does(mode: Mode) -> None:
    lift = Lift()
    assert lift.run(2 * SCAN_S, faults=these(InMode(mode))).mode is mode
    assert lift.run(30).mode is mode
    assert lift.run(2 * SCAN_S, faults=NONE).mode is Mode.NORMAL


@each_row(
    ("key", "fault", "mode"),
    [
        (Key.INSPECTION, Mode.INDEPENDENT, Mode.INSPECTION),
        (Key.INDEPENDENT, Mode.OUT_OF_SERVICE, Mode.OUT_OF_SERVICE),
        (Key.ROBOT, Mode.INDEPENDENT, Mode.INDEPENDENT),
        (Key.INSPECTION, Mode.FIRE, Mode.INSPECTION),
        (Key.OUT_OF_SERVICE, Mode.EMERGENCY, Mode.EMERGENCY),
    ],
)
def test_a_mode_comes_on_top_of_what_people_set_and_the_highest_holds(key: Key, fault: Mode, mode: Mode) -> None:
    lift = Lift()
    assert lift.run(2 * SCAN_S, key=key, faults=these(InMode(fault))).mode is mode


def test_fire_as_a_fault_recalls_the_car_as_the_input_does() -> None:
    by_fault, by_input = Lift(at=3), Lift(at=3)
    assert by_fault.run(30, faults=these(InMode(Mode.FIRE))) == by_input.run(30, fire=True)


def test_too_much_load_keeps_the_doors_open_and_the_car_where_it_is() -> None:
    lift = open_at(1)
    lift.run(SCAN_S, faults=these(Overload()))
    lift.press(car=floors(3))
    for picture in lift.watch(30):
        assert (picture.door_open_floor, picture.overload) == (1, True)
    lift.run(SCAN_S, faults=NONE)
    assert lift.stops(30)[-1] == 3


# -- together


def test_the_order_of_faults_never_matters() -> None:
    some: list[MachineFault] = [
        StuckDoor(),
        WrongFloor(2),
        WrongFloor(-1),
        Relevelling(3.0),
        Relevelling(1.0),
        InMode(Mode.FIRE),
    ]
    assert machine_faults.combine_faults(frozenset(some)) == machine_faults.combine_faults(frozenset(reversed(some)))
    assert machine_faults.combine_faults(frozenset(some)).relevelling == Relevelling(1.0)


def test_an_idle_lift_with_faults_costs_nothing_either() -> None:
    lift = Lift()
    lift.run(60, faults=these(StuckDoor(), NudgingDoor(), Relevelling(), WrongFloor(), Homing(), CallsCancelled()))
    before = lift.state
    lift.run(10 * 24 * 3600.0)  # scan by scan this would take an hour
    assert lift.state._replace(since_scan_s=0.0) == before._replace(since_scan_s=0.0)


@each_row(
    ("make", "words"),
    [
        (lambda: WrongFloor(0), "by must not be 0"),
        (lambda: Relevelling(every_s=0.0), "above 0"),
        (lambda: Relevelling(sinks_m=-0.1), "above 0"),
        (lambda: InMode(Mode.NORMAL), "fire, emergency, inspection"),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused(make: Callable[[], MachineFault], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_speeds_change_no_faster_than_the_car_brakes_when_faults_come_and_go() -> None:
    lift = Lift()
    lift.press(car=floors(4))
    faults = [these(Homing()), NONE, these(CallsCancelled()), NONE, these(WrongFloor(-2)), NONE, these(StuckDoor())]
    seen = [picture for some in faults for picture in lift.watch(1.3, faults=some)]
    for before, after in pairwise(seen):
        assert abs(after.speed_m_s - before.speed_m_s) <= 0.8 * SCAN_S + 1e-9
