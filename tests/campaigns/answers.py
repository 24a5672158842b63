"""Right answers to Modbus/TCP requests, and what a seed makes of them. Pure.

Half of the mutations know the grammar (MODBUS Application Protocol V1.1b3, section 6) and break one rule of it; the others are
blind. What comes out is a script: bytes, the pauses before them, and where the device closes the connection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from random import Random

Script = Sequence[tuple[float, bytes | None]]
"""(pause before it in seconds, bytes); None: the device closes the connection."""

_READS = (1, 2, 3, 4)
_FUNCTIONS = (*range(1, 25), 43, 0, 127)
_BURST = 300
"""More bytes than the longest frame has."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What a device that goes wrong has at hand."""

    request: bytes
    right: bytes
    """The right answer to it."""
    earlier: Sequence[bytes]
    """Right answers it gave before, newest last."""
    timeout_s: float
    """How long the client waits."""
    rng: Random

    @property
    def tid(self) -> int:
        return int.from_bytes(self.request[:2], "big")

    @property
    def unit(self) -> int:
        return self.request[6]

    @property
    def function(self) -> int:
        return self.request[7]

    @property
    def pdu(self) -> bytes:
        """Function code and data of the right answer."""
        return self.right[7:]


def adu(tid: int, unit: int, pdu: bytes, *, protocol: int = 0, length: int | None = None) -> bytes:
    """A frame; any number wraps at the size of its field."""
    said = len(pdu) + 1 if length is None else length
    head = (
        (tid & 0xFFFF).to_bytes(2, "big") + (protocol & 0xFFFF).to_bytes(2, "big") + (said & 0xFFFF).to_bytes(2, "big")
    )
    return head + bytes([unit & 0xFF]) + pdu


def data_length(request: bytes) -> int:
    """How many bytes of data the right answer to a read carries; 0 for a write."""
    if request[7] not in _READS:
        return 0
    quantity = int.from_bytes(request[10:12], "big")
    return (quantity + 7) // 8 if request[7] in (1, 2) else 2 * quantity


def right_answer(request: bytes, data: bytes) -> bytes:
    """The right answer to a well-formed request with function 1 to 6, 15, 16 or 22; `data` is what a read brings."""
    function = request[7:8]
    if request[7] in _READS:
        pdu = function + bytes([len(data)]) + data
    else:
        pdu = function + (request[8:12] if request[7] in (15, 16) else request[8:])
    return adu(int.from_bytes(request[:2], "big"), request[6], pdu)


def script(situation: Situation) -> tuple[str, Script]:
    """Draw what comes instead of the right answer, with the name of the mutation."""
    (kind,) = situation.rng.choices(MUTATIONS, cum_weights=_WEIGHTS)
    return kind.__name__, kind(situation)


def honest(it: Situation) -> Script:
    return ((0.0, it.right),)


def honest_in_segments(it: Situation) -> Script:
    return _segments(it, it.right)


def late(it: Situation) -> Script:
    return ((it.timeout_s * it.rng.choice((0.3, 0.7, 1.1, 1.3, 1.9, 2.1, 3.1)), it.right),)


def torn_by_the_time_out(it: Situation) -> Script:
    place = it.rng.randrange(1, len(it.right))
    return ((0.0, it.right[:place]), (it.timeout_s * it.rng.choice((0.6, 1.05, 1.5)), it.right[place:]))


def silence(_: Situation) -> Script:
    return ()


def hang_up(_: Situation) -> Script:
    return ((0.0, None),)


def half_and_hang_up(it: Situation) -> Script:
    return ((0.0, it.right[: it.rng.randrange(len(it.right) + 1)]), (0.0, None))


def flipped(it: Situation) -> Script:
    data = bytearray(it.right)
    for _ in range(it.rng.choice((1, 1, 1, 2, 3, 8))):
        data[it.rng.randrange(len(data))] ^= 1 << it.rng.randrange(8)
    return _sent(it, bytes(data))


def overwritten(it: Situation) -> Script:
    data = bytearray(it.right)
    for _ in range(it.rng.choice((1, 1, 2, 4))):
        data[it.rng.randrange(len(data))] = it.rng.choice((0, 1, 0x7F, 0x80, 0xFF, it.rng.randrange(256)))
    return _sent(it, bytes(data))


