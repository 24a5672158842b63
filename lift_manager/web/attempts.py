"""Write down who is turned away, without letting them fill the log."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

_log = logging.getLogger(__name__)

LINES = 10
WINDOW_S = 60.0
"""Chosen: a client with a wrong key polls for weeks; ten lines a minute at the most, one for each address and reason."""


class Attempts:
    """What was refused lately."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began_at = -WINDOW_S
        self._told: set[tuple[str, str]] = set()
        self._untold = 0

    def refused(self, address: str, why: str) -> None:
        """Log this, or count it where enough was logged. `why` is ours: nothing that a caller sent belongs in it."""
        now = self._clock()
        if now - self._began_at >= WINDOW_S:
            if self._untold:
                _log.warning("%d more requests were refused since, and not logged each", self._untold)
            self._began_at, self._untold = now, 0
            self._told.clear()
        if (address, why) in self._told or len(self._told) >= LINES:
            self._untold += 1
            return
        self._told.add((address, why))
        _log.warning("a request from %s was refused: %s", address, why)
