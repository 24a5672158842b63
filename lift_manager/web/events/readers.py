"""The readers of event streams: a bounded queue for each, one heartbeat timer for all, and a limit of their number."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol

from lift_manager.api.keys import Key
from lift_manager.web.events.sse import HEARTBEAT
from lift_manager.web.outlet import Outlet

QUEUE_LENGTH = 256
"""Events queued per reader. Chosen: ten seconds of usual traffic, at a few KB per reader."""
HEARTBEAT_S = 1.0
"""Longest time without data on a stream: below the shortest `max_age_s`, because after that a reader knows nothing."""
CHECK_S = 0.25
"""How often all readers are checked. Chosen: short against HEARTBEAT_S, and a revoked key ends its streams well within a second."""
READERS_A_TURN = 50
"""Readers served in one turn of the event loop. Chosen: they take less than a millisecond, after which polls and requests go on."""
BATCH_BYTES = 64 * 1024
"""Queued events are sent together up to this size. Chosen: what the server buffers before it makes a reader wait."""


class Entry(Protocol):
    """Something to send, with the same bytes for all readers."""

    def wire(self, now: float) -> bytes:
        """Return the bytes that are correct at this loop time."""
        ...


_FULL_ADVICE = "close those that nobody reads, or come back later"

Renew = Callable[[int, float], tuple[bytes, Iterable[Entry]]]
"""Takes the number of events that a reader has lost since a loop time; returns a snapshot from after that time, and later events."""


class Reader:
    """One open stream. `put` and `end` never wait; the connection waits for `next`, and gets the rest through the outlet, if it has one."""

    def __init__(self, first: bytes, backlog: Iterable[Entry], renew: Renew) -> None:
        """Begin with these bytes, then the backlog."""
        self._loop = asyncio.get_running_loop()
        self._first = first
        self._backlog = deque(backlog)
        self._queue: deque[Entry] = deque()
        self._renew = renew
        self._lost = 0
        """Events dropped since the last one that was sent."""
        self._lost_at = 0.0
        """When the first of them was dropped."""
        self._heartbeat_due = False
        self._ended = False
        self._waiter: asyncio.Future[None] | None = None
        self._is_waking = False
        self.turns = Turns()
        """The readers among which it is served."""
        self.outlet: Outlet | None = None
        self._sent_at = self._loop.time()

    def put(self, entry: Entry) -> None:
        """Queue an event. If the queue is full, all queued events are dropped: the snapshot that replaces them is newer."""
        if self._lost:
            self._lost += 1
        elif len(self._queue) >= QUEUE_LENGTH:
            self._lost = len(self._backlog) + len(self._queue) + 1
            self._lost_at = self._loop.time()
            self._backlog.clear()
            self._queue.clear()
        else:
            self._queue.append(entry)
        self._wake()

    def extend_backlog(self, entries: Iterable[Entry]) -> None:
        """Send these before what is queued."""
        self._backlog.extend(entries)

    def end(self) -> None:
        """End the stream, whatever is still queued."""
        self._ended = True
        self._wake()

    def send_heartbeat(self, now: float) -> None:
        """Send a heartbeat if nothing else was sent for HEARTBEAT_S."""
        if self._waiter is not None and now - self._sent_at >= HEARTBEAT_S - CHECK_S:
            self._heartbeat_due = True
            self._wake()

    async def next(self) -> bytes | None:
        """Wait for the next bytes to send; None at the end."""
        while not self._has_next:
            self._waiter = self._loop.create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        return None if self._ended else self._take()

    @property
    def _has_next(self) -> bool:
        return bool(self._queue or self._heartbeat_due or self._ended or self._lost or self._first or self._backlog)

    def _take(self) -> bytes:
        self._heartbeat_due = False
        self._sent_at = now = self._loop.time()
        return self._batch(now) or HEARTBEAT

    def _batch(self, now: float) -> bytes:
        parts, self._first = [self._first], b""
        size = len(parts[0])
        if self._lost:
            snapshot, later_entries = self._renew(self._lost, self._lost_at)
            self._backlog.extend(later_entries)
            self._lost = 0  # only now: events that the snapshot itself publishes are contained in it
            return parts[0] + snapshot
        for queue in (self._backlog, self._queue):
            while queue and size < BATCH_BYTES:
                parts.append(queue.popleft().wire(now))
                size += len(parts[-1])
        return b"".join(parts)

    def _wake(self) -> None:
        if self._waiter is not None and not self._is_waking:
            self._is_waking = True
            self.turns.add(self)

    def send_or_wake(self) -> None:
        """Send what has come if there is room, which costs a fraction of a turn of the task that awaits `next`; else let it return."""
        self._is_waking = False
        waiter, outlet = self._waiter, self.outlet
        if waiter is None or waiter.done() or not self._has_next:
            return
        try:
            is_sent = outlet is not None and not self._ended and outlet.has_room
            if is_sent and outlet is not None:
                outlet.write(self._take())
        except Exception as bug:  # noqa: BLE001  `next` raises it
            waiter.set_exception(bug)
        else:
            if not is_sent or self._queue or self._backlog:
                waiter.set_result(None)


class Turns:
    """Serves readers that have something to send, in the order in which they were added, and lets other work go on in between."""

    def __init__(self) -> None:
        self._readers: deque[Reader] = deque()

    def add(self, reader: Reader) -> None:
        """Serve a reader soon."""
        if not self._readers:
            asyncio.get_running_loop().call_soon(self._serve)
        self._readers.append(reader)

    def _serve(self) -> None:
        for _ in range(min(READERS_A_TURN, len(self._readers))):
            self._readers[0].send_or_wake()
            self._readers.popleft()  # only now: one that is added meanwhile needs no other call
        if self._readers:
            asyncio.get_running_loop().call_soon(self._serve)


class OpenStreams:
    """All open streams of one application."""

    def __init__(self, limit: int) -> None:
        """At most so many at a time, and of one key at most half of them."""
        self.limit = limit
        self._of_key: Counter[str] = Counter()
        """By the id of a key."""
        self._readers: dict[Reader, Callable[[], bool]] = {}
        self._turns = Turns()
        self._registered = 0
        self._check_timer: asyncio.TimerHandle | None = None

    @property
    def is_full(self) -> bool:
        """Whether there is no place."""
        return len(self._readers) >= self.limit

    def refusal(self, key: Key | None) -> str:
        """Return why there is no place for one more; empty while there is. Without keys nobody can tell callers apart."""
        if self.is_full:
            return f"{self.limit} event streams are open, and this manager keeps no more; {_FULL_ADVICE}"
        share = max(1, self.limit // 2)
        if key is not None and self._of_key[key.id] >= share:
            return (
                f"the key {key.name} has {share} event streams open, and of the {self.limit} that this manager keeps one key"
                f" gets no more; {_FULL_ADVICE}"
            )
        return ""

    @contextmanager
    def count(self, key: Key | None) -> Iterator[None]:
        """Count a stream as one of this key for as long as the context lasts."""
        key_id = "" if key is None else key.id
        self._of_key[key_id] += 1
        try:
            yield
        finally:
            self._of_key[key_id] -= 1
            if not self._of_key[key_id]:
                del self._of_key[key_id]

    @property
    def retry_ms(self) -> int:
        """How long the next reader should wait before it reconnects: 1 to 2 s, so that not all reconnect at once."""
        return 1000 + 37 * self._registered % 1000

    @contextmanager
    def register(self, reader: Reader, admits: Callable[[], bool]) -> Iterator[None]:
        """Serve a reader in turn with all others within the context, send it heartbeats, and end it as soon as `admits` returns False."""
        reader.turns = self._turns
        self._readers[reader] = admits
        self._registered += 1
        if self._check_timer is None:
            self._check_readers()
        try:
            yield
        finally:
            del self._readers[reader]
            if not self._readers and self._check_timer is not None:
                self._check_timer.cancel()
                self._check_timer = None

    def _check_readers(self) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        for reader, admits in self._readers.items():
            if admits():
                reader.send_heartbeat(now)
            else:
                reader.end()
        self._check_timer = loop.call_later(CHECK_S, self._check_readers)
