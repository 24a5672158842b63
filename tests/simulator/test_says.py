"""What a lift says in every form that the map language has; expected bits are worked out by hand."""

import pytest

from register_maps.words import Mode, Motion, Side, Table
from simulator.controller import Inputs
from simulator.modes import Key
from tests.simulator.faces import SCAN_S, Faced, faced, is_open, stands_open_at
from tests.support.rows import each_row
from tests.support.written_maps import written_map

COIL, DISCRETE, HOLDING, INPUT = Table.COIL, Table.DISCRETE, Table.HOLDING, Table.INPUT

GO_TO = """\
commands:
  go_to: {at: "holding:100", as: floor, action: pulse, width_s: 0.5, rest: 999, confirm: {any_of: [effect], within_s: 30}}
"""
POSITION = """\
signals:
  car_floor: {code_of: ["discrete:4", "discrete:9", "discrete:5"], code: CODE, active: ACTIVE}
  door.front: {at: "discrete:20"}
"""
DOOR = """\
signals:
  car_floor: {at: "input:0", as: floor}
"""


def said(text: str, codes: tuple[int, ...] = (0, 1, 2), start: int = 0, key: Key = Key.NORMAL) -> Faced:
    return faced(written_map(text + GO_TO), codes, start=start, key=key)


# -- floors


@each_row(
    ("code", "active", "bits_of_5"),
    [
        # 5 is 101, and 111 in the reflected binary code
        ("binary", "high", [1, 0, 1]),
        ("binary", "low", [0, 1, 0]),
        ("gray", "high", [1, 1, 1]),
        ("gray", "low", [0, 0, 0]),
    ],
)
def test_a_position_code_has_its_lowest_bit_first_from_wherever_they_are(
    code: str, active: str, bits_of_5: list[int]
) -> None:
    lift = said(POSITION.replace("CODE", code).replace("ACTIVE", active), (4, 5, 6), start=1)
    assert [lift.bit(DISCRETE, address) for address in (4, 9, 5)] == bits_of_5


def test_a_position_code_changes_floor_by_floor_and_never_shows_none() -> None:
    lift = said(POSITION.replace("CODE", "gray").replace("ACTIVE", "high"), (1, 2, 3))
    lift.write(HOLDING, 100, 3)
    seen = []
    while lift.after(SCAN_S).door_open_floor != 2:
        seen.append(tuple(lift.bit(DISCRETE, address) for address in (5, 9, 4)))
    # 1, 2, 3 in the reflected binary code: 001, 011, 010
    assert list(dict.fromkeys(seen)) == [(0, 0, 1), (0, 1, 1), (0, 1, 0)]


@pytest.mark.parametrize(
    ("order", "registers"), [("high_first", [[0xFFFF, 0xFFFE], [0, 3]]), ("low_first", [[0xFFFE, 0xFFFF], [3, 0]])]
)
def test_a_number_of_two_registers_is_in_the_order_of_the_map(order: str, registers: list[list[int]]) -> None:
    text = f"""\
signals:
  car_floor: {{at: "input:30", type: int32, word_order: {order}, as: floor}}
  door.front: {{at: "discrete:20"}}
"""
    for start, expected in enumerate(registers):
        lift = faced(written_map(text), (-2, 3), start=start)
        assert lift.read(INPUT, 30, 2) == expected


def test_the_limit_of_a_floor_is_made_only_while_its_door_is_fully_open() -> None:
    # elevator-interfaces 1.3: discrete 1 and 3, coils 17 (floor 1), 18 (in place), 19 (floor 2)
    lift = faced("seer-lps3-two-stop", (0, 1))
    assert lift.read(DISCRETE, 1, 3) == [0, 0, 0], "nobody tells where a closed car is"
    lift.write(COIL, 19, 1)
    seen = []
    for _ in range(round(20 / SCAN_S)):
        picture = lift.after(SCAN_S)
        bits = lift.read(DISCRETE, 1, 3)
        assert bits == [0, 0, int(picture.door_open_floor == 1)]
        seen.append(bits[2])
    assert set(seen) == {0, 1}


