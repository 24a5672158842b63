"""From points to few block reads: pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from register_maps.codec import Block, Point
from register_maps.words import BIT_TABLES, Table


class PlanError(ValueError):
    """A point lies outside what the device serves."""


def plan_reads(
    points: Iterable[Point],
    served: Mapping[Table, tuple[range, ...]],
    *,
    max_registers: int,
    max_bits: int,
) -> tuple[Block, ...]:
    """Cover the points with as few reads as the served ranges and the request limits allow.

    A gap inside a served range is read along: even the longest read costs a controller less than a second round trip.
    Raises PlanError for a point that no served range holds.
    """
    blocks: list[Block] = []
    for table, address in sorted({(point.table, point.address) for point in points}):
        limit = max_bits if table in BIT_TABLES else max_registers
        last = blocks[-1] if blocks else None
        span = _span(served, table, address)
        if last is not None and last.table is table and last.start in span and address - last.start < limit:
            blocks[-1] = Block(table, last.start, address - last.start + 1)
        else:
            blocks.append(Block(table, address, 1))
    return tuple(blocks)


def _span(served: Mapping[Table, tuple[range, ...]], table: Table, address: int) -> range:
    for span in served.get(table, ()):
        if address in span:
            return span
    raise PlanError(f"{table} {address} (address on the wire) is not in a served range")
