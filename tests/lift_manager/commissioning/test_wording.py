"""How points, signals and commands are put into words."""

from lift_manager.commissioning import wording
from register_maps.codec import Point
from register_maps.words import Table
from tests.support.rows import each_row
from tests.support.written_maps import written_map

SIGNALS = [
    ("overload: {at: 'discrete:1'}", "1 = yes, 0 = no"),
    ("overload: {at: 'discrete:1', active: low}", "0 = yes, 1 = no (inverted)"),
    ("overload: {at: 'holding:1.3', active: low}", "0 = yes, 1 = no (inverted)"),
    ("overload: {at: 'holding:1', means_yes: 255}", "255 = yes, 0 = no"),
    ("overload: {at: 'holding:1', means_yes: 255, active: low}", "0 = yes, 255 = no (inverted)"),
    ("overload: {at: 'holding:1', yes_from: 110, unit: '%'}", "110 or more = yes, less = no; in %"),
    (
        "level: {at: 'holding:1', type: int16, yes_from: -5, yes_to: 5, unknown: [999], range: [-500, 500]}",
        "signed; -5 to 5 = yes, everything else = no, outside -500 to 500 = not known, 999 = not known",
    ),
    (
        "door.front: {at: 'holding:1', open_at: 90, closed_at: 2, range: [0, 100]}",
        "90 or more = open, 2 or less = closed, between = moving, outside 0 to 100 = not known",
    ),
    ("door.front: {at: 'discrete:1'}", "0 = closed, 1 = open"),
    ("door.front: {at: 'discrete:1', active: low}", "1 = closed, 0 = open (inverted)"),
    (
        "door.front: {open_limit: 'discrete:1', closed_limit: 'discrete:2'}",
        "limit contacts fully open and fully closed; neither = moving, both = fault",
    ),
    (
        "door.front: {open_limit: 'discrete:1', closed_limit: 'discrete:2', active: low}",
        "limit contacts fully open and fully closed; neither = moving, both = fault; inverted: 0 = made",
    ),
    ("motion: {at: 'holding:1', values: {0: stopped, 1: up}, unknown: [9]}", "0 = stopped, 1 = up, 9 = not known"),
    ("motion: {up: 'coil:1', down: 'coil:2'}", "two bits, up and down; neither = stopped, both = unknown"),
    ("mode: {at: 'holding:1', bits: [4, 6], values: {1: normal, 2: inspection}}", "3 bits; 1 = normal, 2 = inspection"),
    (
        "destination: {at: 'holding:1', type: int16, as: floor, none: [0], unknown: [99]}",
        "signed; the code of a floor, 99 = not known, 0 = no floor",
    ),
    (
        "car_floor: {one_of: ['coil:1', 'coil:2']}",
        "one bit per floor, lowest first; none = no floor known, several = unknown",
    ),
    (
        "car_floor: {one_of: ['coil:1', 'coil:2'], codes: [-1, 4]}",
        "one bit per floor, for the codes -1, 4; none = no floor known, several = unknown",
    ),
    (
        "car_floor: {at: 'holding:1', as: floor, code: bcd, byte_order: low_first, unknown: [0]}",
        "low byte first; BCD; the code of a floor, 0 = not known",
    ),
    (
        "car_position: {at: 'holding:1', type: int16, unit: mm, positions: {1: -20, 2: 3500}, tolerance: 15}",
        "signed; the floor within 15 mm of its position: -20 mm = code 1, 3500 mm = code 2",
    ),
    ("calls_registered: {each_of: ['coil:1', 'coil:2']}", "one bit per floor, lowest first; any number of them"),
    (
        "car_floor: {code_of: ['coil:1', 'coil:2'], code: gray, active: low}",
        "2 bits, lowest first; Gray code; every bit inverted; the code of a floor",
    ),
    (
        "load: {at: 'holding:1', type: uint32, word_order: low_first, unit: kg}",
        "two registers, 32 bits, low word first; a number; in kg",
    ),
    ("watchdog_time: {at: 'holding:1', unit_s: 0.1}", "a number; one count is 0.1 s"),
    (
        "alive: {at: 'holding:1', type: counter, must_change_within_s: 3}",
        "a number that changes; must change within 3 s",
    ),
]

