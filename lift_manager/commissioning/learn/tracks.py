"""A recording as tracks (one point over time) and moments (what the lift did when), the material of the analysis. Pure."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum, unique
from itertools import pairwise
from typing import Any

from lift_manager.commissioning.learn.samples import BlockReads, MarkKind, Recording
from register_maps.points import Point
from register_maps.words import BIT_TABLES, Table

FRESH_S = 1.5
"""A read this far from a moment still shows it. Chosen: a door needs two seconds, and a person half a second for ENTER."""
MIRROR_S = 0.5
"""Two points that differ for no longer than this mirror each other; they were read one after the other. Chosen."""
MOST_MISFITS_OF_CLASS = 0.25
MOST_MISFITS = 0.1
"""Of the moments, if a point is to be considered all the same: people press ENTER too late now and then."""


@unique
class Confidence(StrEnum):
    """How far a proposal can be trusted."""

    SURE = "sure"
    LIKELY = "likely"
    NOT_SURE = "not sure"

    def at_most(self, limit: Confidence) -> Confidence:
        """Return the less sure of two."""
        ranked = list(Confidence)
        return max(self, limit, key=ranked.index)


@dataclass(frozen=True, slots=True)
class Proposal:
    """One signal of the draft."""

    signal: str
    confidence: Confidence
    spec: dict[str, Any]
    """Its entry in the map."""
    reasons: tuple[str, ...]
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Moment:
    """What the lift did at one mark."""

    at_s: float
    kind: MarkKind
    floor: str
    """Where the car stands; empty while it moves, and where that is not known."""
    direction: int
    """1 up, -1 down; 0 if the car stands, and where that is not known."""
    stand: int
    """The number of the stop; of a moving car, of the stop that it left last."""

    @property
    def stands(self) -> bool:
        """Whether the car stands."""
        return self.kind is not MarkKind.MOVING


def moments(recording: Recording) -> list[Moment]:
    """Return the marks of a recording with floor, direction and stop.

    A mark between two floors without a move in between belongs to the floor before it; one that follows a move, to the next.
    """
    height = {name: index for index, name in enumerate(recording.floors)}
    marks = sorted(recording.marks, key=lambda mark: mark.at_s)
    stand, floors, has_moved = 0, [""], False
    stands: list[int] = []
    for mark in marks:
        if mark.kind is MarkKind.MOVING:
            has_moved = True
        elif has_moved or (mark.floor and floors[stand] and mark.floor != floors[stand]):
            stand += 1
            floors.append("")
            has_moved = False
        if mark.floor:
            floors[stand] = mark.floor
        stands.append(stand)
    found = []
    for mark, number in zip(marks, stands, strict=True):
        direction = 0
        if mark.kind is MarkKind.MOVING:
            start, end = floors[number], floors[number + 1] if number + 1 < len(floors) else ""
            if start in height and end in height:
                direction = (height[end] > height[start]) - (height[end] < height[start])
        floor = "" if mark.kind is MarkKind.MOVING else floors[number]
        found.append(Moment(mark.at_s, mark.kind, floor, direction, number))
    return found


@dataclass(frozen=True, slots=True)
class Track:
    """One point over time."""

    points: tuple[Point, ...]
    """More than one for a code that is spread over several bits, lowest first, and for a 32-bit number, its low half first."""
    times: Sequence[float]
    values: Sequence[int]

    def at(self, at_s: float) -> int | None:
        """Return the value at a moment; None if nothing was read near it."""
        if (index := self.index_at(at_s)) is None:
            return None
        return self.values[index]

    def index_at(self, at_s: float) -> int | None:
        """Return the index of the read nearest to a moment, if it is near enough."""
        after = bisect_left(self.times, at_s)
        near = [index for index in (after - 1, after) if 0 <= index < len(self.times)]
        best = min(near, key=lambda index: abs(self.times[index] - at_s), default=None)
        return best if best is not None and abs(self.times[best] - at_s) <= FRESH_S else None

    def between(self, first_s: float, last_s: float) -> Sequence[int]:
        """Return the values read in a stretch of time."""
        return self.values[bisect_left(self.times, first_s) : bisect_left(self.times, last_s)]

    @property
    def distinct(self) -> frozenset[int]:
        """Every value it ever had."""
        return frozenset(self.values)

    @property
    def changes(self) -> int:
        """How often it changed."""
        return sum(a != b for a, b in pairwise(self.values))

    @property
    def is_bit(self) -> bool:
        """Whether it is a single bit."""
        return len(self.points) == 1 and self.points[0].width == 1

    @property
    def is_register(self) -> bool:
        """Whether it is one whole register."""
        return len(self.points) == 1 and self.points[0].width == 16

    @property
    def place(self) -> str:
        """Its address as the draft writes it."""
        return ", ".join(place(point) for point in self.points)

    def mapped(self, of: Callable[[int], int]) -> Track:
        """Return a track of the same points with other values."""
        return Track(self.points, self.times, [of(value) for value in self.values])


def bits_of(point: Point) -> Iterator[tuple[Table, int, int]]:
    """Yield every bit of a point."""
    return ((point.table, point.address, bit) for bit in range(point.low, point.low + point.width))


def place(point: Point) -> str:
    """Return a point as the draft writes it: `holding:5.1`, or with the bits of a field in words."""
    text = f"{point.table}:{point.address}"
    if point.table in BIT_TABLES or point.width == 16:
        return text
    return f"{text}.{point.low}" if point.width == 1 else f"{text} bits {point.low} to {point.low + point.width - 1}"


_PREFERENCE = {Table.DISCRETE: 0, Table.INPUT: 1, Table.HOLDING: 2, Table.COIL: 3}


def preference(track: Track) -> tuple[int, int, int]:
    """Return a key that puts read-only tables first, and lower addresses."""
    point = track.points[0]
    return _PREFERENCE[point.table], point.address, point.low


@dataclass(frozen=True, slots=True)
class Tracks:
    """Every point that ever changed."""

    binary: tuple[Track, ...]
    """Coils, discrete inputs, the bits of registers that changed, and whole registers that ever had two values only."""
    registers: tuple[Track, ...]
    fields: tuple[Track, ...]
    """Parts of registers, of two bits or more, that begin and end with a bit that changed."""
    pairs: tuple[Track, ...]
    """32-bit numbers of two adjacent registers, high half first."""

    def without(self, points: Iterable[Point]) -> Tracks:
        """Return the tracks that share no bit with these points."""
        used = {bit for point in points for bit in bits_of(point)}

        def keep(tracks: tuple[Track, ...]) -> tuple[Track, ...]:
            return tuple(
                track for track in tracks if used.isdisjoint(bit for point in track.points for bit in bits_of(point))
            )

        return Tracks(keep(self.binary), keep(self.registers), keep(self.fields), keep(self.pairs))


def tracks(blocks: Iterable[BlockReads]) -> Tracks:
    """Return the tracks of everything that changed."""
    bits: list[Track] = []
    registers: list[Track] = []
    pairs: list[Track] = []
    for block in blocks:
        times, rows = _columns(block)
        changed = [index for index, column in enumerate(rows) if len(set(column)) > 1]
        if block.table in BIT_TABLES:
            bits += [Track((Point(block.table, block.start + index),), times, rows[index]) for index in changed]
            continue
        registers += [Track((_register(block, index),), times, rows[index]) for index in changed]
        for high in sorted({index - 1 for index in changed if index} | {i for i in changed if i + 1 < block.count}):
            joined = [a << 16 | b for a, b in zip(rows[high], rows[high + 1], strict=True)]
            pairs.append(Track((_register(block, high + 1), _register(block, high)), times, joined))
    switches = [register for register in registers if _is_switch(register)]
    parts = [part for register in registers if register not in switches for part in _parts(register)]
    return Tracks(
        (*bits, *switches, *(part for part in parts if part.is_bit)),
        tuple(registers),
        tuple(part for part in parts if not part.is_bit),
        tuple(pairs),
    )


def _register(block: BlockReads, index: int) -> Point:
    return Point(block.table, block.start + index, 0, 16)


def _is_switch(register: Track) -> bool:
    """Whether a register as a whole has two values, and is not one bit among others: 0 and 1, 0 and 255, 1 and 2."""
    if len(register.distinct) != 2:
        return False
    low, high = sorted(register.distinct)
    return (low, high) == (0, 1) or (low ^ high).bit_count() > 1


def _columns(block: BlockReads) -> tuple[list[float], list[list[int]]]:
    times: list[float] = []
    columns: list[list[int]] = [[] for _ in range(block.count)]
    for at_s, values in block.each_read():
        times.append(at_s)
        for column, value in zip(columns, values, strict=True):
            column.append(value)
    return times, columns


def _parts(register: Track) -> Iterator[Track]:
    (point,) = register.points
    first = register.values[0]
    varying = 0
    for value in register.values:
        varying |= value ^ first
    ends = [bit for bit in range(16) if varying >> bit & 1]
    for low in ends:
        for high in ends:
            if high >= low and (low, high) != (0, 15):
                part = Point(point.table, point.address, low, high - low + 1)
                yield Track((part,), register.times, [part.within(value) for value in register.values])


def agree(one: Track, other: Track) -> bool:
    """Whether two tracks have equal values but for moments, so that one mirrors the other."""
    differ_since: float | None = None
    longest_s = 0.0
    for at_s, value in zip(one.times, one.values, strict=True):
        if (there := other.at(at_s)) is None or there == value:
            differ_since = None
        else:
            differ_since = at_s if differ_since is None else differ_since
            longest_s = max(longest_s, at_s - differ_since)
    return longest_s <= max(MIRROR_S, 2 * period_s(one), 2 * period_s(other))


def period_s(track: Track) -> float:
    """Return the usual time from one read of a track to the next."""
    gaps = sorted(b - a for a, b in pairwise(track.times))
    return gaps[len(gaps) // 2] if gaps else 0.0


def same_meaning(one: Track, other: Track) -> bool:
    """Whether two tracks show the same in codes of their own, such as a bit and its inverse."""
    together: dict[int, dict[int, int]] = {}
    for at_s, value in zip(one.times, one.values, strict=True):
        if (there := other.at(at_s)) is not None:
            counts = together.setdefault(value, {})
            counts[there] = counts.get(there, 0) + 1
    to = {value: max(counts, key=lambda there: counts[there]) for value, counts in together.items()}
    return len(set(to.values())) == len(to) and agree(one.mapped(lambda value: to.get(value, -1)), other)


def share_of(track: Track, value: int) -> float:
    """Return for which share of its reads a track has a value."""
    return sum(found == value for found in track.values) / max(1, len(track.values))


@dataclass(frozen=True, slots=True)
class Fit:
    """How well a track shows two or more classes of moments: one value in each."""

    value_of: dict[Hashable, int]
    misfits: tuple[Moment, ...] = ()

    def merged(self, groups: Mapping[Hashable, Hashable]) -> Fit | None:
        """Return it with groups of classes that all have the same value; None if those of a group differ."""
        value_of: dict[Hashable, int] = {}
        for label, value in self.value_of.items():
            if value_of.setdefault(groups[label], value) != value:
                return None
        return Fit(value_of, self.misfits)


def fit(track: Track, classes: Iterable[tuple[Hashable, Moment]]) -> Fit | None:
    """Return the value of a track in each class of moments; None if it has not one value in each, but for a few misfits."""
    observed: dict[Hashable, dict[int, list[Moment]]] = {}
    total = 0
    for label, moment in classes:
        if (value := track.at(moment.at_s)) is not None:
            observed.setdefault(label, {}).setdefault(value, []).append(moment)
            total += 1
    value_of: dict[Hashable, int] = {}
    misfits: list[Moment] = []
    for label, by_value in observed.items():
        best = max(by_value, key=lambda value: len(by_value[value]))
        value_of[label] = best
        misfits += [moment for value, found in by_value.items() if value != best for moment in found]
        others = sum(len(found) for value, found in by_value.items() if value != best)
        if others > MOST_MISFITS_OF_CLASS * (others + len(by_value[best])):
            return None
    if len(misfits) > MOST_MISFITS * total:
        return None
    return Fit(value_of, tuple(misfits))


STANDS: Mapping[Hashable, Hashable] = {kind: kind is not MarkKind.MOVING for kind in MarkKind}
"""Whether the car stands, by the kind of a moment."""
OPEN: Mapping[Hashable, Hashable] = {kind: kind is MarkKind.OPEN for kind in MarkKind}
"""Whether the door is open, by the kind of a moment."""


def fit_kinds(track: Track, observed: Iterable[Moment], groups: Mapping[Hashable, Hashable]) -> Fit | None:
    """Return the value of a track in two groups of kinds of moments; None if it has not one value in each, or the same in both."""
    fitting = fit(track, ((moment.kind, moment) for moment in observed))
    merged = None if fitting is None else fitting.merged(groups)
    return merged if merged is not None and len(set(merged.value_of.values())) == 2 else None
