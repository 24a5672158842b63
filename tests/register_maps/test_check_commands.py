"""What `check` refuses in the commands of a map: without an end, without a proof, or at odds with each other."""

from pathlib import Path

import pytest

from tests.support.good_map import GOOD, HANDSHAKE, Mistake, changed, expect_only, findings_of, loaded
from tests.support.rows import each_row

FLOOR = 'car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"]}'
CALL = 'one_of: ["coil:0", "coil:1", "coil:2"]\n    action: hold\n'
GO = 'at: "holding:20"\n    as: floor\n    action: hold\n    until: robot_left\n'
IN_PLACE = 'robot_in_place: {at: "coil:8", action: pulse, width_s: 5, confirm: {any_of: [readback], within_s: 3}}'
LEFT = 'robot_left: {at: "coil:9", action: pulse, width_s: 5, reset_first_s: 0.2, confirm: {any_of: [readback], within_s: 3}}'
BEAT = 'heartbeat: {at: "holding:21", action: count, every_s: 0.5}'
READ_AT = 'read_at: "input:10.0"'
TIMED = "    width_s: 0.5\n    timed_by: device\n    payload: {time: width_s, unit_s: 0.1}\n"
SECONDS = "payload: {time: max_hold_s, unit_s: 1}"
REAR = "    until: closed\n    max_hold_s: 10\n    repeat_pulse_s: 2\n    width_s: 0.5\n"
FREE = HANDSHAKE.replace('write_blocks:\n  - {at: "holding:20", count: 4, function: 16, every_s: 0.5, gaps: 0}\n', "")
"""Without the block, so that a command can be moved."""

