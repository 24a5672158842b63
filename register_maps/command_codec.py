"""Compiles commands into the bits on the wire that press and release them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from register_maps.points import Block, Cell, Image, Point
from register_maps.schema import CALLS, Command
from register_maps.signal_codec import Locate, floor_entry, from_bcd, highest_bcd, swap_bytes, to_bcd
from register_maps.words import BIT_TABLES, Table

Stamp = tuple[tuple[Cell, int, int], ...]
"""What a command puts into its cells: each cell with the bits that it leaves alone, and those that it sets."""

Written = tuple[Block, int, float | None]
"""A block that is always written as a whole: (block, function, seconds of its cycle if it has one)."""


@dataclass(frozen=True, slots=True)
class CommandCodec:
    """One command: the points it owns and what is written to them."""

    name: str
    spec: Command
    points: tuple[Point, ...]
    read_points: tuple[Point, ...]
    """Where each point is read back; none for a command that the device ends by itself."""
    blocks: tuple[Block, ...]
    """What one write of this command covers: its own cells, or the whole block they are always written with."""
    functions: tuple[int, ...]
    """Write function per block: 5, 6, 15, 16, or 22 for some bits of a register."""
    is_shared: bool = False
    """It occupies some bits of a register in which others write too."""
    shows_lamp: bool = False
    """The controller shows its answer at the same points: they read what is registered, not what we write."""
    _stamps: dict[int | None, Stamp] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Those of every code so far, except of a heartbeat, which has too many."""

    @property
    def endpoint(self) -> str:
        """The device it is written to; of a call spread over several, the one of its lowest floor."""
        return self.points[0].endpoint

    @property
    def is_call(self) -> bool:
        """Whether it carries a floor."""
        return self.name in CALLS

    @property
    def is_timed_coil(self) -> bool:
        """Whether it writes a number to a coil: the duration of a pulse that the device times."""
        return self.points[0].table is Table.COIL and self.spec.payload is not None

    def encode(self, code: int | None) -> dict[Point, int]:
        """Return the values of its points that press the command; those that release it for None.

        `code` is the floor code of a call and the count of a heartbeat; other commands ignore it. Raises ValueError for a
        floor code that this coding cannot express.
        """
        spec = self.spec
        if spec.one_of is not None:
            pressed = None if code is None else floor_entry(self.name, spec.floor_codes, code)
            return {point: int(index == pressed) for index, point in enumerate(self.points)}
        point = self.points[0]
        value = self._value(code)
        return {point: (swap_bytes(value & 0xFFFF) if spec.byte_order == "low_first" else value) & point.mask}

    def stamp(self, code: int | None) -> Stamp:
        """Return what `encode` returns, as it is put into the cells of its points."""
        if (known := self._stamps.get(code)) is None:
            known = stamp(self.encode(code))
            if not self.spec.is_heartbeat:
                self._stamps[code] = known
        return known

    def _value(self, code: int | None) -> int:
        """Return what its one point holds, as its source counts it."""
        spec = self.spec
        if code is None:
            return spec.rest
        if spec.is_heartbeat:
            return code
        if spec.payload is not None:
            return payload_counts(spec)
        return spec.on if spec.as_ is None else _checked_code(self.name, code, spec)

    def decode(self, image: Image) -> int | None:
        """Return what a register image commands: a floor code, a count, 1 for on, None for rest or an invalid value."""
        spec = self.spec
        raw = [point.within(image[point.space][point.address]) for point in self.points]
        if spec.one_of is not None:
            return spec.floor_codes[raw.index(1)] if raw.count(1) == 1 and sum(raw) == 1 else None
        value = swap_bytes(raw[0]) if spec.byte_order == "low_first" else raw[0]
        value = value - 0x10000 if spec.type == "int16" and value & 0x8000 else value
        if spec.is_heartbeat:
            return value
        if value == spec.rest:
            return None
        if spec.as_ is not None:
            return from_bcd(value) if spec.code == "bcd" else value
        return 1 if spec.payload is not None or value == spec.on else None


def stamp(values: Mapping[Point, int]) -> Stamp:
    """Return values of points as they are put into their cells."""
    return tuple((point.cell, ~(point.mask << point.low), point.into(0, value)) for point, value in values.items())


def payload_counts(spec: Command) -> int:
    """Return the time that a command writes, in the counts of its register."""
    if spec.payload is None:
        raise ValueError("the command writes no time")
    seconds = spec.width_s if spec.payload.time == "width_s" else spec.max_hold_s
    return round((seconds or 0.0) / spec.payload.unit_s)


def command_codec(
    name: str, spec: Command, locate: Locate, written: Sequence[Written], lamps: frozenset[Point]
) -> CommandCodec:
    """Compile one command; `written` are the blocks of the map, `lamps` the points that show registered calls."""
    points = tuple(locate(address) for address in spec.addresses)
    read_points = tuple(locate(address) for _, address in spec.keyed_read_addresses) or points
    if spec.ends_itself or spec.is_heartbeat:
        read_points = ()
    blocks: dict[Block, int] = {}
    for point in points:
        block, function = next(
            ((block, function) for block, function, _ in written if block.holds(point)),
            (Block(point.table, point.address, 1, point.endpoint), _function(point, spec)),
        )
        blocks[block] = function
    return CommandCodec(
        name,
        spec,
        points,
        read_points,
        tuple(blocks),
        tuple(blocks.values()),
        is_shared=spec.shared_word in ("accepted", "mask_write"),
        shows_lamp=bool(lamps & set(read_points)),
    )


def _function(point: Point, spec: Command) -> int:
    if point.table in BIT_TABLES:
        return 5
    return 22 if spec.shared_word == "mask_write" else 6


def _checked_code(name: str, code: int, spec: Command) -> int:
    low, high = (-32768, 32767) if spec.type == "int16" else (0, highest_bcd(16)) if spec.code == "bcd" else (0, 65535)
    if not low <= code <= high:
        counting = "BCD" if spec.code == "bcd" else spec.type
        raise ValueError(f"{name} writes {counting}, {low} to {high}; floor code {code} does not fit")
    value = to_bcd(code, 16) if spec.code == "bcd" else code
    if value == spec.rest and not spec.ends_itself:
        raise ValueError(f"{name} rests at {spec.rest}, so a release would call a floor with that code")
    return value
