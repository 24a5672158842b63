"""Where commands are written and read back: bits of registers, other addresses, lamps, further devices."""

import pytest

from register_maps.words import Table
from simulator.registers import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ExceptionReply
from tests.simulator.faces import faced, is_closed, is_open, stands_open_at
from tests.support.written_maps import HEAD, written_map

COIL, DISCRETE, HOLDING, INPUT = Table.COIL, Table.DISCRETE, Table.HOLDING, Table.INPUT

SHARED_WORD = """\
signals:
  car_floor: {at: "input:1", as: floor}
  door.front: {at: "holding:30.7", values: {0: closed, 1: open}}
commands:
  go_to:
    one_of: ["holding:30.1", "holding:30.2"]
    action: pulse
    width_s: 0.5
    shared_word: mask_write
    confirm: {any_of: [effect], within_s: 30}
  hold_door.front:
    at: "holding:30.0"
    action: hold
    max_hold_s: 30
    refresh_s: 2
    on_link_loss: latches
    shared_word: mask_write
    confirm: {any_of: [readback], within_s: 2}
"""
LAMPS = """\
signals:
  car_floor: {at: "input:1", as: floor}
  door.front: {at: "discrete:0"}
  calls_registered: {each_of: ["coil:0", "coil:1", "coil:2"]}
commands:
  go_to:
    one_of: ["coil:0", "coil:1", "coil:2"]
    action: pulse
    width_s: 0.5
    confirm: {any_of: [calls_registered], within_s: 2}
"""
TWO_DEVICES = (
    HEAD.replace("at_floor_evidence", "endpoints: {sensor: {unit_id: 9, served: {discrete: [[0, 3]], holding: [[5, 5]]}}}\nat_floor_evidence"),
    """\
signals:
  car_floor: {one_of: ["sensor/discrete:0", "sensor/discrete:1"]}
  door.front: {at: "sensor/discrete:2", active: low}
commands:
  go_to: {one_of: ["coil:0", "coil:1"], action: pulse, width_s: 0.5, confirm: {any_of: [effect], within_s: 30}}
  hold_door.front:
    at: "sensor/holding:5"
    action: hold
    max_hold_s: 30
    refresh_s: 1
    on_link_loss: device_watchdog
    confirm: {any_of: [readback], within_s: 2}
""",
)  # fmt: skip


# -- bits of a register


def test_a_mask_write_gives_one_command_and_leaves_its_neighbours_alone() -> None:
    lift = faced(written_map(SHARED_WORD), (0, 1))
    lift.write(HOLDING, 30, 0b1000_0000_0000_0000)
    lift.mask(30, 0xFFFE, 0x0001)
    assert is_open(lift.after(3))
    # bit 15 is nobody's: it keeps what was written; bit 7 is the door
    assert lift.read(HOLDING, 30) == [0b1000_0000_1000_0001]
    lift.mask(30, 0xFFFE, 0x0000)
    assert is_closed(lift.after(10))
    assert lift.read(HOLDING, 30) == [0b1000_0000_0000_0000]


def test_a_mask_write_follows_the_formula_of_the_specification() -> None:
    lift = faced(written_map(SHARED_WORD), (0, 1))
    # the example of the specification (V1.1b3, 6.16): 12 AND F2 OR (25 AND NOT F2) is 17
    lift.write(HOLDING, 4, 0x12)
    lift.mask(4, 0xF2, 0x25)
    assert lift.read(HOLDING, 4) == [0x17]


def test_a_write_of_the_whole_register_gives_and_takes_every_command_in_it() -> None:
    lift = faced(written_map(SHARED_WORD), (0, 1))
    lift.write(HOLDING, 30, 0b001)
    lift.until(is_open)
    lift.write(HOLDING, 30, 0b100)
    assert lift.after(0.2).car_calls == {1}
    lift.write(HOLDING, 30, 0)
    lift.until(stands_open_at(1))


def test_a_bit_in_which_the_lift_speaks_cannot_be_written() -> None:
    lift = faced(written_map(SHARED_WORD), (0, 1))
    lift.mask(30, 0xFF7F, 0x0080)
    assert lift.read(HOLDING, 30) == [0]


