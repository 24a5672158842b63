"""What `check` refuses in a map: each mistake by its line, its key and the words that say how to mend it."""

from pathlib import Path

import pytest

from register_maps.check import Problem, check
from tests.support.good_map import GOOD, changed, findings_of, loaded
from tests.support.rows import each_row

FLOOR = 'car_floor: {at: "holding:1", type: int16, as: floor, unknown: [0]}'
MOTION = 'motion: {at: "holding:2", values: {1: stopped, 2: up, 3: down}}'
FRONT = 'door.front: {at: "holding:3", bits: [4, 5], values: {0: closed, 1: opening, 2: open, 3: closing}}'
REAR = 'door.rear: {open_limit: "discrete:1", closed_limit: "discrete:2"}'
FIRE = 'fire: {at: "discrete:3", active: low}'
LEVEL = 'level: {at: "discrete:4"}'
ALIVE = 'alive: {at: "holding:6", type: counter, must_change_within_s: 3}'
LOAD = 'load: {at: "input:1"}'
MODE = 'mode: {at: "holding:4", values: {1: normal, 2: independent}}'
BLOCK = '{at: "coil:1", count: 3, function: 15}'
LAMPS = 'call_accepted: {one_of: ["coil:11", "coil:12"]}'

REFUSED: list[tuple[str, str, str, int, str, str]] = [
    # name, old, new, line after the first changed one, key, words
    ("a signal with a typo", LEVEL, 'levle: {at: "discrete:4"}', 0, "signals.levle", "did you mean `level`?"),
    ("a signal nobody knows", LOAD, 'qqq: {at: "input:1"}', 0, "signals.qqq", "signals are car_floor, destination"),
    ("a command with a typo", "  robot_mode:\n", "  robot_mod:\n", 0, "commands.robot_mod", "did you mean `robot_mode`?"),
    ("a command nobody knows", "  robot_mode:\n", "  reset:\n", 0, "commands.reset", "commands are go_to, go_to.front"),
    ("words on a flag", LEVEL, 'level: {at: "discrete:4", values: {0: up}}', 0, "signals.level.values", "use `active: low`"),
    ("words on a floor", FLOOR, FLOOR[:-1] + ", values: {1: up}}", 0, "signals.car_floor.values", "the site file names the floor codes"),
    ("codes on a number", LOAD, LOAD[:-1] + ", unknown: [3]}", 0, "signals.load.unknown", "remove `unknown`"),
    ("no floor on a motion", MOTION, MOTION[:-1] + ", none: [3]}", 0, "signals.motion.none", "`none` is for floors"),
    ("a motion word on a door", FRONT, FRONT.replace("opening", "up"), 0, "signals.door.front.values[1]", "'up' is no door word; use closed"),
    ("a word with a typo", FRONT, FRONT.replace("opening", "openin"), 0, "signals.door.front.values[1]", "did you mean `opening`?"),
    ("unknown as a word", FRONT, FRONT.replace("opening", "unknown"), 0, "signals.door.front.values[1]", "use `unknown: [1]`"),
    ("a motion without words", MOTION, 'motion: {at: "holding:2"}', 0, "signals.motion", "needs `values`"),
    ("a door word without words", FRONT, 'door.front: {at: "holding:3"}', 0, "signals.door.front", "needs `values`"),
    ("a door that is always open", FRONT, FRONT.replace("closed", "open").replace("opening", "open").replace("closing", "open"), 0, "signals.door.front.values", "with open alone an open and a shut door read the same; give at least two words, one of them not `open`"),
    ("a door that is never open", FRONT, 'door.front: {at: "holding:3", values: {1: closed}}', 0, "signals.door.front.values", "with closed alone"),
    ("a door of no word", FRONT, 'door.front: {at: "holding:3", values: {}}', 0, "signals.door.front.values", "with no word alone"),
    ("a floor without as", FLOOR, 'car_floor: {at: "holding:1"}', 0, "signals.car_floor", "needs `as: floor`"),
    ("as: floor on a flag", LEVEL, LEVEL[:-1] + ", as: floor}", 0, "signals.level.as", "`as: floor` is for floors"),
    ("one bit per floor for a door", REAR, 'door.rear: {one_of: ["discrete:1", "discrete:2"]}', 0, "signals.door.rear.one_of", "this is a door"),
    ("limits for a flag", LEVEL, 'level: {open_limit: "discrete:4", closed_limit: "discrete:5"}', 0, "signals.level.open_limit", "limits are for doors"),
    ("words with limits", REAR, REAR[:-1] + ", values: {0: open}}", 0, "signals.door.rear.values", "belongs to a signal with `at`"),
    ("bits of a discrete", LEVEL, LEVEL[:-1] + ", bits: [0, 1]}", 0, "signals.level.bits", "a discrete is a single bit"),
    ("bits of a bit", FRONT, FRONT.replace("holding:3", "holding:3.1"), 0, "signals.door.front.bits", "names bit 1 already"),
    ("a signed bit field", FRONT, FRONT[:-1] + ", type: int16}", 0, "signals.door.front.type", "int16 needs a whole register, and this is 2 bits"),
    ("an inverted number", LOAD, LOAD[:-1] + ", active: low}", 0, "signals.load.active", "change the `values`"),
    ("a counter without its type", ALIVE, 'alive: {at: "holding:6", must_change_within_s: 3}', 0, "signals.alive.type", "a counter needs `type: counter`"),
    ("a counter that may stand still", ALIVE, 'alive: {at: "holding:6", type: counter}', 0, "signals.alive", "needs `must_change_within_s`"),
    ("a number that counts", LOAD, LOAD[:-1] + ", type: counter}", 0, "signals.load.type", "a number is not a counter"),
    ("a flag that must change", LEVEL, LEVEL[:-1] + ", must_change_within_s: 3}", 0, "signals.level.must_change_within_s", "belongs to a counter"),
    ("a code outside the bits", FRONT, FRONT.replace("3: closing", "4: closing"), 0, "signals.door.front.values[4]", "2 bits of uint16 hold 0 to 3"),
    ("a negative code without a sign", MOTION, MOTION.replace("3: down", "-1: down"), 0, "signals.motion.values[-1]", "needs `type: int16`"),
    ("a code as it would be without sign", FLOOR, FLOOR.replace("[0]", "[65535]"), 0, "signals.car_floor.unknown[0]", "as int16 it is -1"),
    ("a code with two meanings", MOTION, MOTION[:-1] + ", unknown: [9, 2]}", 0, "signals.motion.unknown[1]", "code 2 means up already"),
    ("a code both none and unknown", FLOOR, FLOOR[:-1] + ", none: [0]}", 0, "signals.car_floor.none[0]", "code 0 means unknown already"),
    ("an address below the base", LEVEL, 'level: {at: "discrete:0"}', 0, "signals.level.at", "with `base: 1` numbers start at 1"),
    ("an address beyond the wire", LEVEL, 'level: {at: "discrete:65537"}', 0, "signals.level.at", "65537 is 65536 on the wire, and the highest address there is 65535"),
    ("an address nobody serves", LEVEL, 'level: {at: "discrete:17"}', 0, "signals.level.at", "the map serves 1 to 16; correct the address"),
    ("a command nobody serves", 'at: "holding:30"', 'at: "holding:25"', 0, "commands.go_to.at", "serves 1 to 20, 30 to 40"),
    ("a lamp nobody serves", LAMPS, LAMPS.replace("coil:12", "coil:99"), 0, "signals.call_accepted.one_of[1]", "coil:99 is not served"),
    ("a table nobody serves", "  input: [[1, 9]]\n", "", 10, "signals.load.at", "the map serves nothing"),
    ("a range the wrong way round", "input: [[1, 9]]", "input: [[9, 1]]", 0, "served.input[0]", "the wrong way round"),
    ("ranges that overlap", "[[1, 20], [30, 40]]", "[[1, 20], [20, 40]]", 0, "served.holding[1]", "20 is served already"),
    ("ranges out of order", "[[1, 20], [30, 40]]", "[[30, 40], [1, 20]]", 0, "served.holding[1]", "in order"),
    ("a range below the base", "input: [[1, 9]]", "input: [[0, 9]]", 0, "served.input[0]", "0 is below the first address"),
    ("a range beyond the wire", "input: [[1, 9]]", "input: [[1, 99999]]", 0, "served.input[0]", "highest address there is 65535"),
    ("two signals at one bit", LEVEL, 'level: {at: "discrete:2"}', 0, "signals.level.at", "discrete:2 is in door.rear already"),
    ("a signal inside another's word", LEVEL, 'level: {at: "holding:2.7"}', 0, "signals.level.at", "holding:2.7 is in motion already"),
    ("bit fields that overlap", LEVEL, 'level: {at: "holding:3.5"}', 0, "signals.level.at", "in door.front already"),
    ("one lamp for two floors", LAMPS, LAMPS.replace("coil:12", "coil:11"), 0, "signals.call_accepted.one_of[1]", "twice in this one"),
    ("two commands at one coil", '    at: "coil:2"', '    at: "coil:1"', 0, "commands.close_door.front.at", "in hold_door.front already"),
    ("a command on inputs", 'at: "coil:2"', 'at: "discrete:9"', 0, "commands.close_door.front.at", "a discrete cannot be written"),
    ("a command in a bit", 'at: "holding:30"', 'at: "holding:30.2"', 0, "commands.go_to.at", "a bit cannot carry a floor number"),
    ("a floor number in a coil", 'at: "holding:30"', 'at: "coil:9"', 0, "commands.go_to.at", "a coil cannot carry a floor number"),
    ("a number in a coil", 'at: "coil:2"', 'at: "coil:2"\n    press: 5', 1, "commands.close_door.front.press", "a coil holds 0 to 1"),
    ("a negative rest without a sign", 'at: "holding:30"', 'at: "holding:30"\n    rest: -1', 1, "commands.go_to.rest", "uint16 holds 0 to 65535"),
    ("a call with a fixed value", 'at: "holding:30"', 'at: "holding:30"\n    press: 5', 1, "commands.go_to.press", "remove `press`"),
    ("a call without floors", "    as: floor\n", "", -2, "commands.go_to", "use `as: floor`"),
    ("a call said twice", 'at: "holding:30"', 'one_of: ["coil:8", "coil:9"]', 1, "commands.go_to.as", "remove `as`"),
    ("outputs that rest on", 'at: "holding:30"\n    as: floor', 'one_of: ["coil:8", "coil:9"]\n    rest: 1', 1, "commands.go_to.rest", "rest at 0"),
    ("a door with a floor", 'at: "coil:1"\n', 'at: "coil:1"\n    as: floor\n', 1, "commands.hold_door.front.as", "belongs to a call"),
    ("a door that arrives", 'at: "coil:1"\n', 'at: "coil:1"\n    until: arrived\n', 1, "commands.hold_door.front.until", "belongs to a call"),
    ("a door of several outputs", 'at: "coil:1"\n', 'one_of: ["coil:1", "coil:4"]\n', 0, "commands.hold_door.front.one_of", "belongs to a call"),
    ("a pulse that is held", "    width_s: 1\n", "    width_s: 1\n    max_hold_s: 3\n", 1, "commands.close_door.front.max_hold_s", "belongs to `action: hold`"),
    ("a hold with a width", "max_hold_s: 30\n", "max_hold_s: 30\n    width_s: 1\n", 1, "commands.hold_door.front.width_s", "belongs to `action: pulse`"),
    ("a refresh that comes too late", "refresh_s: 2", "refresh_s: 30", 0, "commands.hold_door.front.refresh_s", "30 s is not before max_hold_s, 30 s"),
    ("a hold nothing confirms", "    confirm: {any_of: [readback], within_s: 2}\n", "", -7, "commands.hold_door.front", "a hold needs `confirm`"),
    ("a condition that is not there", "[robot_mode_on]", "[robot_mode_no]", 0, "commands.go_to.requires[0]", "did you mean `robot_mode_on`?"),
    ("a condition that is no flag", "[robot_mode_on]", "[motion]", 0, "commands.go_to.requires[0]", "motion is no flag"),
    ("a grant by something else", "granted_by: robot_mode_on", "granted_by: ready", 0, "commands.robot_mode.granted_by", "robot_mode_on"),
    ("a condition that is trouble", "[robot_mode_on]", "[fire]", 0, "commands.go_to.requires[0]", "a yes of fire is trouble; remove it"),
    ("an exclusion of nothing", "[close_door.front]", "[close_door.rear]", 0, "commands.hold_door.front.excludes[0]", "did you mean `close_door.front`?"),
    ("an exclusion of itself", "[close_door.front]", "[hold_door.front]", 0, "commands.hold_door.front.excludes[0]", "cannot exclude itself"),
    ("a proof that is not there", "[call_accepted, effect]", "[destination]", 0, "commands.go_to.confirm.any_of[0]", "no signal destination"),
    ("a proof with a typo", "[call_accepted, effect]", "[efect]", 0, "commands.go_to.confirm.any_of[0]", "did you mean `effect`?"),
    ("a proof of the wrong kind", "[call_accepted, effect]", "[motion]", 0, "commands.go_to.confirm.any_of[0]", "only a flag or a floor confirms"),
    ("a floor as proof of a door", "[readback]", "[car_floor]", 0, "commands.hold_door.front.confirm.any_of[0]", "only a call has a floor to compare with"),
    ("a proof that is trouble", "[call_accepted, effect]", "[fire]", 0, "commands.go_to.confirm.any_of[0]", "a yes of fire is trouble and proves no press"),
    ("an effect nobody can see", f"  {FRONT}\n", "", 28, "commands.close_door.front.confirm.any_of[0]", "cannot be seen without door.front"),
    ("a block of too many coils", BLOCK, BLOCK.replace("3,", "1968,"), 0, "write_blocks[0]", "belong to no command"),
    ("a pulse of the device in a block of several", "    width_s: 1\n", "    width_s: 1\n    timed_by: device\n", 11, "write_blocks[0]", "close_door.front is a pulse that the device ends, and each write of hold_door.front, robot_mode would restart it; give it a write of its own"),
    ("a block with the wrong function", BLOCK, BLOCK.replace("15", "16"), 0, "write_blocks[0].function", "function 16 does not write a coil; use 15"),
    ("a block of too many registers", BLOCK, '{at: "holding:30", count: 124, function: 16}', 0, "write_blocks[0].count", "the limit is 123"),
    ("a block of inputs", BLOCK, '{at: "input:1", count: 1, function: 16}', 0, "write_blocks[0].at", "cannot start a block"),
    ("a block that starts in a bit", BLOCK, '{at: "holding:30.1", count: 1, function: 16}', 0, "write_blocks[0].at", "cannot start a block"),
    ("a block with a stranger in it", BLOCK, BLOCK.replace("3,", "5,"), 0, "write_blocks[0]", "coil 4, 5 in it belong to no command"),
    ("blocks that overlap", BLOCK, BLOCK + '\n  - {at: "coil:2", count: 1, function: 15}', 1, "write_blocks[1]", "overlaps write block 1"),
    ("a block below the base", BLOCK, BLOCK.replace("coil:1", "coil:0"), 0, "write_blocks[0].at", "0 is below the first address"),
    ("evidence without its signal", f"  {LEVEL}\n", "", 34, "at_floor_evidence", "the map has no signal level"),
    ("a visible fire that is not", "at_floor_evidence", "not_visible: {fire: because}\nat_floor_evidence", 0, "not_visible.fire", "has a fire signal; remove"),
    ("a fire nobody sees", f"  {FIRE}\n", "", -16, "not_visible", "give the reason"),
]  # fmt: skip


