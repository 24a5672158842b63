"""Reads the project's YAML files strictly: reports every mistake at once, with its line and key.

Used for register maps and for site files. YAML is read as nodes, never as objects; its surprising features (tabs,
duplicate keys, numbers and booleans as keys, anchors, tags) are refused with an explanation.
"""

from __future__ import annotations

import hashlib
import json
import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from register_maps.error_texts import explain_error, for_example
from register_maps.errors import Finding, MapFileError
from register_maps.nodes import ALIAS, TAG, Notes, compose

__all__ = [
    "LEFT_OUT",
    "Finding",
    "KeyPath",
    "MapFileError",
    "Source",
    "StandIns",
    "ValidationResult",
    "key_text",
    "read",
    "try_validate",
    "validate",
]

MAX_BYTES = 1_000_000
"""Chosen: ten times a site of a thousand lifts. A larger file is a mistake, and is not read."""

KeyPath = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

LEFT_OUT = object()
"""Replaces a value that may be omitted."""
StandIns = Mapping[tuple[str, ...], object]
"""Replacements for missing or wrong values by place, in which `*` is any key, so that the rest can be checked."""

_READ_AS = {
    "int": "a number",
    "float": "a number",
    "bool": "a boolean",
    "null": "nothing",
    "timestamp": "a date",
    "merge": "a merge",
    "value": "a default",
}


@dataclass(frozen=True, slots=True)
class ValidationResult(Generic[Model]):
    """The result of validating a file that may have mistakes."""

    model: Model | None
    """The model as far as the file allows; None if it does not."""
    findings: tuple[Finding, ...]
    replaced: frozenset[KeyPath] = frozenset()
    """Places where a value of the file was replaced: errors that follow from it are not the file's."""


@dataclass(frozen=True, slots=True)
class Source:
    """One file as plain data, with the line of every key."""

    file: str
    data: object
    sha256: str
    """Of the bytes that were read."""
    lines: Mapping[tuple[str, ...], int]
    written: Mapping[tuple[str, ...], str]
    """The text of the file where YAML reads something other than text."""
    findings: tuple[Finding, ...] = ()
    """Mistakes that left the data readable; `validate` raises them with its own."""
    spoiled: frozenset[KeyPath] = frozenset()
    """Places of unusable values that were replaced: further errors there are not the file's."""

    def line(self, path: KeyPath) -> int | None:
        """Line of a key, or of the nearest part of its path that the file has."""
        names = tuple(map(str, path))
        return next((self.lines[names[:end]] for end in range(len(names), -1, -1) if names[:end] in self.lines), None)

    def finding(self, path: KeyPath, message: str) -> Finding:
        """Return a finding about a key."""
        return Finding(self.file, self.line(path), key_text(path), message)


def key_text(path: KeyPath) -> str:
    """Return a path as people write it: `served.holding[0]`."""
    text = ""
    for part in path:
        shown = part if isinstance(part, int) or part.isprintable() else repr(part)[1:-1]
        text += f"[{part}]" if isinstance(part, int) else f".{shown}" if text else str(shown)
    return text


def read(path: Path, *, number_keys: Callable[[KeyPath], bool] = lambda _: False) -> Source:
    """Read a file; `number_keys` tells for the path of a table whether its keys may be whole numbers.

    Raises MapFileError if nothing can be read. Lesser mistakes are kept in the source for `validate`.
    """
    file = str(path)
    raw = _bytes(path)
    text = _text(file, raw)
    node, notes = compose(file, text)
    if node is None:
        raise MapFileError([Finding(file, None, "", "the file is empty")])
    builder = _Builder(file, number_keys, notes)
    data = builder.value((), node)
    return Source(
        file,
        data,
        hashlib.sha256(raw).hexdigest(),
        builder.lines,
        builder.written,
        (*builder.findings, *(Finding(file, line, "", message) for line, message in notes.values())),
        frozenset(builder.spoiled),
    )


def validate(source: Source, model: type[Model]) -> Model:
    """Turn a source into a model. Raises MapFileError with every finding."""
    tried = try_validate(source, model)
    if tried.findings or tried.model is None:
        raise MapFileError(tried.findings)
    return tried.model


