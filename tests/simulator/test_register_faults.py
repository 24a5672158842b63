"""What is read and what becomes of writes while the registers of a lift are at fault; the picture stays the truth throughout."""

import math
from itertools import pairwise

import pytest

from lift_manager.lab.plant import simulated_lift
from register_maps.words import Door, Mode, Motion, Side, Table
from simulator.controller import Inputs, Parameters
from simulator.faults import (
    ContradictingLimits,
    DisconnectedSignal,
    Fault,
    FloorAhead,
    ForeignCell,
    ForeignWriter,
    FrozenHeartbeat,
    FrozenRegisters,
    IgnoredWrites,
    LostPress,
    Overload,
    RegisterFault,
    Relevelling,
    SaysWrongFloor,
    Stopped,
)
from simulator.modes import Key
from simulator.registers import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionReply
from tests.simulator.faces import SCAN_S, Faced, faced, is_closed, is_open, stands_open_at
from tests.support.good_map import HANDSHAKE
from tests.support.rows import each_row
from tests.support.shipped_maps import compiled
from tests.support.written_maps import written_map

COIL, DISCRETE, HOLDING, INPUT = Table.COIL, Table.DISCRETE, Table.HOLDING, Table.INPUT

# generic-registers, typed from its YAML
ALIVE, FLOOR, MOTION, DOOR, MODE, FLAGS, DESTINATION, ACCEPTED = range(8)
GO_TO, HOLD, ROBOT = 16, 17, 18
DOOR_CODES = {1, 2, 3, 4, 5}
"""What the door register may say, a fault among them."""
WATCHDOG_S = 3.0
TIMED_HOLD = """\
signals:
  car_floor: {at: "input:1", as: floor}
  door.front: {at: "discrete:0"}
commands:
  hold_door.front:
    at: "holding:8"
    action: hold
    max_hold_s: 6
    refresh_s: 2
    on_link_loss: timed_by_device
    payload: {time: max_hold_s, unit_s: 0.1}
    confirm: {any_of: [effect], within_s: 5}
"""


def generic(*, start: int = 0, key: Key = Key.ROBOT, like: Parameters | None = None) -> Faced:
    return faced("generic-registers", (1, 2, 3, 4), start=start, key=key, like=like)


def coils(*, start: int = 0) -> Faced:
    """generic-coils: calls at coils 0 to 7, floor at discrete 0 to 7, limits at discrete 16 and 17."""
    return faced("generic-coils", tuple(range(8)), start=start, key=Key.ROBOT)


def begun(lift: Faced, *faults: Fault) -> Faced:
    for fault in faults:
        lift.face.begin(fault, lift.now)
    return lift


def ended(lift: Faced, *faults: Fault) -> Faced:
    for fault in faults:
        lift.face.end(fault, lift.now)
    return lift


def press(lift: Faced, floor: int, *, for_s: float = 0.5) -> None:
    """Call a floor of generic-registers by its code, and let go."""
    lift.write(HOLDING, GO_TO, floor)
    lift.write(HOLDING, GO_TO, 0, after_s=for_s)


def moving(lift: Faced, to: int = 4) -> Faced:
    """A generic lift at full speed."""
    press(lift, to)
    lift.until(lambda picture: abs(picture.speed_m_s) == 1.0)
    return lift


# -- begin and end


def test_faults_are_present_from_begin_to_end_and_twice_is_as_good_as_once() -> None:
    lift = begun(generic(), LostPress(), Overload(), LostPress())
    assert lift.face.faults == {LostPress(), Overload()}
    ended(lift, LostPress(), LostPress())
    assert lift.face.faults == {Overload()}


def test_a_fault_of_the_machine_stays_whatever_people_do_and_goes_when_it_ends() -> None:
    lift = begun(generic(), Overload())
    assert lift.people(Inputs()).overload
    ended(lift, Overload())
    assert not lift.after(1).overload


def test_a_fault_that_came_in_with_the_people_goes_with_them() -> None:
    lift = generic()
    lift.people(Inputs(faults=frozenset({Overload()})))
    ended(begun(lift, Relevelling()), Relevelling())
    assert lift.after(1).overload
    assert not lift.people(Inputs()).overload


