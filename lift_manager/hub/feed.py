"""Publishes the events of all sites to readers of the event stream; one that reconnects gets what it has missed from the database."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from lift_manager.api.events import Lost
from lift_manager.hub.rows import MOST_AT_ONCE, StoredEvent
from lift_manager.hub.service import Hub
from lift_manager.web.events import sse
from lift_manager.web.events.readers import Entry, OpenStreams, Reader


class _EventEntry:
    """One event on its way to readers."""

    __slots__ = ("_event",)

    def __init__(self, event: StoredEvent) -> None:
        self._event = event

    def wire(self, now: float) -> bytes:
        """Return the encoded event. JSON has no line breaks: one line of data."""
        number, name, text = self._event
        return f"id: {number}\nevent: {name}\ndata: {text}\n\n".encode()


class HubFeed:
    """The event streams of a hub."""

    def __init__(self, hub: Hub, open_streams: OpenStreams) -> None:
        self._hub = hub
        self._open_streams = open_streams

    @contextmanager
    def reader(self, site: str | None, after: int | None, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader of one site, or of all, for as long as the context lasts; from now on if `after` is None."""
        first = sse.retry(self._open_streams.retry_ms)
        missed: tuple[StoredEvent, ...] = ()
        newest = 0
        if after is not None:
            with closing(self._hub.open_rows()) as rows:
                missed = tuple(rows.after(after, site))
            newest = missed[-1].number if missed else 0
            if len(missed) == MOST_AT_ONCE:
                first += sse.event("lost", Lost(events=max(0, missed[0].number - after - 1)))
        reader = Reader(first, map(_EventEntry, missed), _lost_event)

        def receive(event: StoredEvent, of: str) -> None:
            # an event may be in the database a moment before it is passed on
            if event.number > newest and site in (None, of):
                reader.put(_EventEntry(event))

        with self._hub.listen(receive), self._open_streams.register(reader, admits):
            yield reader


def _lost_event(count: int, _since: float) -> tuple[bytes, tuple[Entry, ...]]:
    return sse.event("lost", Lost(events=count)), ()
