"""What `check` refuses in the signals of a map: ways of saying things that do not fit the kind, and places that clash."""

from pathlib import Path

import pytest

from tests.support.good_map import HANDSHAKE, Mistake, changed, expect_only, findings_of, loaded
from tests.support.rows import each_row

FLOOR = 'car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"]}'
FRONT = 'door.front: {open_limits: ["discrete:0", "discrete:1", "discrete:2"]}'
REAR = 'door.rear: {at: "sensor/discrete:0", active: low}'
MOTION = 'motion: {up: "discrete:8", down: "discrete:9"}'
CODE = 'destination: {code_of: ["input:0.0", "input:0.1"], code: gray, active: low, none: [3]}'
LAMPS = 'calls_registered: {each_of: ["coil:0", "coil:1", "coil:2"]}'
ENTER = 'may_enter: {at: "discrete:10"}'
OVERLOAD = 'overload: {at: "holding:10", means_yes: 2}'
LOAD = 'load: {at: "input:2", type: uint32, word_order: high_first, unit: kg}'
WATCHDOG = 'watchdog_time: {at: "holding:12", unit_s: 0.1}'

FORMS: list[Mistake] = [
    ("a floor in any number of bits", CODE, 'destination: {each_of: ["input:0.0", "input:0.1"]}', "signals.destination.each_of", "this is a floor; use `at` or `one_of` or `code_of`"),
    ("a set of floors at one point", LAMPS, 'calls_registered: {at: "holding:13"}', "signals.calls_registered.at", "use `each_of`"),
    ("a set of floors of which one is set", LAMPS, LAMPS.replace("each_of", "one_of"), "signals.calls_registered.one_of", "use `each_of`"),
    ("a position code for a motion", MOTION, 'motion: {code_of: ["discrete:8", "discrete:9"]}', "signals.motion.code_of", "this is a motion"),
    ("two directions for a flag", ENTER, 'may_enter: {up: "discrete:10", down: "discrete:12"}', "signals.may_enter.up", "this is a flag; use `at`"),
    ("one limit per floor for a flag", ENTER, 'may_enter: {open_limits: ["discrete:10", "discrete:12"]}', "signals.may_enter.open_limits", "this is a flag; use `at`"),
    ("words for two directions", MOTION, MOTION[:-1] + ", values: {0: stopped}}", "signals.motion.values", "belongs to a signal with `at`"),
    ("a field of a position code", CODE, CODE[:-1] + ", bits: [0, 1]}", "signals.destination.bits", "belongs to a signal with `at`"),
    ("a reserved code of one bit per floor", FLOOR, FLOOR[:-1] + ", unknown: [0]}", "signals.car_floor.unknown", "belongs to a signal with `at` or `code_of`"),
    ("a code of one bit per floor", FLOOR, FLOOR[:-1] + ", code: gray}", "signals.car_floor.code", "belongs to a signal with `at` or `code_of`"),
    ("a whole register where a bit is meant", CODE, CODE.replace("input:0.1", "input:1"), "signals.destination.code_of[1]", "name it, such as input:1.0"),
    ("a whole register for a direction", MOTION, MOTION.replace("discrete:9", "holding:13"), "signals.motion.down", "name it, such as holding:13.0"),
    ("Gray code in a flag", ENTER, ENTER[:-1] + ", code: gray}", "signals.may_enter.code", "is for a floor in several bits, without a sign; remove `code`"),
    ("Gray code in one bit", CODE, 'destination: {at: "input:0.0", as: floor, code: gray}', "signals.destination.code", "several bits"),
    ("Gray code with a sign", CODE, 'destination: {at: "input:0", as: floor, type: int16, code: gray}', "signals.destination.code", "use `type: uint16`"),
    ("an inverted floor number", CODE, 'destination: {at: "input:0", as: floor, active: low}', "signals.destination.active", "the bits of a position code"),
    ("an inverted word", REAR, 'door.rear: {at: "sensor/holding:1", values: {0: closed, 1: open}, active: low}', "signals.door.rear.active", "change the `values`"),
    ("a door that is open either way", REAR, 'door.rear: {at: "sensor/discrete:0", values: {0: open, 1: open}}', "signals.door.rear.values", "with open alone an open and a shut door read the same"),
    ("an inverted motion word", MOTION, 'motion: {at: "discrete:8", values: {0: stopped, 1: moving}, active: low}', "signals.motion.active", "change the `values`"),
    ("a reserved code beyond the position code", CODE, CODE.replace("[3]", "[4]"), "signals.destination.none[0]", "2 bits of uint16 hold 0 to 3"),
    ("a position code with two meanings", CODE, CODE.replace("none: [3]", "none: [3], unknown: [3]"), "signals.destination.none[0]", "code 3 means unknown already"),
    ("a signed position code", CODE, CODE.replace("code: gray, ", "type: int16, "), "signals.destination.type", "int16 needs a whole register, and this is 2 bits"),
    ("another signal than the floor that counts while stopped", CODE, CODE[:-1] + ", known_while: stopped}", "signals.destination.known_while", "belongs to car_floor"),
    ("a signed door limit", FRONT, FRONT[:-1] + ", type: int16}", "signals.door.front.type", "and this is 1 bit"),
    ("codes of a position", CODE, CODE[:-1] + ", codes: [0, 1]}", "signals.destination.codes", "belongs to a signal with `one_of` or `each_of` or `open_limits`"),
    ("fewer codes than floors", LAMPS, LAMPS[:-1] + ", codes: [0, 1]}", "signals.calls_registered.codes", "has 2 entries for 3 bits"),
    ("a code for two floors", LAMPS, LAMPS.replace('"coil:0", "coil:1", "coil:2"', '"coil:50", "coil:51", "coil:52"')[:-1] + ", codes: [0, 1, 0]}", "signals.calls_registered.codes[2]", "code 0 is given twice"),
    ("lamps of a floor that is never shown", LAMPS, LAMPS.replace('"coil:0", "coil:1", "coil:2"', '"coil:50", "coil:51", "coil:52"')[:-1] + ", codes: [0, 1, 7]}", "signals.calls_registered.codes", "car_floor only reports codes 0 to 2; a floor is never shown: 7"),
    ("BCD with a sign", CODE, 'destination: {at: "input:0", as: floor, type: int16, code: bcd}', "signals.destination.code", "without a sign; use `type: uint16`, and for a floor with a sign `positions`"),
    ("BCD in a flag", ENTER, ENTER[:-1] + ", code: bcd}", "signals.may_enter.code", "BCD is for a floor or a number in several bits"),
    ("a reserved code beyond BCD", CODE, 'destination: {at: "input:0", as: floor, code: bcd, none: [10000]}', "signals.destination.none[0]", "16 bits of BCD hold 0 to 9999"),
    ("bytes of a bit", ENTER, ENTER[:-1] + ", byte_order: low_first}", "signals.may_enter.byte_order", "is for whole registers"),
    ("bytes of a field", CODE, 'destination: {at: "input:0", bits: [0, 3], as: floor, byte_order: low_first}', "signals.destination.byte_order", "is for whole registers"),
    ("positions without a tolerance", LOAD, LOAD[:-1] + ", positions: {0: 1, 1: 9}}", "signals.load", "`positions` and `tolerance` belong together"),
    ("positions of a load", LOAD, LOAD[:-1] + ", positions: {0: 1, 1: 9}, tolerance: 1}", "signals.load.positions", "belongs to car_position"),
    ("positions beside a floor", LOAD, 'car_position: {at: "input:2", positions: {0: 1, 1: 9}, tolerance: 1}', "signals.car_position.positions", "the map has a car_floor of its own"),
    # flags and doors that a number shows
    ("a threshold of a bit", ENTER, ENTER[:-1] + ", yes_from: 1}", "signals.may_enter.yes_from", "is for a number, and this is a single bit"),
    ("a threshold of a number", LOAD, LOAD[:-1] + ", yes_from: 110}", "signals.load.yes_from", "belongs to a flag, and this is a number"),
    ("a threshold of a flag for a door", REAR, 'door.rear: {at: "sensor/holding:1", values: {0: closed, 1: open}, yes_to: 9}', "signals.door.rear.yes_to", "belongs to a flag, and this is a door"),
    ("a threshold beyond the type", OVERLOAD, 'overload: {at: "holding:10", yes_from: 70000}', "signals.overload.yes_from", "number 70000 does not fit: 16 bits of uint16 hold 0 to 65535"),
    ("a threshold beyond the range", OVERLOAD, 'overload: {at: "holding:10", yes_from: 110, range: [0, 100]}', "signals.overload.yes_from", "110 is outside `range`, 0 to 100"),
    ("a range beyond the type", OVERLOAD, 'overload: {at: "holding:10", yes_from: 110, range: [-1, 120]}', "signals.overload.range", "number -1 does not fit"),
    ("a range of one number", OVERLOAD, 'overload: {at: "holding:10", yes_from: 110, range: [110, 110]}', "signals.overload.range", "holds no two numbers"),
    ("a threshold that is not known", OVERLOAD, 'overload: {at: "holding:10", yes_from: 110, unknown: [110]}', "signals.overload.yes_from", "110 is `unknown` already"),
    ("a flag that is always yes", OVERLOAD, 'overload: {at: "holding:10", yes_from: 0}', "signals.overload.yes_from", "every number from 0 to 65535 would mean yes"),
    ("a flag that is never yes", OVERLOAD, 'overload: {at: "holding:10", yes_from: 9, yes_to: 3}', "signals.overload.yes_to", "no number is at least 9 and at most 3; exchange the two"),
    ("a code for yes beside a threshold", OVERLOAD, OVERLOAD[:-1] + ", yes_from: 110}", "signals.overload.means_yes", "`yes_from` say what the number means; remove it"),
    ("a range without a threshold", OVERLOAD, OVERLOAD[:-1] + ", range: [0, 9]}", "signals.overload.range", "belongs to a flag with `yes_from` or `yes_to`"),
    ("a door that is open without being closed", REAR, 'door.rear: {at: "sensor/holding:1", open_at: 90, range: [0, 100]}', "signals.door.rear", "`open_at` and `closed_at` belong together"),
    ("a door without its range", REAR, 'door.rear: {at: "sensor/holding:1", open_at: 90, closed_at: 2}', "signals.door.rear", "needs `range`, its lowest and highest one"),
    ("a door that never moves", REAR, 'door.rear: {at: "sensor/holding:1", open_at: 90, closed_at: 89, range: [0, 100]}', "signals.door.rear.closed_at", "leaves no position between open and closed"),
    ("words for a position", REAR, 'door.rear: {at: "sensor/holding:1", open_at: 90, closed_at: 2, range: [0, 100], values: {0: closed, 1: open}}', "signals.door.rear.values", "`open_at` and `closed_at` say what the number means"),
    ("a flag of a number that is read otherwise", OVERLOAD, 'overload: {at: "input:2", yes_from: 110}', "signals.load.at", "which reads it otherwise; give both the same type, bits and order"),
]  # fmt: skip