def test_a_fault_takes_effect_at_its_own_instant_however_time_is_cut() -> None:
    faults: list[tuple[float, Fault]] = [(1.07, Stopped()), (2.333, FloorAhead()), (3.1, LostPress())]

    def run(step_s: float) -> list[object]:
        lift = generic()
        seen: list[object] = []
        lift.write(HOLDING, GO_TO, 4)
        for at, fault in faults:
            while lift.now + step_s < at:
                lift.after(step_s)
            lift.after(at - lift.now)
            begun(lift, fault)
        for at in (5.0, 9.0):
            while lift.now + step_s < at:
                lift.after(step_s)
            seen.append(lift.after(at - lift.now))
            ended(lift, Stopped())
        return seen

    assert run(0.013) == run(0.4) == run(100)


# -- what is told


@each_row(("by", "start", "shown"), [(1, 0, 2), (1, 2, 4), (1, 3, 3), (-1, 0, 2), (-1, 3, 3), (2, 1, 4)])
def test_the_wrong_floor_is_so_many_floors_off_and_on_the_other_side_at_the_end_of_the_shaft(
    by: int, start: int, shown: int
) -> None:
    lift = begun(generic(start=start), SaysWrongFloor(by))
    assert lift.read(HOLDING, FLOOR) == [shown]
    assert lift.read(HOLDING, FLAGS)[0] & 0b100, "level it is"
    assert lift.face.picture.level_floor == start
    assert ended(lift, SaysWrongFloor(by)).read(HOLDING, FLOOR) == [start + 1]


def test_a_wrong_floor_switch_is_made_in_the_door_zone_of_the_right_floor_only() -> None:
    lift = begun(faced("two-stop-agv", (0, 1), key=Key.ROBOT), SaysWrongFloor())
    assert lift.read(DISCRETE, 2, 2) == [0, 1]
    lift.write(COIL, 0, 0, 1, 0, 0)
    lift.until(lambda picture: not picture.in_door_zone)
    assert lift.read(DISCRETE, 2, 2) == [0, 0]
    lift.until(stands_open_at(1))
    assert lift.read(DISCRETE, 0, 4) == [1, 0, 1, 0]


def test_a_wrong_floor_makes_the_open_limit_of_the_other_landing() -> None:
    # elevator-interfaces 1.3: discrete 1 and 3, coils 17 and 19
    lift = begun(faced("seer-lps3-two-stop", (0, 1)), SaysWrongFloor())
    lift.write(COIL, 17, 1)
    lift.until(stands_open_at(0))
    assert lift.read(DISCRETE, 1, 3) == [0, 0, 1]


def test_a_floor_ahead_is_that_of_the_next_stop_from_the_moment_the_car_leaves() -> None:
    lift = begun(generic(), FloorAhead())
    press(lift, 3)
    assert lift.until(lambda picture: picture.motion is Motion.UP).floor == 0
    assert lift.read(HOLDING, FLOOR) == [3]
    floors = set()
    while lift.after(SCAN_S).motion is Motion.UP:
        floors |= set(lift.read(HOLDING, FLOOR))
    assert floors == {3}
    assert lift.face.picture.level_floor == 2


def test_a_floor_ahead_without_a_stop_to_come_is_the_next_floor_of_the_way() -> None:
    lift = moving(begun(generic(), FloorAhead()))
    lift.people(Inputs(key=Key.INSPECTION))
    assert lift.face.picture.motion is Motion.UP
    assert lift.face.picture.destination is None
    assert lift.read(HOLDING, FLOOR) == [lift.face.picture.floor + 2]


def test_a_car_that_levels_with_its_door_open_does_not_leave() -> None:
    lift = begun(generic(start=1), FloorAhead(), Relevelling())
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    motions = set()
    for _ in range(200):
        motions.add(lift.after(SCAN_S).motion)
        assert lift.read(HOLDING, FLOOR) == [2]
    assert Motion.UP in motions


def test_a_floor_ahead_shows_between_two_floors_too_where_each_floor_has_a_switch() -> None:
    lift = begun(coils(), FloorAhead())
    lift.write(COIL, 2, 1)
    assert not lift.until(lambda picture: not picture.in_door_zone).in_door_zone
    assert lift.read(DISCRETE, 0, 8) == [0, 0, 1, 0, 0, 0, 0, 0]
    ended(lift, FloorAhead())
    assert lift.read(DISCRETE, 0, 8) == [0] * 8


