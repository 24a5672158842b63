"""Explains pydantic's errors to a person who edits a YAML file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

Path = tuple[str | int, ...]
JsonSchema = Mapping[str, Any]

TABLE = "a table of keys"
_SORTS = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a number",
    "bool": "true or false",
    "string": "text",
    "list": "a list in [ ]",
    "tuple": "a list in [ ]",
    "dict": TABLE,
    "model": TABLE,
}
_BOUNDS = {
    "greater_than": ("more than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}


def closest(word: str, allowed: Iterable[str]) -> str:
    """Return a hint at the most similar allowed word, `; did you mean ...?`; empty if none is similar."""
    found = difflib.get_close_matches(word, list(allowed), n=1)
    return f"; did you mean `{found[0]}`?" if found else ""


def explain_error(
    error: ErrorDetails, schema: JsonSchema, data: object, written: Mapping[tuple[str, ...], str]
) -> tuple[Path, str]:
    """Return the path in the file, and what is wrong and right there."""
    path, key_is_wrong = _place(error["loc"], data)
    kind = error["type"]
    if kind == "missing":
        last = error["loc"][-1]
        if isinstance(last, int):
            return path, f"entry {last + 1} is missing"
        return (*path, last), "is missing"
    if kind == "extra_forbidden":
        return path, _unknown_key(str(path[-1]), sorted(_keys(schema, path[:-1])))
    message = _message(error, schema, path, written.get(tuple(map(str, path))))
    return path, f"the key {message}" if key_is_wrong else message


def _place(location: tuple[int | str, ...], data: object) -> tuple[Path, bool]:
    """Follow pydantic's location through the file; it also names types and union branches, which the file does not have."""
    path: list[str | int] = []
    for part in location:
        if isinstance(data, dict):
            key = next((key for key in data if str(key) == str(part)), None)
            if key is not None:
                path.append(key)
                data = data[key]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            path.append(part)
            data = data[part]
    return tuple(path), bool(location) and location[-1] == "[key]"


def _message(error: ErrorDetails, schema: JsonSchema, path: Path, written: str | None) -> str:
    kind, context, given = error["type"], error.get("ctx", {}), error["input"]
    if kind in ("enum", "literal_error"):
        return _not_one_of(given, written, str(context["expected"]))
    if kind in _BOUNDS:
        words, name = _BOUNDS[kind]
        return f"must be {words} {context[name]:g}, not {written or given}"
    if kind == "value_error":
        return str(context["error"])
    if kind in ("too_short", "too_long"):
        limit = context.get("min_length" if kind == "too_short" else "max_length")
        return f"must have {'at least' if kind == 'too_short' else 'at most'} {limit} {'entry' if limit == 1 else 'entries'}, not {context['actual_length']}"
    if kind == "string_pattern_mismatch":
        return f"must be {_description(schema, path, str(context['pattern']), key=error['loc'][-1:] == ('[key]',))}, not {given!r}"
    if kind.startswith("string_too_"):
        return (
            f"must have at most {context['max_length']} characters" if "max_length" in context else "must not be empty"
        )
    sort = _SORTS.get(re.sub(r"_(type|parsing|parsing_size|from_float|attributes_type)$", "", kind))
    if sort is None:
        return error["msg"].replace("Input should", "must")
    return _wrong_sort(sort, given, written) + (for_example(schema, path) if sort == TABLE else "")


def _wrong_sort(sort: str, given: object, written: str | None) -> str:
    if isinstance(given, dict):
        return f"must be {sort}, not a table of keys"
    if isinstance(given, list):
        return f"must be {sort}, not a list"
    if given is None and not written:
        return f"must be {sort}; nothing is given"
    if sort == "text":
        read_as = {bool: "a boolean", type(None): "nothing"}.get(type(given), "a number")
        return f'must be text, and YAML reads {written} as {read_as}; quote it: "{written}"'
    return f"must be {sort}, not {'the text ' if isinstance(given, str) else ''}{written or repr(given)}"