BY_POSITION = 'car_position: {at: "input:3", positions: {0: 100, 1: 4000, 2: 8000}, tolerance: 20}'

POSITIONS: list[Mistake] = [
    ("a position that does not fit", BY_POSITION, BY_POSITION.replace("8000", "70000"), "signals.car_position.positions[2]", "position 70000 does not fit: 16 bits of uint16 hold 0 to 65535"),
    ("floors that are one", BY_POSITION, BY_POSITION.replace("tolerance: 20", "tolerance: 1950"), "signals.car_position.tolerance", "with a tolerance of 1950 the car would be at floors 0 and 1 at once"),
    ("two floors at one position", BY_POSITION, BY_POSITION.replace("4000", "100").replace("tolerance: 20", "tolerance: 0"), "signals.car_position.tolerance", "would be at floors 0 and 1 at once; give each a position of its own"),
    ("a floor at every position", BY_POSITION, BY_POSITION.replace("{0: 100, 1: 4000, 2: 8000}, tolerance: 20", "{0: 1, 1: 2, 2: 3}, tolerance: 0"), "signals.car_position.positions", "no value is left for a car that is at no floor; list one under `unknown`"),
    ("a place that is taken", BY_POSITION, BY_POSITION.replace("input:3", "holding:12"), "signals.watchdog_time.at", "holding:12 is in car_position already"),
    ("a place that is not served", BY_POSITION, BY_POSITION.replace("input:3", "input:300"), "signals.car_position.at", "input:300 is not served"),
    ("a place that cannot be read", BY_POSITION, BY_POSITION.replace("input:3", "inputs:3"), "signals.car_position.at", "inputs:3"),
    ("limits of a floor without a position", 'door.rear: {at: "sensor/discrete:0", active: low}', 'door.rear: {open_limits: ["discrete:20", "discrete:21"], codes: [0, 5]}', "signals.door.rear.codes", "car_floor only reports codes 0 to 2; a floor is never shown: 5"),
]  # fmt: skip

