"""How the program writes down addresses, values and times: one array per Modbus table, indexed as on the wire."""

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
    """Lowest and highest address on the wire."""
    last: int
    commanded: bool
    """Whether the manager writes into it."""

    @property
    def name(self) -> str:
        return _ARRAYS[self.table]

    @property
    def type_name(self) -> str:
        """Name of its type: a caller has to declare the same one, and two arrays without a name are never of one type."""
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
    """Return every table that the map serves."""
    commanded = {point.table for command in codec.commands.values() for point in command.points}
    return tuple(
        Area(Table(table), min(span.start for span in spans), max(span.stop for span in spans) - 1, table in commanded)
        for table, spans in codec.served.items()
        if spans
    )


def cell(point: Point) -> str:
    """Write down the element of the array in which a point lies."""
    return f"{_ARRAYS[point.table]}[{point.address}]"


def literal(point: Point, raw: int) -> str:
    """Write down a value of the cell in which a point lies."""
    if point.table in BIT_TABLES:
        return "TRUE" if raw else "FALSE"
    return f"16#{raw & 0xFFFF:04X}"


def is_value(point: Point, raw: int) -> str:
    """Write down the condition that a cell holds this value."""
    if point.table in BIT_TABLES:
        return cell(point) if raw else f"NOT {cell(point)}"
    return f"({cell(point)} = {literal(point, raw)})"


def assign(values: Mapping[Point, int]) -> Iterator[str]:
    """Write down the statements that put these values into their cells."""
    for point, raw in values.items():
        yield f"{cell(point)} := {literal(point, raw)};"


def seconds(time_s: float) -> str:
    """Write down a time, such as T#500ms."""
    milliseconds = round(time_s * 1000)
    return f"T#{milliseconds // 1000}s" if milliseconds % 1000 == 0 else f"T#{milliseconds}ms"


def comment(text: str) -> str:
    """Write text so that any PLC editor takes it as one comment: plain ASCII, and no end of a comment inside."""
    plain = text.encode("ascii", "replace").decode().replace("(*", "( *").replace("*)", "* )")
    return "(* " + " ".join(plain.split()) + " *)"
