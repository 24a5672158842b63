"""Addresses that say no place, or one that the device does not have; nothing else about them is then checked."""

from pathlib import Path

import pytest

from register_maps.check import check
from register_maps.check_places import find_unreadable
from register_maps.errors import Problem
from register_maps.schema import RegisterMap
from tests.support.good_map import HANDSHAKE, Mistake, changed, expect_only, findings_of, loaded
from tests.support.rows import each_row

ENTER = 'may_enter: {at: "discrete:10"}'
SENSOR = "sensor: {served: {discrete: [[0, 7]], holding: [[0, 3]]}}"
READ_AT = 'read_at: "input:10.0"'

PLACES: list[Mistake] = [
    ("text that is no address", ENTER, "may_enter: {at: discrete}", "signals.may_enter.at", "'discrete' is not an address: write table:number"),
    ("a number of another notation", ENTER, 'may_enter: {at: "10010"}', "signals.may_enter.at", "a table that prints its numbers like this has `notation: modicon`"),
    ("a bit of a discrete", ENTER, 'may_enter: {at: "discrete:10.1"}', "signals.may_enter.at", "a bit number (0 to 15) belongs to a holding or input register"),
    ("a device nobody declares", ENTER, 'may_enter: {at: "roof/discrete:1"}', "signals.may_enter.at", "the map has no endpoint roof; declare it: `endpoints: {roof: {served: ...}}`"),
    ("a device with a typo", ENTER, 'may_enter: {at: "senser/discrete:1"}', "signals.may_enter.at", "did you mean `sensor`?"),
    ("an address beyond the wire", ENTER, 'may_enter: {at: "discrete:0x10000"}', "signals.may_enter.at", "discrete:0x10000 is 65536 on the wire"),
    ("a read-back that is no address", READ_AT, 'read_at: "input"', "commands.hold_door.front.read_at", "'input' is not an address"),
    ("a block that starts nowhere", '{at: "holding:20"', '{at: "holding"', "write_blocks[0].at", "'holding' is not an address"),
    ("one of several addresses", '"discrete:1", "discrete:2"]}\n  door.front', '"discrete:1", "discrete"]}\n  door.front', "signals.car_floor.one_of[2]", "'discrete' is not an address"),
    ("what the second device does not serve", ENTER, 'may_enter: {at: "sensor/discrete:9"}', "signals.may_enter.at", "of discrete at sensor the map serves 0 to 7; correct the address, or add it to `endpoints: sensor: served: discrete`"),
    ("a table the second device does not serve", ENTER, 'may_enter: {at: "sensor/coil:1"}', "signals.may_enter.at", "of coil at sensor the map serves nothing"),
    ("a range of the second device the wrong way round", SENSOR, SENSOR.replace("[0, 3]", "[3, 0]"), "endpoints.sensor.served.holding[0]", "the wrong way round"),
]  # fmt: skip


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in PLACES],
)
def test_an_address_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, key: str, words: str) -> None:
    text, _ = changed(HANDSHAKE, old, new)
    found = findings_of(tmp_path, text)
    # a range the wrong way round serves nothing, and so its commands are found as well
    own = [finding for finding in found if not finding.key.startswith("commands.hold_door.rear")]
    assert [finding.key for finding in own] == [key], "\n".join(map(str, found))
    assert words in own[0].message


def test_leading_zeros_of_a_printed_number_mean_nothing(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, ENTER, 'may_enter: {at: "discrete:010"}')
    assert loaded(tmp_path, text).map.place("discrete:010").number == 10


MODICON = """\
schema: 1
name: good
title: Modicon numbers
provenance: {trust: template, sources: [this test]}
addressing: {notation: modicon}
served: {holding: [[40001, 40020]], discrete: [[10001, 10016]], input: [[300001, 365536]], coil: [[1, 16]]}
endpoints: {sensor: {served: {discrete: [[10001, 10008]]}}}
signals:
  car_floor: {at: "40013", as: floor, unknown: [0]}
  motion: {at: "365536", values: {1: stopped, 2: up, 3: down}}
  door.front: {at: "sensor/10001"}
  level: {at: "40014.3"}
  fire: {at: "10016", active: low}
commands:
  hold_door.front:
    {at: "00001", action: hold, max_hold_s: 30, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}}
at_floor_evidence: {kind: level}
"""

MODICON_PLACES: list[Mistake] = [
    ("a plain address", '"10016"', '"discrete:16"', "signals.fire.at", "is not a Modicon address: write five or six digits"),
    ("a number that does not exist", '"10016"', '"10000"', "signals.fire.at", "10000 is below the first address; Modicon numbers of a discrete start at 10001"),
    ("a number beyond the wire", '"365536"', '"365537"', "signals.motion.at", "365537 is 65536 on the wire"),
    ("a number that is not served", '"10016"', '"10017"', "signals.fire.at", "10017 is not served: of discrete the map serves 10001 to 10016"),
    ("a range below the first number", "[40001, 40020]", "[40000, 40020]", "served.holding[0]", "40000 is below the first address; Modicon numbers of a holding start at 40001"),
    ("a coil that is not served", '"00001"', '"00017"', "commands.hold_door.front.at", "of coil the map serves 1 to 16"),
]  # fmt: skip


@each_row(
    ("old", "new", "key", "words"),
    [pytest.param(*case[1:], id=case[0]) for case in MODICON_PLACES],
)
def test_modicon_numbers_are_checked_in_their_own_words(
    tmp_path: Path, old: str, new: str, key: str, words: str
) -> None:
    assert loaded(tmp_path, MODICON).warnings == ()
    expect_only(tmp_path, changed(MODICON, old, new)[0], key, words)


def test_strangers_of_a_block_are_told_by_their_wire_address_where_numbers_have_a_notation(tmp_path: Path) -> None:
    text = MODICON + 'write_blocks: [{at: "00001", count: 2, function: 15}]\n'
    expect_only(tmp_path, text, "write_blocks[0]", "coil 1 on the wire in it belong to no command")


def test_what_cannot_be_read_is_found_before_the_rest_is_checked(tmp_path: Path) -> None:
    model = loaded(tmp_path, HANDSHAKE).map
    assert find_unreadable(model) == []
    text = model.model_dump_json(by_alias=True, exclude_unset=True).replace('"sensor/discrete:0"', '"sensor/0"')
    spoiled = RegisterMap.model_validate_json(text)
    (problem,) = find_unreadable(spoiled)
    assert isinstance(problem, Problem)
    assert problem.path == ("signals", "door.rear", "at")
    rest = {name: signal for name, signal in spoiled.signals.items() if name != "door.rear"}
    # what is left is checked without it: nothing else shows that the rear door moves
    found = check(spoiled.model_copy(update={"signals": rest}))
    assert {problem.path[1] for problem in found} == {"hold_door.rear", "close_door.rear"}


def test_a_device_that_nothing_uses_is_a_warning(tmp_path: Path) -> None:
    text, _ = changed(HANDSHAKE, f"  {SENSOR}\n", f"  {SENSOR}\n  roof: {{served: {{coil: [[0, 1]]}}}}\n")
    (warning,) = loaded(tmp_path, text).warnings
    assert "nothing in the map is at roof; write roof/ before an address, or remove the endpoint" in warning.message
