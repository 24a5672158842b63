"""Whole Modbus/TCP frames to and from one controller: the `Wire` Protocol, and its form on pymodbus.

It uses only the transport layer of pymodbus. The layers above (transactions, retries, a lock) repeat writes on their own and
accept answers to other requests; `link` does that work. No other module of drivers imports pymodbus.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable
from functools import partial
from typing import Protocol

from pymodbus.transport import CommParams, CommType, ModbusProtocol

from drivers.errors import ConnectFailed, ConnectProblem
from drivers.modbus.tls import (
    NO_TLS,
    ClientContext,
    LinkTls,
    client_context,
    explain_break,
    explain_handshake_failure,
    explain_refusal,
    explain_silence,
    explain_tls_data,
)
from register_maps.errors import FrameError
from register_maps.frames import split

OnFrame = Callable[[bytes], None]
"""Receives every whole frame, in order."""
OnLost = Callable[[str], None]
"""Receives the reason when the connection is lost without `close`: at most once, and after the last frame."""
OnBytes = Callable[[bool, bytes], None]
"""For traces: (sent, frame) of every frame, a sent one just before it leaves and a received one before `OnFrame`."""

CLOSED_BY_CONTROLLER = "the controller closed the connection"
NOT_MODBUS = "the data received is not Modbus/TCP"


class Wire(Protocol):
    """Sends and receives whole frames. It never repeats, answers or reconnects by itself.

    Every implementation passes tests/drivers/test_wire_contract.py.
    """

    on_bytes: OnBytes | None

    @property
    def peer(self) -> str:
        """The address of the other end, for messages: "127.0.0.1:5020"."""

    @property
    def is_open(self) -> bool:
        """Whether frames can be sent."""

    async def open(self, on_frame: OnFrame, on_lost: OnLost, *, timeout_s: float) -> None:
        """Connect. May be called again after `close` or a loss; frames of an earlier connection are no longer delivered.

        `on_lost` is not called before this returns. Raises ConnectFailed, also if `close` was called meanwhile.
        """

    def close(self) -> None:
        """Drop the connection at once, with all unsent data. May be repeated.

        Neither callback is called afterwards, not even for frames received in the same segment.
        """

    def send(self, frame: bytes) -> None:
        """Send one frame. Never waits and never raises: a lost connection is reported by `OnLost`.

        A frame of which a part was received before this call is discarded: it cannot be the answer to this request, and with a
        device that returns no transaction ids it would pass for it.
        """


class PymodbusWire:
    """A wire over TCP, with or without TLS, on the transport layer of pymodbus."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_attempts", "_connection", "_host", "_peer", "_port", "_tls", "on_bytes", "remaining_s")

    def __init__(
        self,
        host: str,
        port: int = 502,
        *,
        tls: LinkTls | None = None,
        remaining_s: Callable[[], float] | None = None,
    ) -> None:
        """`remaining_s` returns for how long this manager may still send; bytes that were not acknowledged by then are dropped.

        None for a manager that is alone, whose kernel may send them again for minutes, even after the manager was killed.
        """
        self.on_bytes: OnBytes | None = None
        self.remaining_s = remaining_s
        self._host = host
        self._port = port
        self._tls = tls
        self._peer = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._connection: _Connection | None = None
        self._attempts = 0
        """Counts calls of `open` and `close`, so that an `open` that waits for its files notices a later call."""

    @property
    def peer(self) -> str:
        return self._peer

    @property
    def is_open(self) -> bool:
        return self._connection is not None and self._connection.is_active()

    async def open(self, on_frame: OnFrame, on_lost: OnLost, *, timeout_s: float) -> None:
        """As in `Wire`; over TLS the handshake has its own `handshake_s` after that."""
        self.close()
        context = None if self._tls is None else await self._context(self._tls)
        connection = _Connection(_params(self._host, self._port, context), self, on_frame, on_lost, self._tls)
        self._connection = connection
        try:
            await _connect(connection, context, timeout_s)
        except TimeoutError as error:
            self.close()
            raise self._timeout_error(context, timeout_s) from error
        except (OSError, UnicodeError) as error:
            self.close()
            raise self._open_error(context, error) from error
        except BaseException:
            self.close()
            raise
        if self._connection is not connection or not connection.is_active():
            raise self._closed_error()
        connection.announced = True
        del connection.call_create  # a connection is made once, and what makes it would stay in memory

    def close(self) -> None:
        self._attempts += 1
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.abort()

    def send(self, frame: bytes) -> None:
        connection = self._connection
        if connection is None or (self.remaining_s is not None and self.remaining_s() <= 0):
            return
        if self.on_bytes is not None:
            self.on_bytes(True, frame)
        connection.write(frame)

    async def _context(self, tls: LinkTls) -> ClientContext:
        attempt = self._attempts
        context = await client_context(tls, self._peer)
        if attempt != self._attempts:
            raise self._closed_error()
        return context

    def _closed_error(self) -> ConnectFailed:
        return ConnectFailed(self._peer, ConnectProblem.OTHER, "the connection was closed as soon as it was made")

    def _timeout_error(self, context: ClientContext | None, timeout_s: float) -> ConnectFailed:
        if context is not None and context.began:
            detail = f"the controller accepted the connection, but the TLS handshake did not complete within {context.handshake_s:g} s; {NO_TLS}"
            return ConnectFailed(self._peer, ConnectProblem.TLS, detail)
        detail = f"no answer to the connection request within {timeout_s:g} s"
        detail += "; the controller may be off, or may have no free connection slot"
        return ConnectFailed(self._peer, ConnectProblem.TIMED_OUT, detail)

    def _open_error(self, context: ClientContext | None, error: OSError | UnicodeError) -> ConnectFailed:
        if context is None or self._tls is None or not context.began or isinstance(error, UnicodeError):
            return _connect_failed(self._peer, error)
        return ConnectFailed(self._peer, ConnectProblem.TLS, explain_handshake_failure(error, self._tls))


