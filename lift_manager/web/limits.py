"""Limits how many clients are connected, so that controllers and disk have descriptors; counts them from `accept` on."""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress

from lift_manager.web.connections import Connections

MAX_CONNECTIONS = 1000
"""Chosen: a site has tens of robots, and hundreds of pages and programs that read events."""
_SHARE = 4
"""A quarter of the descriptors is for clients; the others are for controllers, the disk and what clients make the manager open."""
TARGET_FILES = 8192
"""Descriptors. Chosen: enough for MAX_CONNECTIONS and more controllers than a site has; most systems start with 1024 and allow more."""
HANDSHAKE_WITHIN_S = 10.0
"""Chosen: the time limit of a head; a handshake is three packets."""
EVICTABLE_AFTER_S = 1.0
"""At the limit, a handshake that has taken this long is dropped for the next client. Chosen: more than a slow network needs."""
TLS_SHUTDOWN_S = 10.0
"""How long a client has to confirm the end of TLS."""
_MAX_ACCEPTS = 64
"""Per turn of the loop. Chosen: a flood of connections must not block other work."""
_RETRY_AFTER_S = 1.0

_log = logging.getLogger(__name__)

NextContext = Callable[[], ssl.SSLContext]
"""Returns the TLS of one connection."""


def connections_limit() -> int:
    """Return how many clients may be connected: a share of the descriptors of this process, up to MAX_CONNECTIONS."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MAX_CONNECTIONS if soft == resource.RLIM_INFINITY else min(MAX_CONNECTIONS, soft // _SHARE)


def streams_limit() -> int:
    """Return how many connections may be event streams, which stay open; the rest is for short requests."""
    return max(1, connections_limit() * 6 // 10)


def raise_file_limit(target_files: int = TARGET_FILES) -> None:
    """Raise the limit of descriptors of this process, as far as the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    target = target_files if hard == resource.RLIM_INFINITY else min(target_files, hard)
    if soft != resource.RLIM_INFINITY and soft < target:
        resource.setrlimit(resource.RLIMIT_NOFILE, (target, hard))


class Acceptor:
    """Accepts connections of a listening socket and gives each a protocol of its own, until `close`.

    It replaces the server of asyncio, which notifies a protocol only after the handshake, so clients that never finish it could
    not be counted.
    """

    def __init__(
        self,
        sock: socket.socket,
        make: Callable[[], asyncio.Protocol],
        connections: Connections,
        next_context: NextContext | None,
        *,
        handshake_s: float,
    ) -> None:
        """Start accepting. A new protocol counts itself among the `connections` once it is connected."""
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._make_protocol = make
        self._connections = connections
        self._next_context = next_context
        self._handshake_s = handshake_s
        self._connecting: set[asyncio.Task[None]] = set()
        self._retry_timer: asyncio.TimerHandle | None = None
        self._is_short = False
        self._loop.add_reader(sock, self._accept)

    def close(self) -> None:
        """Stop accepting, and drop unfinished handshakes. May be repeated; the socket stays open."""
        if self._retry_timer is not None:
            self._retry_timer.cancel()
        self._loop.remove_reader(self._sock)
        for task in list(self._connecting):
            task.cancel()

    def _accept(self) -> None:
        for _ in range(_MAX_ACCEPTS):
            try:
                connection, address = self._sock.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._pause(error)
                return
            self._is_short = False
            if self._connections.make_room(address[0]):
                self._connect(connection, address[0])
            else:
                connection.close()

    def _connect(self, connection: socket.socket, address: str) -> None:
        connection.setblocking(False)
        protocol = self._make_protocol()
        task = self._loop.create_task(self._hand_over(connection, protocol))
        self._connections.add(protocol, address, task.cancel, evictable_after_s=EVICTABLE_AFTER_S)
        self._connecting.add(task)
        task.add_done_callback(self._connecting.discard)

    async def _hand_over(self, connection: socket.socket, protocol: asyncio.Protocol) -> None:
        is_connected = False
        # a client that fails the handshake learns that from TLS, and is not an error here
        try:
            with suppress(OSError):
                if self._next_context is None:
                    await self._loop.connect_accepted_socket(lambda: protocol, connection)
                else:
                    await self._loop.connect_accepted_socket(
                        lambda: protocol,
                        connection,
                        ssl=self._next_context(),
                        ssl_handshake_timeout=self._handshake_s,
                        ssl_shutdown_timeout=TLS_SHUTDOWN_S,
                    )
                is_connected = True
        finally:
            if not is_connected:
                self._connections.remove(protocol)

    def _pause(self, error: OSError) -> None:
        """Pause accepting while this computer cannot open a connection: the socket would be ready again at once."""
        if not self._is_short:
            self._is_short = True
            _log.error("api: this computer cannot accept a client at the moment: %s", error.strerror or error)
        self._loop.remove_reader(self._sock)
        self._retry_timer = self._loop.call_later(_RETRY_AFTER_S, self._loop.add_reader, self._sock, self._accept)
