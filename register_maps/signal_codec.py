"""Compiles signals: bits on the wire to values and back.

Every signal becomes one integer (`raw`): a word, a field of bits, or several bits side by side. A table or a rule turns that
integer into a value and back.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection
from dataclasses import dataclass

from register_maps.points import UNLISTED, Image, Point, Unlisted, Value
from register_maps.schema import SIGNALS, WORDS, Kind, Signal
from register_maps.words import Door, Mode, Motion

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
    """Raises ValueError for a value this signal cannot express."""
    floor_codes: tuple[int, ...] = ()
    """The floor code of each point, where there is one point per floor: a switch at each landing."""
    by_position: bool = False
    """The floor is derived from the position of the car; there is none between floors."""

    @property
    def per_floor(self) -> bool:
        """Whether it has one point per floor."""
        return bool(self.floor_codes)

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
    if (codes := spec.floor_codes) and spec.open_limits is not None:
        return SignalCodec(name, kind, bits, *_open_limits(codes, spec), floor_codes=codes)
    if codes:
        per_floor = _one_of if spec.one_of is not None else _each_of
        return SignalCodec(name, kind, bits, *per_floor(name, codes, spec), floor_codes=codes)
    points = bits if spec.code_of is not None else _at(spec, locate)
    width = sum(point.width for point in points)
    by_position = spec.positions is not None and kind is Kind.FLOOR
    decode, encode = _by_position(name, spec, width) if by_position else _coding(name, kind, spec, width)
    if spec.byte_order == "low_first":
        return SignalCodec(name, kind, points, *_swapped(decode, encode), by_position=by_position)
    return SignalCodec(name, kind, points, decode, encode, by_position=by_position)


def _swapped(decode: Callable[[int], Value | Unlisted], encode: Callable[[Value], int]) -> Coding:
    return (lambda raw: decode(swap_bytes(raw))), (lambda value: swap_bytes(encode(value)))


def _at(spec: Signal, locate: Locate) -> tuple[Point, ...]:
    low, high = spec.bits or (0, 15)
    point = locate(spec.addresses[0], high - low + 1, low)
    if not spec.is_wide:
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


def _open_limits(codes: tuple[int, ...], spec: Signal) -> Coding:
    """Raw: one open limit per floor. One set is open, none reads as closed, several contradict each other.

    A set of floor codes encodes as the limits of these floors; `open` alone, without a floor, as that of the first.
    """
    flip = (1 << len(codes)) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value:
        raw ^= flip
        if raw == 0:
            return Door.CLOSED
        return Door.OPEN if raw & raw - 1 == 0 else Door.FAULT

    def encode(value: Value) -> int:
        if isinstance(value, frozenset):
            return sum(1 << place for place, code in enumerate(codes) if code in value) ^ flip
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
            raise ValueError(f"two bits for up and down cannot express {value}")
        return words.index(value) ^ flip

    return decode, encode


def _one_of(name: str, codes: tuple[int, ...], spec: Signal) -> Coding:
    """Raw: one bit per floor. None set is no floor known; several contradict each other."""
    flip = (1 << len(codes)) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value | Unlisted:
        raw ^= flip
        if raw == 0:
            return None
        return codes[raw.bit_length() - 1] if raw & raw - 1 == 0 else UNLISTED

    def encode(value: Value) -> int:
        if value is None:
            return flip
        return 1 << floor_entry(name, codes, value) ^ flip

    return decode, encode


def _each_of(name: str, codes: tuple[int, ...], spec: Signal) -> Coding:
    """Raw: one bit per floor, any number of them set."""
    flip = (1 << len(codes)) - 1 if spec.active == "low" else 0

    def decode(raw: int) -> Value:
        return frozenset(code for place, code in enumerate(codes) if (raw ^ flip) >> place & 1)

    def encode(value: Value) -> int:
        lit = value if isinstance(value, frozenset) else frozenset()
        return sum(1 << floor_entry(name, codes, code) for code in lit) ^ flip

    return decode, encode


def floor_entry(name: str, codes: tuple[int, ...], value: object) -> int:
    """Return which entry of a list with one per floor belongs to a floor code. Raises ValueError where none does."""
    if value not in codes:
        raise ValueError(f"{name} has {len(codes)} floors, with codes {listed_codes(codes)}; {value} is none of them")
    return codes.index(value)


def listed_codes(codes: Collection[int]) -> str:
    """List codes for a reader: `0 to 3` where they follow one another, `1, 2, 4` where they do not."""
    ordered = sorted(codes)
    if len(ordered) > 1 and ordered[-1] - ordered[0] == len(ordered) - 1:
        return f"{ordered[0]} to {ordered[-1]}"
    return ", ".join(map(str, ordered))


def _by_position(name: str, spec: Signal, width: int) -> Coding:
    """Raw: a position. A floor is where the car is within the tolerance of its position; elsewhere there is none."""
    positions, tolerance = spec.positions or {}, spec.tolerance or 0
    read, write = _position(spec, width)

    def decode(raw: int) -> Value | Unlisted:
        position = read(raw)
        if position is None or isinstance(position, Unlisted):
            return position
        return next((code for code, at in positions.items() if abs(_int(position) - at) <= tolerance), None)

    ordered = sorted(positions.values())
    between = ((low + high) // 2 for low, high in itertools.pairwise(ordered) if high - low > 2 * tolerance + 1)
    nowhere = next(iter((*spec.unknown, *between)), None)

    def encode(value: Value) -> int:
        position = nowhere if value is None else positions.get(value) if isinstance(value, int) else None
        if position is None:
            raise ValueError(
                f"{name} has positions for the floors with codes {listed_codes(positions)}; not for {value}"
            )
        return write(position)

    return decode, encode


def _coding(name: str, kind: Kind, spec: Signal, width: int) -> Coding:
    match kind:
        case Kind.FLAG | Kind.DOOR if spec.thresholds:
            return _measured(name, spec, width, _yes_between(spec) if kind is Kind.FLAG else _door_at(spec))
        case Kind.FLAG:
            return _in_robot_mode(spec, width) if spec.names_robot_mode else _flag(spec, width)
        case Kind.DOOR | Kind.MOTION | Kind.MODE:
            return _words(name, kind, spec, width)
        case Kind.FLOOR:
            return _floor(name, spec, width)
        case Kind.NUMBER if spec.unknown:
            return _position(spec, width)
        case Kind.NUMBER | Kind.COUNTER | Kind.FLOORS:
            return _number(spec, width)


def _number(spec: Signal, width: int) -> Coding:
    signed = spec.type in ("int16", "int32")
    if spec.code == "bcd":
        return _bcd, lambda value: to_bcd(_int(value), width)
    return (lambda raw: _signed(raw, width) if signed else raw), (lambda value: _int(value) & (1 << width) - 1)


def _position(spec: Signal, width: int) -> Coding:
    """Raw: a number, or one of those that mean that it is not known."""
    read, write = _number(spec, width)

    def decode(raw: int) -> Value | Unlisted:
        position = read(raw)
        return None if position in spec.unknown else position

    return decode, lambda value: write(next(iter(spec.unknown), 0) if value is None else value)


def _flag(spec: Signal, width: int) -> Coding:
    no, yes = 0, spec.means_yes & (1 << width) - 1 if width > 1 else 1
    if spec.active == "low":
        no, yes = yes, no
    table: dict[int, Value] = {no: False, yes: True}
    return (lambda raw: table.get(raw, UNLISTED)), (lambda value: yes if value else no)


def _measured(name: str, spec: Signal, width: int, meaning: Callable[[int], Value]) -> Coding:
    """Raw: a number, whose meaning is decided by thresholds. It is encoded as a threshold itself, or as a number just beyond one."""
    read, write = _number(spec, width)
    lowest, highest = spec.range or number_range(spec, width)

    def decode(raw: int) -> Value | Unlisted:
        number = read(raw)
        if number in spec.unknown:
            return None
        return meaning(number) if isinstance(number, int) and lowest <= number <= highest else UNLISTED

    ends = tuple(spec.thresholds.values())
    tried = (0, *ends, sum(ends) // 2, *(number for end in ends for number in (end - 1, end + 1)))
    numbers = [number for number in tried if lowest <= number <= highest and number not in spec.unknown]
    # from the last to the first, so that the first number with a meaning stands for it
    known = {meaning(number): number for number in reversed(numbers)}
    known |= {None: spec.unknown[0]} if spec.unknown else {}

    def encode(value: Value) -> int:
        value = Door.MOVING if value in (Door.OPENING, Door.CLOSING) else value
        if value not in known:
            raise ValueError(f"{name} has no number for {value}")
        return write(known[value])

    return decode, encode


def _yes_between(spec: Signal) -> Callable[[int], Value]:
    low, high = spec.yes_from, spec.yes_to
    return lambda number: (low is None or number >= low) and (high is None or number <= high)


def _door_at(spec: Signal) -> Callable[[int], Value]:
    """Return what a position of a door means; some doors count up as they open, and some down."""
    open_at, closed_at = spec.open_at or 0, spec.closed_at or 0
    sign = 1 if open_at > closed_at else -1

    def meaning(number: int) -> Value:
        if sign * number >= sign * open_at:
            return Door.OPEN
        return Door.CLOSED if sign * number <= sign * closed_at else Door.MOVING

    return meaning


def number_range(spec: Signal, width: int) -> tuple[int, int]:
    """Return the lowest and the highest number that so many bits of this signal's type hold."""
    if spec.type in ("int16", "int32"):
        return -(1 << width - 1), (1 << width - 1) - 1
    return 0, highest_bcd(width) if spec.code == "bcd" else (1 << width) - 1


