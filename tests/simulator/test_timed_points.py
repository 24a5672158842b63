"""What the device ends by itself: pulses, holds and coils that are written with their time."""

import pytest

from register_maps.words import Table
from simulator.registers import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, ExceptionReply
from tests.simulator.faces import Faced, faced, is_closed, is_open, stands_open_at
from tests.support.rows import each_row
from tests.support.written_maps import written_map

COIL, HOLDING = Table.COIL, Table.HOLDING
SEEN = """\
signals:
  car_floor: {at: "input:1", as: floor}
  door.front: {at: "discrete:0"}
"""
PULSE_OF_ITS_OWN = """\
commands:
  go_to:
    one_of: ["coil:8", "coil:9"]
    action: pulse
    width_s: 0.8
    timed_by: device
    confirm: {any_of: [effect], within_s: 30}
"""
FLOOR_PULSE = """\
commands:
  go_to: {at: "holding:8", as: floor, action: pulse, width_s: 0.8, timed_by: device, confirm: {any_of: [effect], within_s: 30}}
"""
TIME_IN_A_REGISTER = """\
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
HOLD_OF_ITS_OWN = """\
commands:
  hold_door.front:
    at: "holding:8.3"
    action: hold
    max_hold_s: 6
    refresh_s: 2
    on_link_loss: timed_by_device
    shared_word: mask_write
    confirm: {any_of: [readback], within_s: 5}
