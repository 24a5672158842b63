"""Compiles a map: every signal and command at its address on the wire, for one lift.

Driver and simulator share this module, so their agreement proves nothing: the golden vectors in the tests are typed from
each map's source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import or_

from register_maps.arbitration import ArbitrationCodec, arbitration_codec
from register_maps.command_codec import CommandCodec, Written, command_codec
from register_maps.points import UNLISTED, Block, Cell, Image, Point, Unlisted, Value
from register_maps.schema import RegisterMap
from register_maps.signal_codec import SignalCodec, signal_codec
from register_maps.vocabulary import LAMPS
from register_maps.words import BIT_TABLES, Table

__all__ = [
    "UNLISTED",
    "Block",
    "Cell",
    "Codec",
    "CommandCodec",
    "Image",
    "Point",
    "Reader",
    "SignalCodec",
    "Unlisted",
    "Value",
    "compile_map",
]


@dataclass(frozen=True, slots=True, eq=False)
class Codec:
    """A compiled map: signals and commands at their addresses on the wire.

    It is equal only to itself: what is derived from it can be kept for all lifts that share it.
    """

    map: RegisterMap
    signals: Mapping[str, SignalCodec]
    commands: Mapping[str, CommandCodec]
    served: Mapping[str, tuple[range, ...]]
    """Wire addresses that each device answers for, by space (`coil`, or `endpoint/coil`)."""
    offset: Mapping[Table, int]
    """Offset of each table of the controller."""
    written: tuple[Written, ...] = ()
    """Blocks that are always written as a whole."""
    arbitration: ArbitrationCodec | None = None
    """What each write carries where the controller decides whom it obeys."""
    _layouts: dict[tuple[Block, ...], _Layout] = field(default_factory=dict, compare=False, repr=False)
    """Where the signals lie in a poll, by its blocks: lifts that are read alike share it."""

    @property
    def signal_points(self) -> tuple[Point, ...]:
        """Every point a poll has to read."""
        return tuple(point for signal in self.signals.values() for point in signal.points)

    def reader(self, blocks: Sequence[Block]) -> Reader:
        """Return a decoder for polls that read these blocks in this order."""
        read = tuple(blocks)
        if read not in self._layouts:
            self._layouts[read] = _layout(tuple(self.signals.values()), read)
        return Reader(self._layouts[read])

    def empty_image(self) -> dict[str, list[int]]:
        """Return a register image of zeros for all served addresses."""
        return {space: [0] * max((r.stop for r in ranges), default=0) for space, ranges in self.served.items()}


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where each signal's bits lie in a poll, read as one number; the lists go together."""

    names: list[str]
    decode: list[Callable[[int], Value | Unlisted]]
    places: list[list[tuple[int, int, int]]]
    """Shift there, mask, shift in the raw integer; for each point of a signal."""
    masks: list[int]
    """Which bits of a poll are each signal's."""
    _others: dict[str, int] = field(default_factory=dict)

    def others(self, signal: str) -> int:
        """Return which bits of a poll are those of the other signals."""
        if signal not in self._others:
            masks = zip(self.names, self.masks, strict=True)
            self._others[signal] = reduce(or_, (mask for name, mask in masks if name != signal), 0)
        return self._others[signal]


