"""From points to few block reads: pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from register_maps.address import space
from register_maps.codec import Block, Codec, Point
from register_maps.words import BIT_TABLES


class PlanError(ValueError):
    """A point lies outside what the device serves."""


def polled(codec: Codec) -> list[Point]:
    """List what a poll has to read: every signal and, of a device that only takes commands, one output.

    Without that, a device that is switched off would be missed only by the next command.
    """
    points = list(codec.signal_points)
    seen = {point.endpoint for point in points}
    for command in codec.commands.values():
        for point in command.read_points:
            if point.endpoint not in seen:
                seen.add(point.endpoint)
                points.append(point)
    return points


def plan_reads(
    points: Iterable[Point],
    served: Mapping[str, tuple[range, ...]],
    *,
    max_registers: int,
    max_bits: int,
) -> tuple[Block, ...]:
    """Cover the points with as few reads as the served ranges and the request limits allow.

    A gap inside a served range is read along: even the longest read costs a controller less than a second round trip.
    Raises PlanError for a point that no served range holds.
    """
    blocks: list[Block] = []
    for endpoint, table, address in sorted({point.cell for point in points}):
        limit = max_bits if table in BIT_TABLES else max_registers
        last = blocks[-1] if blocks else None
        span = _span(served, space(endpoint, table), address)
        if (
            last is not None
            and (last.endpoint, last.table) == (endpoint, table)
            and last.start in span
            and address - last.start < limit
        ):
            blocks[-1] = Block(table, last.start, address - last.start + 1, endpoint)
        else:
            blocks.append(Block(table, address, 1, endpoint))
    return tuple(blocks)


def _span(served: Mapping[str, tuple[range, ...]], where: str, address: int) -> range:
    for span in served.get(where, ()):
        if address in span:
            return span
    raise PlanError(f"{where} {address} (address on the wire) is not in a served range")
