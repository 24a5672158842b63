"""The event stream: taken up again by itself, at the event after the last one that was heard."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import httpx
from pydantic import TypeAdapter, ValidationError

from lift_manager.api.events import AnyEvent
from lift_manager.client.call import Call, Http
from lift_manager.client.errors import ClientError, NotAManager, Refused, Unreachable
from lift_manager.plain.aging import SILENT_S
from lift_manager.plain.backoff import Backoff
from lift_manager.plain.sse import EventParser, Message, TooLong

_log = logging.getLogger(__name__)
_EVENT: TypeAdapter[AnyEvent] = TypeAdapter(AnyEvent)
_STREAM = "text/event-stream"
_HEALS = (408, 429)
"""Refusals that are over by themselves; so are those from 500 on."""


@dataclass(frozen=True)
class Connected:
    """The manager is heard. What was missed meanwhile follows, or a snapshot."""


@dataclass(frozen=True)
class Disconnected:
    """The manager is not heard; what was said before is known no more."""

    reason: str
    again_in_s: float
    """Until the next try."""


StreamEvent = AnyEvent | Connected | Disconnected


class EventStream:
    """Yields events, and what becomes of the connection, for ever. `async with` closes it at the end of the block.

    Iterating raises Refused where the manager will not have it, such as for a key that may not listen; everything else is
    `Disconnected`, and it tries again. A wait that is cancelled loses nothing: the next one goes on with the next event.
    """

    def __init__(
        self, http: Http, path: str, query: Mapping[str, str] | None = None, *, backoff: Backoff | None = None
    ) -> None:
        self._http = http
        self._path = path
        self._query = dict(query or {})
        self._backoff = backoff or Backoff()
        self._ready: deque[StreamEvent | tuple[str, AnyEvent]] = deque()
        self._opened: AsyncExitStack | None = None
        self._chunks: AsyncIterator[bytes] | None = None
        self._parser = EventParser()
        self._retry_at: float | None = None
        self.last_id = ""
        """Of the newest event that was handed out."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connection."""
        opened, self._opened, self._chunks = self._opened, None, None
        if opened is not None:
            await opened.aclose()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> StreamEvent:
        while not self._ready:
            await self._more()
        found = self._ready.popleft()
        if isinstance(found, tuple):
            self.last_id, event = found
            return event
        return found

    async def _more(self) -> None:
        if self._retry_at is not None:
            pause_s = self._retry_at - asyncio.get_running_loop().time()
            await asyncio.sleep(max(0.0, pause_s))
            self._retry_at = None
        whole = False
        try:
            async with asyncio.timeout(SILENT_S):
                await (self._open() if self._chunks is None else self._hear(self._chunks))
            whole = True
        except TimeoutError:
            self._lost(f"nothing was heard for {SILENT_S:g} s")
        except Refused as error:
            if error.status < 500 and error.status not in _HEALS:
                raise
            self._lost(str(error))
        except ClientError as error:
            self._lost(error.text if isinstance(error, Unreachable) else str(error))
        except StopAsyncIteration:
            self._lost("the manager ended the stream")
        finally:
            if not whole:
                # cancelled in the middle, too: half a chunk is gone, so it begins anew after the last whole event
                await self.aclose()

    async def _open(self) -> None:
        headers = {"accept": _STREAM, "accept-encoding": "identity", "cache-control": "no-store"}
        if self.last_id:
            headers["last-event-id"] = self.last_id
        async with AsyncExitStack() as stack:
            call = Call("GET", self._path, self._query, headers=headers)
            response = await stack.enter_async_context(self._http.opened(call))
            if response.status_code != 200:
                raise self._http.refused(response.status_code, await _some(response))
            if response.headers.get("content-type", "").partition(";")[0].strip() != _STREAM:
                raise NotAManager("it sends no events", url=self._http.url, status=response.status_code)
            self._opened = stack.pop_all()
        self._chunks = response.aiter_bytes()
        self._parser = EventParser(last_id=self.last_id)
        self._ready.append(Connected())

    async def _hear(self, chunks: AsyncIterator[bytes]) -> None:
        try:
            chunk = await anext(chunks)
        except (httpx.TransportError, httpx.StreamError, httpx.DecodingError) as error:
            text = str(error) or type(error).__name__
            raise Unreachable(text, url=self._http.url, may_have_arrived=True) from error
        try:
            heard = self._parser.feed(chunk)
        except TooLong as error:
            raise NotAManager(str(error), url=self._http.url, status=200) from error
        self._ready.extend((message.id, event) for message in heard if (event := self._event(message)) is not None)
        self._backoff.reset()

    def _event(self, message: Message) -> AnyEvent | None:
        try:
            return _EVENT.validate_json(message.data)
        except ValidationError as error:
            if any(found["type"] == "union_tag_invalid" for found in error.errors(include_url=False)):
                _log.debug("an event %r, which this client does not know, is passed over", message.event)
                return None
            raise NotAManager(f"its event {message.event!r} cannot be read", url=self._http.url, status=200) from error

    def _lost(self, reason: str) -> None:
        pause_s = self._backoff.next_s()
        self._retry_at = asyncio.get_running_loop().time() + pause_s
        self._ready.append(Disconnected(reason, pause_s))


async def _some(response: httpx.Response, limit: int = 65536) -> bytes:
    content = b""
    async for piece in response.aiter_bytes():
        content += piece
        if len(content) > limit:
            break
    return content
