"""The register face: what a simulated lift shows and obeys behind each map. Time is a plain number."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from register_maps.words import Door, Mode, Motion, Side, Table
from simulator import shaft
from simulator.controller import Inputs, Parameters, ShownState
from simulator.modes import Key
from simulator.registers import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ExceptionReply, RegisterFace
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled

SCAN_S = 0.05
FRONT = frozenset({Side.FRONT})
ROBOT_DELAY_S = 0.3
"""By then robot mode is granted to a lift that stands idle."""

# generic-registers, typed from its YAML
ALIVE, FLOOR, MOTION, DOOR, MODE, FLAGS, DESTINATION, ACCEPTED = range(8)
GO_TO, HOLD, ROBOT, CLOSE = range(16, 20)
MOTIONS = {Motion.STOPPED: 1, Motion.UP: 2, Motion.DOWN: 3}
DOORS = {Door.CLOSED: 1, Door.OPENING: 2, Door.OPEN: 3, Door.CLOSING: 4}
MODES = {
    Mode.NORMAL: 1,
    Mode.ROBOT: 2,
    Mode.INDEPENDENT: 3,
    Mode.INSPECTION: 4,
    Mode.FIRE: 5,
    Mode.EMERGENCY: 6,
    Mode.OUT_OF_SERVICE: 7,
}
CODES = (-1, 1, 2)
BASEMENT = 0xFFFF
WORDS = (BASEMENT, 1, 2)
"""The floors as they stand in a register."""

# two-stop-agv, typed from elevator-interfaces 1.4
CALL_4F, CALL_5F, HOLD_OPEN, HOLD_CLOSED = range(4)


@dataclass
class Lift:
    """One face and its time."""

    face: RegisterFace
    now: float = 0.0

    def holding(self) -> list[int]:
        return self.face.read(Table.HOLDING, 0, 8, self.now)

    def number(self) -> int:
        """The six discrete inputs as one number, as in the value table of the source."""
        bits = self.face.read(Table.DISCRETE, 0, 6, self.now)
        return sum(bit << place for place, bit in enumerate(bits))

    def write(self, address: int, *values: int, after_s: float = 0.0) -> None:
        self.now += after_s
        self.face.write(Table.HOLDING, address, values, self.now)

    def coils(self, *values: int, after_s: float = 0.0) -> None:
        self.now += after_s
        self.face.write(Table.COIL, 0, values, self.now)

    def people(self, inputs: Inputs) -> ShownState:
        """Let people do this, and the next scans see it."""
        self.face.people(self.now, inputs)
        return self.after(3 * SCAN_S)

    def after(self, duration_s: float) -> ShownState:
        """Let time pass with nobody looking, then look."""
        self.now += duration_s
        self.face.advance(self.now)
        return self.face.picture

    def until(self, true: Callable[[ShownState], bool], within_s: float = 60.0) -> ShownState:
        """Look at every scan until it is so."""
        for _ in range(round(within_s / SCAN_S)):
            if true(self.face.picture):
                return self.face.picture
            self.after(SCAN_S)
        raise AssertionError(f"not within {within_s} s: {self.face.picture}")

    def asks_robot_mode(self) -> None:
        self.write(ROBOT, 1)
        assert self.after(ROBOT_DELAY_S).robot_mode_on


def generic(*, start: int = 0, key: Key = Key.NORMAL, scan_s: float = SCAN_S) -> Lift:
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(3)), scan_s=scan_s)
    return Lift(RegisterFace(compiled("generic-registers"), CODES, building, start=start, key=key))


def two_stop(*, start: int = 0, key: Key = Key.ROBOT) -> Lift:
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(2)))
    return Lift(RegisterFace(compiled("two-stop-agv"), (0, 1), building, start=start, key=key))


def is_open(picture: ShownState) -> bool:
    return picture.doors[Side.FRONT] is Door.OPEN


def is_closed(picture: ShownState) -> bool:
    return picture.doors[Side.FRONT] is Door.CLOSED


def is_closing(picture: ShownState) -> bool:
    return picture.doors[Side.FRONT] is Door.CLOSING


# -- what it shows


def test_at_every_scan_of_a_ride_every_register_says_what_the_lift_does() -> None:
    lift = generic()
    seen = []
    for scan in range(round(30 / SCAN_S)):
        if scan % 20 == 0:
            lift.write(ROBOT, 1)
        if scan == 10:
            lift.write(GO_TO, 2)
        if scan == 20:
            lift.write(GO_TO, 0)
        picture, words = lift.after(SCAN_S), lift.holding()
        level, robot = picture.level_floor is not None, picture.robot_mode_on
        assert words[ALIVE] == int(lift.now * 2)
        assert words[FLOOR] == WORDS[picture.floor]
        assert words[MOTION] == MOTIONS[picture.motion]
        assert words[DOOR] == DOORS[picture.doors[Side.FRONT]]
        assert words[MODE] == MODES[picture.mode]
        assert words[FLAGS] == 0b00001 + 0b00010 * robot + 0b00100 * level
        assert words[DESTINATION] == (0 if picture.destination is None else WORDS[picture.destination])
        assert words[ACCEPTED] == (2 if 2 in picture.car_calls else 0)
        seen.append(tuple(words[FLOOR:]))
    for register, values in enumerate(zip(*seen, strict=True), start=FLOOR):
        assert len(set(values)) > 1, f"register {register} never moved"
    doors = [words[DOOR - 1] for words in seen]
    assert list(dict.fromkeys(doors)) == [1, 2, 3, 4]
    assert list(dict.fromkeys(words[FLOOR - 1] for words in seen)) == [BASEMENT, 1, 2]


@each_row(
    ("inputs", "mode"),
    [
        (Inputs(), Mode.NORMAL),
        (Inputs(robot_mode_request=True), Mode.ROBOT),
        (Inputs(key=Key.INDEPENDENT), Mode.INDEPENDENT),
        (Inputs(key=Key.INSPECTION), Mode.INSPECTION),
        (Inputs(fire=True), Mode.FIRE),
        (Inputs(emergency=True), Mode.EMERGENCY),
        (Inputs(key=Key.OUT_OF_SERVICE), Mode.OUT_OF_SERVICE),
    ],
)
def test_every_mode_has_its_code_and_fire_its_bit_too(inputs: Inputs, mode: Mode) -> None:
    lift = generic()
    lift.write(HOLD, 0)  # the robot's request counts only while somebody writes
    lift.people(inputs)
    lift.after(0.5)
    words = lift.holding()
    assert words[MODE] == MODES[mode]
    assert words[FLAGS] & 0b1 == (mode is not Mode.FIRE)
    assert bool(words[FLAGS] & 0b10) == (mode is Mode.ROBOT)


def test_the_alive_counter_counts_twice_a_second_and_goes_round() -> None:
    lift = generic()
    assert [lift.face.read(Table.HOLDING, ALIVE, 1, now) for now in (0.0, 0.4, 0.5, 1.0, 10.0)] == [
        [0], [0], [1], [2], [20],
    ]  # fmt: skip
    assert lift.face.read(Table.HOLDING, ALIVE, 1, 32767.5) == [65535]
    assert lift.face.read(Table.HOLDING, ALIVE, 1, 32768.0) == [0]


def test_a_clock_that_has_long_been_running_is_caught_up_with_at_once() -> None:
    lift = generic()
    lift.after(400 * 86_400)
    assert lift.holding()[FLOOR] == BASEMENT
    lift.asks_robot_mode()


def test_a_broken_light_curtain_shows_and_the_door_opens_again() -> None:
    lift = generic()
    lift.people(Inputs(landing_buttons=frozenset({0})))
    lift.people(Inputs())
    lift.until(is_closing)
    assert lift.holding()[FLAGS] & 0b1000 == 0
    lift.people(Inputs(obstruction=FRONT))
    assert lift.holding()[FLAGS] & 0b1000 != 0
    assert lift.holding()[DOOR] in (2, 3)


def test_a_call_is_shown_as_accepted_from_its_scan_until_it_is_served() -> None:
    lift = generic()
    lift.asks_robot_mode()
    lift.write(GO_TO, 1)
    assert lift.holding()[ACCEPTED] == 0
    lift.after(2 * SCAN_S)
    assert lift.holding()[ACCEPTED] == 1
    lift.write(GO_TO, 0, after_s=0.5)
    lift.write(ROBOT, 1, after_s=2)
    assert lift.holding()[ACCEPTED] == 1
    lift.until(lambda picture: picture.level_floor == 1)
    assert lift.holding()[ACCEPTED] == 0


def test_two_stop_agv_goes_through_the_numbers_of_its_source_on_a_ride() -> None:
    lift = two_stop()
    lift.coils(0, 1, 0, 0)
    numbers = []
    for _ in range(round(20 / SCAN_S)):
        lift.after(SCAN_S)
        numbers.append(lift.number())
    # 22 at 4F closed; 18 between; 26 at 5F closed, not open yet; 24 moving; 25 open; and closed again
    assert [number for number, before in zip(numbers, [None, *numbers], strict=False) if number != before] == [
        22, 18, 26, 24, 25, 24, 26,
    ]  # fmt: skip


def test_two_stop_agv_shows_that_agv_mode_is_not_granted() -> None:
    lift = two_stop(key=Key.NORMAL)
    assert lift.number() == 22 - 16


def test_a_floor_switch_is_made_in_the_door_zone_only() -> None:
    lift = two_stop()
    lift.coils(0, 1, 0, 0)
    for _ in range(round(8 / SCAN_S)):
        picture = lift.after(SCAN_S)
        at_a_floor = lift.number() & 0b1100 != 0
        assert at_a_floor == picture.in_door_zone


# -- presses


@each_row(("pressed_s", "taken"), [(0.2, False), (0.9, False), (1.1, True), (2.0, True)])
def test_a_press_shorter_than_a_scan_may_be_missed_and_a_longer_one_is_not(pressed_s: float, *, taken: bool) -> None:
    lift = generic(key=Key.ROBOT, scan_s=1.0)
    # just after a scan, so that a short press lies between two
    lift.write(GO_TO, 2, after_s=3.01)
    lift.write(GO_TO, 0, after_s=pressed_s)
    assert (lift.after(5).destination == 2) is taken


def test_a_short_press_on_the_instant_of_a_scan_is_seen() -> None:
    lift = generic(key=Key.ROBOT, scan_s=1.0)
    lift.write(GO_TO, 2, after_s=2.95)
    lift.write(GO_TO, 0, after_s=0.1)
    assert lift.after(1).destination == 2


def test_a_release_and_a_new_press_between_two_scans_are_one_long_press() -> None:
    lift = generic(key=Key.ROBOT)
    lift.write(GO_TO, 1)
    lift.until(is_open)
    lift.until(is_closed)
    # still pressed: no new call, for a controller sees edges
    lift.write(GO_TO, 0, after_s=0.01)
    lift.write(GO_TO, 1, after_s=0.01)
    assert is_closed(lift.after(1))
    lift.write(GO_TO, 0)
    lift.write(GO_TO, 1, after_s=2 * SCAN_S)
    assert not is_closed(lift.after(1))


def test_a_call_for_the_floor_it_stands_at_opens_the_door_and_lights_no_lamp() -> None:
    lift = generic(key=Key.ROBOT)
    lift.write(GO_TO, BASEMENT)
    lamps = []
    while not is_open(lift.after(SCAN_S)):
        lamps.append(lift.holding()[ACCEPTED])
    assert set(lamps) == {0}


@pytest.mark.parametrize("word", [9, 0x8000, BASEMENT - 1])
def test_a_floor_that_is_not_there_is_no_call(word: int) -> None:
    lift = generic(key=Key.ROBOT)
    lift.write(GO_TO, word)
    assert not lift.after(5).car_calls
    assert lift.holding()[DESTINATION] == 0


def test_only_the_value_that_the_map_gives_is_a_hold() -> None:
    lift = generic()
    lift.write(HOLD, 2)
    assert is_closed(lift.after(2))
    lift.write(HOLD, 1)
    assert not is_closed(lift.after(2))


@pytest.mark.parametrize("coils", [(1, 1, 0, 0), (0, 0, 0, 0)])
def test_two_floors_or_none_at_once_are_no_call(coils: tuple[int, ...]) -> None:
    lift = two_stop(start=1)
    lift.coils(*coils)
    assert lift.after(5).destination is None
    assert lift.number() == 26


# -- robot mode


def test_a_command_that_requires_robot_mode_is_ignored_without_it() -> None:
    lift = generic()
    lift.write(GO_TO, 2)
    lift.write(GO_TO, 0, after_s=0.5)
    assert lift.after(1).destination is None
    lift.asks_robot_mode()
    lift.write(GO_TO, 2)
    lift.write(GO_TO, 0, after_s=0.5)
    assert lift.face.picture.destination == 2


def test_two_stop_agv_refuses_every_coil_without_agv_mode() -> None:
    for coils in ((0, 1, 0, 0), (0, 0, 1, 0)):
        lift = two_stop(key=Key.NORMAL)
        lift.coils(*coils)
        picture = lift.after(5)
        assert picture.destination is None
        assert is_closed(picture)


def test_a_coil_that_is_set_already_counts_from_the_moment_agv_mode_is_granted() -> None:
    lift = two_stop(key=Key.NORMAL)
    lift.coils(0, 1, 0, 0)
    assert lift.after(1).destination is None
    lift.people(Inputs(key=Key.ROBOT))
    lift.until(lambda picture: picture.destination == 1, within_s=2)


def test_what_a_lift_does_is_the_same_however_often_it_is_looked_at() -> None:
    seldom, often = generic(), generic()
    for lift in (seldom, often):
        lift.write(ROBOT, 1)
        lift.write(GO_TO, 2)
    seldom.after(2.5)
    for _ in range(round(2.5 / SCAN_S)):
        often.after(SCAN_S)
    assert often.face.picture.position_m > 0
    assert seldom.face.picture.position_m == pytest.approx(often.face.picture.position_m, abs=0.01)


def test_fire_takes_the_lift_from_the_robot_whatever_it_writes() -> None:
    lift = generic(start=2)
    lift.asks_robot_mode()
    lift.people(Inputs(fire=True))
    lift.write(GO_TO, 1)
    lift.write(HOLD, 1)
    lift.write(ROBOT, 1)
    picture = lift.after(1)
    assert (picture.mode, picture.destination) == (Mode.FIRE, 0)
    assert lift.holding()[ACCEPTED] == 0


# -- holds and the watchdog


def test_a_hold_falls_three_refresh_times_after_the_last_write() -> None:
    lift = generic()
    lift.write(HOLD, 1)
    lift.until(is_open)
    lift.write(HOLD, 1)
    # 3 s of watchdog and 3 s of dwell
    assert is_open(lift.after(5.9))
    assert not is_open(lift.after(0.3))
    # the register keeps what was written: the controller does not believe it any more
    assert lift.face.read(Table.HOLDING, HOLD, 1, lift.now) == [1]


def test_a_hold_that_is_written_again_in_time_does_not_fall() -> None:
    lift = generic()
    lift.write(HOLD, 1)
    lift.until(is_open)
    for _ in range(30):
        lift.write(HOLD, 1, after_s=2.8)
        assert is_open(lift.face.picture)


def test_robot_mode_falls_with_the_same_watchdog() -> None:
    lift = generic()
    lift.asks_robot_mode()
    lift.write(ROBOT, 1)
    assert lift.after(2.9).robot_mode_on
    assert not lift.after(0.2).robot_mode_on
    lift.asks_robot_mode()


def test_a_trip_under_way_is_finished_in_robot_mode_when_the_client_is_lost() -> None:
    lift = generic()
    lift.asks_robot_mode()
    lift.write(GO_TO, 2)
    lift.write(GO_TO, 0, after_s=0.5)
    lift.after(4)
    assert lift.face.picture.robot_mode_on
    lift.until(lambda picture: picture.level_floor == 2 and not picture.robot_mode_on)


def test_a_hold_latches_where_the_map_says_so() -> None:
    lift = two_stop()
    lift.coils(0, 0, 1, 0)
    lift.until(is_open)
    assert is_open(lift.after(6 * 3600))
    assert lift.number() == 21
    lift.coils(0, 0, 0, 0)
    assert is_closed(lift.after(3 + 2.5 + 1))


# -- people


def test_what_people_do_comes_beside_the_network_and_neither_undoes_the_other() -> None:
    lift = generic()
    lift.write(HOLD, 1)
    lift.until(is_open)
    lift.people(Inputs(car_buttons=frozenset({1}), obstruction=FRONT))
    lift.write(HOLD, 0)
    # the network let go; the curtain is still broken
    assert is_open(lift.after(20))
    assert lift.face.picture.car_calls == {1}
    lift.write(HOLD, 1)
    lift.people(Inputs())
    # people let go; the network still holds
    assert is_open(lift.after(2))
    lift.write(HOLD, 0)
    lift.until(lambda picture: picture.level_floor == 1)


def test_a_call_of_people_is_served_but_is_not_shown_as_ours() -> None:
    lift = generic()
    lift.people(Inputs(car_buttons=frozenset({2})))
    assert lift.holding()[DESTINATION] == 2
    assert lift.holding()[ACCEPTED] == 0


def test_what_people_do_renews_no_watchdog() -> None:
    lift = generic()
    lift.asks_robot_mode()
    lift.write(ROBOT, 1)
    for _ in range(10):
        lift.after(0.2)
        lift.people(Inputs(landing_buttons=frozenset({2})))
        lift.people(Inputs())
    assert not lift.face.picture.robot_mode_on


# -- what it serves


@each_row(
    ("table", "address", "count", "code"),
    [
        (Table.HOLDING, 8, 1, ILLEGAL_ADDRESS),
        (Table.HOLDING, 7, 2, ILLEGAL_ADDRESS),
        (Table.HOLDING, 0, 20, ILLEGAL_ADDRESS),
        (Table.HOLDING, 15, 1, ILLEGAL_ADDRESS),
        (Table.HOLDING, 20, 1, ILLEGAL_ADDRESS),
        (Table.HOLDING, 65535, 1, ILLEGAL_ADDRESS),
        (Table.COIL, 0, 1, ILLEGAL_FUNCTION),
        (Table.DISCRETE, 0, 1, ILLEGAL_FUNCTION),
        (Table.INPUT, 0, 1, ILLEGAL_FUNCTION),
    ],
)
def test_a_read_outside_what_the_map_serves_is_refused(table: Table, address: int, count: int, code: int) -> None:
    with pytest.raises(ExceptionReply) as refused:
        generic().face.read(table, address, count, 0.0)
    assert refused.value.code == code


def test_a_write_outside_what_the_map_serves_is_refused_and_changes_nothing() -> None:
    lift = generic()
    for address, values in ((15, [1, 2]), (19, [0, 1]), (8, [1]), (40, [1])):
        with pytest.raises(ExceptionReply) as refused:
            lift.face.write(Table.HOLDING, address, values, 0.0)
        assert refused.value.code == ILLEGAL_ADDRESS
    assert lift.face.read(Table.HOLDING, 16, 4, 0.0) == [0, 0, 0, 0]


def test_what_the_lift_says_cannot_be_written_over() -> None:
    lift = generic()
    before = lift.holding()
    lift.write(0, *[77] * 8)
    assert lift.holding() == before


def test_what_was_read_does_not_change_behind_the_readers_back() -> None:
    lift = generic(key=Key.ROBOT)
    before = lift.holding()
    kept = list(before)
    lift.write(GO_TO, 2)
    lift.after(3)
    assert before == kept


@pytest.mark.parametrize(
    ("map_name", "codes", "said"),
    [
        ("two-stop-agv", (0, 1, 2), "2 is none of them"),
        ("generic-registers", (0, 1), "rests at 0"),
        ("generic-registers", (1, 40000), "does not fit"),
    ],
)
def test_floors_that_the_map_cannot_express_are_refused(map_name: str, codes: tuple[int, ...], said: str) -> None:
    building = Parameters(shaft=shaft.Parameters(heights_m=shaft.even_heights(len(codes))))
    with pytest.raises(ValueError, match=said):
        RegisterFace(compiled(map_name), codes, building)