NUMBERS: list[Mistake] = [
    ("a 32-bit number without its order", LOAD, LOAD.replace(" word_order: high_first,", ""), "signals.load", "needs `word_order`"),
    ("an order of a 16-bit number", WATCHDOG, WATCHDOG[:-1] + ", word_order: low_first}", "signals.watchdog_time.word_order", "use `type: uint32`"),
    ("a 32-bit flag", ENTER, 'may_enter: {at: "input:4", type: uint32, word_order: low_first}', "signals.may_enter.type", "is for numbers and floors, and this is a flag"),
    ("a 32-bit number in a bit", LOAD, LOAD.replace("input:2", "input:2.1"), "signals.load.type", "needs two whole registers, and this is 1 bit"),
    ("a 32-bit number in a discrete", LOAD, LOAD.replace("input:2", "discrete:20"), "signals.load.type", "needs two whole registers"),
    ("a field of a 32-bit number", LOAD, LOAD[:-1] + ", bits: [0, 7]}", "signals.load.bits", "uint32 fills two registers"),
    ("a 32-bit number whose second half is not served", LOAD, LOAD.replace("input:2", "input:20"), "signals.load.at", "input:20 and the register after it are not served in one range: of input the map serves 0 to 20"),
    ("a signal in the second half of a number", LOAD, LOAD + '\n  fault: {at: "input:3.7"}', "signals.fault.at", "input:3.7 is in load already"),
    ("a unit of a flag", ENTER, ENTER[:-1] + ", unit: kg}", "signals.may_enter.unit", "belongs to a number, and this is a flag"),
    ("a watchdog whose counts have no length", WATCHDOG, 'watchdog_time: {at: "holding:12"}', "signals.watchdog_time", "needs `unit_s`"),
    ("a load that counts in seconds", LOAD, LOAD[:-1] + ", unit_s: 1}", "signals.load.unit_s", "belongs to watchdog_time"),
    ("yes of a number", LOAD, LOAD[:-1] + ", means_yes: 2}", "signals.load.means_yes", "belongs to a flag, and this is a number"),
    ("yes of a single bit", ENTER, ENTER[:-1] + ", means_yes: 2}", "signals.may_enter.means_yes", "a single bit means yes at 1"),
    ("yes that is no", OVERLOAD, OVERLOAD.replace("2}", "0}"), "signals.overload.means_yes", "0 is no already"),
    ("yes that does not fit", OVERLOAD, 'overload: {at: "holding:10", bits: [0, 1], means_yes: 4}', "signals.overload.means_yes", "2 bits of uint16 hold 0 to 3"),
    ("yes of two directions", MOTION, MOTION[:-1] + ", means_yes: 2}", "signals.motion.means_yes", "belongs to a signal with `at`"),
]  # fmt: skip

