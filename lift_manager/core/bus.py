"""The event bus: state for whoever listens; a slow listener loses its own oldest events and is told how many."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

Item = TypeVar("Item")

QUEUE_LENGTH = 256
"""Events kept for one listener. Chosen: half a minute of a busy building."""


class Subscription(Generic[Item]):
    """What one listener has still to take."""

    def __init__(self, length: int) -> None:
        self._queue: deque[Item] = deque(maxlen=length)
        self._wake = asyncio.Event()
        self.lost = 0
        """Events dropped because this listener was slow."""

    def put(self, item: Item) -> None:
        """Add an event; the oldest goes when there is no room."""
        if len(self._queue) == self._queue.maxlen:
            self.lost += 1
        self._queue.append(item)
        self._wake.set()

    async def next(self) -> Item:
        """Wait for the next event."""
        while not self._queue:
            self._wake.clear()
            await self._wake.wait()
        return self._queue.popleft()


class Bus(Generic[Item]):
    """Hands every event to every listener; never waits for one."""

    def __init__(self) -> None:
        self._listeners: list[Subscription[Item]] = []

    @property
    def heard(self) -> bool:
        """Whether anybody listens."""
        return bool(self._listeners)

    def publish(self, item: Item) -> None:
        """Let an event be known."""
        self.hand_out(item)

    def hand_out(self, item: Item) -> None:
        """Give an event to all listeners, and do no more."""
        for listener in self._listeners:
            listener.put(item)

    @contextmanager
    def listen(self, length: int = QUEUE_LENGTH) -> Iterator[Subscription[Item]]:
        """Listen for as long as the context lasts."""
        listener: Subscription[Item] = Subscription(length)
        self._listeners.append(listener)
        try:
            yield listener
        finally:
            self._listeners.remove(listener)
