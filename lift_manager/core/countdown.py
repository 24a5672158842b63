"""Wakes a lift when the door of its session stops inviting robots, and when it is released. Nothing here waits."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable


class Countdown:
    """One timer for the next of these two moments; a renewal moves it."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """`wake` is called at each of the moments."""
        self._wake = wake
        self._at = math.inf
        self._timer: asyncio.TimerHandle | None = None

    def set(self, *moments: float) -> None:
        """Wake at the first of these moments that is still to come, in loop time."""
        loop = asyncio.get_running_loop()
        now = loop.time()
        at = min((one for one in moments if now < one < math.inf), default=math.inf)
        if at == self._at:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._at = at
        self._timer = None if math.isinf(at) else loop.call_at(at, self._due)

    def _due(self) -> None:
        self._at, self._timer = math.inf, None
        self._wake()