COMMANDS = [
    (
        "close_door.front: {at: 'coil:1', action: pulse, width_s: 1}",
        "1 = on, 0 = released",
        "pressed for 1 s, then released",
    ),
    (
        "close_door.front: {at: 'coil:1', action: pulse, width_s: 1, press: 0, rest: 1}",
        "0 = on, 1 = released",
        "pressed for 1 s, then released",
    ),
    (
        "close_door.front: {at: 'coil:1', action: pulse, width_s: 1, reset_first_s: 0.5, min_repeat_s: 5}",
        "1 = on, 0 = released",
        "pressed for 1 s, then released; the rest value is written 0.5 s before each press; at least 5 s from press to press",
    ),
    (
        "go_to: {at: 'holding:1', type: int16, as: floor, action: pulse, width_s: 1}",
        "signed number, the code of a floor; 0 = no command",
        "pressed for 1 s, then released",
    ),
    (
        "go_to: {at: 'holding:1', as: floor, code: bcd, byte_order: low_first, action: pulse, width_s: 1}",
        "BCD number, low byte first, the code of a floor; 0 = no command",
        "pressed for 1 s, then released",
    ),
    (
        "go_to: {one_of: ['coil:1', 'coil:2'], codes: [1, 2], action: pulse, width_s: 1}",
        "one output per floor, for the codes 1, 2; 1 = on, 0 = released",
        "pressed for 1 s, then released",
    ),
    (
        "go_to: {at: 'holding:1', as: floor, action: pulse, width_s: 5, timed_by: device, rest: 9}",
        "number, the code of a floor",
        "a press of 5 s that the device ends; nothing is written back",
    ),
    (
        "go_to: {one_of: ['coil:1', 'coil:2'], action: hold, max_hold_s: 60, refresh_s: 2, until: arrived, on_link_loss: latches}",
        "one output per floor, lowest first; 1 = on, 0 = released",
        "held until the car is there, at most 60 s unless renewed; written again every 2 s",
    ),
    (
        "hold_door.front: {at: 'holding:1', action: hold, max_hold_s: 5, refresh_s: 2, on_link_loss: timed_by_device, payload: {time: max_hold_s, unit_s: 0.5}}",
        "the time it is to last (10 counts of 0.5 s) is written; 0 releases it",
        "held until released, at most 5 s unless renewed; written again every 2 s",
    ),
    (
        "hold_door.front: {at: 'coil:1', action: hold, max_hold_s: 30, repeat_pulse_s: 4, width_s: 1, on_link_loss: latches}",
        "1 = on, 0 = released",
        "held until released, at most 30 s unless renewed; made of presses of 1 s, every 4 s",
    ),
    (
        "go_to: {one_of: ['coil:512', 'coil:513'], action: pulse, width_s: 0.5, timed_by: device, payload: {time: width_s, unit_s: 0.1}}",
        "one relay pulse per floor, lowest first; the time in the request (5 counts of 0.1 s) closes the relay",
        "a press of 0.5 s that the device ends; nothing is written back",
    ),
    (
        "heartbeat: {at: 'holding:1', action: count, every_s: 0.5}",
        "counts up from 1, and never writes 0",
        "always written, every 0.5 s",
    ),
    ("heartbeat: {at: 'coil:1', action: toggle, every_s: 1}", "0 and 1 in turn", "always written, every 1 s"),
]
OTHER = "ready: {at: 'input:9'}, car_floor: {at: 'input:10', as: floor}"


@each_row(("text", "words"), SIGNALS)
def test_a_signal_is_coded_in_these_words(text: str, words: str) -> None:
    name = text.split(":", maxsplit=1)[0]
    more = "" if name == "motion" else "\n  motion: {at: 'input:8', values: {0: stopped}}"
    codec = written_map(f"signals:\n  {text}{more}\n")
    assert wording.signal_coding(codec.signals[name], codec.map.signals[name]) == words


