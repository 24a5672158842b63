"""Which answer a Modbus/TCP client may take for each request, from the bytes that one connection carried.

Written from the specification alone, and it imports nothing of what it judges, so that it can contradict it:
MODBUS Application Protocol V1.1b3 (sections 4.1, 6.1 to 6.6, 6.11, 6.12, 6.16, 7) and the MODBUS Messaging on TCP/IP Implementation
Guide V1.0b (3.1.3 header, 4.4.1.3 confirmation). Modbus/TCP has no checksum: a well-formed answer with other data is an answer.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

HEADER = 6
"""Transaction id, protocol id and length field, two bytes each; the length counts what follows."""
SHORTEST, LONGEST = 2, 254
"""What the length field may say: unit id and function code at least; unit id and a PDU of 253 at most (4.1)."""
_READ_BITS = frozenset({1, 2})
_READ_REGISTERS = frozenset({3, 4})
_ECHOED = frozenset({5, 6, 22})
"""Functions whose answer repeats the request (6.5, 6.6, 6.16)."""
_COUNTED = frozenset({15, 16})
"""Functions whose answer repeats starting address and quantity (6.11, 6.12)."""
_REMEMBERED = 12


@dataclass(frozen=True, slots=True)
class Payload:
    """A positive answer."""

    data: bytes
    """What follows the byte count of a read; empty for a write."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """An exception answer. The codes of section 7 are not all that devices give, so every code counts."""

    code: int


Answer = Payload | Refusal


def fitting(request: bytes, answer: bytes) -> Answer | None:
    """What a whole frame says to a whole request frame, transaction ids apart; None: it is no answer to it.

    The bits that pad the last byte of a bit read should be 0 (6.1), and mean nothing where they are not.
    """
    if len(answer) < HEADER + SHORTEST or answer[HEADER] != request[HEADER]:
        return None
    asked, function, data = request[7], answer[7], answer[8:]
    if function == asked + 0x80:
        return Refusal(data[0]) if len(data) == 1 else None
    if function != asked:
        return None
    if asked in _READ_BITS or asked in _READ_REGISTERS:
        quantity = int.from_bytes(request[10:12], "big")
        length = (quantity + 7) // 8 if asked in _READ_BITS else 2 * quantity
        return Payload(data[1:]) if len(data) == 1 + length and data[0] == length else None
    repeated = request[8:] if asked in _ECHOED else request[8:12] if asked in _COUNTED else None
    return Payload(b"") if data == repeated else None


class Question:
    """One request on one connection, and what came for it."""

    __slots__ = ("answer", "answered_at", "asked_at", "clean", "decided", "frame")

    def __init__(self, frame: bytes, asked_at: float) -> None:
        self.frame = frame
        self.asked_at = asked_at
        self.answer: Answer | None = None
        """What may be taken; None: nothing that has come so far."""
        self.answered_at = 0.0
        self.decided = False
        """Whether a frame with this transaction id came: the first that began after the request decides, for good or bad
        (guide, 4.4.1.3)."""
        self.clean = True
        """Whether nothing else came since the request left, so that a client has no reason to refuse the answer."""

    def must_take(self, within_s: float) -> bool:
        """Whether a client that waits so long has to take the answer."""
        return self.answer is not None and self.clean and self.answered_at - self.asked_at < within_s


class Hearing:
    """One connection, in the order of its events as its client had them."""

    def __init__(self, *, echoes_tid: bool = True) -> None:
        """Without `echoes_tid` the device is known not to return transaction ids, and the next frame is the answer."""
        self.broken = False
        """Whether the stream has stopped to be Modbus/TCP; nothing after that point can be believed."""
        self.events: deque[tuple[float, str, bytes]] = deque(maxlen=_REMEMBERED)
        """The last of them: (time, "asked" or "came", bytes)."""
        self._echoes_tid = echoes_tid
        self._rest = b""
        self._rest_is_older = False
        self._question: Question | None = None

    def asked(self, frame: bytes, at: float) -> Question:
        """A request leaves. Whatever began to come before cannot be the answer to it."""
        self.events.append((at, "asked", frame))
        self._rest_is_older = bool(self._rest)
        self._question = Question(frame, at)
        return self._question

    def came(self, data: bytes, at: float) -> None:
        """Bytes come."""
        self.events.append((at, "came", data))
        self._rest += data
        question = self._question if self._question is not None and not self._question.decided else None
        while (frame := self._whole_frame()) is not None:
            older, self._rest_is_older = self._rest_is_older, False
            if question is None:
                continue
            if older or question.decided or (self._echoes_tid and frame[:2] != question.frame[:2]):
                question.clean = False
                continue
            question.decided = True
            question.answered_at = at
            question.answer = fitting(question.frame, frame)
        if question is not None and (self.broken or (question.decided and self._rest)):
            # a client may give up a segment of which it can read only the beginning
            question.clean = False

    def _whole_frame(self) -> bytes | None:
        if self.broken or len(self._rest) < HEADER:
            return None
        protocol, length = int.from_bytes(self._rest[2:4], "big"), int.from_bytes(self._rest[4:6], "big")
        if protocol != 0 or not SHORTEST <= length <= LONGEST:
            self.broken = True
            return None
        if len(self._rest) < HEADER + length:
            return None
        frame, self._rest = self._rest[: HEADER + length], self._rest[HEADER + length :]
        return frame


def whole_frames(stream: bytes) -> list[bytes]:
    """The whole frames of a stream, up to where it stops to be Modbus/TCP."""
    frames: list[bytes] = []
    start = 0
    while len(stream) - start >= HEADER:
        protocol = int.from_bytes(stream[start + 2 : start + 4], "big")
        length = int.from_bytes(stream[start + 4 : start + 6], "big")
        stop = start + HEADER + length
        if protocol != 0 or not SHORTEST <= length <= LONGEST or len(stream) < stop:
            break
        frames.append(stream[start:stop])
        start = stop
    return frames
