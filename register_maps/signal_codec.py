"""Signals: bits on the wire to values and back.

Every signal becomes one integer (`raw`): a word, a field of bits, or several bits side by side. A table or a rule turns that
integer into a value and back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from register_maps.points import UNLISTED, Image, Point, Unlisted, Value
from register_maps.schema import SIGNALS, WORDS, Kind, Signal
from register_maps.words import Door, Motion

Coding = tuple[Callable[[int], Value | Unlisted], Callable[[Value], int]]
Locate = Callable[..., Point]
"""(address text, width, lowest bit) -> point."""


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
    per_floor: bool = False
    """One point per floor: a switch at each landing."""

    @property
    def width(self) -> int:
        """Bits in the raw integer."""
        return sum(point.width for point in self.points)

    def extract(self, image: Image) -> int:
        """Read the raw integer out of a register image."""
        raw = shift = 0
        for point in self.points:
            raw |= point.within(image[point.space][point.address]) << shift
            shift += point.width
        return raw

    def insert(self, image: Image, value: Value) -> None:
        """Write a value into a register image, leaving neighbouring bits alone."""
        raw = self.encode(value)
        for point in self.points:
            cells = image[point.space]
            cells[point.address] = point.into(cells[point.address], raw)
            raw >>= point.width


def signal_codec(name: str, spec: Signal, locate: Locate) -> SignalCodec:
    """Compile one signal."""
    kind = SIGNALS[name]
    bits = tuple(locate(address, 1) for address in spec.addresses)
    if spec.open_limit is not None:
        return SignalCodec(name, kind, bits, *_limits(spec))
    if spec.up is not None:
        return SignalCodec(name, kind, bits, *_directions(spec))
    if spec.open_limits is not None:
        return SignalCodec(name, kind, bits, *_open_limits(len(bits), spec), per_floor=True)
    if spec.one_of is not None:
        return SignalCodec(name, kind, bits, *_one_of(name, len(bits), spec), per_floor=True)
    if spec.each_of is not None:
        return SignalCodec(name, kind, bits, *_each_of(name, len(bits), spec), per_floor=True)
    points = bits if spec.code_of is not None else _at(spec, locate)
    return SignalCodec(name, kind, points, *_coding(name, kind, spec, sum(point.width for point in points)))


def _at(spec: Signal, locate: Locate) -> tuple[Point, ...]:
    low, high = spec.bits or (0, 15)
    point = locate(spec.addresses[0], high - low + 1, low)
    if not spec.wide:
        return (point,)
    after = Point(point.table, point.address + 1, 0, 16, point.endpoint)
    return (after, point) if spec.word_order == "high_first" else (point, after)


def _limits(spec: Signal) -> Coding:
    """Raw: bit 0 the open limit, bit 1 the closed limit. Both at once is a contradiction, hence a fault."""
    flip = 0b11 if spec.active == "low" else 0
    words = (Door.MOVING, Door.OPEN, Door.CLOSED, Door.FAULT)

    def encode(value: Value) -> int:
        raw = words.index(value) if isinstance(value, Door) and value in words else 0
        return raw ^ flip

    return lambda raw: words[raw ^ flip], encode


def _open_limits(count: int, spec: Signal) -> Coding:
    """Raw: one open limit per floor. One set is open, none reads as closed, several contradict each other.

    A set of floor codes encodes as the limits of these floors; `open` alone, without a floor, as that of the lowest.
    """
    flip = (1 << count) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value:
        raw ^= flip
        if raw == 0:
            return Door.CLOSED
        return Door.OPEN if raw & raw - 1 == 0 else Door.FAULT

    def encode(value: Value) -> int:
        if isinstance(value, frozenset):
            return sum(1 << code for code in value if 0 <= code < count) ^ flip
        return {Door.OPEN: 0b1, Door.FAULT: 0b11}.get(value, 0) ^ flip if isinstance(value, Door) else flip

    return decode, encode


def _directions(spec: Signal) -> Coding:
    """Raw: bit 0 up, bit 1 down. Both at once contradict each other."""
    flip = 0b11 if spec.active == "low" else 0
    words = (Motion.STOPPED, Motion.UP, Motion.DOWN)

    def decode(raw: int) -> Value | Unlisted:
        return words[raw ^ flip] if raw ^ flip < 3 else UNLISTED

    def encode(value: Value) -> int:
        if value not in words:
            raise ValueError(f"two bits for up and down cannot say {value}")
        return words.index(value) ^ flip

    return decode, encode


def _one_of(name: str, count: int, spec: Signal) -> Coding:
    """Raw: one bit per floor. None set is no floor known; several contradict each other."""
    flip = (1 << count) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value | Unlisted:
        raw ^= flip
        if raw == 0:
            return None
        return raw.bit_length() - 1 if raw & raw - 1 == 0 else UNLISTED

    def encode(value: Value) -> int:
        if value is None:
            return flip
        return 1 << _floor_code(name, count, value) ^ flip

    return decode, encode


def _each_of(name: str, count: int, spec: Signal) -> Coding:
    """Raw: one bit per floor, any number of them set."""
    flip = (1 << count) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value:
        return frozenset(code for code in range(count) if (raw ^ flip) >> code & 1)

    def encode(value: Value) -> int:
        codes = value if isinstance(value, frozenset) else frozenset()
        return sum(1 << _floor_code(name, count, code) for code in codes) ^ flip

    return decode, encode


def _floor_code(name: str, count: int, value: object) -> int:
    if not isinstance(value, int) or not 0 <= value < count:
        raise ValueError(f"{name} has {count} floors, with codes 0 to {count - 1}; {value} is none of them")
    return value


def _coding(name: str, kind: Kind, spec: Signal, width: int) -> Coding:
    match kind:
        case Kind.FLAG:
            return _flag(spec, width)
        case Kind.DOOR | Kind.MOTION | Kind.MODE:
            return _words(name, kind, spec, width)
        case Kind.FLOOR:
            return _floor(name, spec, width)
        case Kind.NUMBER | Kind.COUNTER | Kind.FLOORS:
            return _number(width, signed=spec.type in ("int16", "int32"))


def _number(width: int, *, signed: bool) -> Coding:
    return (lambda raw: _signed(raw, width) if signed else raw), (lambda value: _int(value) & (1 << width) - 1)


def _flag(spec: Signal, width: int) -> Coding:
    no, yes = 0, spec.means_yes & (1 << width) - 1 if width > 1 else 1
    if spec.active == "low":
        no, yes = yes, no
    table: dict[int, Value] = {no: False, yes: True}
    return (lambda raw: table.get(raw, UNLISTED)), (lambda value: yes if value else no)


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


def _floor(name: str, spec: Signal, width: int) -> Coding:
    signed = spec.type in ("int16", "int32")
    nothing = frozenset(spec.unknown) | frozenset(spec.none)
    blank = next(iter((*spec.none, *spec.unknown)), None)
    flip = (1 << width) - 1 if spec.active == "low" else 0
    gray = spec.code == "gray"

    def decode(raw: int) -> Value:
        raw = _from_gray(raw ^ flip) if gray else raw ^ flip
        code = _signed(raw, width) if signed else raw
        return None if code in nothing else code

    def encode(value: Value) -> int:
        code = blank if value is None else value
        if code is None:
            raise ValueError(f"{name} has no code for no floor")
        raw = _int(code) & (1 << width) - 1
        return (raw ^ raw >> 1 if gray else raw) ^ flip

    return decode, encode


def _from_gray(raw: int) -> int:
    """Undo the reflected binary code: every bit is the parity of itself and all above."""
    shift = raw >> 1
    while shift:
        raw ^= shift
        shift >>= 1
    return raw


def _int(value: Value) -> int:
    return int(value) if isinstance(value, int) else 0


def _signed(raw: int, width: int) -> int:
    return raw - (1 << width) if raw >> width - 1 & 1 else raw
