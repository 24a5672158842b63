"""Put the web application on a port, and take it off again quickly."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
from collections.abc import Generator

import uvicorn
from starlette.types import ASGIApp

from lift_manager.web.connections import ConnectionLimits, Connections
from lift_manager.web.errors import ListenError
from lift_manager.web.http_protocol import JsonHttpProtocol
from lift_manager.web.limits import HANDSHAKE_WITHIN_S, Acceptor, NextContext, connections_limit
from lift_manager.web.shutdown import KEY, ShutdownSignal
from lift_manager.web.tls import ServerCertificates

BACKLOG = 2048
KEEP_ALIVE_S = 60
"""Chosen: above the period of any poller, so that no connection is closed under a request that is on its way."""
FINISH_WITHIN_S = 0.3
"""Chosen: an answer takes milliseconds; what takes longer is a stream or half a request."""
CANCEL_AFTER_S = 0.4
"""With FINISH_WITHIN_S and uvicorn's own 0.1 s this stays under 1 s, of the 5 s in which the manager must be out."""


def listen(host: str, port: int) -> socket.socket:
    """A socket that already listens, so that a busy port is known before anything else is started.

    Port 0 takes any free one. Raises ListenError with a sentence for the person at the command line.
    """
    if not 0 <= port <= 65535:
        raise ListenError(f"port {port} does not exist; choose one from 1 to 65535 with --port")
    family, address = resolved(host, port)
    sock = socket.socket(family, socket.SOCK_STREAM)
    try:
        # without it the port stays taken for a minute after a restart
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
        # here and not later: two sockets with SO_REUSEADDR may both be bound, but only one may listen
        sock.listen(BACKLOG)
    except OSError as error:
        sock.close()
        raise ListenError(_advice(error, host, port)) from error
    sock.setblocking(False)
    return sock


def resolved(host: str, port: int) -> tuple[socket.AddressFamily, tuple[object, ...]]:
    """Return where a host is, as this computer knows it. Raises ListenError."""
    bare = host.removeprefix("[").removesuffix("]")
    if not bare:
        raise ListenError(f"the host is empty; {HOSTS}")  # to the system that means everybody
    try:
        found = socket.getaddrinfo(bare, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, ValueError) as error:  # ValueError: a name that cannot be one, such as `a..b`
        raise ListenError(f"host {host!r} is not known here; {HOSTS}") from error
    # `localhost` is both, and clients that are told 127.0.0.1 are the more common
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, address


HOSTS = "with --host choose 127.0.0.1 (this computer only), 0.0.0.0 (everybody), or one of this computer's addresses"


def _advice(error: OSError, host: str, port: int) -> str:
    match error.errno:
        case errno.EADDRINUSE:
            return f"port {port} on {host} is in use by another program; stop that one, or choose another with --port"
        case errno.EACCES:
            return f"port {port} on {host} needs more rights than this user has; choose one above 1023 with --port"
        case errno.EADDRNOTAVAIL:
            return f"{host} is not an address of this computer, so port {port} cannot be opened on it; {HOSTS}"
        case _:
            return f"cannot listen on {host} port {port} ({error.strerror}); choose another with --host or --port"


async def serve(
    app: ASGIApp,
    sock: socket.socket,
    *,
    tls: ServerCertificates | None = None,
    handshake_s: float = HANDSHAKE_WITHIN_S,
    limits: ConnectionLimits | None = None,
) -> None:
    """Answer on `sock` until cancelled, then be out within a second and leave `sock` closed; HTTPS alone with `tls`.

    Without `limits` there may be as many connections as this computer has descriptors for.
    Signals are left to the caller. A task that is cancelled before it ever ran closes nothing: put the socket into a
    `with` around it.
    """
    config = uvicorn.Config(
        app,
        http=JsonHttpProtocol,
        log_config=None,
        log_level="error",  # it warns of every line that is no HTTP, and so lets anybody fill the log
        access_log=False,
        server_header=False,
        proxy_headers=False,
        lifespan="off",
        ws="none",
        timeout_keep_alive=KEEP_ALIVE_S,
    )
    # the annotation says int, but the number goes straight to asyncio.wait_for
    config.timeout_graceful_shutdown = CANCEL_AFTER_S  # type: ignore[assignment]
    limits = limits or ConnectionLimits.of(connections_limit())
    server = _Server(config, None if tls is None else tls.next_context, handshake_s, Connections(limits))
    try:
        await server.serve(sockets=[sock])
    except asyncio.CancelledError:
        if server.started:
            await server.shutdown([sock])
        raise
    finally:
        sock.close()


class _Server(uvicorn.Server):
    """uvicorn's server as a part of a program, not as its owner, and with our own way of taking connections."""

    def __init__(
        self, config: uvicorn.Config, tls: NextContext | None, handshake_s: float, connections: Connections
    ) -> None:
        super().__init__(config)
        self.servers = []
        self._tls = tls
        self._handshake_s = handshake_s
        self._connections = connections
        self._ending = ShutdownSignal()
        self._acceptors: list[Acceptor] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Take connections."""
        self._acceptors += [
            Acceptor(sock, self._protocol, self._connections, self._tls, handshake_s=self._handshake_s)
            for sock in sockets or ()
        ]
        self.started = True

    def _protocol(self) -> JsonHttpProtocol:
        return JsonHttpProtocol(self.config, self.server_state, {KEY: self._ending}, self._connections)

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """Leave the signals alone: held outputs are released before the pages go away."""
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Hang up on whoever does not finish soon.

        uvicorn would wait for an event stream until its time-out and then log the stream's cancellation as an error;
        told of the end, or that the client is gone, a stream ends by itself.
        """
        for acceptor in self._acceptors:
            acceptor.close()
        self._connections.close()
        self._ending.tell()
        for connection in list(self.server_state.connections):
            connection.shutdown()
        await self._until_idle()
        for connection in list(self.server_state.connections):
            transport = connection.transport
            # closing would wait for a reader who does not read, and over TLS for a goodbye, which `connection.shutdown` has said
            if self._tls is not None or transport.get_write_buffer_size():
                transport.abort()
            else:
                transport.close()
        await super().shutdown(sockets)

    async def _until_idle(self) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(FINISH_WITHIN_S):
                while self.server_state.tasks:
                    await asyncio.wait(self.server_state.tasks)