def test_a_mask_write_of_a_neighbour_does_not_press_what_the_lift_shows_there() -> None:
    lamp_word = SHARED_WORD.replace(
        "signals:\n", 'signals:\n  calls_registered: {each_of: ["holding:30.1", "holding:30.2"]}\n'
    )
    lift = faced(written_map(lamp_word), (0, 1))
    lift.mask(30, 0xFFFB, 0x0004)
    lift.after(0.5)
    lift.mask(30, 0xFFFB, 0x0000)
    assert lift.read(HOLDING, 30) == [0b100], "the call is registered, and nobody presses it"
    lift.mask(30, 0xFFFE, 0x0001)
    assert lift.face.stored(HOLDING, 30, lift.now) == 0b001


@pytest.mark.parametrize("address", [1000, 2000])
def test_a_mask_write_outside_what_is_served_is_refused(address: int) -> None:
    with pytest.raises(ExceptionReply) as refused:
        faced(written_map(SHARED_WORD), (0, 1)).mask(address, 0xFFFF, 0)
    assert refused.value.code == ILLEGAL_ADDRESS


def test_robotnik_reads_its_two_words_of_outputs_as_bits() -> None:
    # elevator-interfaces 1.6: 384 bits 0 to 2 call, 385 bit 0 the door; 0 bits 0 to 2 the floor, bit 4 closed
    lift = faced("robotnik-il-eth", (0, 1, 2))
    assert lift.read(HOLDING, 0) == [0b1_0001]
    lift.write(HOLDING, 384, 0b0100)
    lift.write(HOLDING, 384, 0, after_s=0.1)
    lift.write(HOLDING, 385, 0b1001)
    assert lift.read(HOLDING, 384, 2) == [0, 0b1001]
    assert lift.read(HOLDING, 0) == [0b1_0001], "the door hold came before the doors had anything to close"
    lift.write(HOLDING, 385, 0b1000)
    lift.until(stands_open_at(2))
    assert lift.read(HOLDING, 0) == [0b0_0100]


# -- read at another address


def test_wago_outputs_are_read_back_0x200_higher_and_at_their_own_address_are_inputs() -> None:
    # elevator-interfaces 2: reading coil 0 is an input, writing coil 0 is an output
    lift = faced("wago-750", (0, 1))
    assert lift.read(DISCRETE, 0, 5) == [0, 1, 1, 0, 1]
    assert lift.read(COIL, 0, 3) == [0, 1, 1]
    lift.write(COIL, 1, 1)
    lift.write(COIL, 2, 1)
    assert lift.read(COIL, 0x200, 3) == [0, 1, 1]
    assert lift.read(COIL, 0, 3) == lift.read(DISCRETE, 0, 3) == [0, 1, 1]
    lift.until(is_open)
    assert lift.read(COIL, 0, 3) == [1, 0, 1]
    lift.write(COIL, 1, 0)
    lift.write(COIL, 2, 0)
    assert lift.read(COIL, 0x200, 3) == [0, 0, 0]
    lift.until(stands_open_at(1))
    assert lift.read(DISCRETE, 0, 5) == [1, 0, 0, 1, 1]


def test_what_is_written_to_the_address_of_the_read_back_presses_nothing() -> None:
    lift = faced("wago-750", (0, 1))
    lift.write(COIL, 0x200, 1, 1, 1)
    assert lift.read(COIL, 0x200, 3) == [0, 0, 0]
    assert is_closed(lift.after(5))


def test_an_output_may_be_read_back_in_another_table() -> None:
    text = SHARED_WORD.replace('at: "holding:30.0"', 'at: "holding:30.0"\n    read_at: "input:10.4"')
    lift = faced(written_map(text), (0, 1))
    lift.mask(30, 0xFFFE, 0x0001)
    assert lift.read(INPUT, 10) == [0b1_0000]
    lift.mask(30, 0xFFFE, 0x0000)
    assert lift.read(INPUT, 10) == [0]


# -- a lamp on the point of the call


