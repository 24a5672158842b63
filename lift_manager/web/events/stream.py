"""An answer that goes on for as long as its reader listens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from lift_manager.web.ending import ending_of
from lift_manager.web.events.readers import Places, Reader
from lift_manager.web.events.sse import MEDIA_TYPE
from lift_manager.web.problem import problem

HEADERS = {
    "cache-control": "no-store",
    "x-accel-buffering": "no",  # nginx would hold events back until it has a page of them
}
COME_BACK_S = 5
"""Chosen: about as long as it takes until somebody has gone."""


class EventStream(Response):
    """Server-sent events. Nothing is kept for it before it is answered with."""

    def __init__(self, places: Places, reading: Callable[[], AbstractContextManager[Reader]]) -> None:
        """`reading` opens what is to be sent; it takes a place of `places`."""
        super().__init__(headers=HEADERS, media_type=MEDIA_TYPE)
        del self.headers["content-length"]
        self._places = places
        self._reading = reading

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the reader goes, the server ends, or the reader may not read any more."""
        if self._places.is_full:
            await _full(self._places.most)(scope, receive, send)
            return
        with self._reading() as reader, ending_of(scope).heard(reader.end):
            await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
            async with asyncio.TaskGroup() as tasks:
                watching = tasks.create_task(_until_gone(receive, reader))
                while (sent := await reader.next()) is not None:
                    await send({"type": "http.response.body", "body": sent, "more_body": True})
                watching.cancel()
            await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _until_gone(receive: Receive, reader: Reader) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    reader.end()


def _full(most: int) -> Response:
    text = f"{most} event streams are open, and this manager keeps no more; close those that nobody reads, or come back later"
    no = problem(503, "too_many_streams", text)
    no.headers["retry-after"] = str(COME_BACK_S)
    return no