@pytest.mark.parametrize("opened", [False, True])
def test_contradicting_limits_are_both_made_whatever_the_door_does(*, opened: bool) -> None:
    lift = begun(coils(), ContradictingLimits())
    lift.write(COIL, 8, int(opened))
    assert is_open(lift.after(2.5)) is opened
    assert lift.read(DISCRETE, 16, 2) == [1, 1]
    ended(lift, ContradictingLimits())
    assert lift.read(DISCRETE, 16, 2) == [int(opened), int(not opened)]


def test_a_door_told_in_one_word_contradicts_itself_in_a_code_that_its_map_does_not_list() -> None:
    lift = begun(generic(), ContradictingLimits())
    assert lift.read(HOLDING, DOOR)[0] not in DOOR_CODES
    assert lift.face.picture.doors[Side.FRONT] is Door.CLOSED


def test_open_limits_contradict_each_other_at_two_floors() -> None:
    lift = begun(faced("seer-lps3-two-stop", (0, 1)), ContradictingLimits())
    assert lift.read(DISCRETE, 1, 3) == [1, 0, 1]


def test_the_other_door_contradicts_nothing() -> None:
    lift = begun(generic(), ContradictingLimits(Side.REAR))
    assert lift.read(HOLDING, DOOR) == [1]


def test_frozen_registers_stand_still_heartbeat_and_all_while_the_lift_goes_on() -> None:
    lift = generic()
    before = lift.read(HOLDING, 0, 8)
    begun(lift, FrozenRegisters())
    press(lift, 3)
    lift.write(HOLDING, HOLD, 1)
    assert lift.read(HOLDING, HOLD) == [0]
    lift.until(stands_open_at(2))
    assert lift.read(HOLDING, 0, 8) == before
    assert lift.face.stored(HOLDING, HOLD, lift.now) == 1
    ended(lift, FrozenRegisters())
    assert lift.read(HOLDING, ALIVE, 4) == [int(lift.now * 2), 3, 1, 3]
    assert lift.read(HOLDING, HOLD) == [1]


def test_a_frozen_heartbeat_is_all_that_stands_still() -> None:
    lift = generic()
    lift.after(3.2)
    begun(lift, FrozenHeartbeat())
    press(lift, 3)
    lift.until(stands_open_at(2))
    assert lift.read(HOLDING, ALIVE, 4) == [6, 3, 1, 3]
    ended(lift, FrozenHeartbeat())
    assert lift.read(HOLDING, ALIVE) == [int(lift.now * 2)]


# -- a program in STOP


def test_a_stopped_controller_brakes_its_car_and_answers_as_if_nothing_happened() -> None:
    lift = moving(generic())
    before = lift.read(HOLDING, 0, 8)
    begun(lift, Stopped())
    at_m = lift.face.picture.position_m
    stood = lift.after(1.25)
    assert stood.motion is Motion.STOPPED
    assert stood.position_m == pytest.approx(at_m + 1.0**2 / (2 * 0.8))
    assert lift.after(600) == stood
    assert lift.read(HOLDING, 0, 8) == before


def test_a_stopped_controller_stores_what_is_written_and_acts_on_it_once_it_runs() -> None:
    lift = begun(generic(), Stopped())
    lift.write(HOLDING, GO_TO, 3)
    lift.write(HOLDING, FLOOR, 77)
    assert lift.read(HOLDING, GO_TO) == [3]
    assert lift.read(HOLDING, FLOOR) == [1], "where the lift speaks it says what it said"
    assert lift.after(60).level_floor == 0
    ended(lift, Stopped())
    assert lift.after(0.2).destination == 2


def test_doors_of_a_stopped_lift_stay_as_they_are() -> None:
    lift = generic()
    lift.write(HOLDING, HOLD, 1)
    half = lift.after(1).doors
    assert half[Side.FRONT] is Door.OPENING
    begun(lift, Stopped())
    assert lift.after(20).doors == half
    ended(lift, Stopped())
    assert is_open(lift.after(1.5))


def test_the_alive_counter_of_a_stopped_controller_goes_on_where_it_stood() -> None:
    lift = generic()
    lift.after(5)
    begun(lift, Stopped())
    lift.after(20)
    assert lift.read(HOLDING, ALIVE) == [10]
    ended(lift, Stopped())
    assert lift.read(HOLDING, ALIVE) == [10]
    lift.after(0.5)
    assert lift.read(HOLDING, ALIVE) == [11]