@each_row(("old", "new", "offset", "key", "words"), [c[1:] for c in REFUSED])
def test_a_mistake_is_named_with_its_line_its_key_and_the_way_to_mend_it(
    tmp_path: Path, old: str, new: str, offset: int, key: str, words: str
) -> None:
    text, line = changed(GOOD, old, new)
    found = findings_of(tmp_path, text)
    assert [f.line for f in found if f.key == key and words in f.message] == [line + offset], "\n".join(map(str, found))


def test_the_map_these_mistakes_are_made_in_has_none(tmp_path: Path) -> None:
    assert loaded(tmp_path, GOOD).warnings == ()


def test_every_problem_is_found_at_once_with_those_of_the_schema(tmp_path: Path) -> None:
    text = (
        GOOD.replace(LEVEL, 'level: {at: "discrete:3", activ: low}')
        .replace(MOTION, 'motion: {at: "holding 2"}')
        .replace(LOAD, 'load: {at: "input:77"}')
        .replace("refresh_s: 2", "refresh_s: 99")
    )
    keys = [finding.key for finding in findings_of(tmp_path, text)]
    assert keys == [
        "signals.motion.at",
        "signals.level.activ",
        "signals.level.at",
        "signals.load.at",
        "commands.hold_door.front.refresh_s",
    ]


