"""How many clients may be connected: few enough to leave descriptors to the controllers and the disk, counted from the first moment on."""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress

from lift_manager.web.connections import Connections

MOST_CONNECTIONS = 1000
"""Chosen: a site has tens of robots, and hundreds of pages and programs that listen."""
_SHARE = 4
"""Of so many descriptors one is for a client; the others are for controllers, the disk and what a client makes the manager open."""
FILES_WANTED = 8192
"""Descriptors. Chosen: for as many clients, and more controllers than a site has; most systems begin with 1024 and allow more."""
HANDSHAKE_WITHIN_S = 10.0
"""Chosen: as long as a head may take; a handshake is three packets."""
YIELDS_AFTER_S = 1.0
"""When no place is left, a handshake that has taken this long makes room for the next client. Chosen: above what a slow network needs."""
GOODBYE_WITHIN_S = 10.0
"""How long a client has for the end of TLS, which it should confirm."""
_AT_ONCE = 64
"""Chosen: whoever floods the port waits for what else the loop has to do."""
_AGAIN_AFTER_S = 1.0

_log = logging.getLogger(__name__)

NextContext = Callable[[], ssl.SSLContext]
"""Returns the TLS of one connection."""


def connections_limit() -> int:
    """Return how many clients may be connected: a share of the descriptors that this process may open, and never too many."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST_CONNECTIONS if soft == resource.RLIM_INFINITY else min(MOST_CONNECTIONS, soft // _SHARE)


def streams_limit() -> int:
    """Return how many of them may be event streams, which stay: the others are for those who ask something and go."""
    return max(1, connections_limit() * 6 // 10)


def allow_files(wanted: int = FILES_WANTED) -> None:
    """Raise the number of descriptors that this process may open to what is wanted, as far as the system lets it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


class Acceptor:
    """Hands every connection that a listening socket gets to a protocol of its own, until `close`.

    Not asyncio's own server: that tells a protocol nothing before the handshake, and nothing at all if it fails, so those
    who never finish it could not be counted.
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
        """Begin. A protocol that is made takes its own place among the `connections` once it is connected, and gives it up."""
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._make = make
        self._connections = connections
        self._next_context = next_context
        self._handshake_s = handshake_s
        self._coming: set[asyncio.Task[None]] = set()
        self._again: asyncio.TimerHandle | None = None
        self._is_short = False
        self._loop.add_reader(sock, self._accept)

    def close(self) -> None:
        """Take nobody else, and hang up on whoever has not shaken hands. May be repeated; the socket stays open."""
        if self._again is not None:
            self._again.cancel()
        self._loop.remove_reader(self._sock)
        for task in list(self._coming):
            task.cancel()

    def _accept(self) -> None:
        for _ in range(_AT_ONCE):
            try:
                connection, address = self._sock.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._pause(error)
                return
            self._is_short = False
            if self._connections.make_room(address[0]):
                self._take(connection, address[0])
            else:
                connection.close()

    def _take(self, connection: socket.socket, address: str) -> None:
        connection.setblocking(False)
        protocol = self._make()
        task = self._loop.create_task(self._hand_over(connection, protocol))
        self._connections.add(protocol, address, task.cancel, yields_after_s=YIELDS_AFTER_S)
        self._coming.add(task)
        task.add_done_callback(self._coming.discard)

    async def _hand_over(self, connection: socket.socket, protocol: asyncio.Protocol) -> None:
        is_handed_over = False
        # whoever does not get through the handshake is told so by TLS, and is no trouble of ours
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
                        ssl_shutdown_timeout=GOODBYE_WITHIN_S,
                    )
                is_handed_over = True
        finally:
            if not is_handed_over:
                self._connections.remove(protocol)

    def _pause(self, error: OSError) -> None:
        """Wait a little where this computer has no room for a connection: the socket would call again at once."""
        if not self._is_short:
            self._is_short = True
            _log.error("api: this computer takes no client at the moment: %s", error.strerror or error)
        self._loop.remove_reader(self._sock)
        self._again = self._loop.call_later(_AGAIN_AFTER_S, self._loop.add_reader, self._sock, self._accept)
