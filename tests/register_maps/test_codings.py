"""Codings that no shipped map has, against bytes typed by hand: what is read, and what is written."""

from pathlib import Path

import pytest

from drivers.modbus.read_plan import plan_reads
from register_maps.codec import UNLISTED, Codec, Value
from register_maps.errors import MapFileError
from register_maps.points import Block
from tests.support.good_map import loaded
from tests.support.rows import each_row
from tests.support.written_maps import HEAD, written_map

GO_TO = "commands:\n  go_to: {{{place}, action: pulse, width_s: 0.5, confirm: {{any_of: [effect], within_s: 30}}}}\n"
FLOOR = 'signals:\n  car_floor: {at: "input:0", as: floor, unknown: [0]}\n'
BUTTONS = GO_TO.format(place='one_of: ["coil:16", "coil:17", "coil:18"], codes: [1, 2, 5]')


def read(codec: Codec, data: str) -> tuple[dict[str, Value], dict[str, int]]:
    """Decode one poll, given as the data bytes of its one answer."""
    (block,) = plan_reads(codec.signal_points, codec.served, max_registers=125, max_bits=2000)
    reader = codec.reader((block,))
    reader.feed((bytes.fromhex(data),))
    return reader.values, reader.unlisted


def written(codec: Codec, code: int | None) -> dict[int, int]:
    """What a call writes, by address on the wire."""
    return {point.address: value for point, value in codec.commands["go_to"].encode(code).items()}


@each_row(
    ("data", "floor"),
    [("00", None), ("01", -1), ("02", 1), ("04", 2), ("08", None), ("0A", 1)],
)
def test_one_bit_per_floor_has_the_codes_that_the_map_gives(data: str, floor: int | None) -> None:
    codec = written_map(
        'signals:\n  car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"], codes: [-1, 1, 2]}\n'
    )
    values, unlisted = read(codec, data)
    assert (values["car_floor"], unlisted) == (floor, {})


def test_two_floors_at_once_are_none_whatever_their_codes() -> None:
    codec = written_map('signals:\n  car_floor: {one_of: ["discrete:0", "discrete:1"], codes: [5, 9]}\n')
    assert read(codec, "03") == ({"car_floor": None}, {"car_floor": 3})


@each_row(("data", "lit"), [("00", frozenset()), ("01", {5}), ("03", {5, 1}), ("06", {1, 2}), ("07", {1, 2, 5})])
def test_lamps_have_the_codes_that_the_map_gives_in_any_order(data: str, lit: frozenset[int]) -> None:
    codec = written_map(
        'signals:\n  calls_registered: {each_of: ["discrete:0", "discrete:1", "discrete:2"], codes: [5, 1, 2]}\n'
    )
    assert read(codec, data)[0]["calls_registered"] == lit


@pytest.mark.parametrize(("code", "pressed"), [(1, 16), (2, 17), (5, 18)])
def test_a_position_register_that_counts_from_1_goes_with_one_output_per_floor(code: int, pressed: int) -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", as: floor, unknown: [0]}\n' + BUTTONS)
    assert read(codec, f"{code:04X}")[0]["car_floor"] == code
    assert written(codec, code) == {address: int(address == pressed) for address in (16, 17, 18)}
    assert written(codec, None) == {16: 0, 17: 0, 18: 0}


def test_a_floor_that_no_output_has_is_never_called() -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", as: floor, unknown: [0]}\n' + BUTTONS)
    with pytest.raises(ValueError, match="go_to has 3 floors, with codes 1, 2, 5; 3 is none of them"):
        codec.commands["go_to"].encode(3)


def test_what_an_output_asks_for_is_read_back_by_its_code() -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", as: floor, unknown: [0]}\n' + BUTTONS)
    image = codec.empty_image()
    image["coil"][18] = 1
    assert codec.commands["go_to"].decode(image) == 5


