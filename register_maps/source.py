"""Strict reading of the project's YAML files: every mistake at once, each with its line and key.

Used for register maps and for site files. YAML is read for its nodes, never for objects; what surprises people in it (tabs,
duplicate keys, numbers and booleans as keys, anchors, tags) is refused in plain words.
"""

from __future__ import annotations

import hashlib
import json
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from register_maps.errors import Finding, MapFileError
from register_maps.plain import plain_words

__all__ = ["Finding", "KeyPath", "MapFileError", "Source", "key_text", "read", "try_validate", "validate"]

MAX_BYTES = 1_000_000
"""Chosen: ten times a site of a thousand lifts. What is larger is a mistake, and is not read."""
MAX_DEPTH = 40
"""Chosen: far above any file of ours, far below what recursion can bear."""

KeyPath = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)

_TAG = "tag:yaml.org,2002:"
_ALIAS = "alias"
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
class Source:
    """One file as plain data, with the line of every key."""

    file: str
    data: object
    sha256: str
    """Of the bytes that were read."""
    lines: Mapping[tuple[str, ...], int]
    written: Mapping[tuple[str, ...], str]
    """What the file says where YAML reads something other than text."""
    findings: tuple[Finding, ...] = ()
    """Mistakes that left the data readable; `validate` raises them with its own."""
    spoiled: frozenset[KeyPath] = frozenset()
    """Where a value could not be taken over: what a model says about it there is not the file's fault."""

    def line(self, path: KeyPath) -> int | None:
        """Line of a key, or of the nearest part of its path that the file has."""
        names = tuple(map(str, path))
        return next((self.lines[names[:end]] for end in range(len(names), -1, -1) if names[:end] in self.lines), None)

    def finding(self, path: KeyPath, message: str) -> Finding:
        """Say something about a key."""
        return Finding(self.file, self.line(path), key_text(path), message)


