"""One timer for many sleepers: those that are due within the same hundredth of a second wake together."""

from __future__ import annotations

import asyncio
import math

BEAT_S = 0.01
"""How finely time is cut. Chosen: half the shortest poll period."""


class Ticker:
    """Wakes sleepers on the beat, at most one beat late: a timer for every poll of every lift costs as much as decoding it.

    It belongs to one event loop: the one it is first used in.
    """

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._sleepers: dict[int, list[asyncio.Future[None]]] = {}
        """The sleepers by beat."""

    def sleep_until(self, when: float, sleeper: asyncio.Future[None] | None = None) -> asyncio.Future[None]:
        """Return what to await until this loop time: a sleeper that sleeps already wakes at the earlier of its times."""
        loop = self._loop
        if loop is None:
            loop = self._loop = asyncio.get_running_loop()
        future: asyncio.Future[None] = loop.create_future() if sleeper is None else sleeper
        beat = math.ceil(when / BEAT_S)
        sleepers = self._sleepers.get(beat)
        if sleepers is None:
            self._sleepers[beat] = [future]
            loop.call_at(beat * BEAT_S, self._wake, beat)
        else:
            sleepers.append(future)
        return future

    def _wake(self, beat: int) -> None:
        for future in self._sleepers.pop(beat):
            if not future.done():
                future.set_result(None)


class Pause:
    """The pause of a sleeper between two rounds, which another task may shorten."""

    def __init__(self) -> None:
        self._ticker: Ticker | None = None
        self._sleeper: asyncio.Future[None] | None = None
        self.until = math.inf
        """When the newest one was to end."""
        self._end_by = math.inf

    def last_until(self, when: float, ticker: Ticker) -> asyncio.Future[None]:
        """Return what to await until this loop time, or an earlier one by which the pause is to end: `until` is which it was."""
        self._ticker, self.until = ticker, min(when, self._end_by)
        self._end_by = math.inf
        self._sleeper = ticker.sleep_until(self.until)
        return self._sleeper

    def end_by(self, when: float) -> None:
        """End this pause at this loop time at the latest, or the next one if there is none now."""
        if self._sleeper is None or self._ticker is None or self._sleeper.done():
            self._end_by = min(when, self._end_by)
        elif when < self.until:
            self.until = when
            self._sleeper = self._ticker.sleep_until(when, self._sleeper)