@pytest.mark.parametrize("door_first", [False, True])
def test_it_does_not_matter_which_of_two_signals_at_the_same_points_is_named_first(*, door_first: bool) -> None:
    at = '["discrete:0", "discrete:1"]'
    named = [f"  car_floor: {{one_of: {at}}}\n", f"  door.front: {{open_limits: {at}}}\n"]
    text = "signals:\n" + "".join(named[::-1] if door_first else named) + GO_TO.replace("999", "9")
    lift = faced(written_map(text), (0, 1), start=1)
    assert lift.read(DISCRETE, 0, 2) == [0, 0]
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    lift.until(is_open)
    assert lift.read(DISCRETE, 0, 2) == [0, 1]


def test_two_doors_with_limits_of_their_own_are_told_apart() -> None:
    text = """\
signals:
  car_floor: {at: "input:0", as: floor}
  door.front: {open_limits: ["discrete:0", "discrete:1"]}
  door.rear: {open_limits: ["discrete:2", "discrete:3"], active: low}
commands:
  hold_door.rear:
    {at: "coil:0", action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}}
"""
    lift = faced(written_map(text), (0, 1), sides=frozenset(Side))
    assert lift.read(DISCRETE, 0, 4) == [0, 0, 1, 1]
    lift.write(COIL, 0, 1)
    lift.after(5)
    assert lift.read(DISCRETE, 0, 4) == [0, 0, 0, 1]


# -- doors, motion, flags


@each_row(
    ("door", "closed", "ajar", "opened"),
    [
        ('{at: "discrete:20"}', [0], [0], [1]),
        ('{at: "discrete:20", active: low}', [1], [1], [0]),
        # a contact that is made while the door is closed says nothing else
        ('{at: "discrete:20", values: {0: open, 1: closed}}', [1], [0], [0]),
        ('{at: "discrete:20", values: {0: moving, 1: closed}}', [1], [0], [0]),
        ('{open_limit: "discrete:20", closed_limit: "discrete:21"}', [0, 1], [0, 0], [1, 0]),
        ('{open_limit: "discrete:20", closed_limit: "discrete:21", active: low}', [1, 0], [1, 1], [0, 1]),
    ],
)
def test_every_kind_of_door_contact(door: str, closed: list[int], ajar: list[int], opened: list[int]) -> None:
    lift = said(f"{DOOR}  door.front: {door}\n")
    assert lift.read(DISCRETE, 20, len(closed)) == closed
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    lift.after(1)
    assert lift.read(DISCRETE, 20, len(closed)) == ajar
    lift.until(is_open)
    assert lift.read(DISCRETE, 20, len(closed)) == opened


def test_a_door_field_says_moving_where_the_map_has_no_direction() -> None:
    lift = said(f'{DOOR}  door.front: {{at: "input:7", bits: [4, 6], values: {{2: closed, 3: moving, 5: open}}}}\n')
    assert lift.read(INPUT, 7) == [2 << 4]
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    assert lift.read(INPUT, 7) == [3 << 4]
    lift.until(is_open)
    assert lift.read(INPUT, 7) == [5 << 4]


def test_two_bits_say_up_and_down() -> None:
    lift = said('signals:\n  car_floor: {at: "input:0", as: floor}\n  motion: {up: "discrete:8", down: "discrete:3"}\n')
    bits = []
    for call in (2, 0):
        lift.write(HOLDING, 100, call)
        lift.until(lambda picture: picture.motion is not Motion.STOPPED)
        bits.append((lift.bit(DISCRETE, 8), lift.bit(DISCRETE, 3)))
        lift.until(stands_open_at(call))
        bits.append((lift.bit(DISCRETE, 8), lift.bit(DISCRETE, 3)))
    assert bits == [(1, 0), (0, 0), (0, 1), (0, 0)]


