"""Builds, parses, checks and describes Modbus/TCP frames. Pure.

A frame is one whole ADU: transaction id, protocol id 0, length, unit id, function, data. Layout and limits are those of
the Modbus Application Protocol V1.1b3 (section 6) and the Modbus Messaging on TCP/IP Implementation Guide V1.0b (3.1).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from register_maps.errors import BadRequest, ExceptionAnswer, FrameError, Mismatch
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table

MAX_READ_BITS = 2000
MAX_READ_REGISTERS = 125
MAX_WRITE_COILS = 1968
MAX_WRITE_REGISTERS = 123
MAX_FRAME = 260
"""Bytes in the longest frame: 6 of header before the unit id, then at most 254."""

READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT = 1, 2, 3, 4
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS, MASK_WRITE = 5, 6, 15, 16, 22
READS = frozenset({READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT})
WRITES = frozenset({WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS, MASK_WRITE})
_SINGLE = frozenset({WRITE_COIL, WRITE_REGISTER, MASK_WRITE})
"""Writes of one address, whose right answer repeats the request."""

_SHORTEST, _LONGEST = 2, 254
"""Limits of the length field: unit id and function at least; unit id and a PDU of 253 at most (guide, 3.1.2)."""
_HEADER = 6
_WHOLE = tuple(struct.pack(">HH", 0, max(0, length - _HEADER)) for length in range(MAX_FRAME + 1))
"""Protocol id and length field of a frame of so many bytes."""
_COIL_ON, _COIL_OFF = 0xFF00, 0x0000
_LONGEST_DURATION = 0x7FFF
"""Of a coil pulse that the module times (elevator-interfaces 2, Waveshare)."""
_LIMIT = {
    READ_COILS: MAX_READ_BITS,
    READ_DISCRETE: MAX_READ_BITS,
    READ_HOLDING: MAX_READ_REGISTERS,
    READ_INPUT: MAX_READ_REGISTERS,
    WRITE_COIL: 1,
    WRITE_REGISTER: 1,
    WRITE_COILS: MAX_WRITE_COILS,
    WRITE_REGISTERS: MAX_WRITE_REGISTERS,
    MASK_WRITE: 1,
}
_TABLE = {
    **{function: table for table, function in READ_FUNCTION.items()},
    WRITE_COIL: Table.COIL,
    WRITE_COILS: Table.COIL,
    WRITE_REGISTER: Table.HOLDING,
    WRITE_REGISTERS: Table.HOLDING,
    MASK_WRITE: Table.HOLDING,
}
_NOUN = {
    Table.COIL: "coil",
    Table.DISCRETE: "discrete input",
    Table.HOLDING: "holding register",
    Table.INPUT: "input register",
}


@dataclass(frozen=True, slots=True)
class Request:
    """One request, checked against the limits of the specification; build it with `read` or a `write_...`.

    Raises BadRequest if the specification does not allow it.
    """

    unit: int
    """0 to 255; 255 (or 0) for a directly connected device (guide, 4.4.1.2)."""
    function: int
    address: int
    """As on the wire: the first one is 0."""
    count: int
    """Bits or registers."""
    values: tuple[int, ...] = ()
    """What a write writes: 0 or 1 for a coil, 0 to 65535 for a register; the AND mask and the OR mask of function 22;
    empty for a read."""
    duration: int | None = None
    """With function 5 on some relay modules: how long the coil is to stay on, in counts of the module, 1 to 0x7FFF. The
    specification knows FF00 and 0000 only."""
    body: bytes = field(init=False, repr=False, compare=False)
    """The frame after its transaction id; constant."""
    answer_head: bytes = field(init=False, repr=False, compare=False)
    """The right answer after its transaction id, up to its payload."""
    answer_length: int = field(init=False, repr=False, compare=False)
    """Bytes of the right answer, transaction id included."""

    def __post_init__(self) -> None:
        _check_limits(self)
        body = _adu_body(self.unit, _request_pdu(self))
        payload = _payload_length(self)
        if payload:
            head = struct.pack(">HHBBB", 0, 3 + payload, self.unit, self.function, payload)
        elif self.function in _SINGLE:
            head = body
        else:
            head = struct.pack(">HHBBHH", 0, 6, self.unit, self.function, self.address, self.count)
        object.__setattr__(self, "body", body)
        object.__setattr__(self, "answer_head", head)
        object.__setattr__(self, "answer_length", 2 + len(head) + payload)

    @property
    def table(self) -> Table:
        """The table of the data model that it accesses."""
        return _TABLE[self.function]

    @property
    def is_write(self) -> bool:
        """Whether it is a write."""
        return self.function in WRITES

    def __str__(self) -> str:
        noun = _NOUN[self.table]
        if self.function in READS:
            return f"read {self.count} {noun}{'' if self.count == 1 else 's'} from {self.address}, unit {self.unit}"
        if self.function == MASK_WRITE:
            keep, put = self.values
            return f"write {noun} {self.address} := itself AND {keep:04X} OR {put:04X}, unit {self.unit}"
        if self.duration is not None:
            return f"write {noun} {self.address} := on for {self.duration} counts, unit {self.unit}"
        if self.function in (WRITE_COIL, WRITE_REGISTER):
            return f"write {noun} {self.address} := {_value_text(self, self.values[0])}, unit {self.unit}"
        written = " ".join(_value_text(self, value) for value in self.values)
        noun = f"{self.count} {noun}{'' if self.count == 1 else 's'}"
        return f"write {noun} from {self.address} := {written}, unit {self.unit}"


def read(table: Table, address: int, count: int = 1, unit: int = 1) -> Request:
    """Return a read of bits (FC1, FC2) or registers (FC3, FC4)."""
    return Request(unit, READ_FUNCTION[table], address, count)


def write_coil(address: int, value: bool, unit: int = 1) -> Request:  # noqa: FBT001 - it is the value written
    """Set one coil (FC5)."""
    return Request(unit, WRITE_COIL, address, 1, (int(value),))


def write_register(address: int, value: int, unit: int = 1) -> Request:
    """Set one holding register (FC6)."""
    return Request(unit, WRITE_REGISTER, address, 1, (value,))


def write_coils(address: int, values: Iterable[bool], unit: int = 1) -> Request:
    """Set coils that follow one another (FC15)."""
    written = tuple(int(value) for value in values)
    return Request(unit, WRITE_COILS, address, len(written), written)


def write_registers(address: int, values: Iterable[int], unit: int = 1) -> Request:
    """Set holding registers that follow one another (FC16)."""
    written = tuple(values)
    return Request(unit, WRITE_REGISTERS, address, len(written), written)


def mask_write(address: int, keep: int, put: int, unit: int = 1) -> Request:
    """Set some bits of a holding register inside the device (FC22): contents AND `keep`, OR `put` without `keep`."""
    return Request(unit, MASK_WRITE, address, 1, (keep, put))


def pulse_coil(address: int, duration: int, unit: int = 1) -> Request:
    """Set a coil for a duration that the device times (FC5 with a number, on modules that know it); 1 to 0x7FFF counts."""
    return Request(unit, WRITE_COIL, address, 1, (1,), duration)


def frame(request: Request, tid: int) -> bytes:
    """The bytes to send, under this transaction id."""
    return tid.to_bytes(2, "big") + request.body


def tid_of(frame: bytes) -> int:
    """The transaction id of a frame."""
    return frame[0] << 8 | frame[1]


def split(buffer: bytes) -> tuple[list[bytes], bytes]:
    """Split received bytes into whole frames and the rest.

    Raises FrameError where the stream cannot be Modbus/TCP: nothing after that point can be believed.
    """
    frames: list[bytes] = []
    start, end = 0, len(buffer)
    if _HEADER + _SHORTEST <= end <= MAX_FRAME and buffer[2:_HEADER] == _WHOLE[end]:
        return [buffer], b""  # nearly always: one answer, in one piece
    while end - start >= _HEADER:
        protocol, length = struct.unpack_from(">HH", buffer, start + 2)
        if protocol != 0:
            raise FrameError(f"protocol id {protocol} where Modbus/TCP has 0: {_hex(buffer[start : start + 12])}")
        if not _SHORTEST <= length <= _LONGEST:
            raise FrameError(f"length {length}, allowed {_SHORTEST} to {_LONGEST}: {_hex(buffer[start : start + 12])}")
        stop = start + _HEADER + length
        if stop > end:
            break
        frames.append(buffer[start:stop])
        start = stop
    return frames, buffer[start:]


def check(request: Request, frame: bytes, *, tid: int | None = None) -> bytes:
    """The payload of an answer: register bytes, bit bytes, or b"" for a write.

    `tid` is the transaction id it must carry; None where it was looked at before, or the device does not echo it.
    Raises ExceptionAnswer, or Mismatch if anything else does not fit the request: unit id, function, length, byte count, echoed
    address, value or count.
    """
    fits = frame.startswith(request.answer_head, 2) and len(frame) == request.answer_length
    if fits and (tid is None or tid_of(frame) == tid):
        return frame[2 + len(request.answer_head) :]
    raise _what_is_wrong(request, frame, tid)


def parse_request(frame: bytes, *, timed_coils: bool = False) -> Request:
    """Read a request as a device does; with `timed_coils`, as a module that times coil pulses.

    Raises BadRequest, with the exception code to answer, or FrameError.
    """
    return _parsed(*_open(frame), timed_coils)


@lru_cache(1024)  # clients repeat the same few requests; exceptions are not cached
def _parsed(unit: int, pdu: bytes, timed_coils: bool) -> Request:  # noqa: FBT001 - part of the key
    if (function := pdu[0]) not in _TABLE:
        raise BadRequest(f"function {function} is none of 1 to 6, 15, 16, 22", code=1)
    if len(pdu) < 5:
        raise BadRequest(f"a request with function {function} and {len(pdu) - 1} bytes of data")
    address, number = struct.unpack_from(">HH", pdu, 1)
    if function in READS or function in (WRITE_COIL, WRITE_REGISTER):
        if len(pdu) != 5:
            raise BadRequest(f"a request with function {function} and {len(pdu) - 1} bytes of data, expected 4")
        if function in READS:
            return Request(unit, function, address, number)
        if timed_coils and function == WRITE_COIL and 1 <= number <= _LONGEST_DURATION:
            return pulse_coil(address, number, unit)
        return Request(unit, function, address, 1, (_single_value(function, number),))
    if function == MASK_WRITE:
        if len(pdu) != 7:
            raise BadRequest(f"a request with function {function} and {len(pdu) - 1} bytes of data, expected 6")
        return mask_write(address, number, int.from_bytes(pdu[5:], "big"), unit)
    return Request(unit, function, address, number, _many_values(function, number, pdu))


def answer(request: Request, tid: int, payload: bytes = b"") -> bytes:
    """The right answer to a request, as a device gives it; `payload` are the bytes of a read.

    Raises FrameError if the payload does not have the requested length.
    """
    built = tid.to_bytes(2, "big") + request.answer_head + payload
    if len(built) != request.answer_length:
        raise FrameError(f"{len(payload)} bytes of payload to {request}, expected {_payload_length(request)}")
    return built


def exception_answer(request_frame: bytes, code: int) -> bytes:
    """The answer that refuses a request, whatever its function."""
    unit, pdu = _open(request_frame)
    return request_frame[:2] + _adu_body(unit, bytes((pdu[0] | 0x80, code)))


def describe(frame: bytes) -> str:
    """Describe a request on one line; never raises."""
    try:
        return str(parse_request(frame))
    except FrameError as error:
        return f"not a request ({error}): {_hex(frame)}"


def describe_answer(frame: bytes) -> str:
    """Describe an answer on one line; never raises. Without its request the addresses of its values are unknown."""
    try:
        unit, pdu = _open(frame)
    except FrameError as error:
        return f"not an answer ({error}): {_hex(frame)}"
    function, data = pdu[0], pdu[1:]
    if function & 0x80 and len(data) == 1:
        return f"{ExceptionAnswer(function & 0x7F, data[0])}, unit {unit}"
    if function in READS and data and len(data) == 1 + data[0]:
        return f"{data[0]} bytes of {_NOUN[_TABLE[function]]}s: {_hex(data[1:])}, unit {unit}"
    if function in (WRITE_COILS, WRITE_REGISTERS) and len(data) == 4:
        address, count = struct.unpack(">HH", data)
        return f"{count} {_NOUN[_TABLE[function]]}{'' if count == 1 else 's'} written from {address}, unit {unit}"
    if function == MASK_WRITE and len(data) == 6:
        return f"{_NOUN[_TABLE[function]]} {int.from_bytes(data[:2], 'big')} masked: {_hex(data[2:])}, unit {unit}"
    if function in (WRITE_COIL, WRITE_REGISTER) and len(data) == 4:
        address, number = struct.unpack(">HH", data)
        return f"{_NOUN[_TABLE[function]]} {address} written := {number}, unit {unit}"
    return f"not an answer: {_hex(frame)}"


def pack_bits(values: Sequence[int]) -> bytes:
    """Bits as FC1, FC2 and FC15 carry them: the first is the lowest of the first byte; padded with 0."""
    number = 0
    for place, value in enumerate(values):
        if value:
            number |= 1 << place
    return number.to_bytes((len(values) + 7) // 8, "little")


def unpack_bits(payload: bytes, count: int) -> tuple[int, ...]:
    """The first `count` bits of a payload."""
    return tuple(payload[place >> 3] >> (place & 7) & 1 for place in range(count))


def values_of(request: Request, payload: bytes) -> tuple[int, ...]:
    """The bits (0 or 1) or registers (0 to 65535) in the payload of a read."""
    if request.table in BIT_TABLES:
        return unpack_bits(payload, request.count)
    return struct.unpack(f">{request.count}H", payload)


def _check_limits(request: Request) -> None:
    limit = _LIMIT.get(request.function)
    if limit is None:
        raise BadRequest(f"function {request.function} is none of 1 to 6, 15, 16, 22", code=1)
    if not 0 <= request.unit <= 255:
        raise BadRequest(f"unit id {request.unit}, allowed 0 to 255")
    if not 1 <= request.count <= limit:
        raise BadRequest(f"count {request.count} with function {request.function}, allowed 1 to {limit}")
    if not 0 <= request.address <= 65536 - request.count:
        raise BadRequest(f"address {request.address} with count {request.count} is not within 0 to 65535", code=2)
    expected = {MASK_WRITE: 2}.get(request.function, request.count) if request.function in WRITES else 0
    if len(request.values) != expected:
        raise BadRequest(f"{len(request.values)} values with function {request.function} and count {request.count}")
    if request.duration is not None and not (
        request.function == WRITE_COIL and 1 <= request.duration <= _LONGEST_DURATION
    ):
        raise BadRequest(f"duration {request.duration}, allowed 1 to {_LONGEST_DURATION} with function 5")
    highest = 1 if _TABLE[request.function] is Table.COIL else 0xFFFF
    for value in request.values:
        if not 0 <= value <= highest:
            raise BadRequest(f"value {value} to write, allowed 0 to {highest}")


def _request_pdu(request: Request) -> bytes:
    function, address, count, values = request.function, request.address, request.count, request.values
    if function in READS:
        return struct.pack(">BHH", function, address, count)
    if function == WRITE_COIL:
        state = _COIL_ON if values[0] else _COIL_OFF
        return struct.pack(">BHH", function, address, state if request.duration is None else request.duration)
    if function == MASK_WRITE:
        return struct.pack(">BHHH", function, address, *values)
    if function == WRITE_REGISTER:
        return struct.pack(">BHH", function, address, values[0])
    data = pack_bits(values) if function == WRITE_COILS else struct.pack(f">{count}H", *values)
    return struct.pack(">BHHB", function, address, count, len(data)) + data


def _payload_length(request: Request) -> int:
    if request.function in WRITES:
        return 0
    return (request.count + 7) // 8 if request.function in (READ_COILS, READ_DISCRETE) else 2 * request.count


def _adu_body(unit: int, pdu: bytes) -> bytes:
    return struct.pack(">HHB", 0, 1 + len(pdu), unit) + pdu


def _open(frame: bytes) -> tuple[int, bytes]:
    frames, rest = split(frame)
    if len(frames) != 1 or rest:
        raise FrameError(f"{len(frame)} bytes are not one whole frame: {_hex(frame)}")
    return frame[6], frame[7:]


def _single_value(function: int, number: int) -> int:
    if function == WRITE_REGISTER:
        return number
    if number not in (_COIL_ON, _COIL_OFF):
        raise BadRequest(f"coil value {number:04X}, allowed FF00 and 0000")
    return int(number == _COIL_ON)


def _many_values(function: int, count: int, pdu: bytes) -> tuple[int, ...]:
    expected = (count + 7) // 8 if function == WRITE_COILS else 2 * count
    data = pdu[6:]
    if not 1 <= count <= _LIMIT[function] or len(pdu) < 6 or not pdu[5] == len(data) == expected:
        raise BadRequest(f"function {function} writes {count} values in {len(data)} bytes, expected {expected}")
    return unpack_bits(data, count) if function == WRITE_COILS else struct.unpack(f">{count}H", data)


def _what_is_wrong(request: Request, frame: bytes, tid: int | None) -> Mismatch | ExceptionAnswer:
    request_text = str(request)
    if len(frame) < 8:
        return Mismatch(request_text, f"{request.answer_length} bytes", f"{len(frame)} bytes ({_hex(frame)})")
    if tid is not None and tid_of(frame) != tid:
        return Mismatch(request_text, f"transaction id {tid}", f"{tid_of(frame)}")
    if frame[6] != request.unit:
        return Mismatch(request_text, f"unit {request.unit}", f"unit {frame[6]}")
    if frame[7] == request.function | 0x80 and len(frame) == 9 and frame[2:6] == b"\0\0\0\3":
        return ExceptionAnswer(request.function, frame[8])
    if frame[7] != request.function:
        return Mismatch(request_text, f"function {request.function}", f"function {frame[7]}")
    return Mismatch(
        request_text, f"{_hex(request.answer_head[5:])} and {_payload_length(request)} bytes", _hex(frame[7:])
    )


def _value_text(request: Request, value: int) -> str:
    if request.table is Table.COIL:
        return "on" if value else "off"
    return str(value)


def _hex(data: bytes) -> str:
    return data.hex(" ")
