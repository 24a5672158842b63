"""A proxy that makes faults in front of any Modbus/TCP server: a simulated one, somebody else's, a real controller.

Without a fault every byte passes as it came, both ways, also those of frames that it does not understand. A stream that is
no Modbus/TCP passes untouched from that point on, and so escapes every fault.
"""

from __future__ import annotations

import asyncio
import heapq
import socket
import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from types import TracebackType
from typing import Self

from register_maps import frames
from register_maps.errors import FrameError
from simulator.wire_faults import Connection, ConnectOutcome, Reply, WireFaults

_CHUNK = 65536
_RESET = struct.pack("ii", 1, 0)
"""SO_LINGER on, for 0 s: closing sends RST and throws away what was still to be sent."""
_BACKLOG = 100

_Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]
OnRequest = Callable[[str, bytes], None]
"""Receives the host and port of the client, as `host:port`, and the frame."""


class FaultProxy:
    """Listens for clients and passes them on to the server at `host` and `port`, each over a connection of its own.

    A client whose server cannot be reached is reset. While the proxy is stopped its port refuses.
    """

    def __init__(
        self,
        host: str,
        port: int,
        faults: WireFaults,
        *,
        listen_host: str = "127.0.0.1",
        listen_port: int = 0,
        on_request: OnRequest | None = None,
    ) -> None:
        """`listen_port` 0: any free one, and the same again after a stop. `on_request` is called for each request that reaches the server."""
        self.faults = faults
        """May be changed at any time."""
        self._server = host, port
        self._listen_host = listen_host
        self._port = listen_port
        self._on_request = on_request
        self._work: asyncio.Task[None] | None = None

    @property
    def port(self) -> int:
        """The port it listens on, once started."""
        return self._port

    async def start(self) -> None:
        """Listen. Raises OSError when the port is taken."""
        if self._work is not None:
            raise RuntimeError("the proxy runs already")
        family = socket.AF_INET6 if ":" in self._listen_host else socket.AF_INET
        listener = socket.create_server((self._listen_host, self._port), family=family, backlog=_BACKLOG)
        listener.setblocking(False)
        self._port = listener.getsockname()[1]
        loop = asyncio.get_running_loop()
        self.faults.begin(loop.time())
        self._work = loop.create_task(self._accept(listener), name=f"fault proxy {self._port}")
        # also where it is cancelled before its first step
        self._work.add_done_callback(lambda _: listener.close())

    async def stop(self) -> None:
        """Close the listener and every connection. Raises what made the proxy fail, if anything did."""
        work, self._work = self._work, None
        if work is None:
            return
        work.cancel()
        await asyncio.wait({work})
        if not work.cancelled():
            work.result()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.stop()

    async def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        async with asyncio.TaskGroup() as clients:
            # Not `sock_accept`: cancelled in the wrong moment, it loses the connection that it has just accepted.
            loop.add_reader(listener, self._welcome, listener, clients)
            try:
                await loop.create_future()
            finally:
                loop.remove_reader(listener)

    def _welcome(self, listener: socket.socket, clients: asyncio.TaskGroup) -> None:
        try:
            client, _ = listener.accept()
        except (BlockingIOError, ConnectionAbortedError):  # it went away while it waited
            return
        client.setblocking(False)
        task = clients.create_task(self._serve(client))
        task.add_done_callback(lambda _: client.close())

    async def _serve(self, client: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        connection = self.faults.connection(loop.time())
        writers: list[asyncio.StreamWriter] = []
        try:
            near = await asyncio.open_connection(sock=client)
            writers.append(near[1])
            if connection.admission is ConnectOutcome.REFUSED:
                _reset(near[1])
                return
            device: _Stream | None = None
            if connection.admission is ConnectOutcome.ADMITTED:
                try:
                    device = await asyncio.open_connection(*self._server)
                except OSError:
                    _reset(near[1])
                    return
                writers.append(device[1])
            await _Relay(near, device, connection, loop.time, self._on_request).run()
            await _close(near[1])
        finally:
            connection.close(loop.time())
            for writer in writers:
                writer.transport.abort()  # closing would wait for one that does not read
            for writer in writers:
                await _close(writer)


class _Outbox:
    """What a client is to get, each segment at its time."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._due: list[tuple[float, int, bytes | None]] = []
        self._count = 0
        self._changed = asyncio.Event()
        self._complete = False
        self._is_client_done = False
        self._abandoned = False

    def put(self, replies: Iterable[Reply], now: float) -> None:
        """These come so many seconds from `now`, the moment for which they were planned; those for one moment in this order."""
        for delay_s, data in replies:
            self._count += 1
            heapq.heappush(self._due, (now + delay_s, self._count, data))
        self._changed.set()

    def finish(self) -> None:
        """Nothing more will be put."""
        self._complete = True
        self._changed.set()

    def leave(self) -> None:
        """The client sends nothing more: it gets the remaining answers of the device, but no delayed ones."""
        self._is_client_done = True
        self._changed.set()

    def abandon(self) -> None:
        """Discard the remaining segments."""
        self._abandoned = True
        self._changed.set()

    async def send(self, writer: asyncio.StreamWriter) -> None:
        """Send everything at its time, until a reset, or until it is finished or abandoned."""
        while not self._abandoned:
            self._changed.clear()
            wait_s = self._due[0][0] - self._clock() if self._due else None
            if wait_s is None or wait_s > 0:
                if self._complete and (self._is_client_done or not self._due):
                    return
                with suppress(TimeoutError):
                    async with asyncio.timeout(wait_s):
                        await self._changed.wait()
                continue
            _, _, data = heapq.heappop(self._due)
            if data is None:
                _reset(writer)
                return
            writer.write(data)
            await writer.drain()


class _Relay:
    """One client and its connection to the server."""

    def __init__(
        self,
        client: _Stream,
        device: _Stream | None,
        connection: Connection,
        clock: Callable[[], float],
        on_request: OnRequest | None,
    ) -> None:
        """`device` is None for a client that never gets an answer."""
        self._client = client
        self._device = device
        self._connection = connection
        self._clock = clock
        self._on_request = on_request
        self._outbox = _Outbox(clock)

    async def run(self) -> None:
        """Pass on what comes, until one of the two has ended it."""
        async with asyncio.TaskGroup() as group:
            requests = group.create_task(self._requests())
            answers = group.create_task(self._answers())
            with suppress(OSError):  # the client is gone, and so are the remaining answers
                await self._outbox.send(self._client[1])
            requests.cancel()
            if self._connection.dead:
                # The device is not notified that its client is gone, as with a pulled cable.
                await self._forget_client()
            else:
                answers.cancel()

    async def _forget_client(self) -> None:
        self._connection.close(self._clock())
        await _close(self._client[1])

    async def _requests(self) -> None:
        """From the client to the device."""
        splitter = _Splitter()
        try:
            while data := await self._client[0].read(_CHUNK):
                whole, raw = splitter.split(data)
                for frame in whole:
                    self._request(frame)
                self._pass(raw)
                await self._drain()
        except OSError:
            self._outbox.abandon()
            return
        if self._device is None or self._connection.dead:
            self._outbox.abandon()
            return
        self._pass(splitter.rest)
        self._outbox.leave()
        if not self._device[1].is_closing():
            self._device[1].write_eof()

    async def _drain(self) -> None:
        if self._device is not None:
            with suppress(OSError):  # `_answers` meets the same error, and ends the connection
                await self._device[1].drain()

    def _request(self, frame: bytes) -> None:
        now = self._clock()
        verdict = self._connection.take(frame, now)
        if verdict.executed:
            self._pass(frame)
            if self._on_request is not None and (address := self._client[1].get_extra_info("peername")) is not None:
                self._on_request(f"{address[0]}:{address[1]}", frame)
        self._outbox.put(verdict.replies, now)

    def _pass(self, data: bytes) -> None:
        if data and self._device is not None and not self._connection.dead:
            self._device[1].write(data)

    async def _answers(self) -> None:
        """From the device to the client."""
        if self._device is None:
            return
        splitter = _Splitter()
        reset = False
        try:
            while data := await self._device[0].read(_CHUNK):
                whole, raw = splitter.split(data)
                now = self._clock()
                for frame in whole:
                    self._outbox.put(self._connection.answered(frame, now), now)
                self._pass_raw(raw)
        except OSError:
            reset = True
        if self._connection.dead:
            return
        self._pass_raw(splitter.rest)
        if reset:
            self._outbox.put([(0.0, None)], self._clock())
        self._outbox.finish()

    def _pass_raw(self, raw: bytes) -> None:
        if raw and not self._connection.dead:
            self._outbox.put([(0.0, raw)], self._clock())


class _Splitter:
    """A stream, taken apart into frames for as long as it consists of them."""

    def __init__(self) -> None:
        self.rest = b""
        """What has come of a frame that is not whole."""
        self._broken = False

    def split(self, data: bytes) -> tuple[list[bytes], bytes]:
        """Whole frames, and bytes that are none."""
        if not self._broken:
            try:
                whole, self.rest = frames.split(self.rest + data)
            except FrameError:
                self._broken = True
            else:
                return whole, b""
        raw, self.rest = self.rest + data, b""
        return [], raw


def _reset(writer: asyncio.StreamWriter) -> None:
    connected = writer.get_extra_info("socket")
    with suppress(OSError):  # gone already
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
    writer.transport.abort()


async def _close(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with suppress(OSError):  # the break was noticed by the reader
        await writer.wait_closed()
