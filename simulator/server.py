"""Modbus/TCP in front of simulated lifts. The only importer of pymodbus here."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException, NoSuchIdException
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationRequest, ReadDeviceInformationResponse
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from register_maps import frames
from register_maps.errors import BadRequest, FrameError
from register_maps.words import Table
from simulator.cells import ILLEGAL_FUNCTION, ILLEGAL_VALUE, ExceptionReply, NoReply
from simulator.faults import Fault, SlotKept

_FUNCTION_AT = 7
"""Where the function code is in a frame."""

_COIL_VALUE_AT = slice(10, 12)
_COIL_VALUES = (b"\xff\x00", b"\x00\x00")
"""What the specification lets function 5 write (V1.1b3, 6.5); pymodbus takes anything else for off."""

_TABLES = {1: Table.COIL, 5: Table.COIL, 15: Table.COIL, 2: Table.DISCRETE, 4: Table.INPUT} | dict.fromkeys(
    (3, 6, 16, 22, 23), Table.HOLDING
)


_SINGLE_WRITES = (frames.WRITE_COIL, frames.WRITE_REGISTER, frames.MASK_WRITE)
"""Writes for which pymodbus reads the cell again: to answer, or to mask it."""


_LAST_OBJECT = {1: 2, 2: 6}
"""Of the basic and of the regular device identification (V1.1b3, 6.21)."""

GAP_ROUNDING_S = 0.002
"""A request this much too soon is still taken. Chosen: the timers of uvloop count whole milliseconds."""

_NO_LINGER = struct.pack("ii", 1, 0)


class Device(Protocol):
    """What answers for one unit id."""

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Return cells, or raise ExceptionReply."""
        ...

    def write(self, table: Table, address: int, values: list[int], now: float) -> None:
        """Write cells, or raise ExceptionReply."""
        ...

    def stored(self, table: Table, address: int, now: float) -> int:
        """Return what was last written to a cell, or raise ExceptionReply: a mask write starts from it, and a write is answered with it."""
        ...

    def pulse(self, address: int, counts: int, now: float) -> None:
        """Set a coil for so many counts of the device, or raise ExceptionReply."""
        ...


