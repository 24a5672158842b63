"""Publishes the events of all sites to readers of the event stream; what a reader has missed is read from the database, page by page."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from lift_manager.hub.api import Lost
from lift_manager.hub.rows import PAGE, RowStore, StoredEvent
from lift_manager.hub.service import Hub
from lift_manager.web.events import sse
from lift_manager.web.events.readers import Entry, OpenStreams, Reader

FOREIGN_EVENTS = 10_000
"""How many of the newest events a reader gets that comes from another hub. Chosen: more than a reader misses that changes at once."""
EVENT_ID = re.compile("0|([0-9a-f]{8})-([0-9]{1,18})")
"""The id of an event: that of the database, which no other hub has, and the number; 0 for the beginning."""


class _Position:
    """How far one reader is."""

    def __init__(self, rows: RowStore, site: str | None) -> None:
        """From now on."""
        self._rows, self._site = rows, site
        self._sent = rows.newest()
        self.reader: Reader

    def continue_after(self, event_id: str) -> bytes:
        """Go to where an event was; return what is to be sent first if it is unknown what the reader has missed."""
        of, number = _parts(event_id)
        if of == "":
            self._sent = 0
        elif of == self._rows.id:
            self._sent = min(number, self._rows.newest())
            return self._lost_bytes()
        else:
            self._sent = max(0, self._rows.newest() - FOREIGN_EVENTS)
            return sse.event("lost", Lost(text=ANOTHER_HUB))
        return b""

    def page(self) -> list[Entry]:
        """Return the next events; the last one of a full page reads the next page when it is sent."""
        events = self._rows.after(self._sent, self._site)
        entries: list[Entry] = [_Entry(self, event) for event in events]
        if len(events) == PAGE:
            entries[-1] = _LastOfPage(self, events[-1])
        return entries

    def again(self, _lost: int, _since: float) -> tuple[bytes, list[Entry]]:
        """Read what was dropped from the queue."""
        return self._lost_bytes(), self.page()

    def wire(self, event: StoredEvent) -> bytes:
        """Return an encoded event, once. JSON has no line breaks: one line of data."""
        if event.number <= self._sent:
            return b""
        self._sent = event.number
        return f"id: {self._rows.id}-{event.number}\nevent: {event.name}\ndata: {event.text}\n\n".encode()

    def _lost_bytes(self) -> bytes:
        return sse.event("lost", Lost(text=PRUNED)) if self._rows.pruned(self._site) > self._sent else b""


ANOTHER_HUB = (
    "the last event id is that of another hub, or of a database that was lost: the newest events follow, and some that were sent"
    " already; a row is the same row wherever `site`, `journal` and `seq` are the same"
)
PRUNED = "events after the last one that was sent are no longer kept; numbers `seq` that are missing show which"


class _Entry:
    """One event on its way to one reader."""

    __slots__ = ("_event", "_position")

    def __init__(self, position: _Position, event: StoredEvent) -> None:
        self._position, self._event = position, event

    def wire(self, now: float) -> bytes:
        """Return the encoded event."""
        return self._position.wire(self._event)


class _LastOfPage(_Entry):
    __slots__ = ()

    def wire(self, now: float) -> bytes:
        """Return the encoded event, after which the next page follows."""
        data = super().wire(now)
        self._position.reader.extend_backlog(self._position.page())
        return data


class HubFeed:
    """The event streams of a hub."""

    def __init__(self, hub: Hub, open_streams: OpenStreams) -> None:
        self._hub = hub
        self._open_streams = open_streams

    @contextmanager
    def reader(self, site: str | None, after: str | None, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader of one site, or of all, for as long as the context lasts; from now on if `after`, the id of an event, is None."""
        with closing(self._hub.open_rows()) as rows:
            position = _Position(rows, site)
            first = sse.retry(self._open_streams.retry_ms)
            if after is not None:
                first += position.continue_after(after)
            position.reader = reader = Reader(first, position.page(), position.again)

            def receive(event: StoredEvent, of: str) -> None:
                if site in (None, of):
                    reader.put(_Entry(position, event))

            with self._hub.listen(receive), self._open_streams.register(reader, admits):
                yield reader


def _parts(event_id: str) -> tuple[str, int]:
    """Return the id of the database and the number; empty and 0 for the beginning."""
    of, _, number = event_id.rpartition("-")
    return of, int(number)