@each_row(("text", "coding", "action"), COMMANDS)
def test_a_command_is_coded_and_given_in_these_words(text: str, coding: str, action: str) -> None:
    name = text.split(":", maxsplit=1)[0]
    confirm = "" if name == "heartbeat" else ", confirm: {any_of: [ready], within_s: 2}"
    if name == "go_to":
        confirm = ", confirm: {any_of: [effect], within_s: 2}"
    codec = written_map(f"signals: {{{OTHER}}}\ncommands:\n  {text[:-1]}{confirm}}}\n")
    command = codec.commands[name]
    assert wording.command_coding(command) == coding
    assert wording.action(command.spec) == action


def test_what_surrounds_a_press_is_told() -> None:
    codec = written_map("""\
signals: {may_enter: {at: "coil:7"}, ready: {at: "coil:9"}, robot_mode_on: {at: "coil:8"}}
commands:
  robot_mode:
    {at: "coil:1", action: hold, max_hold_s: 60, refresh_s: 1, on_link_loss: device_watchdog, granted_by: robot_mode_on,
     requires: [ready], confirm: {any_of: [effect], within_s: 600}}
  hold_door.front:
    {at: "coil:2", action: hold, max_hold_s: 30, on_link_loss: latches, excludes: [close_door.front], gap_s: 0.5,
     requires: [ready, robot_mode_on], confirm: {any_of: [may_enter, readback], within_s: 2}}
  close_door.front: {at: "coil:3", action: pulse, width_s: 1, confirm: {any_of: [may_enter], within_s: 2}}
""")
    mode, hold, close = (codec.commands[name].spec for name in ("robot_mode", "hold_door.front", "close_door.front"))
    assert wording.conditions(mode) == "only while ready reads yes; granted by robot_mode_on, within 600 s"
    assert wording.conditions(hold) == (
        "only while ready and robot_mode_on read yes; close_door.front is released 0.5 s before"
    )
    assert wording.conditions(close) == ""
    assert wording.confirmation(mode) == "the lift does it, within 600 s"
    assert wording.confirmation(hold) == "may_enter shows it or the output reads back as written, within 2 s"
    assert wording.link_loss(mode) == "the watchdog of the controller releases it"
    assert wording.link_loss(hold) == "STAYS ON: nothing releases it"
    assert wording.link_loss(close) == "a press that is on STAYS ON until the manager is back"


PLACES = [
    (Point(Table.COIL, 16), 1, "coil 16"),
    (Point(Table.DISCRETE, 0), 8, "discrete 0 to 7"),
    (Point(Table.HOLDING, 5, 0, 16), 1, "holding 5"),
    (Point(Table.HOLDING, 5, 3), 1, "holding 5 bit 3"),
    (Point(Table.HOLDING, 5, 4, 2), 1, "holding 5 bits 4 to 5"),
    (Point(Table.HOLDING, 5, 0), 3, "holding 5 bits 0 to 2"),
    (Point(Table.INPUT, 7, 0, 16, "sensor"), 2, "sensor/input 7 to 8"),
]


@each_row(("point", "count", "words"), PLACES)
def test_a_place_on_the_wire_is_named(point: Point, count: int, words: str) -> None:
    assert wording.wire(point, count) == words


def test_only_points_side_by_side_are_taken_together() -> None:
    coils = [Point(Table.COIL, address) for address in (1, 2, 3, 7, 6)]
    assert list(wording.runs(coils)) == [(0, 3), (3, 1), (4, 1)]
    bits = [Point(Table.HOLDING, 1, bit) for bit in (14, 15)]
    assert list(wording.runs([*bits, Point(Table.HOLDING, 2, 0)])) == [(0, 2), (2, 1)]
    assert list(wording.runs([Point(Table.COIL, 1), Point(Table.COIL, 2, endpoint="sensor")])) == [(0, 1), (1, 1)]
    assert list(wording.runs([])) == []


def test_control_characters_of_a_strangers_text_do_not_reach_a_terminal_or_a_file() -> None:
    assert wording.one_line("a\x1b[31m b\r\n\tc\u2028d\x85e ") == "a [31m b c d e"
