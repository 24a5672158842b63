"""Points, blocks and values: the types that all codecs share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from register_maps.address import space
from register_maps.words import BIT_TABLES, Door, Mode, Motion, Table

Value = bool | int | Door | Mode | Motion | frozenset[int] | None
"""A decoded signal. Floors are their codes; None is "no floor" or "not known"."""

Image = Mapping[str, list[int]]
"""Register contents by space (`coil`, or `endpoint/coil`), indexed by wire address; bits are 0 or 1."""


class Unlisted(Enum):
    """The value of a code that no table lists."""

    UNLISTED = "unlisted"


UNLISTED = Unlisted.UNLISTED


@dataclass(frozen=True, slots=True, order=True)
class Point:
    """One place in the registers, by its address on the wire."""

    table: Table
    address: int
    low: int = 0
    """Lowest bit inside a register."""
    width: int = 1
    """Bits: 1 in a bit table, up to 16 in a register."""
    endpoint: str = ""
    """Which device; empty for the controller itself."""

    @property
    def is_whole(self) -> bool:
        """Whether the point fills its address."""
        return self.table in BIT_TABLES or self.width == 16

    @property
    def mask(self) -> int:
        """Its bits, moved down to the lowest."""
        return (1 << self.width) - 1

    @property
    def space(self) -> str:
        """The key of its table in an image."""
        return space(self.endpoint, self.table)

    @property
    def cell(self) -> Cell:
        """The cell it is part of."""
        return self.endpoint, self.table, self.address

    def within(self, cell: int) -> int:
        """Return its own bits from the content of its address."""
        return cell >> self.low & self.mask

    def into(self, cell: int, value: int) -> int:
        """Return the content of its address with a value put in; neighbouring bits are kept."""
        mask = self.mask
        return cell & ~(mask << self.low) | (value & mask) << self.low


Cell = tuple[str, Table, int]
"""Endpoint, table and address of one register or bit."""


@dataclass(frozen=True, slots=True, order=True)
class Block:
    """Adjacent addresses of one table, read or written by one request."""

    table: Table
    start: int
    count: int
    endpoint: str = ""

    def holds(self, point: Point) -> bool:
        """Whether the point lies in this block."""
        return (
            point.table is self.table
            and point.endpoint == self.endpoint
            and self.start <= point.address < self.start + self.count
        )

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Every address in it."""
        return tuple([(self.endpoint, self.table, address) for address in range(self.start, self.start + self.count)])