def inserted(it: Situation) -> Script:
    place, count = it.rng.randrange(len(it.right) + 1), it.rng.choice((1, 1, 2, 6, 20))
    return _sent(it, it.right[:place] + it.rng.randbytes(count) + it.right[place:])


def deleted(it: Situation) -> Script:
    place = it.rng.randrange(len(it.right))
    return _sent(it, it.right[:place] + it.right[place + it.rng.choice((1, 1, 2, 5)) :])


def repeated_bytes(it: Situation) -> Script:
    low = it.rng.randrange(len(it.right))
    high = it.rng.randrange(low, len(it.right)) + 1
    return _sent(it, it.right[:high] + it.right[low:])


def cut_short(it: Situation) -> Script:
    return _sent(it, it.right[: it.rng.randrange(len(it.right))])


def wrong_length_field(it: Situation) -> Script:
    right = len(it.pdu) + 1
    said = it.rng.choice((right - 1, right + 1, right - 2, right + 2, 0, 1, 2, 3, 254, 255, 256, 0xFFFF, right << 8))
    return _sent(it, adu(it.tid, it.unit, it.pdu, length=said))


def wrong_protocol(it: Situation) -> Script:
    return _sent(
        it, adu(it.tid, it.unit, it.pdu, protocol=it.rng.choice((1, 0x100, 0xFFFF, it.rng.randrange(1, 65536))))
    )


def wrong_tid(it: Situation) -> Script:
    swapped = (it.tid & 0xFF) << 8 | it.tid >> 8
    return _sent(it, adu(it.rng.choice((0, it.tid - 1, it.tid + 1, it.tid - 2, swapped, 0xFFFF)), it.unit, it.pdu))


def answer_to_the_next(it: Situation) -> Script:
    """An answer, and one to a request like it that has not been sent yet: whole, or torn by it."""
    ahead = adu(it.tid + 1, it.unit, it.pdu[:2] + it.rng.randbytes(len(it.pdu) - 2)) if it.function in _READS else b""
    ahead = ahead or adu(it.tid + 1, it.unit, it.pdu)
    place, pause_s = it.rng.randrange(len(ahead) + 1), it.rng.choice((0.0, it.timeout_s / 50))
    return ((0.0, it.right + ahead[:place]), (pause_s, ahead[place:]))


def wrong_unit(it: Situation) -> Script:
    return _sent(it, adu(it.tid, it.rng.choice((0, 255, it.unit + 1, it.unit ^ 0x80, it.rng.randrange(256))), it.pdu))


def wrong_function(it: Situation) -> Script:
    function = it.rng.choice((*_FUNCTIONS, it.function | 0x80, it.function ^ 1))
    return _sent(it, adu(it.tid, it.unit, bytes([function]) + it.pdu[1:]))


def wrong_byte_count(it: Situation) -> Script:
    said = it.rng.choice((0, 1, 255, it.pdu[1] - 1, it.pdu[1] + 1, it.pdu[1] * 2)) & 0xFF
    return _sent(it, adu(it.tid, it.unit, it.pdu[:1] + bytes([said]) + it.pdu[2:]))


def more_or_less_data(it: Situation) -> Script:
    """Well-formed in itself, for another quantity than was asked; or with a byte count that tells the old one."""
    length = it.rng.choice((0, 1, 2, len(it.pdu) - 3, len(it.pdu) - 1, len(it.pdu), len(it.pdu) + 2, 252)) % 253
    said = it.rng.choice((length & 0xFF, it.pdu[1]))
    return _sent(it, adu(it.tid, it.unit, bytes([it.function, said]) + it.rng.randbytes(length)))


def wrong_echo(it: Situation) -> Script:
    pdu = bytearray(it.pdu)
    pdu[it.rng.randrange(1, len(pdu))] ^= it.rng.choice((1, 0x80, 0xFF))
    return _sent(it, adu(it.tid, it.unit, bytes(pdu)))


def refusal(it: Situation) -> Script:
    code = it.rng.choice((0, 1, 2, 3, 4, 5, 6, 8, 10, 11, 12, 127, 128, 255, it.rng.randrange(256)))
    return _sent(it, adu(it.tid, it.unit, bytes([it.function | 0x80, code])))