MISTAKES: list[Mistake] = [
    # its points
    ("an output pressed with a value of its own", CALL, CALL + "    press: 2\n", "commands.call.press", "are pressed with 1; remove `press`"),
    ("a floor number in a bit", GO, GO.replace("holding:20", "coil:21"), "commands.go.at", "a coil cannot carry a floor number"),
    ("two commands at one coil", '"coil:9"', '"coil:8"', "commands.robot_left.at", "in robot_in_place already; give each command a place of its own"),
    ("a bit of a register that is written whole", '"holding:30.1"', '"holding:20.1"', "commands.close_door.rear.at", "a register is written either whole or bit by bit"),
    ("a signed bit", READ_AT, READ_AT + "\n    type: int16", "commands.hold_door.front.type", "int16 needs a whole register, and this is 1 bit"),
    ("a number in a bit", READ_AT, READ_AT + "\n    press: 2", "commands.hold_door.front.press", "a bit holds 0 to 1"),
    ("a bit read back as a register", READ_AT, 'read_at: "input:10"', "commands.hold_door.front.read_at", "holding:30.0 is a single bit, and input:10 is not"),
    ("a register read back as a bit", GO, GO + '    read_at: "coil:50"\n', "commands.go.read_at", "read it back from a whole register"),
    ("one output read back as several", GO, GO + '    read_one_of: ["holding:5", "holding:6"]\n', "commands.go.read_one_of", "use `read_at`"),
    ("several outputs read back as one", CALL, CALL + '    read_at: "coil:50"\n', "commands.call.read_at", "use `read_one_of`"),
    ("outputs read back at too few places", CALL, CALL + '    read_one_of: ["coil:50", "coil:51"]\n', "commands.call.read_one_of", "has 2 entries for 3 outputs"),
    ("outputs read back in two ways", READ_AT, READ_AT + '\n    read_one_of: ["input:10.1", "input:10.2"]', "commands.hold_door.front.read_at", "remove one of the two"),
    ("an output read back where another is", READ_AT, 'read_at: "coil:8"', "commands.hold_door.front.read_at", "coil:8 is where robot_in_place is read back"),
    ("a read-back nobody serves", READ_AT, 'read_at: "input:30.0"', "commands.hold_door.front.read_at", "input:30.0 is not served"),
    ("a read-back of what ends by itself", TIMED, TIMED + '    read_at: "coil:50"\n', "commands.close_door.front.read_at", "the device ends this pulse by itself"),
    ("a read-back of a heartbeat", BEAT, BEAT[:-1] + ', read_at: "holding:5"}', "commands.heartbeat.read_at", "a heartbeat changes all the time"),
    ("fewer codes than outputs", CALL, CALL + "    codes: [0, 1]\n", "commands.call.codes", "has 2 entries for 3 outputs"),
    ("codes of a number", GO, GO + "    codes: [0, 1, 2]\n", "commands.go.codes", "a number is the floor code itself"),
    ("codes of no call", IN_PLACE, IN_PLACE[:-1] + ", codes: [0, 1]}", "commands.robot_in_place.codes", "robot_in_place has no floor"),
    ("BCD in bits", CALL, CALL + "    code: bcd\n", "commands.call.code", "`one_of` has one bit per floor"),
    ("BCD with a sign", GO, GO + "    code: bcd\n    type: int16\n", "commands.go.code", "BCD has no sign"),
    ("bytes of a coil", IN_PLACE, IN_PLACE[:-1] + ", byte_order: low_first}", "commands.robot_in_place.byte_order", "is for a whole register"),
    # its action
    ("a heartbeat that is a pulse", BEAT, 'heartbeat: {at: "holding:21", action: pulse, width_s: 1, confirm: {any_of: [may_enter], within_s: 1}}', "commands.heartbeat.action", "use `action: count` or `action: toggle`"),
    ("a word to the lift that counts", IN_PLACE, 'robot_in_place: {at: "coil:8", action: toggle, confirm: {any_of: [overload], within_s: 3}}', "commands.robot_in_place.action", "is for the heartbeat"),
    ("a heartbeat without its pace", BEAT, 'heartbeat: {at: "holding:21", action: count}', "commands.heartbeat", "needs `every_s`"),
    ("a heartbeat faster than the link", BEAT, BEAT.replace("0.5", "0.01"), "commands.heartbeat.every_s", "the link leaves 0.05 s between requests"),
    ("a count in a coil", BEAT, 'heartbeat: {at: "coil:30", action: count, every_s: 0.5}', "commands.heartbeat.action", "use `action: toggle`"),
    ("a heartbeat that is held", BEAT, BEAT[:-1] + ", max_hold_s: 3}", "commands.heartbeat.max_hold_s", "written all the time and never pressed"),
    ("a heartbeat that waits for permission", BEAT, BEAT[:-1] + ", requires: [may_enter]}", "commands.heartbeat.requires", "never pressed; remove it"),
    ("a heartbeat with an edge", BEAT, BEAT[:-1] + ", reset_first_s: 1}", "commands.heartbeat.reset_first_s", "never pressed"),
    ("a heartbeat that is confirmed", BEAT, BEAT[:-1] + ", confirm: {any_of: [overload], within_s: 1}}", "commands.heartbeat.confirm", "never pressed"),
    ("a heartbeat with a value", BEAT, BEAT[:-1] + ", press: 4}", "commands.heartbeat.press", "never pressed"),
    ("a heartbeat with an end", BEAT, BEAT[:-1] + ", until: arrived}", "commands.heartbeat.until", "heartbeat goes nowhere"),
    ("a pace of something else", IN_PLACE, IN_PLACE[:-1] + ", every_s: 1}", "commands.robot_in_place.every_s", "belongs to the heartbeat"),
    ("a hold that the device times", GO, GO + "    timed_by: device\n", "commands.go.timed_by", "use `on_link_loss: timed_by_device`"),
    ("a pulse with a limit", IN_PLACE, IN_PLACE[:-1] + ", max_hold_s: 9}", "commands.robot_in_place.max_hold_s", "belongs to `action: hold`"),
    # its end
    ("a word to the lift that arrives", IN_PLACE, 'robot_in_place: {at: "coil:8", action: hold, until: arrived, max_hold_s: 9, on_link_loss: latches, confirm: {any_of: [readback], within_s: 3}}', "commands.robot_in_place.until", "belongs to a call"),
    ("a call that ends when a door is closed", GO, GO.replace("robot_left", "closed"), "commands.go.until", "`closed` ends close_door"),
    ("a door that closes until the robot is gone", REAR, REAR.replace("closed", "robot_left"), "commands.close_door.rear.until", "`robot_left` ends call or go"),
    # its times
    ("a pulse repeated before it ends", REAR, REAR.replace("0.5", "2"), "commands.close_door.rear.repeat_pulse_s", "each pulse lasts 2 s and has to end before the next"),
    ("a pulse repeated too late", REAR, REAR.replace("repeat_pulse_s: 2", "repeat_pulse_s: 10"), "commands.close_door.rear.repeat_pulse_s", "10 s is not before max_hold_s, 10 s; repeat sooner"),
    ("a pulse that the controller takes", IN_PLACE, IN_PLACE.replace("width_s: 5", "width_s: 5, self_clearing: true"), "commands.robot_in_place.self_clearing", "belongs to a hold that is one level and no call"),
    ("a hold that is taken and never written again", IN_PLACE, IN_PLACE.replace("pulse, width_s: 5", "hold, self_clearing: true, max_hold_s: 9, on_link_loss: latches").replace("readback", "may_leave"), "commands.robot_in_place.self_clearing", "has to be written again: use `refresh_s`"),
    ("a point that is cleared as its own proof", IN_PLACE, IN_PLACE.replace("pulse, width_s: 5", "hold, self_clearing: true, refresh_s: 1, max_hold_s: 9, on_link_loss: latches"), "commands.robot_in_place.self_clearing", "a point that the controller clears confirms nothing"),
    ("a word to the lift that the controller ends", IN_PLACE, IN_PLACE[:-1].replace("pulse, width_s: 5", "hold, max_hold_s: 9, on_link_loss: latches") + ", released_after_s: 60}", "commands.robot_in_place.released_after_s", "belongs to a door hold; remove it"),
    ("a hold that ends before it is written again", READ_AT, READ_AT + "\n    released_after_s: 2", "commands.hold_door.front.released_after_s", "2 s is over before the hold is written again (refresh_s: 2)"),
    ("a hold that is taken before it is written again", IN_PLACE, IN_PLACE.replace("pulse, width_s: 5", "hold, cleared_after_s: 1, refresh_s: 1, max_hold_s: 9, on_link_loss: latches"), "commands.robot_in_place.cleared_after_s", "use `self_clearing: true` instead"),
    ("a hold written and pressed again", REAR, REAR + "    refresh_s: 1\n", "commands.close_door.rear.refresh_s", "remove one of the two"),
    ("a gap after nothing", READ_AT, READ_AT + "\n    gap_s: 1", "commands.hold_door.front.gap_s", "use `excludes`"),
    ("a grant in time and by nobody", READ_AT, READ_AT + "\n    granted_within_s: 9", "commands.hold_door.front.granted_within_s", "belongs to `granted_by`"),
    ("a door that arrives in time", READ_AT, READ_AT + "\n    arrive_within_s: 9", "commands.hold_door.front.arrive_within_s", "hold_door.front goes nowhere"),
    # a time as its value
    ("a time that is not given", SECONDS, SECONDS.replace("max_hold_s", "width_s"), "commands.hold_door.rear.payload.time", "use `time: max_hold_s`"),
    ("a time in a call", GO, GO + "    payload: {time: max_hold_s, unit_s: 1}\n", "commands.go.payload", "a call writes its floor, and cannot carry a time"),
    ("a time in one output per floor", CALL, CALL + "    payload: {time: max_hold_s, unit_s: 1}\n", "commands.call.payload", "one output per floor carries a time only if the device ends it"),
    ("a time and a value", SECONDS, SECONDS + "\n    press: 3", "commands.hold_door.rear.press", "the value written is the time"),
    ("a time in a bit", READ_AT, READ_AT + "\n    payload: {time: max_hold_s, unit_s: 1}", "commands.hold_door.front.payload", "a bit cannot carry a time"),
    ("a time in a coil that we time", TIMED, TIMED.replace("    timed_by: device\n", ""), "commands.close_door.front.payload", "use `action: pulse` and `timed_by: device`"),
    ("half a count", SECONDS, SECONDS.replace("unit_s: 1", "unit_s: 2"), "commands.hold_door.rear.max_hold_s", "5 s is 2.5 counts of 2 s; give a whole number"),
    ("no count at all", TIMED, TIMED.replace("unit_s: 0.1", "unit_s: 3600").replace("width_s: 0.5", "width_s: 0.0000001"), "commands.close_door.front.width_s", "1 to 32767 can be written"),
    ("more counts than a coil takes", TIMED, TIMED.replace("unit_s: 0.1", "unit_s: 0.00001"), "commands.close_door.front.width_s", "50000 counts of 1e-05 s, and 1 to 32767 can be written"),
    ("more counts than a register takes", SECONDS, SECONDS.replace("unit_s: 1", "unit_s: 0.00005"), "commands.hold_door.rear.max_hold_s", "1 to 65535 can be written"),
    # what it names
    ("an exclusion of the heartbeat", "[hold_door.rear]", "[heartbeat]", "commands.close_door.rear.excludes[0]", "heartbeat is never released"),
    # what proves it
    ("a read-back of a lamp", "[calls_registered]", "[readback]", "commands.call.confirm.any_of[0]", "is the lamp calls_registered, lit or not whatever we wrote; name calls_registered"),
    ("a read-back of what ends by itself", TIMED + "    confirm: {any_of: [effect]", TIMED + "    confirm: {any_of: [readback]", "commands.close_door.front.confirm.any_of[0]", "the device ends this pulse by itself"),
    ("a read-back between pulses", "{any_of: [effect], within_s: 10}", "{any_of: [readback], within_s: 10}", "commands.close_door.rear.confirm.any_of[0]", "between its pulses it reads as released"),
    ("registered calls as proof of a door", "shared_word: mask_write\n    confirm: {any_of: [readback]", "shared_word: mask_write\n    confirm: {any_of: [calls_registered]", "commands.hold_door.front.confirm.any_of[0]", "calls_registered is a set of floors, and only a call has a floor"),
    ("a number as proof", "shared_word: mask_write\n    confirm: {any_of: [readback]", "shared_word: mask_write\n    confirm: {any_of: [load]", "commands.hold_door.front.confirm.any_of[0]", "only a flag or a floor confirms"),
]  # fmt: skip


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in MISTAKES],
)
def test_a_command_that_cannot_work_is_refused(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    expect_only(tmp_path, changed(FREE, old, new)[0], key, words)


SIDES = """\
  go_to.front: {at: "holding:31", as: floor, action: pulse, width_s: 1, confirm: {any_of: [effect], within_s: 9}}
  go_to.rear: {at: "holding:32", as: floor, action: pulse, width_s: 1, confirm: {any_of: [effect], within_s: 9}}
"""
CALL_TEXT = FREE[FREE.index("  call:") : FREE.index("  go:")]
GO_TEXT = FREE[FREE.index("  go:") : FREE.index("  robot_in_place:")]
LEVEL_IN_PLACE = """\
  robot_in_place:
    at: "coil:8"
    action: hold
    max_hold_s: 300
    on_link_loss: latches
    confirm: {any_of: [readback], within_s: 3}
"""

TOGETHER: list[tuple[str, dict[str, str], list[str], str]] = [
    # name, changes, keys of all findings, words of the first
    ("go without call", {CALL_TEXT: ""}, ["commands.go", "needs_occupancy"], "no command calls the car to it; declare `call`"),
    ("call without go", {GO_TEXT: ""}, ["commands.call", "needs_occupancy"], "no command sends the occupied one on; declare `go`"),
    ("a call for every robot beside call and go", {"  heartbeat:": f"{SIDES}  heartbeat:"}, ["commands.call", "commands.go"], "keep call and go, or go_to.front"),
    ("an end that is not declared", {f"  {LEFT}\n": ""}, ["commands.go.until", "needs_occupancy"], "the map has no command robot_left"),
    ("a word to the lift that has no effect of its own", {IN_PLACE: IN_PLACE.replace("[readback]", "[effect]")}, ["commands.robot_in_place.confirm.any_of[0]"], "lifts differ in what follows robot_in_place; use `readback`"),
    ("a door that nobody sees closed", {'  door.rear: {at: "sensor/discrete:0", active: low}\n': "", "[effect, readback]": "[readback]", "[effect], within_s: 10": "[may_enter], within_s: 10"}, ["commands.close_door.rear.until"], "a closed door is not visible without door.rear"),
    ("a proof that is a condition", {IN_PLACE: IN_PLACE[:-1].replace("[readback]", "[may_enter]") + ", requires: [may_enter]}"}, ["commands.robot_in_place.confirm.any_of[0]"], "may_enter has to read yes before the press, so it proves nothing"),
    ("a car that nobody sees arrive", {GO: GO.replace("robot_left", "arrived"), f"  {FLOOR}\n": "", "door_limit": "motion_stopped"}, ["commands.go.until"], "the arrival of the car is not visible without car_floor; declare it"),
    ("a call to a floor that is never shown", {CALL: CALL.replace('"coil:2"', '"coil:2", "coil:3"')}, ["commands.call.one_of", "commands.call.confirm.any_of[0]"], "has 4 outputs, one per floor, and car_floor only reports codes 0 to 2"),
    ("a lamp of a floor that is never shown", {'"coil:2"]}': '"coil:2", "coil:50"]}'}, ["signals.calls_registered.each_of"], "has 4 bits, one per floor, and car_floor only reports codes 0 to 2"),
    ("too few lamps to confirm every call", {', "coil:2"]}': "]}"}, ["commands.call.confirm.any_of[0]"], "has 2 bits for 3 outputs, and cannot confirm the last"),
    ("too few limits for the floors", {'"discrete:1", "discrete:2"]}\n  door.rear': '"discrete:1"]}\n  door.rear', "door_limit": "motion_stopped"}, ["signals.door.front.open_limits"], "has 2 limits, and car_floor shows 3 floors"),
    ("a floor beyond the position code", {'car_floor: {one_of: ["discrete:0", "discrete:1", "discrete:2"]}': 'car_floor: {at: "discrete:40", as: floor}', "door_limit": "motion_stopped"}, ["signals.door.front.open_limits", "signals.calls_registered.each_of", "commands.call.one_of"], "car_floor only reports codes 0 to 1"),
]  # fmt: skip


@each_row(
    ("changes", "keys", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in TOGETHER],
)
def test_commands_that_do_not_fit_together_are_refused(
    tmp_path: Path, changes: dict[str, str], keys: list[str], words: str
) -> None:
    text = FREE
    for old, new in changes.items():
        text, _ = changed(text, old, new)
    found = findings_of(tmp_path, text)
    assert [finding.key for finding in found] == keys, "\n".join(map(str, found))
    assert words in found[0].message


def test_a_call_names_the_door_or_does_not(tmp_path: Path) -> None:
    text, _ = changed(GOOD, "commands:\n", f"commands:\n{SIDES}")
    assert [(finding.key, "remove one of the two" in finding.message) for finding in findings_of(tmp_path, text)] == [
        ("commands.go_to.front", True),
        ("commands.go_to.rear", True),
    ]
    alone = text.replace(text[text.index("  go_to:") : text.index("  hold_door")], "")
    assert loaded(tmp_path, alone).warnings == ()


def test_a_robot_in_place_that_is_a_level_stands_for_go_and_for_robot_left(tmp_path: Path) -> None:
    text = FREE.replace(GO_TEXT, "").replace(f"  {LEFT}\n", "").replace(f"  {IN_PLACE}\n", LEVEL_IN_PLACE)
    assert loaded(tmp_path, text).warnings == ()


def test_what_the_site_has_to_add_counts_as_declared(tmp_path: Path) -> None:
    text, _ = changed(FREE, '  door.rear: {at: "sensor/discrete:0", active: low}\n', "")
    assert loaded(tmp_path, text + "needs: {door.rear: a second device says it}\n").warnings == ()
    text, _ = changed(FREE.replace("door_limit", "motion_stopped"), f"  {FLOOR}\n", "")
    text, _ = changed(text, GO, GO.replace("robot_left", "arrived"))
    assert loaded(tmp_path, text + "needs: {car_floor: a second device says it}\n").warnings == ()


SAME_HOLD = "action: hold, until: arrived, max_hold_s: 60, refresh_s: 2, on_link_loss: latches,"


@each_row(
    ("front", "rear", "key", "words"),
    [
        ("action: pulse, width_s: 1,", SAME_HOLD, "action", "go_to.front has `action: pulse`"),
        (SAME_HOLD.replace("until: arrived, ", ""), SAME_HOLD, "until", "go_to.front has no `until`"),
        (SAME_HOLD, SAME_HOLD.replace("until: arrived, ", ""), "until", "go_to.front has `until: arrived`"),
    ],
)
def test_the_calls_of_both_doors_are_given_and_ended_alike(
    tmp_path: Path, front: str, rear: str, key: str, words: str
) -> None:
    go_to = GOOD[GOOD.index("  go_to:") : GOOD.index("  hold_door")]
    one, other = SIDES.splitlines(keepends=True)
    pulse = "action: pulse, width_s: 1,"
    text, _ = changed(GOOD, go_to, one.replace(pulse, front) + other.replace(pulse, rear))
    expect_only(tmp_path, text, f"commands.go_to.rear.{key}", f"{words}, and all calls of one lift have the same")
    alike, _ = changed(GOOD, go_to, one.replace(pulse, front) + other.replace(pulse, front))
    assert loaded(tmp_path, alike).warnings == ()


TROUBLE = [
    *("fire", "fireman", "emergency_power", "passenger_alarm", "inspection", "out_of_service", "fault", "attendant"),
    *("overload", "nudging", "watchdog_tripped", "obstruction.front", "obstruction.rear"),
]


@each_row("flag", TROUBLE)
def test_no_press_waits_for_trouble_or_is_proved_by_it(tmp_path: Path, flag: str) -> None:
    text = (
        FREE
        if f"  {flag}:" in FREE
        else changed(FREE, "signals:\n", f'signals:\n  {flag}: {{at: "holding:13.0"}}\n')[0]
    )
    waits, _ = changed(text, IN_PLACE, f"{IN_PLACE[:-1]}, requires: [{flag}]}}")
    words = f"cannot be inverted, and a yes of {flag} is trouble; remove it"
    expect_only(tmp_path, waits, "commands.robot_in_place.requires[0]", words)
    proved, _ = changed(text, IN_PLACE, IN_PLACE.replace("readback", flag))
    words = f"a yes of {flag} is trouble and proves no press"
    expect_only(tmp_path, proved, "commands.robot_in_place.confirm.any_of[0]", words)


def test_the_independent_key_may_be_what_a_lift_gives_to_robots(tmp_path: Path) -> None:
    text, _ = changed(FREE, "signals:\n", 'signals:\n  independent: {at: "holding:13.0"}\n')
    text, _ = changed(text, IN_PLACE, f"{IN_PLACE[:-1]}, requires: [independent]}}")
    assert loaded(tmp_path, text).warnings == ()


def test_an_output_that_no_floor_can_use_is_a_warning(tmp_path: Path) -> None:
    text, _ = changed(GOOD, '    at: "holding:30"\n    as: floor\n', '    one_of: ["coil:8", "coil:9"]\n')
    (warning,) = loaded(tmp_path, text).warnings
    assert warning.key == "commands.go_to.one_of"
    assert (
        "coil:8 calls the floor with code 0, and car_floor never reports 0; give the codes of the outputs, such as `codes: [1, 2, 3]`"
        in warning.message
    )


def test_outputs_whose_codes_are_given_may_leave_out_what_the_floor_never_says(tmp_path: Path) -> None:
    text, _ = changed(
        GOOD, '    at: "holding:30"\n    as: floor\n', '    one_of: ["coil:8", "coil:9"]\n    codes: [1, 2]\n'
    )
    assert loaded(tmp_path, text).warnings == ()


def test_a_given_code_that_the_floor_never_says_is_refused(tmp_path: Path) -> None:
    text, _ = changed(
        GOOD, '    at: "holding:30"\n    as: floor\n', '    one_of: ["coil:8", "coil:9"]\n    codes: [0, 1]\n'
    )
    expect_only(
        tmp_path,
        text,
        "commands.go_to.codes",
        "coil:8 calls the floor with code 0, and car_floor never reports 0; correct it",
    )


def test_a_given_code_that_no_floor_switch_has_is_refused(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, CALL, CALL + "    codes: [0, 1, 3]\n")
    text, _ = changed(text, '{each_of: ["coil:0", "coil:1", "coil:2"]}', '{each_of: ["coil:50", "coil:51", "coil:52"]}')
    expect_only(tmp_path, text, "commands.call.codes", "car_floor only reports codes 0 to 2; a floor is never shown: 3")


def test_a_timed_pulse_without_a_proof_is_not_said_to_be_read_back(tmp_path: Path) -> None:
    text, _ = changed(FREE, TIMED + "    confirm: {any_of: [effect], within_s: 5}\n", TIMED)
    (warning,) = loaded(tmp_path, text).warnings
    assert warning.message.endswith("or it counts as unconfirmed")


@each_row(
    ("old", "new"),
    [
        (BEAT, 'heartbeat: {at: "coil:30", action: toggle, every_s: 0.5}'),
        (BEAT, 'heartbeat: {at: "holding:30.7", action: toggle, every_s: 0.5, shared_word: mask_write}'),
        (BEAT, 'heartbeat: {at: "holding:22", action: count, every_s: 0.5, rest: 0}'),
        (READ_AT, 'read_at: "sensor/discrete:7"'),
        (CALL, CALL + '    read_one_of: ["coil:32", "holding:5.0", "discrete:50"]\n'),
        (SECONDS, "payload: {time: max_hold_s, unit_s: 0.1}"),
        (GO, GO + "    requires: [may_leave]\n    excludes: [robot_left]\n    min_repeat_s: 5\n"),
        (TIMED, "    width_s: 0.5\n    timed_by: device\n"),
        (
            CALL + "    until: robot_in_place\n    max_hold_s: 300\n    on_link_loss: latches\n",
            CALL.replace("hold", "pulse") + TIMED,
        ),
    ],
)
def test_what_works_is_accepted(tmp_path: Path, old: str, new: str) -> None:
    assert loaded(tmp_path, changed(FREE, old, new)[0]).warnings == ()