def test_no_stop_however_timed_turns_the_alive_counter_back() -> None:
    lift = generic()
    lift.after(1000.1)
    for stops in range(60):
        lift.after(0.1 * stops)
        before = lift.read(HOLDING, ALIVE)
        begun(lift, Stopped())
        lift.after(0.7)
        ended(lift, Stopped())
        assert lift.read(HOLDING, ALIVE) == before


def test_a_stopped_car_finishes_its_trip_once_the_program_runs_again() -> None:
    lift = moving(generic())
    begun(lift, Stopped())
    lift.after(10)
    ended(lift, Stopped())
    assert lift.until(stands_open_at(3)).level_floor == 3


# -- what is heard


def test_so_many_presses_are_lost_as_the_fault_says_and_the_next_is_taken() -> None:
    lift = begun(generic(), LostPress(2))
    for _ in range(2):
        lift.write(HOLDING, GO_TO, 3)
        assert lift.read(HOLDING, GO_TO) == [3], "answered and stored"
        assert lift.after(5).destination is None
        lift.write(HOLDING, GO_TO, 0)
        lift.after(1)
    lift.write(HOLDING, GO_TO, 3)
    assert lift.after(1).destination == 2


def test_a_lost_press_stays_lost_while_it_lasts_however_often_it_is_written() -> None:
    lift = begun(generic(), LostPress())
    for _ in range(5):
        lift.write(HOLDING, HOLD, 1, after_s=1)
    ended(lift, LostPress())
    assert is_closed(lift.after(1))
    lift.write(HOLDING, HOLD, 0)
    lift.write(HOLDING, HOLD, 1, after_s=1)
    assert is_open(lift.after(2.5))


def test_only_what_newly_asks_is_lost() -> None:
    lift = generic(key=Key.NORMAL)
    lift.write(HOLDING, ROBOT, 1)
    lift.after(1)
    begun(lift, LostPress())
    lift.write(HOLDING, ROBOT, 1, after_s=1)
    assert lift.after(1).robot_mode_on
    lift.write(HOLDING, GO_TO, 3)
    assert lift.after(1).destination is None, "this is the first that does"


def test_a_press_of_somebody_else_is_not_the_one_that_is_lost() -> None:
    lift = begun(generic(), LostPress(), ForeignWriter("go_to", floor=1, every_s=100))
    assert lift.after(0.5).destination == 1
    lift.write(HOLDING, HOLD, 1)
    assert lift.until(stands_open_at(1)).level_floor == 1
    assert is_closed(lift.after(20))


def test_a_timed_relay_can_be_pressed_in_vain() -> None:
    lift = begun(faced("waveshare-relay", (0, 1)), LostPress())
    lift.pulse(0x201, 5)
    assert lift.read(COIL, 0x201) == [1]
    assert lift.after(2).car_calls == frozenset()
    lift.pulse(0x201, 5)
    assert lift.after(0.2).car_calls == {1}


@pytest.mark.parametrize(("stored", "read"), [(False, 0), (True, 3)])
def test_ignored_writes_are_answered_and_read_back_only_if_stored(*, stored: bool, read: int) -> None:
    lift = begun(generic(), IgnoredWrites(stored))
    lift.write(HOLDING, GO_TO, 3)
    assert lift.face.stored(HOLDING, GO_TO, lift.now) == 3, "the answer to the write"
    assert lift.read(HOLDING, GO_TO) == [read]
    assert lift.after(10).destination is None
    ended(lift, IgnoredWrites(stored))
    assert lift.after(1).destination == (2 if stored else None)
    assert lift.face.stored(HOLDING, GO_TO, lift.now) == read


@pytest.mark.parametrize("stored", [False, True])
def test_a_write_that_is_ignored_does_not_let_go_and_is_no_sign_of_life(*, stored: bool) -> None:
    lift = generic()
    lift.write(HOLDING, HOLD, 1)
    lift.after(2.5)
    begun(lift, IgnoredWrites(stored))
    lift.write(HOLDING, HOLD, 0)
    assert is_open(lift.after(0.4)), "still held"
    for _ in range(7):
        lift.write(HOLDING, HOLD, 1, after_s=1)
    assert is_closed(lift.after(0.2)), "the watchdog heard nothing"