@each_row(
    ("data", "floor", "unlisted"),
    [
        ("00 12", 12, {}),
        ("01 07", 107, {}),
        ("99 99", 9999, {}),
        ("00 1A", None, {"car_floor": 0x1A}),
        ("00 00", None, {}),
    ],
)
def test_bcd_has_four_bits_for_each_digit(data: str, floor: int | None, unlisted: dict[str, int]) -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", as: floor, code: bcd, unknown: [0]}\n')
    assert read(codec, data) == ({"car_floor": floor}, unlisted)


def test_bcd_may_fill_a_field_of_bits() -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", bits: [4, 9], as: floor, code: bcd}\n')
    # 10 0111 is 2 and 7; 11 1111 is no digit
    assert read(codec, "02 70")[0]["car_floor"] == 27
    assert read(codec, "03 F0") == ({"car_floor": None}, {"car_floor": 0x3F})


def test_a_number_in_bcd_may_fill_two_registers() -> None:
    codec = written_map(
        'signals:\n  load: {at: "input:0", type: uint32, word_order: high_first, code: bcd, unit: kg}\n'
    )
    assert read(codec, "00 01 23 45")[0]["load"] == 12345


@each_row(("code", "word"), [(1, 0x0001), (12, 0x0012), (9999, 0x9999), (None, 0)])
def test_a_floor_is_called_in_bcd(code: int | None, word: int) -> None:
    codec = written_map(FLOOR + GO_TO.format(place='at: "holding:7", as: floor, code: bcd'))
    assert written(codec, code) == {7: word}
    image = codec.empty_image()
    image["holding"][7] = word
    assert codec.commands["go_to"].decode(image) == code


def test_a_floor_beyond_bcd_is_never_called() -> None:
    codec = written_map(FLOOR + GO_TO.format(place='at: "holding:7", as: floor, code: bcd'))
    with pytest.raises(ValueError, match="go_to writes BCD, 0 to 9999; floor code 10000 does not fit"):
        codec.commands["go_to"].encode(10000)


@each_row(
    ("coding", "data", "value"),
    [
        ("type: uint16", "01 02", 0x0201),
        ("type: int16", "FE FF", -2),
        ("type: uint32, word_order: high_first", "01 02 03 04", 0x02010403),
        ("type: uint32, word_order: low_first", "01 02 03 04", 0x04030201),
        ("type: int32, word_order: low_first", "FE FF FF FF", -2),
        ("code: bcd", "34 12", 1234),
    ],
)
def test_a_register_may_have_its_low_byte_first(coding: str, data: str, value: int) -> None:
    codec = written_map(f'signals:\n  load: {{at: "input:0", {coding}, byte_order: low_first}}\n')
    assert read(codec, data)[0]["load"] == value


def test_words_and_flags_may_have_their_low_byte_first() -> None:
    codec = written_map(
        "signals:\n"
        '  motion: {at: "input:0", byte_order: low_first, values: {1: stopped, 258: up}}\n'
        '  ready: {at: "input:1", byte_order: low_first, means_yes: 255}\n'
    )
    assert read(codec, "01 00 FF 00")[0] == {"motion": "stopped", "ready": True}
    assert read(codec, "02 01 00 00")[0] == {"motion": "up", "ready": False}


@pytest.mark.parametrize(("code", "word"), [(2, 0x0200), (-2, 0xFEFF), (None, 0)])
def test_a_floor_is_called_with_the_low_byte_first(code: int | None, word: int) -> None:
    codec = written_map(FLOOR + GO_TO.format(place='at: "holding:7", as: floor, type: int16, byte_order: low_first'))
    assert written(codec, code) == {7: word}
    image = codec.empty_image()
    image["holding"][7] = word
    assert codec.commands["go_to"].decode(image) == code


