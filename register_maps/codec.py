"""Words and bits on the wire, to and from values; compiled once per map and lift.

Every signal becomes one integer (`raw`): a word, a field of bits, or several bits side by side. A table or a rule turns that
integer into a value and back. Driver and simulator share this module, so their agreement proves nothing; the golden
vectors in the tests are typed from each map's source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import reduce
from operator import or_

from register_maps.schema import SIGNALS, WORDS, Command, Kind, RegisterMap, Signal
from register_maps.words import BIT_TABLES, Door, Mode, Motion, Table

Value = bool | int | Door | Mode | Motion | None
"""A decoded signal. Floors are their codes; None is "no floor" or "not known"."""

Image = Mapping[Table, list[int]]
"""Register contents by table, indexed by wire address; bits are 0 or 1."""


class Unlisted(Enum):
    """The one value that no table lists."""

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

    @property
    def whole(self) -> bool:
        """Whether the point is all there is at its address."""
        return self.table in BIT_TABLES or self.width == 16


@dataclass(frozen=True, slots=True)
class Block:
    """Adjacent addresses of one table, read or written by one request."""

    table: Table
    start: int
    count: int

    def holds(self, point: Point) -> bool:
        """Whether the point lies in this block."""
        return point.table is self.table and self.start <= point.address < self.start + self.count


@dataclass(frozen=True, slots=True)
class SignalCodec:
    """One signal: where it is, and what its raw integer means."""

    name: str
    kind: Kind
    points: tuple[Point, ...]
    """Lowest bits of the raw integer first."""
    decode: Callable[[int], Value | Unlisted]
    encode: Callable[[Value], int]
    """Raises ValueError for a value this signal cannot say."""

    def extract(self, image: Image) -> int:
        """Read the raw integer out of a register image."""
        raw = shift = 0
        for point in self.points:
            raw |= (image[point.table][point.address] >> point.low & (1 << point.width) - 1) << shift
            shift += point.width
        return raw

    def insert(self, image: Image, value: Value) -> None:
        """Write a value into a register image, leaving neighbouring bits alone."""
        raw = self.encode(value)
        for point in self.points:
            mask = (1 << point.width) - 1
            cells = image[point.table]
            cells[point.address] = cells[point.address] & ~(mask << point.low) | (raw & mask) << point.low
            raw >>= point.width


@dataclass(frozen=True, slots=True)
class CommandCodec:
    """One command: the cells it owns and what is written to them."""

    name: str
    spec: Command
    points: tuple[Point, ...]
    blocks: tuple[Block, ...]
    """What one write of this command covers: its own cells, or the whole block they are always written with."""
    functions: tuple[int, ...]
    """Write function per block: 5, 6, 15 or 16."""

    @property
    def is_call(self) -> bool:
        """Whether it carries a floor."""
        return self.spec.one_of is not None or self.spec.as_ is not None

    def encode(self, code: int | None) -> dict[tuple[Table, int], int]:
        """Cell contents that give the command; a floor code for `go_to`, ignored by others, None lets go.

        Raises ValueError for a floor code that this coding cannot express.
        """
        spec = self.spec
        if spec.one_of is not None:
            if code is not None and not 0 <= code < len(self.points):
                raise ValueError(
                    f"{self.name} has {len(self.points)} floors, with codes 0 to {len(self.points) - 1}; {code} is none of them"
                )
            return {(p.table, p.address): int(index == code) for index, p in enumerate(self.points)}
        point = self.points[0]
        if code is None:
            value = spec.rest
        elif spec.as_ is None:
            value = spec.on
        else:
            value = _checked_code(self.name, code, spec)
        return {(point.table, point.address): value & 0xFFFF if point.table is Table.HOLDING else value}

    def decode(self, image: Image) -> int | None:
        """What a register image asks for: a floor code, 1 for on, None for rest or nonsense."""
        spec = self.spec
        cells = [image[p.table][p.address] for p in self.points]
        if spec.one_of is not None:
            return cells.index(1) if cells.count(1) == 1 and sum(cells) == 1 else None
        value = _signed(cells[0]) if spec.type == "int16" else cells[0]
        if value == spec.rest:
            return None
        if spec.as_ is None:
            return 1 if value == spec.on else None
        return value


@dataclass(frozen=True, slots=True)
class Codec:
    """A compiled map: signals and commands at their addresses on the wire."""

    map: RegisterMap
    signals: Mapping[str, SignalCodec]
    commands: Mapping[str, CommandCodec]
    served: Mapping[Table, tuple[range, ...]]
    """Wire addresses the device answers for."""
    offset: Mapping[Table, int]
    """How far each table was moved."""

    @property
    def signal_points(self) -> tuple[Point, ...]:
        """Every point a poll has to read."""
        return tuple(point for signal in self.signals.values() for point in signal.points)

    def reader(self, blocks: Sequence[Block]) -> Reader:
        """Decoder for polls that read these blocks in this order."""
        return Reader(tuple(self.signals.values()), tuple(blocks))

    def empty_image(self) -> dict[Table, list[int]]:
        """A register image of zeros, large enough for everything served."""
        return {table: [0] * max((r.stop for r in ranges), default=0) for table, ranges in self.served.items()}


class Reader:
    """Turns the payloads of one poll into values; what did not change is not decoded again."""

    def __init__(self, signals: tuple[SignalCodec, ...], blocks: tuple[Block, ...]) -> None:
        """Work out once where each signal's bits lie in the blocks."""
        self._names = [signal.name for signal in signals]
        self._decode = [signal.decode for signal in signals]
        self._places = [_places(signal, blocks) for signal in signals]
        self._masks = [reduce(or_, (mask << shift for shift, mask, _ in places)) for places in self._places]
        """Which bits of a poll are each signal's."""
        self._payloads: tuple[bytes, ...] = ()
        self._bits = 0
        """The payloads, joined and taken for one number."""
        self.values: dict[str, Value] = {}
        """By signal name; replaced, never changed, so that a holder of an older one keeps what it saw."""
        self.unlisted: dict[str, int] = {}
        """Raw integers that no table lists, by signal name; their value is None."""

    def feed(self, payloads: tuple[bytes, ...]) -> frozenset[str] | None:
        """Take one poll. Returns the names of the signals that changed, or None when no byte did."""
        if payloads == self._payloads:
            return None
        bits = int.from_bytes(b"".join(payloads), "big")
        differ = bits ^ self._bits if self._payloads else -1
        changed: dict[str, Value] = {}
        unlisted = self.unlisted
        for index in [index for index, mask in enumerate(self._masks) if mask & differ]:
            raw = 0
            for shift, mask, to in self._places[index]:
                raw |= (bits >> shift & mask) << to
            name = self._names[index]
            value = self._decode[index](raw)
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


