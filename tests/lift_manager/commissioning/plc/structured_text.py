"""Runs one function block of Structured Text in scans, on a clock that is set by hand, whoever wrote the text.

The text is parsed by tree-sitter with a public grammar of IEC 61131-3. Types are taken as the strictest PLC takes them:
no number for a condition, no store outside a declared range or array, no store into an input, no undeclared name.
Standard function blocks follow the timing diagrams of IEC 61131-3, 2.5.2.3.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import tree_sitter_iec61131_3_st as grammar
from tree_sitter import Language, Node, Parser

LANGUAGE = Language(grammar.language())

_RANGES = {"INT": (-32768, 32767), "UINT": (0, 65535), "WORD": (0, 65535)}
_NUMBERS = {"INT", "UINT"}

Evaluate = Callable[[], Any]
Execute = Callable[[], None]


class StError(AssertionError):
    """The text is not a program that a strict PLC would take."""


def parse(text: str) -> Node:
    """Parse one function block. Raises StError with the first line that is no Structured Text."""
    root = Parser(LANGUAGE).parse(text.encode("ascii")).root_node
    if root.has_error:
        bad = next(node for node in _walk(root) if node.is_error or node.is_missing)
        raise StError(f"line {bad.start_point.row + 1}: {_text(bad)!r}")
    return root


@dataclass(slots=True)
class Timer:
    """TON, TOF or TP, by its kind."""

    kind: str
    q: bool = False
    since: float | None = None
    """When the time began to run; None: it does not."""
    before: bool = False

    def call(self, now: float, *, level: bool, preset_s: float) -> None:
        over = self.since is not None and now - self.since >= preset_s - 1e-9
        if self.kind == "TON":
            self.since = None if not level else now if self.since is None else self.since
            self.q = level and self.since is not None and now - self.since >= preset_s - 1e-9
        elif self.kind == "TOF":
            if level:
                self.q, self.since = True, None
            elif self.before:
                self.since = now
            elif over:
                self.q, self.since = False, None
        elif over:
            self.q, self.since = False, None
        elif level and not self.before and self.since is None:
            self.q, self.since = True, now
        self.before = level


@dataclass(slots=True)
class Edge:
    """R_TRIG."""

    q: bool = False
    before: bool = False

    def call(self, *, level: bool) -> None:
        self.q, self.before = level and not self.before, level


@dataclass(slots=True)
class Machine:
    """One instance of a function block, and its arrays as the Modbus server and the terminals see them."""

    text: str
    now: float = 0.0
    values: dict[str, Any] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    """`BOOL`, `INT`, `UINT`, `WORD`, `TON`, `TOF`, `TP`, `R_TRIG`; of an array: its elements'."""
    sections: dict[str, str] = field(default_factory=dict)
    """Where each variable was declared, such as `var_input`."""
    _named: dict[str, Node] = field(default_factory=dict)
    """Types that the program declares, by name."""
    _body: list[Execute] = field(default_factory=list)

    def __post_init__(self) -> None:
        block = parse(self.text).named_children
        blocks = [node for node in block if node.type == "function_block_declaration"]
        if len(blocks) != 1:
            raise StError("one function block was expected")
        for node in (
            definition for part in block if part.type == "type_declaration" for definition in part.named_children
        ):
            if node.type == "type_definition":
                self._named[_text(_child(node, "name"))] = _child(node, "definition")
        for node in blocks[0].named_children:
            if node.type.startswith("var_"):
                self._declare(node)
        self._body = [self._statement(node) for node in blocks[0].children_by_field_name("body")]

    def scan(self, now: float) -> None:
        """Run the body once at this time."""
        self.now = now
        for execute in self._body:
            execute()

    def _declare(self, section: Node) -> None:
        for node in section.named_children:
            if node.type != "variable_declaration":
                continue
            kind = self._type(_child(node, "type"), section)
            for name in (_text(name) for name in node.children_by_field_name("names") if name.is_named):
                if name.upper() in map(str.upper, self.types):
                    raise StError(f"{name} is declared twice")
                self.sections[name] = section.type
                self.types[name], self.values[name] = _initial(kind)

    def _type(self, kind: Node, section: Node) -> Node:
        """The type of a variable; what a caller passes in must be of a type that has a name, or no two are the same."""
        if section.type == "var_in_out" and kind.type == "array_type":
            raise StError(f"a caller can pass nothing into {_text(kind)}: its type has no name")
        return self._named.get(_text(kind), kind)

    # -- statements

    def _statement(self, node: Node) -> Execute:
        if node.type == "empty_statement":
            return lambda: None
        if node.type == "assignment_statement":
            return self._assignment(node)
        if node.type == "invocation_statement":
            return self._call(node.named_children[0])
        if node.type == "if_statement":
            return self._if(node)
        raise StError(f"no such statement here: {_text(node)}")

    def _assignment(self, node: Node) -> Execute:
        target, (kind, value) = _child(node, "left"), self._expression(_child(node, "right"))
        name = _text(_child(target, "object") if target.type == "index_expression" else target)
        if self.sections.get(name) == "var_input" or name not in self.types:
            raise StError(f"{name} cannot be stored into")
        store_kind = self.types[name]
        if kind not in (store_kind, "literal") or (kind == "literal" and store_kind not in _RANGES):
            raise StError(f"{_text(node)}: a {kind} into a {store_kind}")

        if target.type == "identifier":

            def store() -> None:
                self.values[name] = _fits(store_kind, value(), name)

            return store
        index = int(_text(_child(target, "index")))
        array = self.values[name]
        if index not in array:
            raise StError(f"{_text(target)} is outside the array")

        def store_element() -> None:
            array[index] = _fits(store_kind, value(), name)

        return store_element

    def _if(self, node: Node) -> Execute:
        branches = [(self._condition(_child(node, "condition")), self._block(node, "consequence"))]
        otherwise: list[Execute] = []
        for clause in node.named_children:
            if clause.type == "elsif_clause":
                branches.append((self._condition(_child(clause, "condition")), self._block(clause, "body")))
            elif clause.type == "else_clause":
                otherwise = self._block(clause, "body")

        def choose() -> None:
            body = next((body for condition, body in branches if condition()), otherwise)
            for execute in body:
                execute()

        return choose

    def _block(self, node: Node, name: str) -> list[Execute]:
        return [self._statement(child) for child in node.children_by_field_name(name) if child.is_named]

    def _call(self, node: Node) -> Execute:
        name = _text(_child(node, "function"))
        given = {
            _text(_child(argument, "name")): self._expression(_child(argument, "value"))
            for argument in _child(node, "arguments").named_children
        }
        block = self.values.get(name)
        if isinstance(block, Edge) and {key: kind for key, (kind, _) in given.items()} == {"CLK": "BOOL"}:
            clock = given["CLK"][1]
            return lambda: block.call(level=clock())
        if isinstance(block, Timer) and {key: kind for key, (kind, _) in given.items()} == {"IN": "BOOL", "PT": "TIME"}:
            level, preset = given["IN"][1], given["PT"][1]
            return lambda: block.call(self.now, level=level(), preset_s=preset())
        raise StError(f"no such block, or not its inputs: {_text(node)}")

    # -- expressions, each with its type

    def _condition(self, node: Node) -> Evaluate:
        kind, value = self._expression(node)
        if kind != "BOOL":
            raise StError(f"{_text(node)} is a {kind}, not a condition")
        return value

    def _expression(self, node: Node) -> tuple[str, Evaluate]:
        reader = {
            "parenthesized_expression": lambda inner: self._expression(inner.named_children[0]),
            "boolean_literal": _constant,
            "integer_literal": _constant,
            "time_literal": _constant,
            "identifier": self._variable,
            "index_expression": self._element,
            "member_access_expression": self._output,
            "unary_expression": self._unary,
            "binary_expression": self._binary,
            "call_expression": self._conversion,
        }.get(node.type)
        if reader is None:
            raise StError(f"no such expression here: {_text(node)}")
        return reader(node)

    def _variable(self, node: Node) -> tuple[str, Evaluate]:
        name = _text(node)
        if self.types.get(name) not in ("BOOL", *_RANGES) or isinstance(self.values[name], dict):
            raise StError(f"{name} is no variable with a value")
        return self.types[name], lambda: self.values[name]

    def _output(self, node: Node) -> tuple[str, Evaluate]:
        block = self.values.get(_text(_child(node, "object")))
        if not isinstance(block, Timer | Edge) or _text(_child(node, "member")) != "Q":
            raise StError(f"no such output: {_text(node)}")
        return "BOOL", lambda: block.q

    def _unary(self, node: Node) -> tuple[str, Evaluate]:
        if _text(_child(node, "operator")) != "NOT":
            raise StError(f"no such expression here: {_text(node)}")
        operand = self._condition(_child(node, "operand"))
        return "BOOL", lambda: not operand()

    def _conversion(self, node: Node) -> tuple[str, Evaluate]:
        kind, value = self._expression(_child(node, "arguments").named_children[0])
        function = _text(_child(node, "function"))
        if (function, kind) not in (("UINT_TO_WORD", "UINT"), ("WORD_TO_UINT", "WORD")):
            raise StError(f"no such conversion here: {_text(node)}")
        return function.partition("_TO_")[2], value

    def _element(self, node: Node) -> tuple[str, Evaluate]:
        name, index = _text(_child(node, "object")), int(_text(_child(node, "index")))
        array = self.values[name]
        if index not in array:
            raise StError(f"{_text(node)} is outside the array")
        return self.types[name], lambda: array[index]

    def _binary(self, node: Node) -> tuple[str, Evaluate]:
        operator = _text(_child(node, "operator"))
        (left_kind, left), (right_kind, right) = (
            self._expression(_child(node, "left")),
            self._expression(_child(node, "right")),
        )
        kind = left_kind if right_kind in (left_kind, "literal") else ""
        if operator == "AND" and kind == "BOOL":
            return "BOOL", lambda: bool(left()) & bool(right())
        if operator == "AND" and kind == "WORD":
            return kind, lambda: left() & right()
        if operator == "OR" and kind in ("BOOL", "WORD"):
            return kind, lambda: left() | right()
        if operator == "=" and kind in _RANGES:
            return "BOOL", lambda: left() == right()
        if operator == ">" and kind in _NUMBERS:
            return "BOOL", lambda: left() > right()
        if operator == "+" and kind in _NUMBERS:
            return kind, lambda: left() + right()
        raise StError(f"{_text(node)}: {left_kind} {operator} {right_kind}")