def test_an_ignored_write_is_refused_where_any_write_is() -> None:
    lift = begun(faced("waveshare-relay", (0, 1)), IgnoredWrites())
    for refused, code in ((0x208, ILLEGAL_ADDRESS), (0x200, ILLEGAL_VALUE)):
        with pytest.raises(ExceptionReply) as objection:
            lift.write(COIL, refused, 1)
        assert objection.value.code == code
    with pytest.raises(ExceptionReply):
        lift.pulse(0x002, 5)
    lift.pulse(0x201, 5)
    assert lift.read(COIL, 0x201) == [0]


def test_what_the_device_times_ends_although_writes_are_ignored() -> None:
    lift = faced(written_map(TIMED_HOLD), (0, 1))
    lift.write(HOLDING, 8, 60)  # six seconds
    begun(lift, IgnoredWrites(stored=True))
    assert is_open(lift.after(5.9))
    assert is_closed(lift.after(0.2 + 3 + 2.5))
    assert lift.read(HOLDING, 8) == [0]


# -- who else writes


def test_a_foreign_call_is_taken_and_written_again_at_its_instants_however_time_is_cut() -> None:
    lift = begun(generic(), ForeignWriter("go_to", floor=2, every_s=0.7))
    assert lift.read(HOLDING, GO_TO) == [3], "at once"
    assert lift.after(0.1).destination == 2
    written = []
    for _ in range(200):
        lift.write(HOLDING, GO_TO, 0)
        lift.after(0.01)
        written += [lift.now] if lift.read(HOLDING, GO_TO) == [3] else []
    assert [round(later - at, 2) for at, later in pairwise(written)] == [0.7, 0.7]


def test_a_foreign_writer_keeps_its_instants_while_nobody_looks() -> None:
    looked_at, left_alone = (begun(generic(), ForeignWriter("go_to", floor=2, every_s=0.7)) for _ in range(2))
    for lift in (looked_at, left_alone):
        lift.write(HOLDING, GO_TO, 0, after_s=1.0)  # a press anew at 1.4 s
    for _ in range(1000):
        looked_at.after(0.02)
    assert left_alone.after(20) == looked_at.face.picture
    assert left_alone.read(HOLDING, FLOOR, 7) == looked_at.read(HOLDING, FLOOR, 7)


def test_somebody_else_lets_go_of_what_we_hold() -> None:
    lift = begun(generic(), ForeignWriter("hold_door.front", pressed=False, every_s=4.0))
    for _ in range(7):
        lift.write(HOLDING, HOLD, 1, after_s=0.5)
    assert is_open(lift.face.picture)
    lift.after(0.6)
    assert lift.read(HOLDING, HOLD) == [0]
    ended(lift, ForeignWriter("hold_door.front", pressed=False, every_s=4.0))
    lift.write(HOLDING, HOLD, 1)
    lift.after(2.9)
    assert lift.read(HOLDING, HOLD) == [1]


def test_somebody_else_presses_a_bit_and_leaves_its_neighbours_alone() -> None:
    # robotnik-il-eth: robot mode is bit 3 and the door bit 0 of register 385
    lift = faced("robotnik-il-eth", (0, 1, 2))
    lift.write(HOLDING, 385, 0b1000)
    begun(lift, ForeignWriter("hold_door.front"))
    assert lift.read(HOLDING, 385) == [0b1001]
    assert is_open(lift.after(3))


def test_somebody_else_presses_a_timed_relay() -> None:
    lift = begun(faced("waveshare-relay", (0, 1)), ForeignWriter("go_to", floor=1, every_s=60))
    assert lift.after(0.2).car_calls == {1}
    assert lift.read(COIL, 0x201) == [1]
    lift.after(5)
    assert lift.read(COIL, 0x201) == [0]


def test_what_others_write_is_no_sign_of_life_of_ours() -> None:
    lift = begun(generic(), ForeignWriter("hold_door.front", every_s=0.5))
    assert is_open(lift.after(2.5))
    assert is_closed(lift.after(WATCHDOG_S + 3 + 2.5))


def test_a_heartbeat_is_a_sign_of_life_whoever_writes_it() -> None:
    lift = faced(written_map(HANDSHAKE, ""), (1, 2), sides=frozenset(Side))
    lift.write(HOLDING, 20, 1)
    lift.after(5)
    assert lift.face.picture.watchdog_tripped
    begun(lift, ForeignWriter("heartbeat", every_s=0.5))
    assert not lift.after(5).watchdog_tripped


