"""Who reads a stream: a queue each that stays small whatever the reader does, one timer for all, and so many and no more."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol

from lift_manager.api.keys import Key
from lift_manager.web.events.sse import HEARTBEAT

QUEUE_LENGTH = 256
"""Events that wait for one reader. Chosen: ten seconds of what one reader is usually sent, and a reader costs a few KB."""
BEAT_S = 1.0
"""Something is sent at least so often: below the shortest `max_age_s`, for whoever hears nothing for that long knows nothing."""
LOOK_S = 0.25
"""From one look at all readers to the next. Chosen: short against BEAT_S, and a revoked key ends its streams well within a second."""
BATCH_BYTES = 64 * 1024
"""Events that wait together are sent together, up to this. Chosen: what the server takes before it lets a reader wait."""


class Entry(Protocol):
    """Something to be sent, the same bytes to everybody."""

    def wire(self, now: float) -> bytes:
        """Return its bytes as they are right at this loop time."""
        ...


_CLOSE = "close those that nobody reads, or come back later"

Renew = Callable[[int, float], tuple[bytes, Iterable[Entry]]]
"""Told how many events a reader has lost since a loop time, returns how things are, at that time or later, and what came after it."""


class Reader:
    """One open stream. `put` and `end` never wait; `next` is what its connection waits for."""

    def __init__(self, first: bytes, backlog: Iterable[Entry], renew: Renew) -> None:
        """Begin with bytes, and what came after them."""
        self._loop = asyncio.get_running_loop()
        self._first = first
        self._backlog = deque(backlog)
        self._queue: deque[Entry] = deque()
        self._renew = renew
        self._lost = 0
        """Events dropped since the last that was sent."""
        self._lost_at = 0.0
        """When the first of them was dropped; all that came later were."""
        self._beat = False
        self._over = False
        self._waiter: asyncio.Future[None] | None = None
        self._sent_at = self._loop.time()

    def put(self, entry: Entry) -> None:
        """Add an event. A reader that has no room loses all that waits: what it gets instead is newer than each of them."""
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

    def end(self) -> None:
        """Let the stream end, whatever still waits."""
        self._over = True
        self._wake()

    def beat(self, now: float) -> None:
        """Send a heartbeat if nothing else was sent for as long."""
        if self._waiter is not None and now - self._sent_at >= BEAT_S - LOOK_S:
            self._beat = True
            self._wake()

    async def next(self) -> bytes | None:
        """Wait for what is to be sent next; None at the end."""
        while not (self._first or self._backlog or self._queue or self._lost or self._beat or self._over):
            self._waiter = self._loop.create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None
        if self._over:
            return None
        self._beat = False
        self._sent_at = now = self._loop.time()
        return self._batch(now) or HEARTBEAT

    def _batch(self, now: float) -> bytes:
        parts, self._first = [self._first], b""
        size = len(parts[0])
        if self._lost:
            said, came_after = self._renew(self._lost, self._lost_at)
            self._backlog.extend(came_after)
            self._lost = 0  # only here: what is published for the sake of being up to date is in what was said
            return parts[0] + said
        for waiting in (self._backlog, self._queue):
            while waiting and size < BATCH_BYTES:
                parts.append(waiting.popleft().wire(now))
                size += len(parts[-1])
        return b"".join(parts)

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class OpenStreams:
    """All open streams of one application."""

    def __init__(self, most: int) -> None:
        """At most so many at a time, and of one key at most half of them."""
        self.most = most
        self._of_key: Counter[str] = Counter()
        """By the id of a key."""
        self._readers: dict[Reader, Callable[[], bool]] = {}
        self._taken = 0
        self._looking: asyncio.TimerHandle | None = None

    @property
    def is_full(self) -> bool:
        """Whether there is no place."""
        return len(self._readers) >= self.most

    def refusal(self, key: Key | None) -> str:
        """Return why there is no place for one more; empty while there is. Without keys nobody can tell callers apart."""
        if self.is_full:
            return f"{self.most} event streams are open, and this manager keeps no more; {_CLOSE}"
        share = max(1, self.most // 2)
        if key is not None and self._of_key[key.id] >= share:
            return (
                f"the key {key.name} has {share} event streams open, and of the {self.most} that this manager keeps one key"
                f" gets no more; {_CLOSE}"
            )
        return ""

    @contextmanager
    def counted(self, key: Key | None) -> Iterator[None]:
        """Count a stream as one of this key for as long as the context lasts."""
        of = "" if key is None else key.id
        self._of_key[of] += 1
        try:
            yield
        finally:
            self._of_key[of] -= 1
            if not self._of_key[of]:
                del self._of_key[of]

    @property
    def retry_ms(self) -> int:
        """When the next reader should come back after its connection broke: 1 to 2 s, so that not all do so at once."""
        return 1000 + 37 * self._taken % 1000

    @contextmanager
    def taken(self, reader: Reader, admits: Callable[[], bool]) -> Iterator[None]:
        """Keep a place for a reader, with heartbeats; it is ended as soon as `admits` says no."""
        self._readers[reader] = admits
        self._taken += 1
        if self._looking is None:
            self._look()
        try:
            yield
        finally:
            del self._readers[reader]
            if not self._readers and self._looking is not None:
                self._looking.cancel()
                self._looking = None

    def _look(self) -> None:
        loop = asyncio.get_running_loop()
        now = loop.time()
        for reader, admits in self._readers.items():
            if admits():
                reader.beat(now)
            else:
                reader.end()
        self._looking = loop.call_later(LOOK_S, self._look)