def test_what_depends_on_a_broken_entry_is_not_reported(tmp_path: Path) -> None:
    text = GOOD.replace(FIRE, "fire: {at: discrete}").replace('at: "coil:1"\n', "at: coil\n").replace(LEVEL, "level: 5")
    keys = [finding.key for finding in findings_of(tmp_path, text)]
    assert keys == ["signals.fire.at", "signals.level", "commands.hold_door.front.at"]


def test_a_call_may_open_the_door_where_no_button_does(tmp_path: Path) -> None:
    monitor = GOOD[: GOOD.index("  hold_door.front")] + "at_floor_evidence: {kind: level}\n"
    assert [finding.key for finding in findings_of(tmp_path, monitor)] == ["at_same_floor"]
    assert loaded(tmp_path, monitor + "at_same_floor: call\n").warnings == ()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (f"  {FLOOR}\n", "", "no car_floor"),
        ("    confirm: {any_of: [effect], within_s: 5}\n", "", "nothing confirms this press"),
    ],
)
def test_what_may_be_right_is_a_warning(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert any(words in str(finding) for finding in loaded(tmp_path, changed(GOOD, old, new)[0]).warnings)


def test_a_map_without_doors_is_warned_about(tmp_path: Path) -> None:
    text = GOOD.replace(f"  {FRONT}\n  {REAR}\n", "").replace("[effect], within_s: 5", "[readback], within_s: 5")
    assert any("no door signal" in str(finding) for finding in loaded(tmp_path, text).warnings)


NO_GUARD = (
    GOOD.replace(", unknown: [0]", "")
    .replace(f"  {REAR}\n", "")
    .replace(f"  {ALIVE}\n", "")
    .replace(", active: low", "")
    .replace("{kind: level}", "{kind: motion_stopped}")
    .replace("1: normal", "0: normal")
)


def test_zeros_that_would_pass_for_a_healthy_lift_are_warned_about(tmp_path: Path) -> None:
    (warning,) = loaded(tmp_path, NO_GUARD).warnings
    assert "a controller that serves only zeros would pass for a healthy lift" in warning.message


@each_row(
    ("old", "new"),
    [
        ("as: floor}\n", "as: floor, unknown: [0]}\n"),
        (LEVEL, f"{LEVEL}\n  {ALIVE}"),
        (LEVEL, f"{LEVEL}\n  {REAR}"),
        ('fire: {at: "discrete:3"}', FIRE),
        (LEVEL, f'{LEVEL}\n  fault: {{at: "discrete:9", active: low}}'),
        ("0: normal", "9: normal"),
        ("{0: closed, 1: opening, 2: open, 3: closing}", "{0: closing, 1: closed, 2: open}"),
        ("{kind: motion_stopped}", "{kind: level}"),
    ],
)
def test_one_signal_that_is_safe_at_zero_is_enough(tmp_path: Path, old: str, new: str) -> None:
    assert NO_GUARD.count(old) == 1
    assert loaded(tmp_path, NO_GUARD.replace(old, new)).warnings == ()


def test_fire_may_be_a_word_of_the_mode(tmp_path: Path) -> None:
    text = GOOD.replace(f"  {FIRE}\n", "").replace("2: independent", "2: fire")
    assert loaded(tmp_path, text).warnings == ()


def test_a_reason_of_blanks_is_no_reason(tmp_path: Path) -> None:
    text = GOOD.replace(f"  {FIRE}\n", "") + 'not_visible: {fire: " "}\n'
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["not_visible"]


def test_a_problem_is_known_by_its_path_and_says_whether_it_only_warns(tmp_path: Path) -> None:
    problems = check(loaded(tmp_path, NO_GUARD).map)
    assert [(problem.path, problem.warning) for problem in problems] == [(("signals",), True)]
    assert isinstance(problems[0], Problem)


def test_what_has_to_be_kept_on_cannot_be_a_pulse(tmp_path: Path) -> None:
    text = GOOD.replace(
        "    action: hold\n    max_hold_s: 60\n    on_link_loss: latches\n    granted_by",
        "    action: pulse\n    width_s: 1\n    granted_by",
    )
    assert [(finding.key, "use `action: hold`" in finding.message) for finding in findings_of(tmp_path, text)] == [
        ("commands.robot_mode.action", True)
    ]


HEAD_KEYS = {
    "title": "title: A map without mistakes\n",
    "provenance": "provenance: {trust: template, sources: [this test]}\n",
    "addressing": "addressing: {base: 1}\n",
    "at_floor_evidence": "at_floor_evidence: {kind: level}\n",
}
SERVED = GOOD[GOOD.index("served:") : GOOD.index("signals:")]


@each_row("key", HEAD_KEYS)
def test_a_missing_key_of_the_head_hides_no_other_mistake(tmp_path: Path, key: str) -> None:
    text = GOOD.replace(HEAD_KEYS[key], "").replace(DOOR_WORDS, DOOR_WORDS.replace("2: open", "2: opne"))
    text = text.replace("confirm: {any_of: [effect], within_s: 5}", "confirm: {any_of: [levle], within_s: 5}")
    assert sorted(finding.key for finding in findings_of(tmp_path, text)) == sorted(
        [key, "signals.door.front.values[2]", "commands.close_door.front.confirm.any_of[0]"]
    )


DOOR_WORDS = "values: {0: closed, 1: opening, 2: open, 3: closing}"


def test_a_map_that_does_not_say_what_it_serves_is_checked_for_everything_else(tmp_path: Path) -> None:
    text = GOOD.replace(SERVED, "").replace('"discrete:4"', '"discrete:3"')
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["served", "signals.level.at"]


def test_a_wrong_word_in_the_head_hides_no_other_mistake(tmp_path: Path) -> None:
    text = GOOD.replace("trust: template", "trust: nobody").replace('"discrete:4"', '"discrete:3"')
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["provenance.trust", "signals.level.at"]


def test_nothing_is_said_of_addresses_whose_notation_is_missing(tmp_path: Path) -> None:
    text = GOOD.replace("addressing: {base: 1}\n", "").replace('"discrete:4"', '"X17"')
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["addressing"]


def test_a_map_of_another_schema_is_not_judged_by_this_one(tmp_path: Path) -> None:
    text = GOOD.replace("schema: 1", "schema: 2").replace('"discrete:4"', '"discrete:3"')
    assert [finding.key for finding in findings_of(tmp_path, text)] == ["schema"]