class _Connection(ModbusProtocol):
    """One TCP connection, from its making to its end; never reused."""

    def __init__(
        self, params: CommParams, wire: PymodbusWire, on_frame: OnFrame, on_lost: OnLost, tls: LinkTls | None
    ) -> None:
        super().__init__(params, is_server=False)
        self.comm_params = params  # nobody else has it, and each connection would keep a copy of it
        if tls is not None:
            name = tls.server_name or params.host
            self.call_create = partial(self.call_create, server_hostname=name)  # type: ignore[call-arg]  # a partial itself
        self._tls = tls
        self._wire = wire
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._rest = b""
        self._rest_is_old = False
        """The incoming frame started before the last request was sent, so it cannot be the answer to it."""
        self._aborted = False
        self._has_received = False
        self.announced = False
        """Whether `open` has returned; a loss before that is its failure."""

    def write(self, frame: bytes) -> None:
        # Not `ModbusProtocol.send`: it drops the first half of an answer that is still arriving, and keeps every frame in a list
        # that the whole process shares.
        self._rest_is_old = bool(self._rest)
        if self.transport is not None:
            if self._wire.remaining_s is not None:
                self._limit_repetition(self._wire.remaining_s())
            self.transport.write(frame)  # type: ignore[attr-defined]  # pymodbus types it as BaseTransport

    def _limit_repetition(self, remaining_s: float) -> None:
        """Let the kernel send bytes again for no longer than this manager may send."""
        remaining_ms = max(int(remaining_s * 1000), 1)  # 0 would be the default of the system, minutes
        connected = self.transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, remaining_ms)

    def abort(self) -> None:
        """Drop the connection. `close` alone would wait until a silent peer has received all unsent data."""
        self._aborted = True
        if self.transport is not None:
            self.transport.abort()  # type: ignore[attr-defined]  # pymodbus types it as BaseTransport
        self.close()

    def callback_new_connection(self) -> ModbusProtocol:
        raise RuntimeError("a client accepts no connections")

    def callback_connected(self) -> None:
        if self._aborted:
            self.transport.abort()  # type: ignore[attr-defined]  # pymodbus types it as BaseTransport
            return
        # Both required by the messaging guide, 4.3.2; asyncio sets the first only on some platforms.
        connected = self.transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if self._wire.remaining_s is not None:
            # whatever ends this process, the connection is reset, and what was not sent is dropped
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def callback_disconnected(self, exc: Exception | None) -> None:
        self._aborted = True
        if self.announced:
            self._on_lost(self._ending(exc))

    def _ending(self, exc: Exception | None) -> str:
        reason = f"the connection broke: {explain_break(exc)}" if exc else CLOSED_BY_CONTROLLER
        if self._tls is None or self._has_received:
            return reason
        return explain_refusal(exc, self._tls) or f"{reason} before the first answer; {explain_silence(self._tls)}"

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        raise RuntimeError("data_received does not pass it on")

    def data_received(self, data: bytes) -> None:
        # Not left to ModbusProtocol: its buffer drops everything when more than 516 bytes arrive together.
        self._has_received = True
        try:
            frames, self._rest = split(self._rest + data)
        except FrameError as error:
            self.abort()
            if self.announced:
                self._on_lost(f"{NOT_MODBUS}: {explain_tls_data(self._rest + data) or error}")
            return
        if frames and self._rest_is_old:
            self._rest_is_old = False
            del frames[0]
        for frame in frames:
            if self._aborted:
                return
            if self._wire.on_bytes is not None:
                self._wire.on_bytes(False, frame)
            self._on_frame(frame)


async def _connect(connection: _Connection, context: ClientContext | None, timeout_s: float) -> None:
    """Connect: `timeout_s` for TCP, then the handshake's own time for TLS. Raises OSError, UnicodeError."""
    # Not `ModbusProtocol.connect`: it turns every failure into False and logs it on each attempt.
    async with asyncio.timeout(timeout_s) as limit:
        if context is None:
            await connection.call_create()
            return
        context.on_handshake = partial(_extend_limit, limit, context.handshake_s)
        try:
            await connection.call_create()
        finally:
            context.on_handshake = None


def _extend_limit(limit: asyncio.Timeout, more_s: float) -> None:
    if not limit.expired():
        limit.reschedule(asyncio.get_running_loop().time() + more_s)


def _params(host: str, port: int, context: ClientContext | None) -> CommParams:
    kind = CommType.TCP if context is None else CommType.TLS
    return CommParams(comm_name=host, comm_type=kind, host=host, port=port, reconnect_delay=0, sslctx=context)


def _connect_failed(peer: str, error: OSError | UnicodeError) -> ConnectFailed:
    # UnicodeError: a name that no host can have, such as "lift..local".
    if isinstance(error, (socket.gaierror, UnicodeError)):
        return ConnectFailed(peer, ConnectProblem.HOST_NOT_FOUND, "no host of this name is known")
    if isinstance(error, ConnectionRefusedError):
        return ConnectFailed(peer, ConnectProblem.REFUSED, "connection refused; nothing listens on this port")
    if isinstance(error, TimeoutError):
        return ConnectFailed(peer, ConnectProblem.TIMED_OUT, "no answer to the connection request")
    return ConnectFailed(peer, ConnectProblem.OTHER, f"cannot connect: {error}")