def compile_map(source: RegisterMap, *, offset: Mapping[Table, int] | None = None) -> Codec:
    """Compile a checked map; `offset` moves every address of a table, for one lift of several on a controller."""
    shift = offset or {}

    def place(text: str, width: int = 16, low: int = 0) -> Point:
        table, address, bit = source.wire_address(text)
        address += shift.get(table, 0)
        if table in BIT_TABLES:
            return Point(table, address)
        return Point(table, address, *((low, width) if bit is None else (bit, 1)))

    signals = {name: _signal(name, spec, place) for name, spec in source.signals.items()}
    written = [
        (Block(point.table, point.address, block.count), block.function)
        for block in source.write_blocks
        for point in (place(block.at),)
    ]
    commands = {name: _command(name, spec, place, written) for name, spec in source.commands.items()}
    served = {
        table: tuple(
            range(
                first - source.addressing.base + shift.get(table, 0),
                last + 1 - source.addressing.base + shift.get(table, 0),
            )
            for first, last in ranges
        )
        for table, ranges in source.served.items()
    }
    return Codec(source, signals, commands, served, shift)


def _signal(name: str, spec: Signal, place: Callable[..., Point]) -> SignalCodec:
    kind = SIGNALS[name]
    points: tuple[Point, ...]
    if spec.open_limit is not None and spec.closed_limit is not None:
        points = (place(spec.open_limit, 1), place(spec.closed_limit, 1))
        return SignalCodec(name, kind, points, *_limits(spec))
    if spec.one_of is not None:
        points = tuple(place(address, 1) for address in spec.one_of)
        return SignalCodec(name, kind, points, *_one_of(name, len(points)))
    low, high = spec.bits or (0, 15)
    point = place(spec.addresses[0], high - low + 1, low)
    return SignalCodec(name, kind, (point,), *_coding(name, kind, spec, point.width))


Coding = tuple[Callable[[int], Value | Unlisted], Callable[[Value], int]]


