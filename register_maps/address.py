"""Parses addresses as written in a map into places on the wire.

Plain addresses name the table and the number that the source prints (`holding:12`, `coil:0x20`, `input:7.3`). Modicon numbers
carry the table in their first digit (`40013`), and the letters of a PLC (`X17`, `%QX0.3`) are looked up in a preset.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from register_maps.presets import PRESETS, load_preset
from register_maps.words import BIT_TABLES, Table

if TYPE_CHECKING:
    from register_maps.schema import Addressing

MODICON = "modicon"
"""Tables by first digit, numbers from 1 (Modicon reference guide; five digits, or six where 9999 are too few)."""

HIGHEST = 0xFFFF
"""On the wire (Modbus Application Protocol V1.1b3, 4.4)."""

_ENDPOINT = re.compile(r"(?:(?P<endpoint>[a-z0-9]+(?:-[a-z0-9]+)*)/)?(?P<rest>.*)", re.DOTALL)
_PLAIN = re.compile(
    r"(?P<table>coil|discrete|holding|input):(?P<number>0[xX][0-9a-fA-F]+|[0-9]+)(?:\.(?P<bit>[0-9]+))?"
)
_DIGITS = re.compile(r"(?P<digit>[0134])(?P<number>[0-9]{4,5})(?:\.(?P<bit>[0-9]+))?")
_MODICON_TABLES = {"0": Table.COIL, "1": Table.DISCRETE, "3": Table.INPUT, "4": Table.HOLDING}
_MODICON_DIGITS: Mapping[Table, int] = {table: int(digit) for digit, table in _MODICON_TABLES.items()}


@dataclass(frozen=True, slots=True)
class Place:
    """One address: as printed, and as it is on the wire."""

    text: str
    endpoint: str
    """Name of the endpoint; empty for the controller itself."""
    table: Table
    number: int
    """On the wire; below 0 or above 65535 where the printed number is out of range."""
    bit: int | None

    @property
    def space(self) -> str:
        """Key of the table in register images: the table itself, or `endpoint/table`."""
        return space(self.endpoint, self.table)


@cache
def space(endpoint: str, table: Table) -> str:
    """Return the key of one table of one endpoint; for the controller's own tables just the table."""
    return f"{endpoint}/{table}" if endpoint else table


def parse(text: str, addressing: Addressing, elsewhere: Mapping[str, Addressing] | None = None) -> Place:
    """Read one address of a map; `elsewhere` has the addressing of endpoints that differ from the map's.

    Raises ValueError with the form that is expected.
    """
    match = _ENDPOINT.fullmatch(text)
    endpoint, rest = (match["endpoint"] or "", match["rest"]) if match else ("", text)
    addressing = (elsewhere or {}).get(endpoint, addressing)
    if addressing.notation is None:
        table, number, bit = _plain(rest, addressing.base or 0)
    elif addressing.notation == MODICON:
        table, number, bit = _modicon(rest)
    elif _PLAIN.fullmatch(rest):
        table, number, bit = _plain(rest, 0)
    else:
        table, number, bit = load_preset(addressing.notation).find(rest)
    if bit is not None and (table in BIT_TABLES or bit > 15):
        raise ValueError(f"{text!r}: a bit number (0 to 15) belongs to a holding or input register")
    return Place(text, endpoint, table, number, bit)


def served_number(table: Table, printed: int, addressing: Addressing) -> int:
    """Return the address on the wire of a number under `served`; with a preset they are the same."""
    if addressing.notation == MODICON:
        digit = _MODICON_DIGITS[table]
        six = digit * 100_000
        return printed - (six if printed > six and digit else digit * 10_000) - 1
    return printed - (addressing.base or 0)


def notations() -> tuple[str, ...]:
    """Return every value that `notation` may have."""
    return (MODICON, *PRESETS)


def _plain(text: str, base: int) -> tuple[Table, int, int | None]:
    match = _PLAIN.fullmatch(text)
    if match is None:
        raise ValueError(
            f"{text!r} is not an address: write table:number or table:number.bit, such as holding:12 or holding:12.4"
            + ("; a table that prints its numbers like this has `notation: modicon`" if _DIGITS.fullmatch(text) else "")
        )
    bit = None if match["bit"] is None else int(match["bit"])
    number = match["number"]  # 05 is 5: tables are printed with leading zeros
    return Table(match["table"]), int(number, 16 if number[:2] in ("0x", "0X") else 10) - base, bit


def _modicon(text: str) -> tuple[Table, int, int | None]:
    match = _DIGITS.fullmatch(text)
    if match is None:
        raise ValueError(
            f"{text!r} is not a Modicon address: write five or six digits, the first of them 0, 1, 3 or 4, such as 40013"
        )
    bit = None if match["bit"] is None else int(match["bit"])
    return _MODICON_TABLES[match["digit"]], int(match["number"]) - 1, bit