@runtime_checkable
class Networked(Protocol):
    """A device that is not always on its network."""

    @property
    def on_network(self) -> bool:
        """Whether it answers at all; otherwise every access raises NoReply."""
        ...

    @property
    def faults(self) -> frozenset[Fault]:
        """What is the matter with it; of these the server acts out SlotKept."""
        ...

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call this whenever one of the two has changed."""
        ...


@dataclass(frozen=True, slots=True)
class ClientLimits:
    """What a controller demands of its clients. Seconds are real."""

    most: int | None = None
    """How many connections it has slots for; None: as many as come."""
    idle_timeout_s: float | None = None
    """It closes a connection without a request for so long; None: never."""
    min_gap_s: float = 0.0
    """It loses a request that comes sooner after its last answer on the same connection."""


class _Slots:
    """Who is connected to a controller, and who may be."""

    def __init__(self, devices: Mapping[int, Device], limits: ClientLimits) -> None:
        self._devices = tuple(devices.values())
        self._networked = [device for device in self._devices if isinstance(device, Networked)]
        self._most = limits.most
        self._connected: set[_Connection] = set()
        self._kept = 0
        """Slots of connections that went away unnoticed."""
        for device in self._networked:
            device.watch(self._look)

    def take(self, connection: _Connection) -> None:
        """Somebody has connected; where there is no slot the connection is reset."""
        keeps = self._keeps_slots
        is_full = keeps if self._most is None else len(self._connected) + self._kept >= self._most
        if is_full or not self._on_network:
            connection.reset()
        else:
            self._connected.add(connection)

    def leave(self, connection: _Connection) -> None:
        """Somebody has gone."""
        if connection in self._connected:
            self._connected.remove(connection)
            self._kept += self._keeps_slots

    def clear(self) -> None:
        """The controller listens again."""
        self._connected.clear()
        self._kept = 0

    def _look(self) -> None:
        """A fault of the network has begun or ended."""
        if not self._keeps_slots:
            self._kept = 0
        if not self._on_network:
            self._kept = 0
            for connection in tuple(self._connected):
                connection.reset()

    @property
    def _on_network(self) -> bool:
        return len(self._networked) < len(self._devices) or any(device.on_network for device in self._networked)

    @property
    def _keeps_slots(self) -> bool:
        return any(SlotKept() in device.faults for device in self._networked)


class _Context:
    """What pymodbus's requests run against, in the place of its own memory.

    Its SimDevice drops, shifts or double-counts some layouts and cannot leave a unit unanswered (field notes S3 to S7);
    with the context replaced, every access reaches the device as it came.
    """

    simdevices: tuple[SimDevice, ...] = ()

    def __init__(self, devices: Mapping[int, Device], clock: Callable[[], float], identity: Mapping[int, str]) -> None:
        self._devices = devices
        self._clock = clock
        self._identity = identity

    def device_ids(self) -> list[int]:
        return list(self._devices)

    async def async_getValues(  # noqa: N802 - pymodbus's name
        self, device_id: int, func_code: int, address: int, count: int = 1
    ) -> list[int] | ExcCodes:
        try:
            if func_code in _SINGLE_WRITES:
                return [self._device(device_id).stored(_TABLES[func_code], address, self._clock())]
            return self._device(device_id).read(_TABLES[func_code], address, count, self._clock())
        except ExceptionReply as objection:
            return ExcCodes(objection.code)
        except NoReply as silence:
            raise NoSuchIdException(f"unit {device_id} is off") from silence

    async def async_setValues(  # noqa: N802 - pymodbus's name
        self, device_id: int, func_code: int, address: int, values: list[int]
    ) -> ExcCodes | None:
        try:
            self._device(device_id).write(_TABLES[func_code], address, [int(value) for value in values], self._clock())
        except ExceptionReply as objection:
            return ExcCodes(objection.code)
        except NoReply as silence:
            raise NoSuchIdException(f"unit {device_id} is off") from silence
        return None

    def pulse(self, frame: bytes) -> bytes:
        """Carry out a function 5 with a duration and return the answer."""
        try:
            request = frames.parse_request(frame, timed_coils=True)
            self._device(request.unit).pulse(request.address, request.duration or 0, self._clock())
        except (BadRequest, ExceptionReply) as refusal:
            return frames.exception_answer(frame, refusal.code)
        except (NoSuchIdException, NoReply):
            return frames.exception_answer(frame, ExcCodes.GATEWAY_NO_RESPONSE)
        return frames.answer(request, frames.tid_of(frame))

    def identify(self, request: ReadDeviceInformationRequest) -> ModbusPDU:
        """Return what the device says that it is; pymodbus would answer with what the whole process shares."""
        unit, function, code = request.dev_id, request.function_code, request.read_code or 0
        device = self._devices.get(unit)
        if device is None or (isinstance(device, Networked) and not device.on_network):
            return ExceptionResponse(function, ExcCodes.GATEWAY_NO_RESPONSE)
        if not self._identity:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_FUNCTION)
        if code not in _LAST_OBJECT:
            return ExceptionResponse(function, ExcCodes.ILLEGAL_VALUE)
        first = request.object_id if request.object_id in self._identity else 0
        asked = {number: text for number, text in self._identity.items() if first <= number <= _LAST_OBJECT[code]}
        response = ReadDeviceInformationResponse(code, asked)
        response.conformity = 2 if max(self._identity) > _LAST_OBJECT[1] else 1
        return response

    def _device(self, unit: int) -> Device:
        if unit not in self._devices:
            raise NoSuchIdException(f"no unit {unit}")
        return self._devices[unit]


class _Connection(ServerRequestHandler):
    """One client's requests, each carried out once and in order, however they are cut into segments.

    pymodbus's own handler keeps a single request: a second one in the same segment is lost or answered twice (field
    notes S1 and S2), and what it cannot decode it answers for function 80.
    """

    def __init__(
        self, owner: ModbusTcpServer, context: _Context, slots: _Slots, limits: ClientLimits, clock: Callable[[], float]
    ) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._context = context
        self._slots = slots
        self._limits = limits
        self._clock = clock
        self._answered_at = -math.inf
        self._idle: asyncio.TimerHandle | None = None
        self._rest = b""
        """The beginning of a request of which more is to come."""
        self._waiting: deque[tuple[bytes, ModbusPDU | None]] = deque()
        """Requests in their order, and as pymodbus reads them; None: it cannot."""
        self._worker: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._slots.take(self)
        self._wait_for_request()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._idle is not None:
            self._idle.cancel()
        self._slots.leave(self)
        self._waiting.clear()

    def reset(self) -> None:
        """End the connection with a RST, and whatever still waits with it."""
        self._waiting.clear()
        if self.is_active():
            # without a time to linger a close is a reset
            self.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            # asyncio's and uvloop's connections share no class that can be aborted
            self.transport.abort()  # type: ignore[attr-defined]

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        raise RuntimeError("data_received does not pass it on")

    def data_received(self, data: bytes) -> None:
        # Not left to pymodbus: its buffer drops everything that has come together beyond 260 bytes, and the beginning of a
        # request that is still coming in whenever an answer leaves.
        try:
            whole, self._rest = frames.split(self._rest + data)
        except FrameError:
            self.close()
            return
        if whole:
            self._wait_for_request()
        self._waiting.extend((frame, self._as_pymodbus_reads(frame)) for frame in whole)
        if self._waiting and self._worker is None:
            self._worker = asyncio.get_running_loop().create_task(self._work())

    def _wait_for_request(self) -> None:
        """Close the connection unless a request comes in time."""
        if self._idle is not None:
            self._idle.cancel()
        if self._limits.idle_timeout_s is not None:
            self._idle = asyncio.get_running_loop().call_later(self._limits.idle_timeout_s, self.close)

    def _as_pymodbus_reads(self, frame: bytes) -> ModbusPDU | None:
        if _has_duration(frame):
            return None
        try:
            _, request = self.framer.handleFrame(frame, 0, 0)
        except ModbusIOException:
            return None
        return request

    async def _work(self) -> None:
        try:
            while self._waiting:
                frame, request = self._waiting.popleft()
                if self._clock() < self._answered_at + self._limits.min_gap_s - GAP_ROUNDING_S:
                    continue
                if isinstance(request, ReadDeviceInformationRequest):
                    response = self._context.identify(request)
                    response.transaction_id, response.dev_id = request.transaction_id, request.dev_id
                    self.server_send(response, None)  # type: ignore[no-untyped-call]
                elif request is not None:
                    self.last_pdu = request
                    await self.handle_request()  # type: ignore[no-untyped-call]
                elif _has_duration(frame):
                    self.send(self._context.pulse(frame))
                else:
                    known = frame[_FUNCTION_AT] in _TABLES
                    self.send(frames.exception_answer(frame, ILLEGAL_VALUE if known else ILLEGAL_FUNCTION))
                self._answered_at = self._clock()
        finally:
            self._worker = None


def _has_duration(frame: bytes) -> bool:
    """Whether it is a function 5 with a duration, or with what no device takes."""
    return frame[_FUNCTION_AT] == frames.WRITE_COIL and frame[_COIL_VALUE_AT] not in _COIL_VALUES


class _Server(ModbusTcpServer):
    """pymodbus's server with context and connections of ours."""

    def __init__(
        self,
        context: _Context,
        slots: _Slots,
        limits: ClientLimits,
        clock: Callable[[], float],
        address: tuple[str, int],
    ) -> None:
        placeholder = SimDevice(0, simdata=[SimData(0, values=0, datatype=DataType.UINT16)])
        super().__init__(placeholder, address=address)
        self.context = context  # type: ignore[assignment]  # the same two methods
        self._ours = context
        self._slots = slots
        self._limits = limits
        self._clock = clock

    def callback_new_connection(self) -> _Connection:
        return _Connection(self, self._ours, self._slots, self._limits, self._clock)


