"""The event bus: states and events for every listener; a slow listener loses its own oldest events and is told how many."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Generic, TypeVar

from lift_manager.lift.events import Event as LiftEvent
from lift_manager.lift.state import LiftState
from lift_manager.rides.inputs import RideChanged

Item = TypeVar("Item")

QUEUE_LENGTH = 256
"""Events kept for one listener. Chosen: half a minute of a busy building."""

_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
_BOOT_LENGTH = 8
"""Digits of base 36. Enough for milliseconds since 1970 until the year 2059, so that later boots sort behind earlier ones."""


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The state of a lift differs from the one published last, by more than the passing of time."""

    lift: str
    state: LiftState


Event = LiftEvent | StateChanged | RideChanged
"""Events of a lift, and of rides on it."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """An event as it was published."""

    id: str
    """`<boot>-<number>`: the number rises by one with each event of one process, the boot tells processes apart. The same in log,
    journal and event stream."""
    at: float
    """Monotonic seconds of the event loop."""
    event: Event


class Subscription(Generic[Item]):
    """The events that one listener has not taken yet."""

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
    """Numbers every event and hands it to every listener; never waits for one."""

    def __init__(self, boot: str = "") -> None:
        """`boot` is what the ids begin with; made of the clock where it is empty."""
        self.boot = boot or boot_of(datetime.now(UTC))
        self.newest = 0
        """The number of the newest event; 0 before the first."""
        self._listeners: list[Subscription[Item]] = []
        self._taps: list[Callable[[str, Item], None]] = []
        self._counters: list[Callable[[str, Item], None]] = []

    @property
    def received(self) -> bool:
        """Whether anybody listens."""
        return bool(self._listeners or self._taps)

    def publish(self, item: Item, note: Callable[[str], None] | None = None) -> str:
        """Give an event to all listeners; return its id, which `note` gets before any listener gets the event."""
        self.newest += 1
        event = f"{self.boot}-{self.newest}"
        if note is not None:
            note(event)
        for receive in (*self._counters, *self._taps):
            receive(event, item)
        for listener in self._listeners:
            listener.put(item)
        return event

    @contextmanager
    def listen(self, length: int = QUEUE_LENGTH) -> Iterator[Subscription[Item]]:
        """Listen for as long as the context lasts."""
        listener: Subscription[Item] = Subscription(length)
        self._listeners.append(listener)
        try:
            yield listener
        finally:
            self._listeners.remove(listener)

    @contextmanager
    def tap(self, receive: Callable[[str, Item], None]) -> Iterator[None]:
        """Call `receive` with the id and the event, at once and in order, for as long as the context lasts. It must not raise."""
        self._taps.append(receive)
        try:
            yield
        finally:
            self._taps.remove(receive)

    @contextmanager
    def overhear(self, receive: Callable[[str, Item], None]) -> Iterator[None]:
        """As `tap`, but only for what is published anyway: it is no reason to compute states that nobody else listens to."""
        self._counters.append(receive)
        try:
            yield
        finally:
            self._counters.remove(receive)


def boot_of(at: datetime) -> str:
    """Return what tells a process that starts at this time from others: short, and sorted as the times are."""
    left, digits = int(at.timestamp() * 1000), ""
    while left:
        left, digit = divmod(left, len(_DIGITS))
        digits = _DIGITS[digit] + digits
    return digits.rjust(_BOOT_LENGTH, "0")