CLASHES: list[Mistake] = [
    ("a limit that is another floor's switch", FRONT, FRONT.replace('"discrete:1", "discrete:2"', '"discrete:30", "discrete:1"'), "signals.door.front.open_limits[2]", "discrete:1 is floor 1 of car_floor and floor 2 of door.front; list both in the same order"),
    ("limits inverted, and the switches at them not", FRONT, FRONT[:-1] + ", active: low}", "signals.door.front", "has another `active`; use the same in both"),
    ("a single limit at a floor's switch", REAR, 'door.rear: {at: "discrete:2"}', "signals.door.rear.at", "discrete:2 is in car_floor already"),
    ("a limit at something else", FRONT, FRONT.replace('"discrete:0", "discrete:1", "discrete:2"', '"discrete:30", "discrete:31", "discrete:8"'), "signals.motion.up", "discrete:8 is in door.front already"),
    ("two directions in one bit", MOTION, MOTION.replace("discrete:9", "discrete:8"), "signals.motion.down", "discrete:8 is twice in this one"),
    ("a flag that is our own output", ENTER, 'may_enter: {at: "coil:8"}', "signals.may_enter.at", "coil:8 shows what robot_in_place writes, and not what the lift does"),
    ("a flag where an output is read back", ENTER, 'may_enter: {at: "input:10.0"}', "signals.may_enter.at", "input:10.0 shows what hold_door.front writes"),
    ("a flag in the register of a call", ENTER, 'may_enter: {at: "holding:20.3"}', "signals.may_enter.at", "shows what go writes, and not what the lift does; give the place where the controller reports it; a lamp in a call button is calls_registered or call_accepted"),
    ("lamps in another order than their buttons", LAMPS, LAMPS.replace('"coil:1", "coil:2"', '"coil:2", "coil:1"'), "signals.calls_registered.each_of[1]", "coil:2 is floor 1 here and floor 2 of call; list both in the same order"),
    ("lamps with other codes than their buttons", LAMPS, 'calls_registered: {each_of: ["coil:0", "coil:50", "coil:51"], codes: [1, 0, 2]}', "signals.calls_registered.each_of[0]", "coil:0 is floor 1 here and floor 0 of call; give both the same `codes` for it"),
    ("limits with other codes than the switches", FRONT, 'door.front: {open_limits: ["discrete:0", "discrete:30", "discrete:31"], codes: [1, 0, 2]}', "signals.door.front.open_limits[0]", "discrete:0 is floor 0 of car_floor and floor 1 of door.front; give both the same `codes` for it"),
]  # fmt: skip


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in FORMS + NUMBERS],
)
def test_a_signal_that_does_not_fit_its_kind_is_refused(
    tmp_path: Path, old: str, new: str, key: str, words: str
) -> None:
    text, _ = changed(HANDSHAKE, old, new)
    # another evidence, because a floor that is said in another way is no door limit
    expect_only(tmp_path, text.replace("door_limit", "motion_stopped"), key, words)