def _constant(node: Node) -> tuple[str, Evaluate]:
    text = _text(node)
    if node.type == "boolean_literal":
        return "BOOL", lambda: text == "TRUE"
    if node.type == "time_literal":
        preset_s = _seconds(text)
        return "TIME", lambda: preset_s
    number = int(text[3:], 16) if text.startswith("16#") else int(text)
    return "literal", lambda: number


def _initial(kind: Node) -> tuple[str, Any]:
    name = _text(kind)
    if kind.type == "array_type":
        element = _text(_child(kind, "element_type"))
        span = _child(kind, "range")
        first, last = int(_text(_child(span, "lower"))), int(_text(_child(span, "upper")))
        return element, dict.fromkeys(range(first, last + 1), _initial(_child(kind, "element_type"))[1])
    if name == "BOOL":
        return name, False
    if name in _RANGES:
        return name, 0
    if name in ("TON", "TOF", "TP"):
        return name, Timer(name)
    if name == "R_TRIG":
        return name, Edge()
    raise StError(f"no standard type: {name}")


def _fits(kind: str, value: Any, name: str) -> Any:
    if kind in _RANGES and not _RANGES[kind][0] <= value <= _RANGES[kind][1]:
        raise StError(f"{value} does not fit into {name}, a {kind}")
    return value


def _seconds(text: str) -> float:
    match = re.fullmatch(r"T#(\d+)(ms|s)", text)
    if match is None:
        raise StError(f"no such time: {text}")
    return int(match[1]) / (1000 if match[2] == "ms" else 1)


def _child(node: Node, name: str) -> Node:
    child = node.child_by_field_name(name)
    if child is None:
        raise StError(f"{_text(node)} has no {name}")
    return child


def _text(node: Node) -> str:
    return (node.text or b"").decode("ascii")


def _walk(node: Node) -> Any:
    yield node
    for child in node.children:
        yield from _walk(child)