def broken_refusal(it: Situation) -> Script:
    function = it.rng.choice((it.function | 0x80, (it.function ^ 1) | 0x80, 0x80, 0xFF))
    return _sent(it, adu(it.tid, it.unit, bytes([function]) + it.rng.randbytes(it.rng.choice((0, 1, 2, 5)))))


def answer_of_another(it: Situation) -> Script:
    """What was right for an earlier request, as it was or under this transaction id."""
    if not it.earlier:
        return honest(it)
    other = it.rng.choice(it.earlier)
    return _sent(it, it.rng.choice((other, it.right[:2] + other[2:])))


def the_request_itself(it: Situation) -> Script:
    return _sent(it, it.request)


def two_in_one(it: Situation) -> Script:
    other = it.rng.choice((it.right, *it.earlier[-3:], adu(it.tid, it.unit, bytes([it.function | 0x80, 2]))))
    return _sent(it, b"".join(it.rng.sample((it.right, other), 2)))


def twice_with_other_data(it: Situation) -> Script:
    other = it.right[:9] + it.rng.randbytes(max(0, len(it.right) - 9))
    return ((0.0, it.right), (it.rng.choice((0.0, it.timeout_s / 20, it.timeout_s)), other))


def something_before(it: Situation) -> Script:
    head = it.rng.choice((it.rng.randbytes(it.rng.randrange(1, 12)), adu(it.tid - 1, it.unit, it.pdu)))
    return _sent(it, head + it.right)


def something_after(it: Situation) -> Script:
    return _sent(it, it.right + it.rng.randbytes(it.rng.randrange(1, 12)))


def garbage(it: Situation) -> Script:
    return _sent(it, it.rng.randbytes(it.rng.randrange(_BURST)))


def garbage_in_a_frame(it: Situation) -> Script:
    """The header is right, with the unit id or without; what follows is noise."""
    noise = it.rng.randbytes(it.rng.choice((0, 1, 2, 3, 5, len(it.pdu), 252)))
    keep = it.rng.choice((it.pdu[:1], it.pdu[:2], b""))
    return _sent(it, adu(it.tid, it.unit, (keep + noise)[:253]))


def burst(it: Situation) -> Script:
    one = it.rng.choice((it.right, adu(it.tid - 1, it.unit, it.pdu), *it.earlier[-1:]))
    return _sent(it, one * it.rng.randrange(2, 60))


MUTATIONS: tuple[Callable[[Situation], Script], ...] = (
    honest, honest_in_segments, late, torn_by_the_time_out, silence, hang_up, half_and_hang_up, flipped, overwritten, inserted,
    deleted, repeated_bytes, cut_short, wrong_length_field, wrong_protocol, wrong_tid, answer_to_the_next, wrong_unit,
    wrong_function, wrong_byte_count, more_or_less_data, wrong_echo, refusal, broken_refusal, answer_of_another,
    the_request_itself, two_in_one, twice_with_other_data, something_before, something_after, garbage, garbage_in_a_frame, burst,
)  # fmt: skip
"""Every way an answer goes wrong, and two in which it does not."""

_OFTEN: dict[Callable[[Situation], Script], int] = {honest: 6, refusal: 2, answer_of_another: 2, flipped: 2}
"""Chosen: enough right answers in between that each wrong one meets a connection with a past."""
_WEIGHTS = tuple(accumulate(_OFTEN.get(kind, 1) for kind in MUTATIONS))


def _sent(it: Situation, data: bytes) -> Script:
    """In one piece mostly, at times in segments."""
    return _segments(it, data) if data and it.rng.random() < 0.2 else ((0.0, data),)


def _segments(it: Situation, data: bytes) -> Script:
    if len(data) < 2:
        return ((0.0, data),)
    places = sorted(it.rng.sample(range(1, len(data)), min(it.rng.choice((1, 1, 2, 3)), len(data) - 1)))
    pauses = [it.rng.choice((0.0, 0.0, it.timeout_s / 50)) for _ in range(len(places) + 1)]
    return [
        (pause, data[low:high]) for pause, low, high in zip(pauses, [0, *places], [*places, len(data)], strict=True)
    ]
