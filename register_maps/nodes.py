"""Composes YAML text into nodes: one document; reports anchors, aliases and tags instead of following them."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from register_maps.errors import Finding, MapFileError

MAX_DEPTH = 40
"""Chosen: far above any file of ours, far below the limit of recursion."""
TAG = "tag:yaml.org,2002:"
"""What the names of YAML's own types start with."""
ALIAS = "alias"
"""Tag of the node that stands where an alias stood."""

_TAKEN_DIFFERENTLY = re.compile(r"[\t?\\!&*%]|[|>][+-]?[0-9]?[+-]?#|[^\n -~\u00a0-\u2027\u202a-\ufefe]")
"""Text that libyaml may parse differently from PyYAML; found by comparing both on thousands of spoiled files."""

Notes = dict[object, tuple[int, str]]
"""Line and message by node."""


def compose(file: str, text: str) -> tuple[yaml.Node | None, Notes]:
    """Return the one document of a file, or None, and the notes about its nodes.

    Raises MapFileError for text that is not YAML.
    """
    if yaml.__with_libyaml__ and not _TAKEN_DIFFERENTLY.search(text):
        with suppress(yaml.YAMLError):  # the other parser, below, describes the mistake
            return _composed(_Composer(yaml.CSafeLoader(text)))
    try:
        composer = _Composer(yaml.SafeLoader(text))
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        message = f"character U+{ord(text[error.position]):04X} is not allowed; remove it"
        raise MapFileError([Finding(file, line, "", message)]) from error
    try:
        return _composed(composer)
    except yaml.MarkedYAMLError as error:
        # the notes quote the file, which may be another file and secret
        refused = (
            Finding(file, line, "", "anchors, aliases and tags are not allowed") for line, _ in composer.notes.values()
        )
        raise MapFileError([*refused, _syntax(file, error)]) from error


def _composed(composer: _Composer) -> tuple[yaml.Node | None, Notes]:
    return composer.only_document(), composer.notes


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


class _Composer(Composer, Resolver):
    """Composes one document and records anchors, aliases and tags instead of following them.

    The parser is libyaml's, which takes a sixth of the time, or PyYAML's own; both put the same marks on their events.
    """

    def __init__(self, parser: Any) -> None:
        super().__init__()
        Resolver.__init__(self)
        self.check_event, self.peek_event, self.get_event = parser.check_event, parser.peek_event, parser.get_event
        self.notes: Notes = {}
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
            alias = yaml.ScalarNode(ALIAS, "", event.start_mark, event.end_mark)  # type: ignore[arg-type]  # marks of either parser
            self.notes[alias] = (
                line,
                f"alias `*{event.anchor}`: anchors and aliases are not allowed; write the value out",
            )
            return alias
        if event.anchor is not None:
            note = f"anchor `&{event.anchor}`: anchors and aliases are not allowed; write each value out"
            event.anchor = None
        if event.tag is not None:
            tag = event.tag.replace(TAG, "!!")
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
        return self.peek_event()

    def _take(self) -> None:
        self.get_event()