def try_validate(
    source: Source, model: type[Model], *, spare: Collection[str] = (), stand_ins: StandIns = MappingProxyType({})
) -> ValidationResult[Model]:
    """Validate as far as possible, so that checks across fields can add their findings to these.

    Unknown keys are omitted, and so are wrong entries of the tables named by `spare`. Missing or wrong values with a place in
    `stand_ins` are replaced by it; with any other mistake there is no model.
    """
    if message := _other_kind(source.data, model):
        return ValidationResult(None, (source.finding((), message),), frozenset())
    findings = list(source.findings)
    reported = set(source.spoiled)
    data = source.data
    replaced: dict[KeyPath, object] = {}
    for _ in range(2):
        try:
            # in JSON mode `strict` accepts lists for tuples and strings for enums, but neither "1" nor yes for 1
            result = model.model_validate_json(json.dumps(data), strict=True)
            return ValidationResult(result, tuple(findings), frozenset(replaced))
        except ValidationError as error:
            schema = _json_schema(model)
            dropped: set[KeyPath] = set()
            for entry in error.errors(include_url=False):
                path, message = explain_error(entry, schema, source.data, source.written)
                if not any(path[: len(earlier)] == earlier for earlier in reported):
                    findings.append(source.finding(path, message))
                    reported.add(path)
                if entry["type"] == "extra_forbidden":
                    dropped.add(path)
                elif (stand_in := _stand_in(path, stand_ins)) is not None:
                    replaced[stand_in[0]] = stand_in[1]
                else:
                    dropped.add(path[:2] if len(path) > 1 and path[0] in spare else ())
            if () in dropped:
                break
            data = _without(data, (), {*dropped, *replaced})
            for path, value in replaced.items():
                _put(data, path, value)
    return ValidationResult(None, tuple(findings))


def _stand_in(path: KeyPath, stand_ins: StandIns) -> tuple[KeyPath, object] | None:
    """Return the replacement of a wrong value, with its place: the nearest one that contains the value."""
    for end in range(len(path), 0, -1):
        for place, value in stand_ins.items():
            if len(place) == end and all(name in ("*", part) for name, part in zip(place, path, strict=False)):
                return path[:end], value
    return None


def _put(data: object, path: KeyPath, value: object) -> None:
    for part in path[:-1]:
        data = data.get(part) if isinstance(data, dict) else None
    if isinstance(data, dict) and value is not LEFT_OUT:
        data[path[-1]] = value


def _other_kind(data: object, model: type[BaseModel]) -> str:
    """Return why this is another kind of file; empty if it may be the right kind.

    Nothing of such a file is quoted: the caller may not be allowed to read it, and its content may be secret.
    """
    schema = _json_schema(model)
    keys = schema["properties"].keys()
    if isinstance(data, dict) and (not data or keys & data.keys()):
        return ""
    if not isinstance(data, dict):
        kind = "a list" if isinstance(data, list) else "a text or a number"
        return f"must be a table of keys, not {kind}{for_example(schema, ())}"
    return f"is probably another file: it has none of the keys {', '.join(sorted(keys))}"


