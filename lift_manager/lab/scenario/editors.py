"""Generates the JSON Schema with which editors complete scenario files: draft 7, from the models and the vocabulary."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE, WIRE_FAULT_KEYS, model_of, people_model
from lift_manager.lab.scenario.schema import Scenario
from lift_manager.lab.scenario.vocabulary import KINDS, LISTS, Field, ValueType
from register_maps.draft_7 import draft_7_text
from simulator.wire_faults import Target

Json = dict[str, Any]

_MATCHES = {"Step": ("when", "until"), "Expectation": ("never", "eventually", "count", "while", "after")}
_TYPES: Mapping[ValueType, Json] = {ValueType.NUMBER: {"type": "number"}, ValueType.FLAG: {"type": "boolean"}}


def json_schema() -> str:
    """Return the text of scenario.schema.json."""
    schema = Scenario.model_json_schema()
    parts: Json = schema["$defs"]
    step, expectation = parts["Step"]["properties"], parts["Expectation"]["properties"]
    for name, keys in _MATCHES.items():
        for key in keys:
            parts[name]["properties"][key] = {"$ref": "#/$defs/Match"}
    expectation["ordered"] = {"type": "array", "items": {"$ref": "#/$defs/Match"}, "minItems": 2}
    parts["Match"] = {"oneOf": [_match(kind, parts) for kind in KINDS]}
    step["fault"] = _named(READY, DEVICE_FAULTS, {}, parts)
    further = {
        "times": {"type": "integer", "minimum": 1},
        "probability": {"type": "number", "minimum": 0.0, "maximum": 1.0},
        "only": _part(model_of(Target), parts),
        "controller": {"type": "string"},
    }
    step["wire"] = _named(WIRE, WIRE, {key: further[key] for key in WIRE_FAULT_KEYS}, parts)
    step["people"] = _part(people_model(), parts)
    return draft_7_text(schema)


def _match(kind: str, parts: Json) -> Json:
    fields = {name: _field(f"{kind}_{name}", field, parts) for name, field in KINDS[kind].fields.items()}
    return {
        "type": "object",
        "description": KINDS[kind].about,
        "required": ["kind"],
        "properties": {"kind": {"const": kind}, **fields},
        "additionalProperties": False,
    }


def _field(name: str, field: Field, parts: Json) -> Json:
    """Return one field. Its possible values are defined once, under the name of its choices or of its type."""
    if field.words:
        parts[name] = _values({"enum": list(field.words)}, field.sort)
    shared = name if field.words else f"any_{field.sort.name.lower()}"
    parts.setdefault(shared, _values(_TYPES.get(field.sort, {"type": "string"}), field.sort))
    many = " (any of several)" if field.sort in LISTS else ""
    # draft 7 ignores the siblings of a `$ref`, descriptions included
    return {"description": field.about + many, "allOf": [{"$ref": f"#/$defs/{shared}"}]}


def _values(value: Json, sort: ValueType) -> Json:
    """Return the forms of a value: itself, null, a list of alternatives, or a comparison."""
    one = {"enum": [*value["enum"], None]} if "enum" in value else {"anyOf": [value, {"type": "null"}]}
    some = [one, {"type": "array", "items": one, "minItems": 1}]
    compared: Json = {"not": {"anyOf": some}}
    if sort is ValueType.NUMBER:
        compared |= {"above": {"type": "number"}, "below": {"type": "number"}}
    if sort is ValueType.TEXT:
        compared |= {"contains": {"type": "string", "minLength": 1}}
    comparison = {"type": "object", "properties": compared, "additionalProperties": False, "minProperties": 1}
    return {"anyOf": [*some, comparison]}


def _named(words: Iterable[str], kinds: Mapping[str, type], further: Json, parts: Json) -> Json:
    """Return a fault: its name alone, or a table with its values."""
    tables = []
    for name, kind in kinds.items():
        model = model_of(kind)
        own = _part(model, parts)
        values: list[Json] = [own]
        if (first := next(iter(model.model_fields), None)) is not None:
            values.append(parts[model.__name__]["properties"][first])
        table: Json = {"type": "object", "required": [name], "properties": {name: {"anyOf": values}, **further}}
        tables.append({**table, "additionalProperties": False})
    return {"anyOf": [{"enum": list(words)}, *tables]}


def _part(model: type[BaseModel], parts: Json) -> Json:
    schema = model.model_json_schema()
    for name, part in schema.pop("$defs", {}).items():
        parts.setdefault(name, part)
    parts[model.__name__] = schema
    return {"$ref": f"#/$defs/{model.__name__}"}