def test_somebody_else_writes_a_cell_of_ours() -> None:
    lift = begun(generic(), ForeignCell(HOLDING, GO_TO, 4))
    assert lift.after(0.1).destination == 3
    ended(lift, ForeignCell(HOLDING, GO_TO, 4))
    lift.write(HOLDING, GO_TO, 0)
    lift.after(5)
    assert lift.read(HOLDING, GO_TO) == [0]


@each_row(
    ("map_name", "fault", "says"),
    [
        ("generic-registers", ForeignWriter("go"), "no command go; it has go_to"),
        ("generic-registers", ForeignWriter("go_to"), "a floor from 0 to 1, not None"),
        ("generic-registers", ForeignWriter("go_to", floor=2), "a floor from 0 to 1, not 2"),
        ("generic-registers", ForeignCell(INPUT, 3, 1), "only coils and holding registers"),
        ("generic-registers", ForeignCell(HOLDING, 999, 1), "write of 1 to holding:999 with exception 2"),
        ("generic-registers", ForeignCell(COIL, 0, 1), "exception 1"),
        ("generic-registers", ForeignCell(HOLDING, GO_TO, 65536), "takes 0 to 65535, not 65536"),
        ("generic-coils", ForeignCell(COIL, 0, 2), "takes 0 to 1, not 2"),
        ("waveshare-relay", ForeignCell(COIL, 0x200, 1), "exception 3"),
    ],
)
def test_a_foreign_writer_that_cannot_be_is_refused_and_changes_nothing(
    map_name: str, fault: RegisterFault, says: str
) -> None:
    lift = faced(map_name, (1, 2) if map_name == "generic-registers" else (0, 1))
    with pytest.raises(ValueError, match=says):
        begun(lift, fault)
    assert lift.face.faults == frozenset()
    assert lift.after(5).destination is None


@each_row(
    ("map_name", "table", "address", "bit", "signal"),
    [
        # closed while all is well
        ("generic-coils", DISCRETE, 25, 0, "fire"),
        ("generic-registers", HOLDING, 5, 0, "fire"),
        ("generic-coils", DISCRETE, 18, 0, "level"),
    ],
)
def test_a_signal_whose_wire_is_off_reads_0_and_its_neighbours_do_not(
    map_name: str, table: Table, address: int, bit: int, signal: str
) -> None:
    lift = faced(map_name, (1, 2) if map_name == "generic-registers" else (0, 1))
    (before,) = lift.read(table, address)
    assert before >> bit & 1
    begun(lift, DisconnectedSignal(signal))
    assert lift.read(table, address) == [before & ~(1 << bit)]
    assert lift.after(1.0).mode is Mode.NORMAL
    ended(lift, DisconnectedSignal(signal))
    assert lift.read(table, address) == [before]


def test_a_signal_that_the_map_does_not_have_cannot_be_disconnected() -> None:
    lift = faced("generic-registers", (1, 2))
    with pytest.raises(ValueError, match="generic-registers has no wire for a signal smoke; it has alive, car_floor"):
        begun(lift, DisconnectedSignal("smoke"))
    assert lift.face.faults == frozenset()


# -- the watchdog, present or absent


def held_for(lift: Faced) -> bool:
    """Whether a hold that was written once is still there after ten seconds."""
    lift.write(HOLDING, HOLD, 1)
    return is_open(lift.after(20))


@pytest.mark.parametrize(("limit_s", "held"), [(None, False), (math.inf, True), (60.0, True)])
def test_the_watchdog_of_a_map_can_be_set_and_taken_out(limit_s: float | None, *, held: bool) -> None:
    lift = generic(like=Parameters(hold_watchdog_s=limit_s))
    assert held_for(lift) is held
    codec = compiled("generic-registers")
    floors = {"L1": 1, "L2": 2}
    assert held_for(Faced(simulated_lift(codec, floors, like=Parameters(hold_watchdog_s=limit_s)))) is held


def test_a_map_without_a_watchdog_can_be_given_one() -> None:
    like = Parameters(hold_watchdog_s=2.0, watched=frozenset({"hold_door.front"}))
    lift, plain = faced("seer-generic", (1, 2), like=like), faced("seer-generic", (1, 2))
    for one in (lift, plain):
        one.write(HOLDING, 1, 5)
        one.after(20)
    assert (is_closed(lift.face.picture), is_open(plain.face.picture)) == (True, True)