@cache
def _json_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON Schema of a model; cached because making it takes as long as reading a map."""
    return model.model_json_schema()


def _without(data: object, path: KeyPath, dropped: Collection[KeyPath]) -> object:
    if isinstance(data, dict):
        return {key: _without(item, (*path, key), dropped) for key, item in data.items() if (*path, key) not in dropped}
    if isinstance(data, list):
        return [_without(item, (*path, index), dropped) for index, item in enumerate(data)]
    return data


def _bytes(path: Path) -> bytes:
    def refuse(message: str) -> MapFileError:
        return MapFileError([Finding(str(path), None, "", message)])

    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise refuse("is a directory, not a file" if stat.S_ISDIR(about.st_mode) else "is not an ordinary file")
        if about.st_size > MAX_BYTES:
            raise refuse(f"has {about.st_size} bytes and was not read; the limit is {MAX_BYTES}")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise refuse("there is no such file") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise refuse(f"cannot be read: {reason}") from error


def _text(file: str, raw: bytes) -> str:
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"byte 0x{raw[error.start]:02X} is not UTF-8; save the file as UTF-8"
        raise MapFileError([Finding(file, line, "", message)]) from error
    tabs = [number for number, line in enumerate(text.splitlines(), 1) if re.match(r" *\t\s*\S", line)]
    if tabs:
        raise MapFileError(Finding(file, line, "", "tab; use spaces") for line in tabs)
    return text


class _Builder:
    """Builds plain data from nodes, with the line of every key and findings about wrong keys."""

    def __init__(self, file: str, number_keys: Callable[[KeyPath], bool], notes: Notes) -> None:
        self._file = file
        self._number_keys = number_keys
        self._notes = notes
        self.lines: dict[tuple[str, ...], int] = {}
        self.written: dict[tuple[str, ...], str] = {}
        self.findings: list[Finding] = []
        self.spoiled: set[KeyPath] = set()

    def value(self, path: KeyPath, node: yaml.Node) -> object:
        self.lines.setdefault(tuple(map(str, path)), node.start_mark.line + 1)
        if (note := self._notes.pop(node, None)) is not None:
            self._add_finding(path, *note)
        if node.tag == ALIAS:
            self.spoiled.add(path)
            return None
        if isinstance(node, yaml.MappingNode):
            return self._table(path, node)
        if isinstance(node, yaml.SequenceNode):
            return [self.value((*path, index), item) for index, item in enumerate(node.value)]
        return self._scalar(path, node)

    def _table(self, path: KeyPath, node: yaml.MappingNode) -> dict[str | int, object]:
        table: dict[str | int, object] = {}
        first_lines: dict[str, int] = {}
        for key, line, item in self._entries(path, node):
            here = (*path, key)
            if str(key) in first_lines:
                self._add_finding(
                    here, line, f"given twice, in line {first_lines[str(key)]} and here; remove or rename one"
                )
                continue
            first_lines[str(key)] = line
            self.lines[tuple(map(str, here))] = line
            table[key] = self.value(here, item)
        return table

    def _entries(self, path: KeyPath, node: yaml.MappingNode) -> Iterator[tuple[str | int, int, yaml.Node]]:
        for key_node, item in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                self._add_finding(
                    path, line, "a list or table stands where a key belongs; quote text that starts with [ or {"
                )
                continue
            if key_node.tag == ALIAS:
                continue  # reported already, and its value is unknown
            text = key_node.value
            kind = key_node.tag.removeprefix(TAG)
            if kind == "int" and self._number_keys(path):
                number = self._scalar((*path, text), key_node)
                yield number if isinstance(number, int) else text, line, item
                continue
            if kind != "str":
                self._add_finding(
                    (*path, text), line, f'YAML reads {text or "an empty key"} as {_READ_AS[kind]}; quote it: "{text}"'
                )
            yield text, line, item

    def _scalar(self, path: KeyPath, node: yaml.Node) -> object:
        text, kind = str(node.value), node.tag.removeprefix(TAG)
        line = node.start_mark.line + 1
        if kind in ("str", "timestamp", "merge", "value"):
            if any("\ud800" <= character <= "\udfff" for character in text):
                self._add_finding(path, line, "an escape in this text is half a character; write the character itself")
                self.spoiled.add(path)
                return ""
            return text
        self.written[tuple(map(str, path))] = text
        try:
            value = _usable(_CONSTRUCT[kind](node))
        except (ValueError, OverflowError):
            self._add_finding(path, line, f"{text[:20]} is not a number that can be used")
            self.spoiled.add(path)
            return 0
        if kind == "int" and re.search(r"^[-+]?0[0-7_]|:", text):
            self._add_finding(path, line, f"YAML reads {text} as {value}; write {value}, or quote it if it is text")
        return value

    def _add_finding(self, path: KeyPath, line: int, message: str) -> None:
        self.findings.append(Finding(self._file, line, key_text(path), message))


def _usable(value: object) -> object:
    """Raise OverflowError for a whole number too large for any field and for JSON."""
    if isinstance(value, int) and abs(value) >= 1 << 63:
        raise OverflowError
    return value


_SAFE = yaml.constructor.SafeConstructor()
_CONSTRUCT: Mapping[str, Callable[[Any], object]] = {
    "int": _SAFE.construct_yaml_int,
    "float": _SAFE.construct_yaml_float,
    "bool": _SAFE.construct_yaml_bool,
    "null": _SAFE.construct_yaml_null,
}