def positioned(text: str) -> str:
    """The map with a position instead of floor switches."""
    plain, _ = changed(text, FLOOR, BY_POSITION)
    plain, _ = changed(plain, FRONT, 'door.front: {at: "discrete:0"}')
    return plain.replace("door_limit", "motion_stopped").replace('load: {at: "input:2"', 'load: {at: "input:16"')


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in POSITIONS],
)
def test_a_position_that_shows_no_floor_is_refused_once(
    tmp_path: Path, old: str, new: str, key: str, words: str
) -> None:
    expect_only(tmp_path, changed(positioned(HANDSHAKE), old, new)[0], key, words)


def test_a_table_of_one_position_is_refused(tmp_path: Path) -> None:
    text, _ = changed(positioned(HANDSHAKE), "{0: 100, 1: 4000, 2: 8000}", "{0: 100}")
    found = {finding.key: finding.message for finding in findings_of(tmp_path, text)}
    assert "a lift has at least two floors" in found["signals.car_position.positions"]


def test_a_position_with_a_table_is_a_floor_signal(tmp_path: Path) -> None:
    found = loaded(tmp_path, positioned(HANDSHAKE))
    assert found.warnings == ()
    assert "car_floor" in found.map.signals


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in CLASHES],
)
def test_a_point_belongs_to_one_signal(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    text, _ = changed(HANDSHAKE, old, new)
    expect_only(tmp_path, text.replace("door_limit", "motion_stopped"), key, words)


@each_row(
    ("old", "new"),
    [
        (CODE, 'destination: {at: "input:0", bits: [2, 5], as: floor, code: gray, active: low}'),
        (CODE, 'destination: {at: "input:0", bits: [2, 5], as: floor, active: low, unknown: [15]}'),
        (CODE, 'destination: {code_of: ["input:0.3", "discrete:40", "coil:50"], unknown: [7]}'),
        (CODE, 'destination: {at: "input:0", type: int32, word_order: low_first, as: floor, unknown: [-1]}'),
        (
            LAMPS,
            LAMPS.replace('"coil:0", "coil:1", "coil:2"', '"coil:50", "coil:51", "coil:52"')[:-1] + ", active: low}",
        ),
        (MOTION, MOTION[:-1] + ", active: low}"),
        (OVERLOAD, 'overload: {at: "holding:10", active: low}'),
        (ENTER, 'may_enter: {at: "sensor/holding:3.15", active: low}'),
    ],
)
def test_what_fits_is_accepted(tmp_path: Path, old: str, new: str) -> None:
    assert loaded(tmp_path, changed(HANDSHAKE, old, new)[0]).warnings == ()


def test_lamp_and_button_may_share_a_register_that_holds_the_floor(tmp_path: Path) -> None:
    lamps = 'call_accepted: {at: "holding:20", as: floor, none: [0]}'
    text, _ = changed(HANDSHAKE, f"  {CODE}\n", f"  {lamps}\n")
    assert loaded(tmp_path, text.replace("[destination, effect]", "[call_accepted]")).warnings == ()


def test_a_floor_read_from_the_register_of_the_call_is_a_warning(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, CODE, 'destination: {at: "holding:20", as: floor}')
    (warning,) = loaded(tmp_path, text).warnings
    assert warning.key == "signals.destination.at"
    assert "shows what go writes" in warning.message