@each_row(
    ("coding", "data", "value"),
    [
        ("yes_from: 110", "00 6E", True),
        ("yes_from: 110", "00 6D", False),
        ("yes_from: 110", "FF FF", True),
        ("yes_from: 110, range: [0, 200]", "FF FF", UNLISTED),
        ("yes_from: 110, unknown: [65535]", "FF FF", None),
        ("yes_to: -5, type: int16", "FF FB", True),
        ("yes_to: -5, type: int16", "00 00", False),
        ("yes_from: -5, yes_to: 5, type: int16", "FF FB", True),
        ("yes_from: -5, yes_to: 5, type: int16", "00 06", False),
        ("yes_from: 110, byte_order: low_first", "6E 00", True),
        ("yes_from: 110, code: bcd", "01 10", True),
        ("yes_from: 110, code: bcd", "01 0F", UNLISTED),
        ("yes_from: 10, bits: [4, 7]", "00 A0", True),
    ],
)
def test_a_flag_may_be_a_number_with_a_threshold(coding: str, data: str, value: object) -> None:
    codec = written_map(f'signals:\n  overload: {{at: "input:0", {coding}}}\n')
    values, unlisted = read(codec, data)
    assert values["overload"] is (None if value is UNLISTED else value)
    assert ("overload" in unlisted) is (value is UNLISTED)


def test_a_flag_may_be_a_number_in_two_registers() -> None:
    codec = written_map('signals:\n  overload: {at: "input:0", type: uint32, word_order: low_first, yes_from: 70000}\n')
    assert read(codec, "11 70 00 01")[0] == {"overload": True}
    assert read(codec, "11 6F 00 01")[0] == {"overload": False}


@each_row(
    ("open_at", "closed_at", "words"),
    [
        (90, 2, {0: "closed", 2: "closed", 3: "moving", 89: "moving", 90: "open", 100: "open", 101: None, 255: None}),
        (10, 95, {0: "open", 10: "open", 11: "moving", 94: "moving", 95: "closed", 100: "closed", 0xFFFF: None}),
    ],
)
def test_a_door_may_be_a_position_that_counts_up_or_down(open_at: int, closed_at: int, words: dict[int, str]) -> None:
    coding = f"open_at: {open_at}, closed_at: {closed_at}, range: [0, 100], unknown: [255]"
    codec = written_map(f'signals:\n  door.front: {{at: "input:0", {coding}}}\n')
    assert {number: read(codec, f"{number:04X}")[0]["door.front"] for number in words} == words


def test_a_number_and_the_flag_that_it_shows_share_a_register() -> None:
    codec = written_map('signals:\n  load: {at: "input:0", unit: "%"}\n  overload: {at: "input:0", yes_from: 110}\n')
    assert read(codec, "00 6E")[0] == {"load": 110, "overload": True}


POSITION = """\
signals:
  car_position: {at: "input:0", type: int32, word_order: high_first, unit: mm, positions: {-1: -3500, 0: 0, 1: 4200}, tolerance: 15, unknown: [-30000]}
"""


@each_row(
    ("data", "position", "floor"),
    [
        ("00 00 00 00", 0, 0),
        ("00 00 00 0F", 15, 0),
        ("00 00 00 10", 16, None),
        ("FF FF FF F1", -15, 0),
        ("FF FF F2 54", -3500, -1),
        ("00 00 10 68", 4200, 1),
        ("00 00 10 59", 4185, 1),
        ("00 00 08 34", 2100, None),
        ("7F FF FF FF", 0x7FFFFFFF, None),
        ("FF FF 8A D0", None, None),
    ],
)
def test_a_car_position_gives_the_floor_within_its_tolerance(
    data: str, position: int | None, floor: int | None
) -> None:
    values, unlisted = read(written_map(POSITION), data)
    assert (values, unlisted) == ({"car_position": position, "car_floor": floor}, {})


def test_a_map_that_shows_its_floor_otherwise_has_a_position_without_a_table() -> None:
    codec = written_map(
        'signals:\n  car_position: {at: "input:0"}\n  car_floor: {at: "input:1", as: floor, unknown: [0]}\n'
    )
    assert read(codec, "0F A0 00 02")[0] == {"car_position": 4000, "car_floor": 2}