class Reader:
    """Turns the payloads of polls into values; decodes only what has changed."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_bits", "_layout", "_payloads", "unlisted", "values")

    def __init__(self, layout: _Layout) -> None:
        """Begin without a poll."""
        self._layout = layout
        self._payloads: tuple[bytes, ...] = ()
        self._bits = 0
        """The payloads, joined and read as one number."""
        self.values: dict[str, Value] = {}
        """By signal name; replaced, never mutated, so that references to an older one stay valid."""
        self.unlisted: dict[str, int] = {}
        """Raw integers that no table lists, by signal name; their value is None."""

    def feed(self, payloads: tuple[bytes, ...]) -> frozenset[str] | None:
        """Take one poll. Returns the names of the signals that changed, or None when no byte did."""
        if payloads == self._payloads:
            return None
        bits = int.from_bytes(b"".join(payloads), "big")
        differ = bits ^ self._bits if self._payloads else -1
        changed: dict[str, Value] = {}
        unlisted, layout = self.unlisted, self._layout
        for index in [index for index, mask in enumerate(layout.masks) if mask & differ]:
            raw = 0
            for shift, mask, to in layout.places[index]:
                raw |= (bits >> shift & mask) << to
            name = layout.names[index]
            value = layout.decode[index](raw)
            if isinstance(value, Unlisted):
                unlisted = unlisted | {name: raw}
                value = None
            elif name in unlisted:
                unlisted = {key: old for key, old in unlisted.items() if key != name}
            changed[name] = value
        self._payloads, self._bits = payloads, bits
        self.unlisted = unlisted
        if changed:
            self.values = self.values | changed
        return frozenset(changed)

    def repeats(self, payload: bytes) -> bool:
        """Whether a poll of one block is the same as the newest one."""
        return self._payloads == (payload,)

    def differs_only_in(self, signal: str, payload: bytes) -> bool:
        """Whether a poll of one block differs from the newest one in this signal at the most."""
        differ = int.from_bytes(payload, "big") ^ self._bits
        return len(self._payloads) == 1 and not differ & self._layout.others(signal)

    def raw(self) -> dict[str, int]:
        """Return every signal's raw integer in the newest poll, before scale and table; empty before the first."""
        if not self._payloads:
            return {}
        bits = self._bits
        return {
            name: reduce(or_, ((bits >> shift & mask) << to for shift, mask, to in places))
            for name, places in zip(self._layout.names, self._layout.places, strict=True)
        }


def compile_map(source: RegisterMap, *, offset: Mapping[Table, int] | None = None) -> Codec:
    """Compile a checked map; `offset` moves every address of a table of the controller, for one lift of several on it."""
    shift: dict[str, int] = {table.value: moved for table, moved in (offset or {}).items()}

    def locate(text: str, width: int = 16, low: int = 0) -> Point:
        place = source.place(text)
        address = place.number + (0 if place.endpoint else shift.get(place.table, 0))
        if place.table in BIT_TABLES:
            return Point(place.table, address, endpoint=place.endpoint)
        low, width = (low, width) if place.bit is None else (place.bit, 1)
        return Point(place.table, address, low, width, place.endpoint)

    signals = {name: signal_codec(name, spec, locate) for name, spec in source.signals.items()}
    written = tuple(
        (Block(point.table, point.address, block.count, point.endpoint), block.function, block.every_s)
        for block in source.write_blocks
        for point in (locate(block.at),)
    )
    lamps = frozenset(point for name in LAMPS if name in signals for point in signals[name].points)
    commands = {name: command_codec(name, spec, locate, written, lamps) for name, spec in source.commands.items()}
    served = {
        space: tuple(range(span.start + shift.get(space, 0), span.stop + shift.get(space, 0)) for span in spans)
        for space, spans in source.served_wire.items()
    }
    arbitration = None if source.arbitration is None else arbitration_codec(source.arbitration, locate)
    return Codec(source, signals, commands, served, offset or {}, written, arbitration)


def _layout(signals: tuple[SignalCodec, ...], blocks: tuple[Block, ...]) -> _Layout:
    """Return where the bits of these signals lie in a poll of these blocks."""
    places = [_places(signal, blocks) for signal in signals]
    return _Layout(
        [signal.name for signal in signals],
        [signal.decode for signal in signals],
        places,
        [reduce(or_, (mask << shift for shift, mask, _ in bits)) for bits in places],
    )


def _places(signal: SignalCodec, blocks: tuple[Block, ...]) -> list[tuple[int, int, int]]:
    """Return where one signal's bits lie, as `_Layout.places` has it. Raises ValueError where no block covers a point."""
    lengths = [(block.count + 7) // 8 if block.table in BIT_TABLES else 2 * block.count for block in blocks]
    places, to = [], 0
    for point in signal.points:
        index = next((i for i, block in enumerate(blocks) if block.holds(point)), None)
        if index is None:
            raise ValueError(f"{signal.name}: no block read covers {point.table}:{point.address} on the wire")
        position = point.address - blocks[index].start
        if point.table in BIT_TABLES:
            byte, low = position >> 3, position & 7
        else:
            byte, low = 2 * position + 1, point.low
        shift = 8 * (sum(lengths[index:]) - 1 - byte) + low
        places.append((shift, (1 << point.width) - 1, to))
        to += point.width
    return places
