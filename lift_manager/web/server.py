"""Serves the web application on a port, and shuts down quickly."""

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
"""Chosen: longer than the period of any poller, so that no connection is closed while a request is on its way."""
FINISH_WITHIN_S = 0.3
"""Chosen: a reply takes milliseconds; only a stream or an incomplete request takes longer."""
CANCEL_AFTER_S = 0.4
"""With FINISH_WITHIN_S and uvicorn's own 0.1 s this stays below 1 s, of the 5 s in which the manager must exit."""


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket, so that a busy port is found before anything else starts.

    Port 0 means any free one. Raises ListenError with a message for the command line.
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
        raise ListenError(listen_error_text(error, host, port)) from error
    sock.setblocking(False)
    return sock


def resolved(host: str, port: int) -> tuple[socket.AddressFamily, tuple[object, ...]]:
    """Resolve a host name or address. Raises ListenError."""
    bare = host.removeprefix("[").removesuffix("]")
    if not bare:
        raise ListenError(f"the host is empty; {HOSTS}")  # to the system that means all addresses
    try:
        found = socket.getaddrinfo(bare, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, ValueError) as error:  # ValueError: a name that cannot be one, such as `a..b`
        raise ListenError(f"host {host!r} is not known here; {HOSTS}") from error
    # `localhost` is both, and clients that use 127.0.0.1 are more common
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, address


HOSTS = "with --host choose 127.0.0.1 (this computer only), 0.0.0.0 (everybody), or one of this computer's addresses"


def listen_error_text(error: OSError, host: str, port: int) -> str:
    """Return why a port cannot be listened on, and what to do, for commands with --host and --port."""
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
    """Serve on `sock` until cancelled, then return within a second with `sock` closed; with `tls`, HTTPS only.

    Without `limits`, the number of connections follows from the descriptors of this process. Signals are left to the caller. A task
    that is cancelled before it ran does not close the socket: put it into a `with` statement.
    """
    config = uvicorn.Config(
        app,
        http=JsonHttpProtocol,
        log_config=None,
        log_level="error",  # its warnings for every line that is not HTTP would let anybody fill the log
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
    """uvicorn's server embedded in a program, with an acceptor of its own."""

    def __init__(
        self, config: uvicorn.Config, tls: NextContext | None, handshake_s: float, connections: Connections
    ) -> None:
        super().__init__(config)
        self.servers = []
        self._tls = tls
        self._handshake_s = handshake_s
        self._connections = connections
        self._reply_at_once = getattr(config.app, "reply_at_once", None)
        self._shutdown_signal = ShutdownSignal()
        self._acceptors: list[Acceptor] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept connections."""
        self._acceptors += [
            Acceptor(sock, self._protocol, self._connections, self._tls, handshake_s=self._handshake_s)
            for sock in sockets or ()
        ]
        self.started = True

    def _protocol(self) -> JsonHttpProtocol:
        state = {KEY: self._shutdown_signal}
        return JsonHttpProtocol(self.config, self.server_state, state, self._connections, self._reply_at_once)

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """Leave the signals alone: held outputs are released before the pages go away."""
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut down, and drop connections that do not finish soon.

        uvicorn would wait for an event stream until its time-out and then log its cancellation as an error; after the shutdown
        signal, or the loss of its client, a stream ends by itself.
        """
        for acceptor in self._acceptors:
            acceptor.close()
        self._connections.close()
        self._shutdown_signal.send()
        for connection in list(self.server_state.connections):
            connection.shutdown()
        await self._until_idle()
        for connection in list(self.server_state.connections):
            transport = connection.transport
            # close() would wait for a client that does not read, and over TLS for its close_notify, which was sent by `connection.shutdown`
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
