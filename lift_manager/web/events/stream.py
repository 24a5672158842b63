"""An answer that goes on for as long as its reader listens."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager

from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from lift_manager.api.keys import Key
from lift_manager.web.answers import answer
from lift_manager.web.errors import RequestError
from lift_manager.web.events.readers import OpenStreams, Reader
from lift_manager.web.events.sse import MEDIA_TYPE
from lift_manager.web.shutdown import shutdown_signal

HEADERS = {
    "cache-control": "no-store",
    "x-accel-buffering": "no",  # nginx would hold events back until it has a page of them
}
COME_BACK_S = 5
"""Chosen: about as long as it takes until somebody has gone."""


class EventStream(Response):
    """Server-sent events. Nothing is kept for it before it is answered with."""

    def __init__(
        self, places: OpenStreams, reading: Callable[[], AbstractContextManager[Reader]], key: Key | None = None
    ) -> None:
        """`reading` opens what is to be sent; it takes a place of `places`. `key` is whose stream it is."""
        super().__init__(headers=HEADERS)
        self._places = places
        self._reading = reading
        self._key = key

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the reader goes, the server ends, or the reader may not read any more."""
        if text := self._places.refusal(self._key):
            # the place of its connection is for another client
            headers = {"retry-after": str(COME_BACK_S), "connection": "close"}
            error = RequestError("too_many_streams", text, headers=headers)
            await answer(scope["path"], error)(scope, receive, send)
            return
        with self._places.counted(self._key), self._reading() as reader, shutdown_signal(scope).heard(reader.end):
            await StreamingResponse(_sent(reader), headers=HEADERS, media_type=MEDIA_TYPE)(scope, receive, send)


async def _sent(reader: Reader) -> AsyncIterator[bytes]:
    while (sent := await reader.next()) is not None:
        yield sent
        yield b""  # waits until the connection has room again: what comes next is made when it is sent, not before