def for_example(schema: JsonSchema, path: Path) -> str:
    """Return an example of what may stand at a path: `; for example {at: "holding:12"}`."""
    node = next((node for node in _nodes(schema, path) if node.get("type") == "object"), {})
    example = _example(schema, node, depth=2)
    return f"; for example {example}" if ":" in example else ""


def _example(schema: JsonSchema, node: JsonSchema, *, depth: int) -> str:
    """Return an example value for a part of a JSON Schema, with its required keys, or else the first one."""
    for part in _branches(schema, node):
        if "const" in part or "enum" in part:
            return str(part["const"] if "const" in part else part["enum"][0])
        match part.get("type"):
            case "object" if depth:
                return _example_table(schema, part, depth=depth - 1)
            case "object":
                return "{...}"
            case "array":
                return "[...]"
            case "integer" | "number":
                return "1"
            case "boolean":
                return "true"
            case "string":
                word = re.search(r"such as ([^\s,]+)", str(node.get("description", part.get("description", ""))))
                return "..." if word is None else f'"{word[1]}"' if ":" in word[1] else word[1]
            case _:
                pass
    return "..."


def _example_table(schema: JsonSchema, part: JsonSchema, *, depth: int) -> str:
    properties = part.get("properties", {})
    keys = part.get("required") or list(properties)[:1]
    entries = [f"{key}: {_example(schema, properties[key], depth=depth)}" for key in keys]
    values = part.get("additionalProperties")
    if not entries and isinstance(values, dict):
        named = _example(schema, part["propertyNames"], depth=0) if "propertyNames" in part else "..."
        entries = [f"{'name' if named == '...' else named}: {_example(schema, values, depth=depth)}"]
    return f"{{{', '.join(entries)}}}"


def _unknown_key(word: str, allowed: list[str]) -> str:
    if hint := closest(word, allowed):
        return f"there is no such key here{hint}"
    if " " in word:
        return "there is no such key here; if it is the rest of a text with a comma, quote that text"
    return f"there is no such key here; allowed are {', '.join(allowed)}"


def _not_one_of(given: object, written: str | None, expected: str) -> str:
    words = re.findall(r"'([^']*)'", expected) or [expected]
    listed = words[0] if len(words) == 1 else "one of " + ", ".join(words)
    hint = closest(given, words) if isinstance(given, str) else ""
    return f"must be {listed}, not {written or repr(given)}{hint}"


def _description(schema: JsonSchema, path: Path, pattern: str, *, key: bool) -> str:
    for node in _key_nodes(schema, path[:-1]) if key else _nodes(schema, path):
        if "description" in node:
            return str(node["description"])
    return f"text of the form {pattern}"


def _keys(schema: JsonSchema, path: Path) -> set[str]:
    return {key for node in _nodes(schema, path) for key in node.get("properties", {})}


def _key_nodes(schema: JsonSchema, path: Path) -> Iterator[JsonSchema]:
    for node in _nodes(schema, path):
        if "propertyNames" in node:
            yield from _branches(schema, node["propertyNames"])


def _nodes(schema: JsonSchema, path: Path) -> list[JsonSchema]:
    """All parts of a JSON Schema that describe what stands at a path."""
    nodes = list(_branches(schema, schema))
    for part in path:
        nodes = [branch for node in nodes for child in _children(node, part) for branch in _branches(schema, child)]
    return nodes


def _branches(schema: JsonSchema, node: JsonSchema) -> Iterator[JsonSchema]:
    yield node
    if "$ref" in node:
        yield from _branches(schema, schema["$defs"][node["$ref"].removeprefix("#/$defs/")])
    for branch in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())):
        yield from _branches(schema, branch)


def _children(node: JsonSchema, part: str | int) -> Iterator[JsonSchema]:
    if part in node.get("properties", {}):
        yield node["properties"][part]
        return
    if isinstance(part, int) and "items" in node:
        yield node["items"]
    if isinstance(part, int) and part < len(node.get("prefixItems", ())):
        yield node["prefixItems"][part]
    for container in (*node.get("patternProperties", {}).values(), node.get("additionalProperties")):
        if isinstance(container, dict):
            yield container
