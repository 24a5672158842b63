"""The JSON Schema that editors complete maps from: in step with the model, and in the words of draft 7."""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft7Validator
from pydantic import BaseModel

from register_maps.load import MAPS, json_schema, load, shipped
from register_maps.schema import COMMANDS, SIGNALS, Command, Signal
from tests.support.good_map import GOOD, HANDSHAKE
from tests.support.rows import each_row

FILE = MAPS.parent / "register_map.schema.json"


@cache
def schema() -> Any:
    """What is written; not made where these tests are only collected."""
    return json.loads(json_schema())


def keywords(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        for key, item in node.items():
            yield key
            yield from keywords(item)
    elif isinstance(node, list):
        for item in node:
            yield from keywords(item)


def errors_of(document: Any) -> list[str]:
    # YAML reads the codes of a value table as numbers; JSON has only text for keys
    return [error.message for error in Draft7Validator(schema()).iter_errors(json.loads(json.dumps(document)))]


def good() -> Any:
    return yaml.safe_load((MAPS / "two-stop-agv.yaml").read_text())


def test_the_file_is_what_the_model_says() -> None:
    assert FILE.read_text() == json_schema(), "write it anew with the command in register_maps/GRAMMAR.md"


def test_it_is_made_the_same_every_time() -> None:
    assert json_schema() == json_schema()


def test_it_is_a_draft_7_schema() -> None:
    Draft7Validator.check_schema(schema())
    assert schema()["$schema"] == "http://json-schema.org/draft-07/schema#"


def test_it_uses_no_word_that_came_after_draft_7() -> None:
    later = {
        "$defs",
        "prefixItems",
        "unevaluatedProperties",
        "unevaluatedItems",
        "dependentRequired",
        "minContains",
        "$anchor",
    }
    assert later.isdisjoint(keywords(schema()))
    assert "#/$defs/" not in json.dumps(schema())


@each_row("name", shipped())
def test_every_shipped_map_is_valid(name: str) -> None:
    assert errors_of(yaml.safe_load((MAPS / f"{name}.yaml").read_text())) == []


def test_an_editor_is_told_every_signal_and_command() -> None:
    properties = schema()["properties"]
    assert set(properties["signals"]["properties"]) == set(SIGNALS)
    assert set(properties["commands"]["properties"]) == set(COMMANDS)


@each_row(
    ("table", "key", "value"),
    [
        ("signals", "zzz", {"at": "coil:1"}),
        ("commands", "reset", {"at": "coil:1", "action": "pulse"}),
        ("signals", "fault", {"at": "coil:1", "activ": "low"}),
        ("signals", "fault", {"at": 1}),
        ("signals", "fault", {"at": "holding:1", "bits": [1]}),
        ("signals", "fault", {"at": "holding:1", "bits": [1, 2, 3]}),
        ("signals", "fault", {"one_of": ["coil:1"]}),
        ("signals", "load", {"at": "input:1", "type": "uint32", "word_order": "big"}),
        ("signals", "alive", {"at": "input:1", "must_change_within_s": "{Three}"}),
        ("signals", "alive", {"at": "input:1", "must_change_within_s": "three"}),
        ("commands", "go_to", {"at": "coil:1", "action": "puls"}),
        ("commands", "go_to", {"at": "holding:1.0", "action": "pulse", "shared_word": "mine"}),
        ("commands", "go_to", {"at": "coil:1", "action": "pulse", "width_s": 1, "payload": {"time": "width_s"}}),
        ("endpoints", "sensor", {"unit_id": 2}),
        ("endpoints", "sensor", {"unit_id": 256, "served": {}}),
        ("parameters", "first", {"default": 1}),
    ],
)
def test_an_editor_marks_what_is_not_allowed(table: str, key: str, value: Any) -> None:
    document = good()
    document.setdefault(table, {})[key] = value
    assert errors_of(document)


def test_fields_are_explained_where_the_model_explains_them() -> None:
    signal = schema()["definitions"]["Signal"]["properties"]
    assert signal["active"]["description"].startswith("Which level of a bit means yes")


@pytest.mark.parametrize(("part", "model"), [("Signal", Signal), ("Command", Command)])
def test_an_editor_is_told_every_key(part: str, model: type[BaseModel]) -> None:
    keys = {field.alias or name for name, field in model.model_fields.items()}
    assert set(schema()["definitions"][part]["properties"]) == keys


@pytest.mark.parametrize("text", [GOOD, HANDSHAKE], ids=["plain", "handshake"])
def test_every_way_to_say_something_is_valid(text: str) -> None:
    assert errors_of(yaml.safe_load(text)) == []


WITH_PARAMETERS = """\
schema: 1
name: template
title: A template of which a site says the rest
provenance: {trust: template, sources: [this test]}
parameters:
  base: {default: 0, range: [0, 1], help: whether numbers count from 1}
  first: {example: 4, range: [0, 2000], help: the first input}
  unit: {default: 1, range: [0, 255], help: the unit id}
  pause: {default: 0.5, range: [0.1, 5], help: how long a button is pressed}
  loss: {default: latches, choices: [latches, device_watchdog], help: what happens to the outputs without us}
  closed: {default: 0, help: the code of a closed door}
addressing: {base: "{base}"}
link: {unit_id: "{unit}", timeout_s: "{pause}", max_registers_per_read: "{first+1}"}
served: {discrete: [["{first}", "{first+5}"]], coil: [["{first}", "{first+5}"]], holding: [[0, "{first}"]]}
endpoints: {sensor: {unit_id: "{unit+1}", served: {holding: [["{first}", 20]]}}}
signals:
  door.front: {open_limit: "discrete:{first}", closed_limit: "discrete:{first+1}"}
  car_floor: {at: "sensor/holding:{first}", bits: ["{base}", 7], as: floor, unknown: ["{closed}"]}
  motion: {at: "holding:{first-1}", values: {1: stopped, 2: up, 3: down}}
  overload: {at: "holding:0", means_yes: "{first}"}
  fire: {at: "discrete:{first+2}", active: low}
commands:
  go_to:
    {at: "holding:{first}", as: floor, action: pulse, width_s: "{pause}", rest: "{closed}", confirm: {any_of: [effect], within_s: "{pause}"}}
  hold_door.front:
    {at: "coil:{first}", action: hold, max_hold_s: 30, refresh_s: 1, on_link_loss: "{loss}", confirm: {any_of: [readback], within_s: 2}}
write_blocks: [{at: "coil:{first}", count: "{base+1}", function: 15}]
at_floor_evidence: {kind: position_stable, for_s: "{pause}"}
door_opens_within_s: "{pause+9}"
"""


def test_a_parameter_may_stand_for_a_number_and_for_a_word_of_a_list(tmp_path: Path) -> None:
    assert errors_of(yaml.safe_load(WITH_PARAMETERS)) == []
    path = tmp_path / "template.yaml"
    path.write_text(WITH_PARAMETERS)
    assert load(path).unset == ("first",)


@pytest.mark.parametrize("key", ["schema", "name", "needs_occupancy"])
def test_a_parameter_does_not_stand_for_what_every_site_has_alike(key: str) -> None:
    document = yaml.safe_load(WITH_PARAMETERS)
    document[key] = "{first}"
    assert errors_of(document)