"""


def on_for_s(lift: Faced, table: Table, address: int, most_s: float = 10.0) -> float:
    """How long a cell still reads as on, looked at every 10 ms."""
    looks = 0
    while lift.read(table, address) != [0]:
        lift.after(0.01)
        looks += 1
        assert looks * 0.01 < most_s
    return looks * 0.01


# -- coils that are written with their time


def test_a_waveshare_relay_is_on_for_the_duration_it_was_written_with() -> None:
    # elevator-interfaces 2: function 5 at 0x0200 + n with the duration in 100 ms
    lift = faced("waveshare-relay", (0, 1))
    lift.pulse(0x201, 7)
    assert lift.read(COIL, 0x200, 2) == [0, 1]
    assert on_for_s(lift, COIL, 0x201) == pytest.approx(0.7, abs=0.011)
    lift.until(stands_open_at(1))


def test_a_relay_timed_anew_begins_anew_and_one_switched_off_is_off() -> None:
    lift = faced("waveshare-relay", (0, 1))
    lift.pulse(0x200, 10)
    lift.after(0.9)
    lift.pulse(0x200, 10)
    assert on_for_s(lift, COIL, 0x200) == pytest.approx(1.0, abs=0.011)
    lift.pulse(0x200, 10)
    lift.write(COIL, 0x200, 0)
    assert lift.read(COIL, 0x200) == [0]
    lift.write(COIL, 0, 1)
    lift.after(5)
    assert lift.read(COIL, 0) == [1], "a relay that is not timed stays"


def test_however_long_nobody_looks_a_timed_relay_has_ended_in_time() -> None:
    lift = faced("waveshare-relay", (0, 1))
    lift.pulse(0x201, 5)
    assert lift.after(0.2).car_calls == {1}
    lift.after(3600)
    # the car went, opened and closed again long ago; a button still pressed would not call it again, a new press does
    assert lift.read(COIL, 0x201) == [0]
    lift.pulse(0x200, 5)
    assert lift.after(0.2).car_calls == {0}


@each_row(
    ("address", "code"),
    [(0x000, ILLEGAL_VALUE), (0x007, ILLEGAL_VALUE), (0x202, ILLEGAL_VALUE), (0x208, ILLEGAL_ADDRESS)],
)
def test_a_duration_for_a_coil_that_takes_none_is_refused(address: int, code: int) -> None:
    lift = faced("waveshare-relay", (0, 1))
    with pytest.raises(ExceptionReply) as refused:
        lift.pulse(address, 5)
    assert refused.value.code == code


@pytest.mark.parametrize(
    ("map_name", "code"), [("two-stop-agv", ILLEGAL_VALUE), ("generic-registers", ILLEGAL_FUNCTION)]
)
def test_a_device_without_timed_coils_refuses_durations(map_name: str, code: int) -> None:
    lift = faced(map_name, (0, 1) if map_name == "two-stop-agv" else (1, 2))
    with pytest.raises(ExceptionReply) as refused:
        lift.pulse(0, 5)
    assert refused.value.code == code


def test_a_timed_coil_takes_no_plain_on() -> None:
    lift = faced("waveshare-relay", (0, 1))
    with pytest.raises(ExceptionReply) as refused:
        lift.write(COIL, 0x200, 1)
    assert refused.value.code == ILLEGAL_VALUE
    assert lift.read(COIL, 0x200) == [0]


# -- pulses that the device times


def test_a_pulse_timed_by_the_device_lasts_as_long_as_the_map_says() -> None:
    lift = faced(written_map(SEEN + PULSE_OF_ITS_OWN), (0, 1))
    lift.write(COIL, 9, 1)
    assert on_for_s(lift, COIL, 9) == pytest.approx(0.8, abs=0.011)
    lift.until(stands_open_at(1))


def test_a_floor_number_timed_by_the_device_returns_to_rest() -> None:
    lift = faced(written_map(SEEN + FLOOR_PULSE), (3, 7))
    lift.write(HOLDING, 8, 7)
    assert lift.read(HOLDING, 8) == [7]
    assert on_for_s(lift, HOLDING, 8) == pytest.approx(0.8, abs=0.011)
    lift.until(stands_open_at(1))
    lift.until(is_closed)
    lift.write(HOLDING, 8, 7)
    assert not is_closed(lift.after(1)), "pressed again: it opens"


def test_thingweb_takes_a_floor_where_it_shows_one() -> None:
    # elevator-interfaces 1.11: the register that is written is the low half of the floor that is read
    lift = faced("thingweb-elevator", (1, 2, 15))
    assert lift.read(HOLDING, 40001, 2) == [0, 1]
    lift.write(HOLDING, 40002, 15)
    assert lift.read(HOLDING, 40001, 2) == [0, 1]
    lift.after(2)
    assert lift.read(Table.DISCRETE, 10001) == [1], "moving, whichever way"
    lift.until(stands_open_at(2))
    assert lift.read(HOLDING, 40001, 2) == [0, 15]
    assert lift.read(Table.DISCRETE, 10001) == [0]


# -- holds that the device times


def test_a_door_is_held_for_the_time_that_was_written() -> None:
    lift = faced(written_map(SEEN + TIME_IN_A_REGISTER), (0, 1))
    lift.write(HOLDING, 8, 100)
    assert on_for_s(lift, HOLDING, 8, most_s=20) == pytest.approx(10, abs=0.011)
    assert is_open(lift.after(2.9)), "dwell"
    assert not is_open(lift.after(0.3))


def test_a_time_written_again_begins_again_and_zero_lets_go() -> None:
    lift = faced(written_map(SEEN + TIME_IN_A_REGISTER), (0, 1))
    for _ in range(10):
        lift.write(HOLDING, 8, 60, after_s=4)
    assert is_open(lift.face.picture)
    assert is_open(lift.after(5.9))
    lift.write(HOLDING, 8, 0)
    assert is_closed(lift.after(3 + 2.5 + 0.2))


def test_a_hold_without_a_time_falls_after_its_longest_and_a_neighbour_does_not_renew_it() -> None:
    lift = faced(written_map(SEEN + HOLD_OF_ITS_OWN), (0, 1))
    lift.mask(8, 0xFFF7, 0x0008)
    lift.after(4)
    lift.mask(8, 0xFFFE, 0x0001)
    assert lift.read(HOLDING, 8) == [0b1001]
    lift.after(1.9)
    assert lift.read(HOLDING, 8) == [0b1001]
    lift.after(0.2)
    assert lift.read(HOLDING, 8) == [0b0001]
