"""The event stream, which reconnects by itself and continues after the last received event."""

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
from lift_manager.client.errors import ClientError, NotAManager, Refused, Unreachable
from lift_manager.client.http import HttpClient, HttpRequest
from lift_manager.plain.backoff import Backoff
from lift_manager.plain.client_aging import SILENT_S
from lift_manager.plain.sse import EventParser, Message, TooLong

_log = logging.getLogger(__name__)
_EVENT: TypeAdapter[AnyEvent] = TypeAdapter(AnyEvent)
_STREAM = "text/event-stream"
_TRANSIENT = (408, 429)
"""Refusals that are temporary, like those from 500 on."""


@dataclass(frozen=True)
class Connected:
    """Connected to the manager. Missed events follow, or a snapshot."""


@dataclass(frozen=True)
class Disconnected:
    """The connection is lost; earlier events may be out of date."""

    reason: str
    again_in_s: float
    """Seconds until the next attempt."""


StreamEvent = AnyEvent | Connected | Disconnected


class EventStream:
    """Yields events and changes of the connection without end. `async with` closes it at the end of the block.

    Iterating raises Refused if the manager refuses the stream, such as for a key that may not read; every other failure yields
    `Disconnected` and a new attempt. Cancelling a wait loses nothing: the next one continues with the next event.
    """

    def __init__(
        self, http: HttpClient, path: str, query: Mapping[str, str] | None = None, *, backoff: Backoff | None = None
    ) -> None:
        self._http = http
        self._path = path
        self._query = dict(query or {})
        self._backoff = backoff or Backoff()
        self._ready: deque[StreamEvent | tuple[str, AnyEvent]] = deque()
        self._open_response: AsyncExitStack | None = None
        self._chunks: AsyncIterator[bytes] | None = None
        self._parser = EventParser()
        self._retry_at: float | None = None
        self.last_id = ""
        """The id of the latest event that was returned."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connection."""
        response_stack, self._open_response, self._chunks = self._open_response, None, None
        if response_stack is not None:
            await response_stack.aclose()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> StreamEvent:
        while not self._ready:
            await self._fill()
        found = self._ready.popleft()
        if isinstance(found, tuple):
            self.last_id, event = found
            return event
        return found

    async def _fill(self) -> None:
        if self._retry_at is not None:
            pause_s = self._retry_at - asyncio.get_running_loop().time()
            await asyncio.sleep(max(0.0, pause_s))
            self._retry_at = None
        is_complete = False
        try:
            async with asyncio.timeout(SILENT_S):
                await (self._open() if self._chunks is None else self._receive(self._chunks))
            is_complete = True
        except TimeoutError:
            self._disconnect(f"no data for {SILENT_S:g} s")
        except Refused as error:
            if error.status < 500 and error.status not in _TRANSIENT:
                raise
            self._disconnect(str(error))
        except ClientError as error:
            self._disconnect(error.text if isinstance(error, Unreachable) else str(error))
        except StopAsyncIteration:
            self._disconnect("the manager ended the stream")
        finally:
            if not is_complete:
                # also if cancelled: part of a chunk is lost, so reconnect after the last complete event
                await self.aclose()

    async def _open(self) -> None:
        headers = {"accept": _STREAM, "accept-encoding": "identity", "cache-control": "no-store"}
        if self.last_id:
            headers["last-event-id"] = self.last_id
        async with AsyncExitStack() as stack:
            request = HttpRequest("GET", self._path, self._query, headers=headers)
            response = await stack.enter_async_context(self._http.stream(request))
            if response.status_code != 200:
                raise self._http.error_of(response.status_code, await _read_some(response))
            if response.headers.get("content-type", "").partition(";")[0].strip() != _STREAM:
                raise NotAManager("it sends no events", url=self._http.url, status=response.status_code)
            self._open_response = stack.pop_all()
        self._chunks = response.aiter_bytes()
        self._parser = EventParser(last_id=self.last_id)
        self._ready.append(Connected())

    async def _receive(self, chunks: AsyncIterator[bytes]) -> None:
        try:
            chunk = await anext(chunks)
        except (httpx.TransportError, httpx.StreamError, httpx.DecodingError) as error:
            text = str(error) or type(error).__name__
            raise Unreachable(text, url=self._http.url, may_have_arrived=True) from error
        try:
            messages = self._parser.feed(chunk)
        except TooLong as error:
            raise NotAManager(str(error), url=self._http.url, status=200) from error
        self._ready.extend((message.id, event) for message in messages if (event := self._event(message)) is not None)
        self._backoff.reset()

    def _event(self, message: Message) -> AnyEvent | None:
        try:
            return _EVENT.validate_json(message.data)
        except ValidationError as error:
            if any(found["type"] == "union_tag_invalid" for found in error.errors(include_url=False)):
                _log.debug("ignoring event %r, which this client does not know", message.event)
                return None
            raise NotAManager(f"its event {message.event!r} cannot be read", url=self._http.url, status=200) from error

    def _disconnect(self, reason: str) -> None:
        pause_s = self._backoff.next_s()
        self._retry_at = asyncio.get_running_loop().time() + pause_s
        self._ready.append(Disconnected(reason, pause_s))


async def _read_some(response: httpx.Response, limit: int = 65536) -> bytes:
    content = b""
    async for piece in response.aiter_bytes():
        content += piece
        if len(content) > limit:
            break
    return content
