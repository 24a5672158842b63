"""uvicorn's HTTP protocol with limits, and with JSON replies even to requests that it cannot parse."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle
from uvicorn.server import ServerState

from lift_manager.web.body import LINGER_BYTES, LINGER_S
from lift_manager.web.connections import Connections
from lift_manager.web.errors import RequestError
from lift_manager.web.replies import error_reply

ADVICE = (
    "this could not be read as HTTP/1.1; write what is not ASCII in the address percent-encoded"
    " (curl: -G --data-urlencode 'lift_name=...') and let Content-Length be the length of the body"
)
HEAD_LIMIT_BYTES = 32 * 1024
"""Request line and headers. Chosen: four times what common proxies pass on; the parser itself has no limit."""
HEADERS_LIMIT = 100
HEAD_WITHIN_S = 10.0
"""Chosen: a head is one packet; a slower client sends it drop by drop to keep the connection."""

READ_WITHIN_S = 60.0
"""Chosen: at most some 64 KiB are waiting (uvicorn's high-water mark), and a client that has not read them by then does not read."""

_NOT_HTTP = RequestError("not_http", ADVICE)
_MISSING_HOST = RequestError(
    "not_http", "HTTP/1.1 needs the header Host, once: the name or address that was connected to"
)
_TOO_LONG = RequestError(
    "head_too_long",
    f"address and headers are too long; at most {HEAD_LIMIT_BYTES} bytes and {HEADERS_LIMIT} headers are read",
)


class _HeadRefused(Exception):
    pass


class JsonHttpProtocol(HttpToolsProtocol):
    """HTTP with JSON replies: clients of the workshop API parse every reply as JSON, and crash on plain text."""

    _error = _NOT_HTTP
    _is_awaiting_head = False
    _head_bytes = 0
    _head_timer: asyncio.TimerHandle | None = None
    """Runs while a head is incomplete; most come in one packet and never start it."""
    _unread_timer: asyncio.TimerHandle | None = None
    _linger_timer: asyncio.TimerHandle | None = None
    _discarded_bytes = 0

    def __init__(
        self, config: uvicorn.Config, server_state: ServerState, app_state: dict[str, Any], connections: Connections
    ) -> None:
        super().__init__(config, server_state, app_state)
        self._connections = connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count the connection as idle."""
        super().connection_made(transport)
        self._connections.mark_idle(self, transport.abort)
        self._await_head(begins=True)
        self._start_head_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop counting the connection."""
        self._connections.remove(self)
        self._await_head(begins=False)
        self._stop_unread_timer()
        if self._linger_timer is not None:
            self._linger_timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse data; refuse a head that is too long."""
        if self._linger_timer is not None:
            self._discard(data)
            return
        super().data_received(data)
        if self._is_awaiting_head and not self.transport.is_closing():
            self._start_head_timer()
            self._head_bytes += len(data)
            if self._head_bytes > HEAD_LIMIT_BYTES:
                self._error = _TOO_LONG
                self.send_400_response("")

    def pause_writing(self) -> None:
        """Wait a bounded time for a client that does not read: an event stream would keep its connection."""
        self.flow.pause_writing()
        if self._unread_timer is None:
            self._unread_timer = self.loop.call_later(READ_WITHIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Continue: the client reads again."""
        self._stop_unread_timer()
        self.flow.resume_writing()

    def on_message_begin(self) -> None:
        """Await the head."""
        super().on_message_begin()
        self._await_head(begins=True)

    def on_headers_complete(self) -> None:
        """Pass the request on, unless its head is too long or does not name a host."""
        self._await_head(begins=False)
        size, hosts = len(self.url), 0
        for name, value in self.headers:
            size += len(name) + len(value)
            hosts += name == b"host"
        if size > HEAD_LIMIT_BYTES or len(self.headers) > HEADERS_LIMIT:
            self._error = _TOO_LONG
            raise _HeadRefused
        if hosts > 1 or (not hosts and self.parser.get_http_version() == "1.1"):
            self._error = _MISSING_HOST
            raise _HeadRefused
        self._connections.mark_busy(self)
        super().on_headers_complete()

    def on_response_complete(self) -> None:
        """Continue with the next request, or wait for one."""
        super().on_response_complete()
        if not self._is_answering and not self.transport.is_closing():
            self._connections.mark_idle(self, self.transport.abort)

    def send_400_response(self, msg: str) -> None:
        """Reply in JSON instead of the line `msg`, and close the connection.

        Further data is discarded for a bounded time: closing with unread data resets the connection, and a client that sends
        everything before it reads would never see the reply.
        """
        reply = error_reply(self._path(), self._error)
        headers = [*reply.raw_headers, (b"connection", b"close")]
        status = f"HTTP/1.1 {self._error.status} {HTTPStatus(self._error.status).phrase}".encode()
        lines = [status, *(name + b": " + value for name, value in headers)]
        self.transport.write(b"\r\n".join([*lines, b"", bytes(reply.body)]))
        self._await_head(begins=False)
        if self._is_answering:
            self.transport.close()  # the reply to an earlier request is cut off in any case
            return
        self._linger_timer = self.loop.call_later(LINGER_S, self.transport.close)
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
        """Return the path that decides the format of the reply; only /api is certain if the request cannot be parsed."""
        return "/api" if self.headers and self.url.startswith(b"/api/") else "/open-rmf"

    def _await_head(self, *, begins: bool) -> None:
        """Begin or end to wait for a head."""
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
        self._is_awaiting_head, self._head_bytes = begins, 0

    def _start_head_timer(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(HEAD_WITHIN_S, self.transport.close)

    def _stop_unread_timer(self) -> None:
        if self._unread_timer is not None:
            self._unread_timer.cancel()
            self._unread_timer = None
