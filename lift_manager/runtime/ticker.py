"""One timer for many sleepers: those that are due within the same hundredth of a second wake together."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

BEAT_S = 0.01
"""How finely time is cut. Chosen: half the shortest poll period."""


class Ticker:
    """Ends pauses on the beat, at most one beat late: a timer for every poll of every lift costs as much as decoding it.

    It belongs to one event loop: the one it is first used in.
    """

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._pauses: dict[int, list[Pause]] = {}
        """By the beat on which they end."""

    def add(self, pause: Pause, when: float) -> int:
        """End a pause at this loop time, and return on which beat."""
        loop = self._loop
        if loop is None:
            loop = self._loop = asyncio.get_running_loop()
        beat = math.ceil(when / BEAT_S)
        pauses = self._pauses.get(beat)
        if pauses is None:
            self._pauses[beat] = [pause]
            loop.call_at(beat * BEAT_S, self._on_beat, beat)
        else:
            pauses.append(pause)
        return beat

    def _on_beat(self, beat: int) -> None:
        for pause in self._pauses.pop(beat):
            pause.end(beat)


class Pause:
    """The pause between two rounds of something, which may be shortened."""

    __slots__ = ("_beat", "_end_by", "_then", "_ticker", "until")

    def __init__(self) -> None:
        self._ticker: Ticker | None = None
        self._beat: int | None = None
        """On which it ends; None while there is no pause."""
        self._then: Callable[[], None]
        self.until = math.inf
        """When the newest one was to end."""
        self._end_by = math.inf

    def last_until(self, when: float, ticker: Ticker, then: Callable[[], None]) -> None:
        """Call `then` at this loop time, or an earlier one by which the pause is to end: `until` is which it was.

        `then` must not raise: it would keep other pauses from ending.
        """
        self._ticker, self._then = ticker, then
        when = min(when, self._end_by)
        self.until, self._end_by = when, math.inf
        self._beat = ticker.add(self, when)

    def end_by(self, when: float) -> None:
        """End this pause at this loop time at the latest, or the next one if there is none now."""
        if self._beat is None or self._ticker is None:
            self._end_by = min(when, self._end_by)
        elif when < self.until:
            self.until = when
            self._beat = self._ticker.add(self, when)

    def end(self, beat: int) -> None:
        """End it if this is its beat: one that was shortened has an earlier one."""
        if beat == self._beat:
            self._beat = None
            self._then()