def test_a_motion_word_without_a_direction_says_moving() -> None:
    lift = said(
        'signals:\n  car_floor: {at: "input:0", as: floor}\n  motion: {at: "input:1", values: {1: stopped, 4: moving}}\n'
    )
    assert lift.read(INPUT, 1) == [1]
    lift.write(HOLDING, 100, 2)
    lift.after(2)
    assert lift.read(INPUT, 1) == [4]


def test_a_flag_that_fills_a_register_says_the_maps_own_yes() -> None:
    lift = said(
        DOOR + '  overload: {at: "input:5", means_yes: 85}\n  fault: {at: "input:6", bits: [8, 11], means_yes: 9}\n'
    )
    assert lift.read(INPUT, 5, 2) == [0, 0]
    lift.people(Inputs(overload=True, fault=True))
    assert lift.read(INPUT, 5, 2) == [85, 0x0900]


def test_a_number_is_at_its_threshold_while_the_flag_is_yes_wherever_the_map_lists_the_flag() -> None:
    for signals in (
        '  load: {at: "input:5"}\n  overload: {at: "input:5", yes_from: 110}\n',
        '  overload: {at: "input:5", yes_from: 110}\n  load: {at: "input:5"}\n',
    ):
        lift = said(DOOR + signals)
        assert lift.read(INPUT, 5) == [0]
        lift.people(Inputs(overload=True))
        assert lift.read(INPUT, 5) == [110]


def test_a_door_that_shows_its_position_is_between_its_ends_while_it_moves() -> None:
    lift = said(DOOR + '  door.front: {at: "input:5", open_at: 90, closed_at: 2, range: [1, 100]}\n')
    assert lift.read(INPUT, 5) == [2]
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    lift.after(1)
    assert lift.read(INPUT, 5) == [46]
    lift.until(is_open)
    assert lift.read(INPUT, 5) == [90]


def test_overload_fault_and_out_of_service_are_told() -> None:
    text = """\
  overload: {at: "discrete:30"}
  fault: {at: "discrete:31"}
  out_of_service: {at: "discrete:32", active: low}
  fault_code: {at: "input:9"}
"""
    lift = said(DOOR + text)
    assert lift.read(DISCRETE, 30, 3) == [0, 0, 1]
    assert lift.people(Inputs(overload=True)).mode is Mode.NORMAL
    assert lift.read(DISCRETE, 30, 3) == [1, 0, 1]
    assert lift.people(Inputs(fault=True)).mode is Mode.OUT_OF_SERVICE
    assert lift.read(DISCRETE, 30, 3) == [0, 1, 0]
    assert lift.read(INPUT, 9) == [1]


def test_lamps_show_the_calls_of_everybody() -> None:
    lift = said(DOOR + '  calls_registered: {each_of: ["discrete:0", "discrete:1", "discrete:2"], active: low}\n')
    assert lift.read(DISCRETE, 0, 3) == [1, 1, 1]
    lift.people(Inputs(car_buttons=frozenset({1})))
    lift.write(HOLDING, 100, 2)
    lift.after(0.1)
    assert lift.read(DISCRETE, 0, 3) == [1, 0, 0]


# -- permissions without a handshake


def test_without_acknowledgements_a_robot_may_pass_wherever_the_door_stands_open_in_service() -> None:
    lift = said(DOOR + '  may_enter: {at: "discrete:0"}\n  may_leave: {at: "discrete:1"}\n')
    assert lift.read(DISCRETE, 0, 2) == [0, 0]
    lift.people(Inputs(hold_door=frozenset({Side.FRONT})))
    lift.until(is_open)
    assert lift.read(DISCRETE, 0, 2) == [1, 1]
    lift.people(Inputs(fire=True))
    assert lift.read(DISCRETE, 0, 2) == [0, 0]


# -- watchdogs

WATCHED = """\
signals:
  car_floor: {at: "input:0", as: floor}
  door.front: {at: "discrete:20"}
  watchdog_time: {at: "input:1", unit_s: 0.1}
  watchdog_tripped: {at: "input:2.1"}
commands:
  hold_door.front:
    at: "coil:0"
    action: hold
    max_hold_s: 30
    refresh_s: 2
    on_link_loss: LOSS
    confirm: {any_of: [readback], within_s: 2}
"""
HEARTBEAT = '  heartbeat: {at: "holding:7", action: count, every_s: 0.5}\n'
TOGGLE = '  heartbeat: {at: "coil:7", action: toggle, every_s: 0.5}\n'


