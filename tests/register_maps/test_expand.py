"""Parameters are filled in, and a site's changes laid over a map, before anything is validated."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from register_maps.errors import Finding, MapFileError
from register_maps.expand import fill, find_unused, overlay
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.source import KeyPath
from tests.support.rows import each_row

MAP = """\
schema: 1
name: template
title: A template
provenance: {trust: template, sources: [this test]}
parameters:
  first: {default: 4, range: [0, 90], help: the first input}
  level: {default: high, choices: [high, low], help: what the sensors do}
  floor_at: {example: 7, help: the register of the floor}
addressing: {base: 0}
served: {discrete: [[0, 99]], holding: [[0, 99]], coil: [[0, 9]]}
signals:
  car_floor: {at: "holding:{floor_at}", as: floor, unknown: [0]}
  door.front: {open_limit: "discrete:{first}", closed_limit: "discrete:{first+1}", active: "{level}"}
  fire: {at: "discrete:{first+2}", active: low}
commands:
  hold_door.front:
    {at: "coil:0", read_at: "coil:5", action: hold, max_hold_s: 30, refresh_s: 2, on_link_loss: latches, confirm: {any_of: [readback], within_s: 2}}
needs: {level: it is not wired}
at_floor_evidence: {kind: position_stable, for_s: 1.0}
"""


def in_the_site(key: KeyPath, message: str) -> Finding:
    return Finding("site.yaml", 1, ".".join(map(str, key)), message)


def changed(folder: Path, text: str = MAP, **changes: Any) -> LoadedMap:
    path = folder / "template.yaml"
    path.write_text(text)
    return load(path, changes=MapChanges(changes.get("parameters", {}), changes.get("override", {}), in_the_site))


def findings(folder: Path, text: str = MAP, **changes: Any) -> list[str]:
    with pytest.raises(MapFileError) as caught:
        changed(folder, text, **changes)
    return [f"{finding.file.rpartition('/')[2]}: {finding.key}: {finding.message}" for finding in caught.value.findings]


def test_defaults_and_examples_stand_in_and_what_a_site_must_set_is_told(tmp_path: Path) -> None:
    loaded = changed(tmp_path)
    assert loaded.map.signals["door.front"].addresses == ("discrete:4", "discrete:5")
    assert loaded.map.signals["car_floor"].at == "holding:7"
    assert loaded.parameters == {"first": 4, "level": "high", "floor_at": 7}
    assert loaded.unset == ("floor_at",)


def test_a_site_sets_parameters(tmp_path: Path) -> None:
    loaded = changed(tmp_path, parameters={"first": 80, "level": "low", "floor_at": 2})
    assert loaded.map.signals["fire"].at == "discrete:82"
    assert loaded.map.signals["door.front"].active == "low"
    assert loaded.unset == ()
    assert loaded.sha256 != changed(tmp_path).sha256


@each_row(
    ("given", "words"),
    [
        ({"first": 91}, "parameters.first: must be 0 to 90, not 91 (the first input)"),
        ({"first": "x"}, "parameters.first: must be a number, not 'x'"),
        ({"level": "hihg"}, "parameters.level: must be one of high, low, not 'hihg'"),
        ({"first": math.nan}, "parameters.first: is not a number that can be used; give a plain one"),
        ({"first": -math.inf}, "parameters.first: is not a number that can be used; give a plain one"),
        ({"first": 10**400}, "parameters.first: is not a number that can be used; give a plain one"),
        ({"level": math.nan}, "parameters.level: must be one of high, low, not nan"),
        ({"frist": 4}, "parameters.frist: template has no parameter frist; did you mean `first`?"),
    ],
)
def test_a_value_that_does_not_fit_is_a_mistake_of_the_site(tmp_path: Path, given: dict[str, Any], words: str) -> None:
    told = findings(tmp_path, parameters=given)
    assert any(finding.startswith("site.yaml: ") and words in finding for finding in told), told


def test_a_parameter_that_is_used_and_not_declared_is_a_mistake_of_the_map(tmp_path: Path) -> None:
    assert findings(tmp_path, MAP.replace("{first+2}", "{frist+2}")) == [
        "template.yaml: signals.fire.at: the map has no parameter frist; did you mean `first`?",
        (
            "template.yaml: signals.fire.at: 'discrete:{frist+2}' is not an address: "
            "write table:number or table:number.bit, such as holding:12 or holding:12.4"
        ),
    ]


def test_a_parameter_nobody_uses_is_a_mistake_of_the_map_but_not_of_a_site_that_replaced_its_use(
    tmp_path: Path,
) -> None:
    (told,) = findings(tmp_path, MAP.replace('"holding:{floor_at}"', '"holding:3"'))
    assert told == "template.yaml: parameters.floor_at: nothing in the map uses {floor_at}; use it, or remove it"
    loaded = changed(tmp_path, override={"signals": {"car_floor": {"at": "holding:9"}}})
    assert loaded.map.signals["car_floor"].at == "holding:9"
    assert loaded.map.signals["car_floor"].unknown == (0,)
    assert loaded.unset == ()


def test_nothing_can_be_added_to_text() -> None:
    filled = fill({"parameters": {"level": {"default": "high"}}, "title": "{level+1}"})
    assert [problem.message for problem in filled.problems] == [
        "level is text, and nothing can be added to it; write {level}"
    ]


def test_a_text_that_is_nothing_but_a_parameter_takes_its_type() -> None:
    filled = fill({"parameters": {"a": {"default": 2.5}}, "x": "{a}", "z": ["{a+1}"]})
    assert (filled.data["x"], filled.data["z"]) == (2.5, [3.5])


def test_a_fraction_in_an_address_is_refused_because_it_would_name_a_bit(tmp_path: Path) -> None:
    told = findings(tmp_path, parameters={"floor_at": 1.5})
    assert "template.yaml: signals.car_floor.at: floor_at is 1.5, and only a whole number fits in here" in told
    assert changed(tmp_path, parameters={"floor_at": 3.0}).map.signals["car_floor"].at == "holding:3"


@each_row("value", [".nan", ".inf", "-.inf", str(1 << 60)])
def test_a_number_that_nothing_can_be_done_with_is_a_mistake_of_the_map(tmp_path: Path, value: str) -> None:
    told = findings(tmp_path, MAP.replace("default: 4, range: [0, 90]", f"default: {value}"))
    assert (
        "template.yaml: signals.door.front.open_limit: {first} is not a number that can be used; correct first" in told
    )
    assert "template.yaml: signals.fire.at: {first+2} is not a number that can be used; correct first" in told
    assert any(words.startswith("template.yaml: parameters.first: is not a number that can be used") for words in told)


@each_row(
    ("value", "text"),
    [
        *(
            (value, text)
            for value in (math.nan, math.inf, 1e300, 10**400)
            for text in ("{a}", "{a+1}", "holding:{a-1}")
        ),
        *((value, "{a+" + "9" * 5000 + "}") for value in (1, 0.5)),
    ],
)
def test_what_is_no_number_after_the_sum_is_told_where_it_stands(value: float, text: str) -> None:
    (problem,) = fill({"parameters": {"a": {"default": value}}, "x": [text]}).problems
    assert problem.path == ("x", 0)
    assert problem.message.endswith("is not a number that can be used; correct a")


@each_row("value", [[1], {"b": 1}, True, 2**53])
def test_what_can_be_used_or_is_no_number_at_all_is_left_to_the_schema(value: object) -> None:
    filled = fill({"parameters": {"a": {"default": value}}, "x": "{a}"})
    assert (filled.data["x"], filled.problems) == (value, ())


def test_a_timing_is_changed_and_the_rest_stays(tmp_path: Path) -> None:
    command = changed(tmp_path, override={"commands": {"hold_door.front": {"refresh_s": 1}}}).map.commands[
        "hold_door.front"
    ]
    assert (command.refresh_s, command.max_hold_s, command.at, command.read_at) == (1, 30, "coil:0", "coil:5")


def test_an_inverted_input_stays_inverted_when_it_is_wired_elsewhere(tmp_path: Path) -> None:
    fire = changed(tmp_path, override={"signals": {"fire": {"at": "discrete:50"}}}).map.signals["fire"]
    assert (fire.at, fire.active) == ("discrete:50", "low")


def test_a_signal_that_is_found_in_another_way_keeps_nothing_of_its_coding(tmp_path: Path) -> None:
    door = changed(tmp_path, override={"signals": {"door.front": {"at": "discrete:50"}}}).map.signals["door.front"]
    assert (door.addresses, door.active) == (("discrete:50",), "high")


def test_a_command_that_moves_keeps_its_times_and_can_lose_its_read_back_address(tmp_path: Path) -> None:
    where = {"at": "coil:3", "read_at": None}
    command = changed(tmp_path, override={"commands": {"hold_door.front": where}}).map.commands["hold_door.front"]
    assert (command.at, command.read_at, command.max_hold_s) == ("coil:3", None, 30)


def test_null_takes_an_entry_away_and_what_is_added_is_no_longer_missing(tmp_path: Path) -> None:
    override = {"signals": {"level": {"at": "discrete:60"}}, "commands": {"hold_door.front": None}}
    loaded = changed(tmp_path, override=override)
    assert loaded.map.commands == {}
    assert loaded.map.needs == {}
    assert loaded.map.signals["level"].at == "discrete:60"


def test_a_fire_contact_that_a_site_adds_is_visible() -> None:
    data = {"signals": {}, "not_visible": {"fire": "it is not wired"}}
    assert overlay(data, {"signals": {"fire": {"at": "discrete:1"}}})["not_visible"] == {}


def test_what_a_site_may_not_change_is_refused_by_name(tmp_path: Path) -> None:
    (told,) = findings(tmp_path, override={"provenance": {"trust": "vendor-manual"}})
    assert told.startswith(
        "site.yaml: override.provenance: a site cannot change 'provenance' of a map; it may change signals"
    )


def test_a_mistake_in_a_change_is_found_where_the_change_stands(tmp_path: Path) -> None:
    told = findings(tmp_path, override={"signals": {"fire": {"at": "discrete:900"}}})
    assert [finding.partition(": d")[0] for finding in told] == ["site.yaml: override.signals.fire.at"]
    told = findings(
        tmp_path, MAP.replace('"coil:0"', '"coil:99"'), override={"signals": {"fire": {"at": "discrete:9"}}}
    )
    assert all(finding.startswith("template.yaml: commands.hold_door.front.at: ") for finding in told)


def test_a_second_device_may_count_in_its_own_way(tmp_path: Path) -> None:
    text = (
        MAP.replace("base: 0", "base: 1")
        .replace(
            "discrete: [[0, 99]], holding: [[0, 99]], coil: [[0, 9]]",
            "discrete: [[1, 99]], holding: [[1, 99]], coil: [[1, 9]]",
        )
        .replace('"coil:0"', '"coil:1"')
    )
    override = {
        "endpoints": {"sensor": {"addressing": {"base": 0}, "served": {"discrete": [[0, 3]]}}},
        "signals": {"level": {"at": "sensor/discrete:0"}},
    }
    loaded = changed(tmp_path, text, override=override)
    assert loaded.map.place("sensor/discrete:0").number == 0
    assert loaded.map.served_wire["sensor/discrete"] == (range(4),)
    assert loaded.map.place("discrete:1").number == 0


def test_data_that_is_no_map_goes_through_unchanged() -> None:
    others: tuple[Any, ...] = (None, [], "text", 3)
    for data in others:
        assert overlay(data, {"signals": {}}) == data
        assert fill(data).data == data
        assert find_unused(data) == []


def test_changes_are_named_for_whoever_looks_at_the_site() -> None:
    changes = MapChanges(override=yaml.safe_load("{signals: {fire: {at: x}, level: null}, at_same_floor: call}"))
    assert changes.keys == ("signals.fire", "signals.level", "at_same_floor")
