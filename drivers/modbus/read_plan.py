"""Plans few block reads that cover many points. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from register_maps.address import space
from register_maps.codec import Block, Codec, Point
from register_maps.words import BIT_TABLES

_CAR = ("car_floor", "motion", "level")
"""Signals about where the car is, and whether it stands."""


class PlanError(ValueError):
    """A point lies outside what the device serves."""


def polled_points(codec: Codec) -> list[Point]:
    """Return the points of a poll: every signal and, of a device that only takes commands, one output.

    Without the output, a device that is switched off would be noticed only at the next command.
    """
    points = list(codec.signal_points)
    endpoints = {point.endpoint for point in points}
    for command in codec.commands.values():
        for point in command.read_points:
            if point.endpoint not in endpoints:
                endpoints.add(point.endpoint)
                points.append(point)
    return points


def plan_poll(codec: Codec, *, max_registers: int, max_bits: int) -> tuple[Block, ...]:
    """Return the blocks of a poll in reading order: doors before floor, motion and level.

    If these take several reads, and two polls in a row agree, then an open door was read between two readings of a car that
    stands at the floor. The other way round the car may have departed when the door is read, and be open at the next floor.
    """
    blocks = plan_reads(polled_points(codec), codec.served, max_registers=max_registers, max_bits=max_bits)
    doors = [point for name, signal in codec.signals.items() if name.startswith("door.") for point in signal.points]
    car = [point for name in _CAR if name in codec.signals for point in codec.signals[name].points]
    if any(all(map(block.holds, doors + car)) for block in blocks):
        return blocks
    return tuple(sorted(blocks, key=lambda block: (not any(map(block.holds, doors)), any(map(block.holds, car)))))


def plan_reads(
    points: Iterable[Point],
    served: Mapping[str, tuple[range, ...]],
    *,
    max_registers: int,
    max_bits: int,
) -> tuple[Block, ...]:
    """Cover the points with as few reads as the served ranges and the request limits allow.

    A gap inside a served range is read too: even the longest read costs a controller less than a second round trip.
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