@pytest.mark.parametrize(
    ("loss", "more", "counts"), [("device_watchdog", "", 60), ("latches", "", 0), ("device_watchdog", HEARTBEAT, 15)]
)
def test_the_time_of_the_watchdog_is_told_and_is_zero_where_there_is_none(loss: str, more: str, counts: int) -> None:
    lift = faced(written_map(WATCHED.replace("LOSS", loss) + more), (0, 1))
    assert lift.read(INPUT, 1, 2) == [counts, 0]


def test_a_watchdog_that_tripped_shows_until_the_next_write() -> None:
    lift = faced(written_map(WATCHED.replace("LOSS", "device_watchdog")), (0, 1))
    lift.write(COIL, 0, 1)
    lift.after(5.9)
    assert lift.read(INPUT, 2) == [0]
    lift.after(0.2)
    assert lift.read(INPUT, 2) == [0b10]
    lift.write(COIL, 0, 0)
    lift.after(0.1)
    assert lift.read(INPUT, 2) == [0]


def test_with_a_heartbeat_holds_fall_when_it_stands_still_and_writes_alone_do_not_help() -> None:
    lift = faced(written_map(WATCHED.replace("LOSS", "device_watchdog") + HEARTBEAT), (0, 1))
    lift.write(HOLDING, 7, 1)
    lift.write(COIL, 0, 1)
    lift.after(1.4)
    assert lift.read(INPUT, 2) == [0]
    for _ in range(20):
        lift.write(COIL, 0, 1, after_s=0.4)
        lift.write(HOLDING, 7, 1)
    assert lift.read(INPUT, 2) == [0b10]
    assert not is_open(lift.face.picture)


@pytest.mark.parametrize("more", [HEARTBEAT, TOGGLE])
def test_with_a_heartbeat_that_moves_on_holds_need_no_other_write(more: str) -> None:
    lift = faced(written_map(WATCHED.replace("LOSS", "device_watchdog") + more), (0, 1))
    lift.write(COIL, 0, 1)
    for beat in range(60):
        if more == HEARTBEAT:
            lift.write(HOLDING, 7, 65530 + beat & 0xFFFF, after_s=1.4)
        else:
            lift.write(COIL, 7, 1 - beat % 2, after_s=1.4)
    assert is_open(lift.face.picture)
    assert not is_open(lift.after(1.5 + 3 + 3))


def test_a_hold_that_latches_does_not_fall_with_the_heartbeat() -> None:
    lift = faced(written_map(WATCHED.replace("LOSS", "latches") + HEARTBEAT), (0, 1))
    lift.write(COIL, 0, 1)
    assert is_open(lift.after(3600))


# -- the car position

BY_POSITION = """\
signals:
  car_position: {at: "input:0", type: int32, word_order: high_first, positions: {1: -500, 2: 3000, 5: 6100}, tolerance: 10}
  door.front: {at: "discrete:20"}
"""


def test_a_position_goes_from_that_of_one_floor_to_that_of_the_next() -> None:
    lift = said(BY_POSITION, (1, 2, 5))
    assert position_of(lift) == -500
    lift.write(HOLDING, 100, 5)
    seen = [position_of(lift)]
    while lift.after(SCAN_S).door_open_floor != 2:
        seen.append(position_of(lift))
    assert position_of(lift) == 6100
    assert seen == sorted(seen)
    assert len(set(seen)) > 20


def position_of(lift: Faced) -> int:
    high, low = lift.read(INPUT, 0, 2)
    return int.from_bytes((high << 16 | low).to_bytes(4, "big"), "big", signed=True)


def test_a_floor_without_a_position_is_none_of_the_lift() -> None:
    with pytest.raises(ValueError, match="car_position has no position for the floor with code 3"):
        said(BY_POSITION, (1, 2, 3))