def test_a_lamp_on_the_point_of_a_call_shows_what_is_registered_whatever_was_written() -> None:
    lift = faced(written_map(LAMPS), (0, 1, 2))
    lift.write(COIL, 2, 1)
    assert lift.read(COIL, 0, 3) == [0, 0, 0], "not before the controller has looked"
    lift.after(0.1)
    assert lift.read(COIL, 0, 3) == [0, 0, 1]
    lift.write(COIL, 2, 0, after_s=0.5)
    assert lift.read(COIL, 0, 3) == [0, 0, 1]
    lift.write(COIL, 1, 1)
    lift.after(0.1)
    assert lift.read(COIL, 0, 3) == [0, 1, 1]
    lift.until(stands_open_at(1))
    assert lift.read(COIL, 0, 3) == [0, 0, 1], "served, and the button still pressed"
    lift.write(COIL, 1, 0)
    lift.until(stands_open_at(2))
    assert lift.read(COIL, 0, 3) == [0, 0, 0]


def test_a_lamp_goes_before_the_input_of_the_same_number() -> None:
    elsewhere = LAMPS.replace(
        "    action: pulse", '    read_one_of: ["coil:32", "coil:33", "coil:34"]\n    action: pulse'
    )
    lift = faced(written_map(elsewhere), (0, 1, 2))
    lift.write(COIL, 2, 1)
    lift.after(0.1)
    assert lift.read(COIL, 0, 3) == [0, 0, 1]
    assert lift.read(COIL, 32, 3) == [0, 0, 1]
    lift.write(COIL, 2, 0, after_s=0.5)
    assert lift.read(COIL, 0, 3) == [0, 0, 1]
    assert lift.read(COIL, 32, 3) == [0, 0, 0]


def test_the_lamp_of_a_call_that_was_served_at_once_never_lights() -> None:
    lift = faced(written_map(LAMPS), (0, 1, 2))
    lift.write(COIL, 0, 1)
    lamps = []
    while not is_open(lift.after(0.05)):
        lamps.append(lift.read(COIL, 0, 3))
    assert set(map(tuple, lamps)) == {(0, 0, 0)}


# -- further devices


def test_an_endpoint_is_a_device_of_its_own_behind_the_same_lift() -> None:
    head, text = TWO_DEVICES
    lift = faced(written_map(text, head), (0, 1))
    assert lift.read(DISCRETE, 0, 3, of="sensor") == [1, 0, 1]
    assert lift.read(DISCRETE, 0, 3) == [0, 0, 0], (
        "the controller has discrete inputs too, and nothing is wired to them"
    )
    lift.write(COIL, 1, 1)
    lift.write(COIL, 1, 0, after_s=0.5)
    lift.until(stands_open_at(1))
    assert lift.read(DISCRETE, 0, 3, of="sensor") == [0, 1, 0]


def test_a_command_may_lie_on_an_endpoint_and_each_write_there_keeps_it_alive() -> None:
    head, text = TWO_DEVICES
    lift = faced(written_map(text, head), (0, 1))
    for _ in range(10):
        lift.write(HOLDING, 5, 1, after_s=2.5, of="sensor")
    assert is_open(lift.face.picture)
    assert lift.read(HOLDING, 5, of="sensor") == [1]
    assert lift.read(HOLDING, 5) == [0]
    assert is_closed(lift.after(3 + 3 + 3))


@pytest.mark.parametrize(
    ("table", "address", "code"),
    [(COIL, 0, ILLEGAL_FUNCTION), (DISCRETE, 4, ILLEGAL_ADDRESS), (HOLDING, 4, ILLEGAL_ADDRESS)],
)
def test_an_endpoint_serves_what_the_map_says_of_it_only(table: Table, address: int, code: int) -> None:
    head, text = TWO_DEVICES
    with pytest.raises(ExceptionReply) as refused:
        faced(written_map(text, head), (0, 1)).read(table, address, of="sensor")
    assert refused.value.code == code


def test_an_endpoint_that_the_map_does_not_have_is_refused_with_those_it_has() -> None:
    head, text = TWO_DEVICES
    with pytest.raises(ValueError, match="no endpoint sensors; it has sensor"):
        faced(written_map(text, head), (0, 1)).face.endpoint("sensors")
