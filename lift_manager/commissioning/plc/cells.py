"""Formats addresses, values and times as Structured Text: one array per Modbus table, indexed as on the wire."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from register_maps.codec import Codec, Point
from register_maps.words import BIT_TABLES, Table

BLOCK = "RobotLift"
"""Name of the function block."""

_ARRAYS = {
    Table.COIL: "Coils",
    Table.DISCRETE: "DiscreteInputs",
    Table.HOLDING: "HoldingRegisters",
    Table.INPUT: "InputRegisters",
}


@dataclass(frozen=True, slots=True)
class Area:
    """One Modbus table of the PLC."""

    table: Table
    first: int
    """The lowest address on the wire."""
    last: int
    """The highest address on the wire."""
    commanded: bool
    """Whether the manager writes into it."""

    @property
    def name(self) -> str:
        return _ARRAYS[self.table]

    @property
    def type_name(self) -> str:
        """The name of its type. The caller must declare the same type; two arrays without a type name never have the same type."""
        return f"{BLOCK}{self.name}"

    @property
    def type_declaration(self) -> str:
        """The declaration of its type."""
        element = "BOOL" if self.table in BIT_TABLES else "WORD"
        return f"{self.type_name} : ARRAY [{self.first}..{self.last}] OF {element};"

    @property
    def declaration(self) -> str:
        """The declaration of the array."""
        return f"{self.name} : {self.type_name};"


def areas(codec: Codec) -> tuple[Area, ...]:
    """Return every table of the map."""
    commanded = {point.table for command in codec.commands.values() for point in command.points}
    return tuple(
        Area(Table(table), min(span.start for span in spans), max(span.stop for span in spans) - 1, table in commanded)
        for table, spans in codec.served.items()
        if spans
    )


def cell(point: Point) -> str:
    """Return the array element that contains a point."""
    return f"{_ARRAYS[point.table]}[{point.address}]"


def literal(point: Point, raw: int) -> str:
    """Return a literal for a value of the cell that contains a point."""
    if point.table in BIT_TABLES:
        return "TRUE" if raw else "FALSE"
    return f"16#{raw & 0xFFFF:04X}"


def is_value(point: Point, raw: int) -> str:
    """Return the condition that a cell has this value."""
    if point.table in BIT_TABLES:
        return cell(point) if raw else f"NOT {cell(point)}"
    return f"({cell(point)} = {literal(point, raw)})"


def assign(values: Mapping[Point, int]) -> Iterator[str]:
    """Yield the statements that assign these values to their cells."""
    for point, raw in values.items():
        yield f"{cell(point)} := {literal(point, raw)};"


def seconds(time_s: float) -> str:
    """Return a time literal, such as T#500ms."""
    milliseconds = round(time_s * 1000)
    return f"T#{milliseconds // 1000}s" if milliseconds % 1000 == 0 else f"T#{milliseconds}ms"


def comment(text: str) -> str:
    """Return text as one comment for any PLC editor: plain ASCII, without comment delimiters inside."""
    plain = text.encode("ascii", "replace").decode().replace("(*", "( *").replace("*)", "* )")
    return "(* " + " ".join(plain.split()) + " *)"