def _in_robot_mode(spec: Signal, width: int) -> Coding:
    """A flag that is derived from a mode word: yes where the word is `robot`. It is only ever read."""
    read, write = _words("robot_mode_on", Kind.MODE, spec, width)

    def decode(raw: int) -> Value | Unlisted:
        mode = read(raw)  # a code that is not listed is reported of the mode
        return mode is Mode.ROBOT if isinstance(mode, Mode) else None

    return decode, write


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

    def decode(raw: int) -> Value | Unlisted:
        raw ^= flip
        code: Value | Unlisted = _signed(raw, width) if signed else raw
        if spec.code == "gray":
            code = _from_gray(raw)
        elif spec.code == "bcd":
            code = _bcd(raw)
        return None if code in nothing else code

    def encode(value: Value) -> int:
        code = blank if value is None else value
        if code is None:
            raise ValueError(f"{name} has no code for no floor")
        if spec.code == "bcd":
            return to_bcd(_int(code), width) ^ flip
        raw = _int(code) & (1 << width) - 1
        return (raw ^ raw >> 1 if spec.code == "gray" else raw) ^ flip

    return decode, encode


def _from_gray(raw: int) -> int:
    """Undo the reflected binary code: every bit is the parity of itself and all above."""
    shift = raw >> 1
    while shift:
        raw ^= shift
        shift >>= 1
    return raw


