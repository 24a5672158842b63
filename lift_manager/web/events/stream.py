"""The HTTP response that streams events until its reader disconnects."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager

from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from lift_manager.api.keys import Key
from lift_manager.web.errors import RequestError
from lift_manager.web.events.readers import OpenStreams, Reader
from lift_manager.web.events.sse import MEDIA_TYPE
from lift_manager.web.outlet import outlet_of
from lift_manager.web.replies import error_reply
from lift_manager.web.shutdown import shutdown_signal

HEADERS = {
    "cache-control": "no-store",
    "x-accel-buffering": "no",  # nginx would buffer events until it has a page of them
}
RETRY_AFTER_S = 5
"""Chosen: about the time until another stream has ended."""


class EventStream(Response):
    """Server-sent events. It uses no resources until it is sent."""

    def __init__(
        self,
        open_streams: OpenStreams,
        open_reader: Callable[[], AbstractContextManager[Reader]],
        key: Key | None = None,
    ) -> None:
        """`open_reader` opens a reader of `open_streams`. `key` is the key of the caller."""
        super().__init__(headers=HEADERS)
        self._open_streams = open_streams
        self._open_reader = open_reader
        self._key = key

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the client disconnects, the server shuts down, or the client may no longer read."""
        if text := self._open_streams.refusal(self._key):
            # free the connection for another client
            headers = {"retry-after": str(RETRY_AFTER_S), "connection": "close"}
            error = RequestError("too_many_streams", text, headers=headers)
            await error_reply(scope["path"], error)(scope, receive, send)
            return
        with (
            self._open_streams.count(self._key),
            self._open_reader() as reader,
            shutdown_signal(scope).on_shutdown(reader.end),
        ):
            reader.outlet = outlet_of(scope)
            await StreamingResponse(_chunks(reader), headers=HEADERS, media_type=MEDIA_TYPE)(scope, receive, send)


async def _chunks(reader: Reader) -> AsyncIterator[bytes]:
    while (chunk := await reader.next()) is not None:
        yield chunk
        yield b""  # waits until the connection has room: the next chunk is encoded when it is sent, not before
