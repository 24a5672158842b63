"""A wire in memory and a small controller at its end, for seeded tests and tests on virtual time.

`MemoryWire` passes the same contract tests as the real wire. It uses only the running loop's clock.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from drivers.errors import ILLEGAL_ADDRESS, TARGET_SILENT, ConnectFailed, ConnectProblem
from drivers.modbus.wire import CLOSED_BY_CONTROLLER, NOT_MODBUS, OnBytes, OnFrame, OnLost
from register_maps import frames
from register_maps.errors import BadRequest, FrameError
from register_maps.frames import Request
from register_maps.words import BIT_TABLES, Table

Reply = tuple[float, bytes | None]
"""(delay in seconds, bytes that arrive then); None: the device closes the connection."""
Answer = Callable[[bytes], Iterable[Reply]]
"""Returns the replies to one request frame."""
Admit = Callable[[], ConnectProblem | None]
"""Returns why a connection fails, or None."""


def _everyone() -> ConnectProblem | None:
    return None


class MemoryWire:
    """A wire to `answer`; `admit` is called at every attempt to connect."""

    def __init__(self, answer: Answer, *, admit: Admit = _everyone, peer: str = "memory") -> None:
        self.on_bytes: OnBytes | None = None
        self._answer = answer
        self._admit = admit
        self._peer = peer
        self._open = False
        self._rest = b""
        self._rest_is_old = False
        # Rises with every opening and end; what was scheduled under an earlier number no longer arrives.
        self._generation = 0
        self._is_half_open = False
        self._on_frame: OnFrame
        self._on_lost: OnLost

    @property
    def peer(self) -> str:
        return self._peer

    @property
    def is_open(self) -> bool:
        return self._open

    async def open(self, on_frame: OnFrame, on_lost: OnLost, *, timeout_s: float) -> None:
        self.close()
        generation = self._generation
        problem = self._admit()
        await asyncio.sleep(timeout_s if problem is ConnectProblem.TIMED_OUT else 0)
        if problem is not None:
            raise ConnectFailed(self._peer, problem, problem.value)
        if generation != self._generation:
            raise ConnectFailed(self._peer, ConnectProblem.OTHER, "the connection was closed as soon as it was made")
        self._on_frame, self._on_lost = on_frame, on_lost
        self._rest = b""
        self._rest_is_old = False
        self._open = True
        self._is_half_open = False

    def close(self) -> None:
        self._generation += 1
        self._open = False

    def send(self, frame: bytes) -> None:
        if not self._open:
            return
        if self.on_bytes is not None:
            self.on_bytes(True, frame)
        self._rest_is_old = bool(self._rest)
        if self._is_half_open:
            return
        loop = asyncio.get_running_loop()
        for delay_s, data in self._answer(frame):
            if delay_s > 0:
                loop.call_later(delay_s, self._arrive, self._generation, data)
            else:
                loop.call_soon(self._arrive, self._generation, data)

    def deliver(self, data: bytes) -> None:
        """Receive these bytes now, requested or not."""
        try:
            whole, self._rest = frames.split(self._rest + data)
        except FrameError as error:
            self.drop(f"{NOT_MODBUS}: {error}")
            return
        if whole and self._rest_is_old:
            self._rest_is_old = False
            del whole[0]
        generation = self._generation
        for frame in whole:
            if generation != self._generation:
                return
            if self.on_bytes is not None:
                self.on_bytes(False, frame)
            self._on_frame(frame)

    def drop(self, reason: str = CLOSED_BY_CONTROLLER) -> None:
        """Lose the connection now."""
        if self._open:
            self.close()
            self._on_lost(reason)

    def go_half_open(self) -> None:
        """Lose the other end silently: this connection stays open, but carries nothing any more."""
        self._is_half_open = self._open

    def _arrive(self, generation: int, data: bytes | None) -> None:
        if generation != self._generation or self._is_half_open:
            return
        if data is None:
            self.drop()
        else:
            self.deliver(data)


@dataclass(frozen=True, slots=True)
class Fault:
    """A wrong treatment of one request by a device."""

    replies: Callable[[bytes, bytes], Iterable[Reply]]
    """(request frame, right answer) -> the replies instead."""
    executes: bool = True
    """Whether the device executes the request all the same."""


def silence(*, executes: bool = True) -> Fault:
    """No answer."""
    return Fault(lambda _request, _answer: (), executes=executes)


def late(delay_s: float) -> Fault:
    """The right answer, this many seconds later."""
    return Fault(lambda _request, answer: ((delay_s, answer),))


def twice(second_after_s: float = 0.0) -> Fault:
    """The right answer, and then the same bytes again."""
    return Fault(lambda _request, answer: ((0.0, answer), (second_after_s, answer)))


def edited(edit: Callable[[bytes], bytes]) -> Fault:
    """The right answer, edited: wrong transaction id, wrong echo, cut short."""
    return Fault(lambda _request, answer: ((0.0, edit(answer)),))


def exception(code: int) -> Fault:
    """An exception answer; nothing is executed."""
    return Fault(lambda request, _answer: ((0.0, frames.exception_answer(request, code)),), executes=False)


def in_pieces(*cuts: int, every_s: float = 0.0) -> Fault:
    """The right answer in segments that end at these bytes, `every_s` apart."""
    ends = (0, *cuts, None)
    return Fault(lambda _request, answer: ((i * every_s, answer[a:b]) for i, (a, b) in enumerate(pairwise(ends))))


def after(bytes_before: bytes) -> Fault:
    """Other bytes and the right answer behind them, in one segment."""
    return edited(lambda answer: bytes_before + answer)


def reordered() -> tuple[Fault, Fault]:
    """For two requests: the answer to the first comes behind that to the second, in one segment."""
    return _pair(lambda held, answer: answer + held)


def merged() -> tuple[Fault, Fault]:
    """For two requests: the answer to the first comes only with that to the second, before it, in one segment."""
    return _pair(lambda held, answer: held + answer)


def _pair(together: Callable[[bytes, bytes], bytes]) -> tuple[Fault, Fault]:
    held: list[bytes] = []

    def keep(_request: bytes, answer: bytes) -> Iterable[Reply]:
        held.append(answer)
        return ()

    return Fault(keep), Fault(lambda _request, answer: ((0.0, together(held[-1], answer)),))


def hang_up(*, executes: bool = True) -> Fault:
    """The device closes the connection instead of answering."""
    return Fault(lambda _request, _answer: ((0.0, None),), executes=executes)


@dataclass(frozen=True, slots=True)
class ReceivedRequest:
    """One request that the device received."""

    at_s: float
    """On the loop's clock."""
    request: Request
    executed: bool