def _limits(spec: Signal) -> Coding:
    """Raw: bit 0 the open limit, bit 1 the closed limit. Both at once is a contradiction, hence a fault."""
    flip = 0b11 if spec.active == "low" else 0
    words = (Door.MOVING, Door.OPEN, Door.CLOSED, Door.FAULT)

    def encode(value: Value) -> int:
        raw = words.index(value) if isinstance(value, Door) and value in words else 0
        return raw ^ flip

    return lambda raw: words[raw ^ flip], encode


def _one_of(name: str, count: int) -> Coding:
    """Raw: one bit per floor. None set is no floor known; several contradict each other."""

    def decode(raw: int) -> Value | Unlisted:
        if raw == 0:
            return None
        return raw.bit_length() - 1 if raw & raw - 1 == 0 else UNLISTED

    def encode(value: Value) -> int:
        if value is None:
            return 0
        if not isinstance(value, int) or not 0 <= value < count:
            raise ValueError(f"{name} has {count} floors, with codes 0 to {count - 1}; {value} is none of them")
        return 1 << value

    return decode, encode


def _coding(name: str, kind: Kind, spec: Signal, width: int) -> Coding:
    match kind:
        case Kind.FLAG:
            return _flag(spec)
        case Kind.DOOR | Kind.MOTION | Kind.MODE:
            return _words(name, kind, spec, width)
        case Kind.FLOOR:
            return _floor(name, spec)
        case Kind.NUMBER | Kind.COUNTER:
            signed = spec.type == "int16"
            return (lambda raw: _signed(raw) if signed else raw), (lambda value: int(value or 0) & 0xFFFF)


def _flag(spec: Signal) -> Coding:
    flip = spec.active == "low"
    return (lambda raw: (raw != 0) is not flip), (lambda value: int(bool(value) is not flip))


def _words(name: str, kind: Kind, spec: Signal, width: int) -> Coding:
    word = WORDS[kind]
    table: dict[int, Value] = {}
    for code, text in (spec.values or {0: "closed", 1: "open"}).items():
        table[code & (1 << width) - 1] = word(text)  # type: ignore[assignment]  # Door, Motion and Mode are Values
    for code in spec.unknown:
        table[code & (1 << width) - 1] = None
    codes = {value: code for code, value in reversed(table.items())}

    def encode(value: Value) -> int:
        if value in codes:
            return codes[value]
        if value in (Door.OPENING, Door.CLOSING) and Door.MOVING in codes:
            return codes[Door.MOVING]
        raise ValueError(f"{name} has no code for {value}")

    if spec.active == "low" and width == 1:
        return (lambda raw: table.get(raw ^ 1, UNLISTED)), (lambda value: encode(value) ^ 1)
    return (lambda raw: table.get(raw, UNLISTED)), encode


def _floor(name: str, spec: Signal) -> Coding:
    signed = spec.type == "int16"
    nothing = frozenset(spec.unknown) | frozenset(spec.none)
    blank = next(iter((*spec.none, *spec.unknown)), None)

    def decode(raw: int) -> Value:
        code = _signed(raw) if signed else raw
        return None if code in nothing else code

    def encode(value: Value) -> int:
        code = blank if value is None else value
        if code is None:
            raise ValueError(f"{name} has no code for no floor")
        return int(code) & 0xFFFF

    return decode, encode


def _command(
    name: str, spec: Command, place: Callable[..., Point], written: Sequence[tuple[Block, int]]
) -> CommandCodec:
    points = tuple(place(address) for address in spec.addresses)
    blocks: dict[Block, int] = {}
    for point in points:
        block, function = next(
            ((block, function) for block, function in written if block.holds(point)),
            (Block(point.table, point.address, 1), 5 if point.table is Table.COIL else 6),
        )
        blocks[block] = function
    return CommandCodec(name, spec, points, tuple(blocks), tuple(blocks.values()))


def _places(signal: SignalCodec, blocks: tuple[Block, ...]) -> list[tuple[int, int, int]]:
    """Where a signal's bits lie in a poll taken for one number: (shift there, mask, shift in the raw integer)."""
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


def _signed(raw: int) -> int:
    return raw - 0x10000 if raw & 0x8000 else raw


def _checked_code(name: str, code: int, spec: Command) -> int:
    low, high = (-32768, 32767) if spec.type == "int16" else (0, 65535)
    if not low <= code <= high:
        raise ValueError(f"{name} writes {spec.type}, {low} to {high}; floor code {code} does not fit")
    if code == spec.rest:
        raise ValueError(f"{name} rests at {spec.rest}, so a floor with that code would be called by letting go")
    return code
