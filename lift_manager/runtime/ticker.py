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
        """Who wakes at which beat."""

    def sleep_until(self, when: float) -> asyncio.Future[None]:
        """Return what to await until this loop time."""
        loop = self._loop
        if loop is None:
            loop = self._loop = asyncio.get_running_loop()
        future: asyncio.Future[None] = loop.create_future()
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
