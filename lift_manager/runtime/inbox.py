"""What driver, store and time have reported to one lift, until it takes it."""

from __future__ import annotations

import asyncio
import math
from asyncio import Future
from collections.abc import Callable

from lift_manager.lift.inputs import Input, Tick


class Inbox:
    """Delivers inputs one by one, in their order and soon. The caller that reports is in the middle of its own work."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = ("_bug", "_queue", "_soon", "_take", "_timer", "wake_at")

    def __init__(self, take: Callable[[Input], object]) -> None:
        """`take` steps one input."""
        self._take = take
        self._queue: list[Input] = []
        self._soon: asyncio.Handle | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.wake_at = math.inf
        """When it ticks next; until then time alone changes nothing."""
        self._bug: Future[None] | None = None

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, item: Input) -> None:
        """Have this input taken soon."""
        self._queue.append(item)
        if self._soon is None:
            self._soon = asyncio.get_running_loop().call_soon(self._take_soon)

    def take_now(self, item: Input) -> None:
        """Take this input, after what was reported before it: for a callback of the loop, which is in the middle of no other work."""
        self._queue.append(item)
        self._guarded()

    def take_all(self) -> None:
        """Take everything that was reported, and what follows from that."""
        while self._queue:
            self._take(self._queue.pop(0))

    def wake(self, at: float) -> None:
        """Tick at this time, whatever arrives before."""
        if at == self.wake_at:
            return
        self.wake_at = at
        if self._timer is not None:
            self._timer.cancel()
        if at < math.inf:
            self._timer = asyncio.get_running_loop().call_at(at, self._tick)

    def report_bugs(self, bug: Future[None]) -> None:
        """Have the awaiting task raise the first bug that is met in a callback of the loop, where it would only be logged."""
        self._bug = bug

    def _take_soon(self) -> None:
        self._soon = None
        self._guarded()

    def _tick(self) -> None:
        self.wake_at = math.inf
        self.take_now(Tick())

    def _guarded(self) -> None:
        try:
            self.take_all()
        except Exception as bug:
            if self._bug is None or self._bug.done():
                raise
            self._bug.set_exception(bug)