class SimulatedController:
    """A Modbus/TCP server for one or more units.

    A unit nobody plays is answered with exception 0B, as a gateway does, and so is one that is off the network while
    others are on. `limits` are what the device demands of its clients; nothing by default. `identity` is what every
    unit says that it is, by the number of the object (0 vendor, 1 product code, 2 revision); without it function 43 is refused.

    While no device is on the network every connection is reset, and so is one that finds no slot. A real device leaves its
    SYN unanswered in both cases; here the system accepts it before we are asked.
    """

    def __init__(
        self,
        devices: Mapping[int, Device],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        clock: Callable[[], float] | None = None,
        limits: ClientLimits | None = None,
        identity: Mapping[int, str] | None = None,
    ) -> None:
        self._devices = devices
        self._identity = identity or {}
        self._limits = limits or ClientLimits()
        self._slots = _Slots(devices, self._limits)
        self._host = host
        self._port = port
        self._clock = clock
        self._server: _Server | None = None

    @property
    def port(self) -> int:
        """The port it listens on, once started."""
        return self._port

    async def start(self) -> None:
        """Listen. Raises OSError when the port is taken."""
        loop = asyncio.get_running_loop()
        _check_free(self._host, self._port)
        self._slots.clear()
        clock = self._clock or loop.time
        context = _Context(self._devices, clock, self._identity)
        server = _Server(context, self._slots, self._limits, clock, (self._host, self._port))
        await server.serve_forever(background=True)
        # asyncio's and uvloop's servers share no class that has sockets
        self._port = server.transport.sockets[0].getsockname()[1]  # type: ignore[attr-defined]
        self._server = server

    async def stop(self) -> None:
        """Close the listener and every connection."""
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]  # pymodbus leaves it untyped
            self._server = None


def _check_free(host: str, port: int) -> None:
    """Raise the OSError that pymodbus would swallow when it cannot listen."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