@dataclass(slots=True)
class _Waiting:
    """A fault, the requests that it applies to, and its remaining uses."""

    fault: Fault
    applies: Callable[[Request], bool]
    times: int


class MemoryDevice:
    """A controller in memory: FC 1 to 6, 15, 16 and 22, exceptions 1, 2 and 3, and 0B for a foreign unit.

    Values never set read 0. `served` lists the first and last address of each range; other addresses are answered with
    exception 2. Without it everything is served.
    """

    def __init__(
        self,
        *,
        unit: int = 1,
        served: Mapping[Table, Sequence[tuple[int, int]]] | None = None,
        delay_s: float = 0.0,
        peer: str = "memory",
        timed_coils: bool = False,
    ) -> None:
        self.values: dict[Table, dict[int, int]] = {table: {} for table in Table}
        """The register image, which tests read and set."""
        self.received: list[ReceivedRequest] = []
        """Every well-formed request, in order."""
        self.connects = 0
        """Attempts to connect, including failed ones."""
        self.connect_problem: ConnectProblem | None = None
        """Set it to refuse connections."""
        self.delay_s = delay_s
        """How long an answer takes, seconds."""
        self._unit = unit
        self._served = served
        self._peer = peer
        self._timed_coils = timed_coils
        self._wires: list[MemoryWire] = []
        self._silent_until: float | None = None
        self._faults: list[_Waiting] = []

    def wire(self) -> MemoryWire:
        """Return a new wire to this device; the factory for a link."""
        wire = MemoryWire(self.answer, admit=self._admit, peer=self._peer)
        self._wires.append(wire)
        return wire

    def fail_next(self, fault: Fault, *, times: int = 1, on: Callable[[Request], bool] = lambda _request: True) -> None:
        """Apply a fault to the next requests for which `on` holds; faults queue up."""
        if times > 0:
            self._faults.append(_Waiting(fault, on, times))

    def clear_faults(self) -> None:
        """Behave again."""
        self._faults.clear()

    def fall_silent(self, for_s: float) -> None:
        """Ignore all requests for so long; connections stay open, and new ones are made."""
        self._silent_until = asyncio.get_running_loop().time() + for_s

    def go_half_open(self) -> None:
        """Lose every open connection silently; new ones work."""
        for wire in self._wires:
            wire.go_half_open()

    def disconnect(self) -> None:
        """Close every connection."""
        for wire in self._wires:
            wire.drop()

    def send_unrequested(self, data: bytes) -> None:
        """Send unrequested bytes over every open connection."""
        for wire in self._wires:
            if wire.is_open:
                wire.deliver(data)

    @property
    def executed(self) -> list[Request]:
        """The requests that were carried out, in order."""
        return [heard.request for heard in self.received if heard.executed]

    @property
    def writes(self) -> list[Request]:
        """The writes that were carried out, in order."""
        return [request for request in self.executed if request.is_write]

    def answer(self, frame: bytes) -> list[Reply]:
        """Carry out one request and return the replies."""
        if self._silent_until is not None and asyncio.get_running_loop().time() < self._silent_until:
            return []
        try:
            request = frames.parse_request(frame, timed_coils=self._timed_coils)
        except BadRequest as error:
            return [(self.delay_s, frames.exception_answer(frame, error.code))]
        fault = self._take_fault(request)
        code = self._exception_code(request)
        executes = code is None and (fault is None or fault.executes)
        self.received.append(ReceivedRequest(asyncio.get_running_loop().time(), request, executes))
        if code is not None:
            right = frames.exception_answer(frame, code)
        else:
            if executes:
                self._write(request)
            right = frames.answer(request, frames.tid_of(frame), self._read(request))
        replies = [(0.0, right)] if fault is None else fault.replies(frame, right)
        return [(self.delay_s + delay_s, data) for delay_s, data in replies]

    def _admit(self) -> ConnectProblem | None:
        self.connects += 1
        return self.connect_problem

    def _take_fault(self, request: Request) -> Fault | None:
        for place, waiting in enumerate(self._faults):
            if waiting.applies(request):
                waiting.times -= 1
                if not waiting.times:
                    del self._faults[place]
                return waiting.fault
        return None

    def _exception_code(self, request: Request) -> int | None:
        if request.unit != self._unit:
            return TARGET_SILENT
        if self._served is None:
            return None
        last = request.address + request.count - 1
        if any(low <= request.address and last <= high for low, high in self._served.get(request.table, ())):
            return None
        return ILLEGAL_ADDRESS

    def _write(self, request: Request) -> None:
        cells = self.values[request.table]
        if request.function == frames.MASK_WRITE:
            keep, put = request.values
            cells[request.address] = cells.get(request.address, 0) & keep | put & ~keep & 0xFFFF
            return
        cells.update(enumerate(request.values, start=request.address))

    def _read(self, request: Request) -> bytes:
        if request.is_write:
            return b""
        image = self.values[request.table]
        found = [image.get(address, 0) for address in range(request.address, request.address + request.count)]
        return frames.pack_bits(found) if request.table in BIT_TABLES else struct.pack(f">{request.count}H", *found)
