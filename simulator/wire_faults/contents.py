"""Faults that change the bytes of an answer, as values. Pure.

An answer of fewer bytes than an exception has nothing to change, and stays as it is.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum, unique

from register_maps import frames
from simulator.wire_faults.bases import Limits, Replies, ShapeFault, check_within, each, garbage
from simulator.wire_faults.target import FUNCTION_AT, UNIT_AT

_DATA_AT = 8
"""The byte count of a read's answer, the address of a write's."""
_VALUE_AT = 10
"""The value or quantity of a write's answer."""
_SHORTEST = 9
"""Bytes of an exception answer."""
_COUNTED_WRITES = frozenset({frames.WRITE_COILS, frames.WRITE_REGISTERS})
_COIL_FLIP = 0xFF00


@dataclass(frozen=True, slots=True)
class WrongTransactionId(ShapeFault):
    """The answer has another transaction id."""

    offset: int = 1
    """Added to the right one; -1 looks like the late answer to the request before."""
    fixed: int | None = None
    """This one instead, such as 0, which some clients take for the answer to anything."""

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("fixed", self.fixed or 0, 0, 65535)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _edited(replies, self._edit)

    def _edit(self, answer: bytes) -> bytes:
        tid = (frames.tid_of(answer) + self.offset) % 65536 if self.fixed is None else self.fixed
        return tid.to_bytes(2, "big") + answer[2:]


@dataclass(frozen=True, slots=True)
class WrongUnit(ShapeFault):
    """The answer comes from another unit."""

    offset: int = 1

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _edited(replies, lambda answer: _with_byte(answer, UNIT_AT, answer[UNIT_AT] + self.offset))


@dataclass(frozen=True, slots=True)
class WrongFunction(ShapeFault):
    """The answer is one to another function; an exception stays an exception."""

    offset: int = 1

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _edited(replies, self._edit)

    def _edit(self, answer: bytes) -> bytes:
        function = answer[FUNCTION_AT]
        return _with_byte(answer, FUNCTION_AT, function & 0x80 | (function + self.offset) & 0x7F)


@dataclass(frozen=True, slots=True)
class WrongCount(ShapeFault):
    """The answer to a read has fewer or more values than requested; functions 15 and 16 repeat another quantity.

    An exception answer, and one without room for more, stays as it is.
    """

    by: int = -1
    """Registers, bytes of bits, or the quantity repeated."""
    field_only: bool = False
    """The byte count alone is wrong and the values are all there; makes no difference to functions 15 and 16."""

    def suits(self, function: int) -> bool:
        return function in frames.READS or function in _COUNTED_WRITES

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _edited(replies, self._edit)

    def _edit(self, answer: bytes) -> bytes:
        function = answer[FUNCTION_AT]
        if function in _COUNTED_WRITES:
            return _with_word(answer, _VALUE_AT, _word(answer, _VALUE_AT) + self.by)
        if function not in frames.READS:
            return answer
        width = 1 if function in (frames.READ_COILS, frames.READ_DISCRETE) else 2
        change = width * self.by
        if self.field_only:
            return _with_byte(answer, _DATA_AT, answer[_DATA_AT] + change)
        data = answer[_DATA_AT + 1 :]
        data = data[: max(0, len(data) + change)] if change < 0 else data + data[-width:] * self.by
        if _DATA_AT + 1 + len(data) > frames.MAX_FRAME:
            return answer
        length = (3 + len(data)).to_bytes(2, "big")
        return answer[:4] + length + answer[6:_DATA_AT] + bytes([len(data)]) + data


@unique
class EchoPart(StrEnum):
    """What the answer to a write repeats."""

    ADDRESS = "address"
    VALUE = "value"
    """Of functions 5, 6 and 22; a coil's is turned round, of function 22 it is the mask to keep."""


@dataclass(frozen=True, slots=True)
class WrongEcho(ShapeFault):
    """The answer to a write repeats another address or value than was sent."""

    part: EchoPart = EchoPart.VALUE
    by: int = 1

    def suits(self, function: int) -> bool:
        if self.part is EchoPart.ADDRESS:
            return function in frames.WRITES
        return function in frames.WRITES - _COUNTED_WRITES

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return _edited(replies, self._edit)

    def _edit(self, answer: bytes) -> bytes:
        function = answer[FUNCTION_AT]
        if function not in frames.WRITES:
            return answer
        place = _DATA_AT if self.part is EchoPart.ADDRESS else _VALUE_AT
        value = _word(answer, place)
        if place == _VALUE_AT and function == frames.WRITE_COIL and value in (0, _COIL_FLIP):
            return _with_word(answer, place, value ^ _COIL_FLIP)
        return _with_word(answer, place, value + self.by)


@dataclass(frozen=True, slots=True)
class TruncateAnswer(ShapeFault):
    """The end of the answer never comes, so the head of the next answer is taken for it."""

    cut: int = 1
    """Bytes; of a shorter answer nothing comes."""

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("cut", self.cut, 1, frames.MAX_FRAME)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        cut = each(replies, lambda answer: answer[: -self.cut])
        return tuple(reply for reply in cut if reply[1] != b"")


@dataclass(frozen=True, slots=True)
class GarbageBefore(ShapeFault):
    """Random bytes come before the answer, in one segment with it."""

    length: int = 3

    def __post_init__(self) -> None:
        Limits.__post_init__(self)
        check_within("length", self.length, 1, 65535)

    def shape(self, replies: Replies, chance: random.Random) -> Replies:
        return each(replies, lambda answer: garbage(self.length, chance) + answer)


def _edited(replies: Replies, edit: Callable[[bytes], bytes]) -> Replies:
    return each(replies, lambda answer: edit(answer) if len(answer) >= _SHORTEST else answer)


def _with_byte(frame: bytes, place: int, value: int) -> bytes:
    return frame[:place] + bytes([value & 0xFF]) + frame[place + 1 :]


def _word(frame: bytes, place: int) -> int:
    return int.from_bytes(frame[place : place + 2], "big")


def _with_word(frame: bytes, place: int, value: int) -> bytes:
    return frame[:place] + (value & 0xFFFF).to_bytes(2, "big") + frame[place + 2 :]
