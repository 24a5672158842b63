"""uvicorn's HTTP protocol with limits of its own, answering in JSON even to what it cannot read."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle
from uvicorn.server import ServerState

from lift_manager.web.answers import answer
from lift_manager.web.body import LINGER_BYTES, LINGER_S
from lift_manager.web.connections import Connections
from lift_manager.web.errors import RequestError

ADVICE = (
    "this could not be read as HTTP/1.1; write what is not ASCII in the address percent-encoded"
    " (curl: -G --data-urlencode 'lift_name=...') and let Content-Length be the length of the body"
)
HEAD_LIMIT_BYTES = 32 * 1024
"""Of request line and headers. Chosen: four times what common proxies pass on; the parser itself knows no limit."""
HEADERS_LIMIT = 100
HEAD_WITHIN_S = 10.0
"""Chosen: a head is one packet; who takes longer sends it drop by drop to keep the connection."""

TAKEN_WITHIN_S = 60.0
"""Chosen: what waits is some 64 KiB at most (uvicorn's high-water mark), and whoever has not taken it by then does not read."""

_BAD = RequestError("not_http", ADVICE)
_WITHOUT_HOST = RequestError(
    "not_http", "HTTP/1.1 needs the header Host, once: the name or address that was connected to"
)
_TOO_LONG = RequestError(
    "head_too_long",
    f"address and headers are too long; at most {HEAD_LIMIT_BYTES} bytes and {HEADERS_LIMIT} headers are read",
)


class _HeadRefused(Exception):
    pass


class JsonHttpProtocol(HttpToolsProtocol):
    """The workshop's clients parse every answer as JSON, and a plain line would end them."""

    _error = _BAD
    _head_bytes = 0
    _late: asyncio.TimerHandle | None = None
    """Runs while a head is awaited."""
    _unread: asyncio.TimerHandle | None = None
    _lingering: asyncio.TimerHandle | None = None
    _discarded_bytes = 0

    def __init__(
        self, config: uvicorn.Config, server_state: ServerState, app_state: dict[str, Any], connections: Connections
    ) -> None:
        super().__init__(config, server_state, app_state)
        self._connections = connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin."""
        super().connection_made(transport)
        self._connections.wait(self, transport.abort)
        self._await_head(begins=True)

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._connections.remove(self)
        self._await_head(begins=False)
        self._end_unread()
        if self._lingering is not None:
            self._lingering.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read on; a head that does not end is cut off."""
        if self._lingering is not None:
            self._discard(data)
            return
        super().data_received(data)
        if self._late is not None and not self.transport.is_closing():
            self._head_bytes += len(data)
            if self._head_bytes > HEAD_LIMIT_BYTES:
                self._error = _TOO_LONG
                self.send_400_response("")

    def pause_writing(self) -> None:
        """Wait for a client that does not take its answer, but not for ever: an event stream would keep its place."""
        self.flow.pause_writing()
        if self._unread is None:
            self._unread = self.loop.call_later(TAKEN_WITHIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on: the client reads."""
        self._end_unread()
        self.flow.resume_writing()

    def on_message_begin(self) -> None:
        """Take the first byte of a request."""
        super().on_message_begin()
        self._await_head(begins=True)

    def on_headers_complete(self) -> None:
        """Hand the request on, unless its head is too long or does not name a host."""
        self._await_head(begins=False)
        size, hosts = len(self.url), 0
        for name, value in self.headers:
            size += len(name) + len(value)
            hosts += name == b"host"
        if size > HEAD_LIMIT_BYTES or len(self.headers) > HEADERS_LIMIT:
            self._error = _TOO_LONG
            raise _HeadRefused
        if hosts > 1 or (not hosts and self.parser.get_http_version() == "1.1"):
            self._error = _WITHOUT_HOST
            raise _HeadRefused
        self._connections.serve(self)
        super().on_headers_complete()

    def on_response_complete(self) -> None:
        """Go on with the next request, or wait for one."""
        super().on_response_complete()
        if not self._is_answering and not self.transport.is_closing():
            self._connections.wait(self, self.transport.abort)

    def send_400_response(self, msg: str) -> None:
        """Answer in JSON where uvicorn would answer with the line `msg`, and hang up.

        What the client still sends is discarded for a bounded time: closing with unread data resets the connection, and a client
        that sends everything before it reads would never see the answer.
        """
        said = answer(self._path(), self._error)
        headers = [*said.raw_headers, (b"connection", b"close")]
        status = f"HTTP/1.1 {self._error.status} {HTTPStatus(self._error.status).phrase}".encode()
        lines = [status, *(name + b": " + value for name, value in headers)]
        self.transport.write(b"\r\n".join([*lines, b"", bytes(said.body)]))
        self._await_head(begins=False)
        if self._is_answering:
            self.transport.close()  # the answer to an earlier request is cut off in any case
            return
        self._lingering = self.loop.call_later(LINGER_S, self.transport.close)
        if self.transport.can_write_eof():
            self.transport.write_eof()

    @property
    def _is_answering(self) -> bool:
        cycle: RequestResponseCycle | None = self.cycle  # none before the first request, whatever its annotation says
        return cycle is not None and not cycle.response_complete

    def _discard(self, data: bytes) -> None:
        self._discarded_bytes += len(data)
        if self._discarded_bytes > LINGER_BYTES:
            self.transport.close()

    def _path(self) -> str:
        """Where the answer's form comes from: of what is no HTTP only /api is known with certainty."""
        return "/api" if self.headers and self.url.startswith(b"/api/") else "/open-rmf"

    def _await_head(self, *, begins: bool) -> None:
        """Give a head its time from now on, or end that."""
        if self._late is not None:
            self._late.cancel()
        self._head_bytes = 0
        self._late = self.loop.call_later(HEAD_WITHIN_S, self.transport.close) if begins else None

    def _end_unread(self) -> None:
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None
