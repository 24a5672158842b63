"""uvicorn's HTTP protocol with limits, and with JSON replies even to requests that it cannot parse."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from typing import Any, cast

import uvicorn
from starlette.responses import Response
from starlette.types import Scope
from uvicorn._types import ASGI3Application
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol, RequestResponseCycle
from uvicorn.server import ServerState

from lift_manager.web.body import LINGER_BYTES, LINGER_S
from lift_manager.web.connections import Connections
from lift_manager.web.errors import RequestError
from lift_manager.web.outlet import KEY, Outlet
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

_CLOSE = (b"connection", b"close")
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


ReplyAtOnce = Callable[[Scope, bytes], Response | None]
"""Replies to a request with this body without waiting; None if the application has to be called."""


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
    _idle_since: float | None = None
    """Loop time of the end of the newest reply; None once something has come since."""
    _is_parsing = False
    _parsed: tuple[RequestResponseCycle, ASGI3Application] | None = None
    """The request that began with the data that is being parsed."""

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        connections: Connections,
        reply_at_once: ReplyAtOnce | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state)
        self._connections = connections
        self._reply_at_once = reply_at_once

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
        for timer in (self._linger_timer, self.timeout_keep_alive_task):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse data; refuse a head that is too long."""
        if self._linger_timer is not None:
            self._discard(data)
            return
        self._is_parsing = True
        super().data_received(data)
        self._is_parsing = False
        if self._parsed is not None:
            self._begin(*self._parsed)
            self._parsed = None
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
        if self.pipeline or self.transport.is_closing():
            super().on_response_complete()
            return
        self.server_state.total_requests += 1
        self.flow.resume_reading()
        self._connections.mark_idle(self, self.transport.abort)
        self._idle_since = self.loop.time()
        if self.timeout_keep_alive_task is None:
            self.timeout_keep_alive_task = self.loop.call_later(
                self.timeout_keep_alive, self.timeout_keep_alive_handler
            )

    def _unset_keepalive_if_required(self) -> None:
        """Let the timer run: one for each request would cost as much as parsing it."""
        self._idle_since = None

    def timeout_keep_alive_handler(self) -> None:
        """Close the connection if it has waited for a request for so long."""
        self.timeout_keep_alive_task = None
        if self._idle_since is None:
            return
        remaining_s = self._idle_since + self.timeout_keep_alive - self.loop.time()
        if remaining_s > 0:
            self.timeout_keep_alive_task = self.loop.call_later(remaining_s, self.timeout_keep_alive_handler)
        else:
            super().timeout_keep_alive_handler()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: ASGI3Application) -> None:
        if self._is_parsing:
            self._parsed = cycle, app
        else:
            self._call(cycle, app)

    def _call(self, cycle: RequestResponseCycle, app: ASGI3Application) -> None:
        cycle.scope["extensions"] = cast("dict[str, Any]", {KEY: Outlet(cycle)})
        super()._start_asgi_task(cycle, app)

    def _begin(self, cycle: RequestResponseCycle, app: ASGI3Application) -> None:
        """Reply to a request at once where that is possible: a task, and uvicorn's sending, cost more than most replies."""
        reply = None
        must_wait = cycle.more_body or cycle.waiting_for_100_continue or self.flow.write_paused
        if self._reply_at_once is not None and not must_wait and not self.transport.is_closing():
            reply = self._reply_at_once(cast("Scope", cycle.scope), bytes(cycle.body))
        if reply is None:
            self._call(cycle, app)
            return
        headers = cycle.default_headers + reply.raw_headers
        if _CLOSE in headers:
            cycle.keep_alive = False
        elif not cycle.keep_alive:
            headers.append(_CLOSE)
        self.transport.write(_as_bytes(reply.status_code, headers, reply.body))
        cycle.response_started = cycle.response_complete = True
        if not cycle.keep_alive:
            self.transport.close()
        self.on_response_complete()

    def send_400_response(self, msg: str) -> None:
        """Reply in JSON instead of the line `msg`, and close the connection.

        Further data is discarded for a bounded time: closing with unread data resets the connection, and a client that sends
        everything before it reads would never see the reply.
        """
        reply = error_reply(self._path(), self._error)
        self.transport.write(_as_bytes(reply.status_code, [*reply.raw_headers, _CLOSE], reply.body))
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


def _as_bytes(status: int, headers: Iterable[tuple[bytes, bytes]], body: bytes | memoryview) -> bytes:
    """Return a whole reply."""
    return b"".join([STATUS_LINE[status], *(b"%b: %b\r\n" % header for header in headers), b"\r\n", body])