def key_text(path: KeyPath) -> str:
    """Write a path as people do: `served.holding[0]`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def read(path: Path, *, number_keys: Callable[[KeyPath], bool] = lambda _: False) -> Source:
    """Read a file; `number_keys` says for the path of a table whether its keys may be whole numbers.

    Raises MapFileError when there is no data to go on with. Lesser mistakes are kept in the source for `validate`.
    """
    file = str(path)
    raw = _bytes(path)
    text = _text(file, raw)
    node, notes = _compose(file, text)
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
    result, findings = try_validate(source, model)
    if findings or result is None:
        raise MapFileError(findings)
    return result


def try_validate(source: Source, model: type[Model]) -> tuple[Model | None, tuple[Finding, ...]]:
    """Validate, and return what the file says without its unknown keys when nothing worse is wrong with it.

    So that checks across fields can add their findings to these.
    """
    findings = list(source.findings)
    told = set(source.spoiled)
    data = source.data
    for _ in range(2):
        try:
            # JSON mode is the one in which `strict` takes lists for tuples and words for enums, yet no "1" or yes for 1
            return model.model_validate_json(json.dumps(data), strict=True), tuple(findings)
        except ValidationError as error:
            entries = error.errors(include_url=False)
            schema = model.model_json_schema()
            said = [plain_words(entry, schema, source.data, source.written) for entry in entries]
            for path, message in said:
                if not any(path[: len(known)] == known for known in told):
                    findings.append(source.finding(path, message))
                    told.add(path)
            if any(entry["type"] != "extra_forbidden" for entry in entries):
                break
            data = _without(data, (), frozenset(path for path, _ in said))
    return None, tuple(findings)


def _without(data: object, path: KeyPath, dropped: frozenset[KeyPath]) -> object:
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


def _compose(file: str, text: str) -> tuple[yaml.Node | None, dict[object, tuple[int, str]]]:
    """The nodes of the file, and what was noted about them."""
    try:
        loader = _Loader(text)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"character U+{ord(text[error.position]):04X} is not allowed; remove it"
        raise MapFileError([Finding(file, line, "", message)]) from error
    try:
        return loader.only_document(), loader.notes
    except yaml.MarkedYAMLError as error:
        noted = (Finding(file, line, "", message) for line, message in loader.notes.values())
        raise MapFileError([*noted, _syntax(file, error)]) from error


_SYNTAX = (
    ("'\\t'", "tab; use spaces"),
    ("mapping values are not allowed", "a `:` too many, or the wrong indentation; text with `: ` in it must be quoted"),
    ("could not find expected ':'", "a key without its `:`, or a line of text that is not indented"),
    ("expected <block end>", "the indentation does not fit the lines above, or something follows a value"),
    ("expected ',' or", "a comma or the closing bracket is missing"),
    ("expected the node content", "a value is missing, or a bracket or comma too many"),
    ("unexpected end of stream", "a quotation mark is not closed"),
    ("cannot start any token", "text that starts with this character must be quoted"),
    ("unknown escape character", "a backslash in double quotes starts an escape; use single quotes"),
    ("undefined tag handle", "a tag (`!`); quote text that starts with `!`"),
    ("undefined alias", "an alias (`*`); write the value out"),
)


def _syntax(file: str, error: yaml.MarkedYAMLError) -> Finding:
    mark = error.problem_mark or error.context_mark
    problem = str(error.problem)
    message = next((words for sign, words in _SYNTAX if sign in problem), problem)
    line = None if mark is None else mark.line + 1
    opened = error.context_mark
    if opened is not None and mark is not None and opened.line != mark.line:
        message += f" (what it belongs to starts in line {opened.line + 1})"
    return Finding(file, line, "", message)


class _TooDeep(yaml.MarkedYAMLError):
    pass


class _Loader(yaml.SafeLoader):
    """Composes one document and notes anchors, aliases and tags instead of following them."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.notes: dict[object, tuple[int, str]] = {}
        """Line and message by node."""
        self._depth = 0

    def only_document(self) -> yaml.Node | None:
        self._take()
        if self.check_event(yaml.StreamEndEvent):
            return None
        node: yaml.Node | None = self.compose_document()
        if not self.check_event(yaml.StreamEndEvent):
            line = self._peek().start_mark.line + 1
            self.notes["end"] = (line, "a second document starts here; a file holds one, remove the `---`")
        return node

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self._peek()
        line = event.start_mark.line + 1
        note = ""
        if isinstance(event, yaml.AliasEvent):
            self._take()
            alias = yaml.ScalarNode(_ALIAS, "", event.start_mark, event.end_mark)  # type: ignore[arg-type]  # marks of either parser
            self.notes[alias] = (line, f"alias `*{event.anchor}`: anchors and aliases are not allowed; write the value out")
            return alias
        if event.anchor is not None:
            note = f"anchor `&{event.anchor}`: anchors and aliases are not allowed; write each value out"
            event.anchor = None
        if event.tag is not None:
            tag = event.tag.replace(_TAG, "!!")
            note = f"tag `{tag}`: tags are not allowed; quote text that starts with `!`"
            event.tag = None
            event.implicit = (True, False) if isinstance(event, yaml.ScalarEvent) else True
        if self._depth >= MAX_DEPTH:
            raise _TooDeep(problem=f"nested more than {MAX_DEPTH} levels deep", problem_mark=event.start_mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        if note:
            self.notes[node] = (line, note)
        return node

    def _peek(self) -> Any:
        return self.peek_event()  # type: ignore[no-untyped-call]

    def _take(self) -> None:
        self.get_event()  # type: ignore[no-untyped-call]


class _Builder:
    """Nodes to plain data; every key's line; wrong keys as findings."""

    def __init__(
        self, file: str, number_keys: Callable[[KeyPath], bool], notes: dict[object, tuple[int, str]]
    ) -> None:
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
            self._say(path, *note)
        if node.tag == _ALIAS:
            self.spoiled.add(path)
            return None
        if isinstance(node, yaml.MappingNode):
            return self._table(path, node)
        if isinstance(node, yaml.SequenceNode):
            return [self.value((*path, index), item) for index, item in enumerate(node.value)]
        return self._scalar(path, node)

    def _table(self, path: KeyPath, node: yaml.MappingNode) -> dict[str | int, object]:
        table: dict[str | int, object] = {}
        seen: dict[str, int] = {}
        for key, line, item in self._entries(path, node):
            here = (*path, key)
            if str(key) in seen:
                self._say(here, line, f"given twice, in line {seen[str(key)]} and here; remove or rename one")
                continue
            seen[str(key)] = line
            self.lines[tuple(map(str, here))] = line
            table[key] = self.value(here, item)
        return table

    def _entries(self, path: KeyPath, node: yaml.MappingNode) -> Iterator[tuple[str | int, int, yaml.Node]]:
        for key_node, item in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                self._say(path, line, "a list or table stands where a key belongs; quote text that starts with [ or {")
                continue
            text = key_node.value
            kind = key_node.tag.removeprefix(_TAG)
            if kind == "int" and self._number_keys(path):
                number = self._scalar((*path, text), key_node)
                yield number if isinstance(number, int) else text, line, item
                continue
            if kind != "str":
                self._say((*path, text), line, f'YAML reads {text or "an empty key"} as {_READ_AS[kind]}; quote it: "{text}"')
            yield text, line, item

    def _scalar(self, path: KeyPath, node: yaml.Node) -> object:
        text, kind = str(node.value), node.tag.removeprefix(_TAG)
        line = node.start_mark.line + 1
        if kind in ("str", "timestamp", "merge", "value"):
            if any("\ud800" <= character <= "\udfff" for character in text):
                self._say(path, line, "an escape in this text is half a character; write the character itself")
                return ""
            return text
        self.written[tuple(map(str, path))] = text
        if kind == "int" and re.search(r"^[-+]?0[0-7_]|:", text):
            self._say(path, line, f"YAML does not read {text} as the decimal number it looks like; quote it, or write it plainly")
        try:
            return _CONSTRUCT[kind](node)
        except (ValueError, OverflowError):
            self._say(path, line, f"{text[:20]} is not a number that can be used")
            self.spoiled.add(path)
            return 0

    def _say(self, path: KeyPath, line: int, message: str) -> None:
        self.findings.append(Finding(self._file, line, key_text(path), message))


_SAFE = yaml.constructor.SafeConstructor()
_CONSTRUCT: Mapping[str, Callable[[Any], object]] = {
    "int": _SAFE.construct_yaml_int,
    "float": _SAFE.construct_yaml_float,
    "bool": _SAFE.construct_yaml_bool,
    "null": _SAFE.construct_yaml_null,
}