def test_a_position_is_read_once_for_both() -> None:
    codec = written_map(POSITION)
    assert plan_reads(codec.signal_points, codec.served, max_registers=125, max_bits=2000) == (
        Block(codec.signals["car_position"].points[0].table, 0, 2),
    )


def test_a_floor_that_has_no_position_cannot_be_said() -> None:
    with pytest.raises(ValueError, match="car_floor has positions for the floors with codes -1 to 1; not for 2"):
        written_map(POSITION).signals["car_floor"].encode(2)


def test_between_two_positions_there_is_no_floor_to_say() -> None:
    codec = written_map(POSITION.replace(", unknown: [-30000]", ""))
    floor = codec.signals["car_floor"]
    assert floor.decode(floor.encode(None)) is None


def test_positions_may_follow_one_another_where_another_value_means_no_floor() -> None:
    codes = 'signals:\n  car_position: {at: "input:0", positions: {3: 32769, 4: 1, 5: 2, 6: 3}, tolerance: 0}\n'
    codec = written_map(codes)
    found = {raw: read(codec, raw)[0]["car_floor"] for raw in ("80 01", "00 01", "00 02", "00 03", "00 00")}
    assert found == {"80 01": 3, "00 01": 4, "00 02": 5, "00 03": 6, "00 00": None}
    floor = codec.signals["car_floor"]
    assert floor.decode(floor.encode(None)) is None


def test_a_call_that_the_controller_takes_over_is_timed_by_it() -> None:
    taken = GO_TO.format(place='at: "holding:1", as: floor, self_clearing: true')
    with pytest.raises(MapFileError, match="takes over and clears has `timed_by: device`"):
        written_map(FLOOR + taken)


BY_MODE = """\
signals:
  mode: {at: "input:0", values: {1: normal, 2: robot, 5: inspection}, unknown: [0]}
commands:
  robot_mode: {at: "coil:0", action: hold, max_hold_s: 60, refresh_s: 2, on_link_loss: device_watchdog, bounded_by: session, granted_by: robot_mode_on, granted_within_s: 300, confirm: {any_of: [effect], within_s: 300}}
"""


@each_row(
    ("data", "is_on", "unlisted"),
    [
        ("00 01", False, {}),
        ("00 02", True, {}),
        ("00 05", False, {}),
        ("00 00", None, {}),
        ("00 09", None, {"mode": 9}),
    ],
)
def test_a_mode_word_with_robot_shows_whether_robot_mode_is_granted(
    data: str, is_on: bool | None, unlisted: dict[str, int]
) -> None:
    values, found = read(written_map(BY_MODE), data)
    assert (values["robot_mode_on"], found) == (is_on, unlisted)


def test_robot_mode_at_the_mode_word_need_not_be_declared() -> None:
    declared = BY_MODE.replace("commands:", '  robot_mode_on: {at: "input:0", means_yes: 2}\ncommands:')
    with pytest.raises(MapFileError, match="is in mode already, whose word `robot` shows it; remove robot_mode_on"):
        written_map(declared)


def test_a_map_in_which_nothing_waits_for_robot_mode_is_warned_about(tmp_path: Path) -> None:
    def warned(text: str) -> bool:
        return any(
            "no command waits until robot mode is granted" in one.message for one in loaded(tmp_path, text).warnings
        )

    assert not warned(HEAD + BY_MODE)
    assert warned(HEAD + BY_MODE.replace("granted_by: robot_mode_on, granted_within_s: 300, ", ""))


def test_a_mode_word_shows_no_robot_mode_where_the_lift_is_not_told_to_enter_it() -> None:
    assert "robot_mode_on" not in written_map(BY_MODE.partition("commands:")[0]).signals


def test_digits_that_are_none_are_never_guessed() -> None:
    codec = written_map('signals:\n  car_floor: {at: "input:0", as: floor, code: bcd}\n')
    assert codec.signals["car_floor"].decode(0x00F0) is UNLISTED
