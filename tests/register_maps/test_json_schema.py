"""The JSON Schema that editors complete maps from: in step with the model, and in the words of draft 7."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from jsonschema import Draft7Validator

from register_maps.load import MAPS, json_schema, shipped
from register_maps.schema import COMMANDS, SIGNALS

FILE = MAPS.parent / "register_map.schema.json"
SCHEMA = json.loads(json_schema())


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
    return [error.message for error in Draft7Validator(SCHEMA).iter_errors(json.loads(json.dumps(document)))]


def good() -> Any:
    return yaml.safe_load((MAPS / "two-stop-agv.yaml").read_text())


def test_the_file_is_what_the_model_says() -> None:
    assert FILE.read_text() == json_schema(), "write it anew with the command in register_maps/README.md"


def test_it_is_made_the_same_every_time() -> None:
    assert json_schema() == json_schema()


def test_it_is_a_draft_7_schema() -> None:
    Draft7Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "http://json-schema.org/draft-07/schema#"


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
    assert later.isdisjoint(keywords(SCHEMA))
    assert "#/$defs/" not in json.dumps(SCHEMA)


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_map_is_valid(name: str) -> None:
    assert errors_of(yaml.safe_load((MAPS / f"{name}.yaml").read_text())) == []


def test_an_editor_is_told_every_signal_and_command() -> None:
    properties = SCHEMA["properties"]
    assert set(properties["signals"]["properties"]) == set(SIGNALS)
    assert set(properties["commands"]["properties"]) == set(COMMANDS)


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("signals", "zzz", {"at": "coil:1"}),
        ("commands", "reset", {"at": "coil:1", "action": "pulse"}),
        ("signals", "fault", {"at": "coil:1", "activ": "low"}),
        ("signals", "fault", {"at": "coli:1"}),
        ("signals", "fault", {"at": "holding:1", "bits": [1]}),
        ("signals", "fault", {"at": "holding:1", "bits": [1, 2, 3]}),
        ("commands", "go_to", {"at": "coil:1", "action": "puls"}),
    ],
)
def test_an_editor_marks_what_is_not_allowed(table: str, key: str, value: Any) -> None:
    document = good()
    document[table][key] = value
    assert errors_of(document)


def test_fields_are_explained_where_the_model_explains_them() -> None:
    signal = SCHEMA["definitions"]["Signal"]["properties"]
    assert signal["active"]["description"] == "Which level of a bit means yes."