def from_bcd(raw: int) -> int | None:
    """Read four bits for each decimal digit; None where one of them is more than 9."""
    digits = f"{raw:x}"
    return int(digits) if digits.isdecimal() else None


def _bcd(raw: int) -> int | Unlisted:
    number = from_bcd(raw)
    return UNLISTED if number is None else number


def to_bcd(value: int, width: int) -> int:
    """Write four bits for each decimal digit. Raises ValueError for a number that does not fit."""
    if value < 0 or (raw := int(str(value), 16)) >= 1 << width:
        raise ValueError(f"{value} does not fit: in {width} bits BCD holds 0 to {highest_bcd(width)}")
    return raw


def highest_bcd(width: int) -> int:
    """Return the highest number that so many bits hold in BCD."""
    digits, bits = divmod(width, 4)
    return int(f"{min(9, (1 << bits) - 1)}{'9' * digits}")


def swap_bytes(raw: int) -> int:
    """Exchange the two bytes of each register."""
    return (raw & 0x00FF_00FF) << 8 | raw >> 8 & 0x00FF_00FF


def _int(value: Value) -> int:
    return int(value) if isinstance(value, int) else 0


def _signed(raw: int, width: int) -> int:
    return raw - (1 << width) if raw >> width - 1 & 1 else raw
