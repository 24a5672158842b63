"""Limits how many messages count within a time."""

from __future__ import annotations

from collections import deque


class RateLimiter:
    """Admits at most so many messages within any such time; those that are not admitted do not count."""

    def __init__(self, most: int, within_s: float) -> None:
        self._admitted: deque[float] = deque(maxlen=most)
        self._within_s = within_s

    def admits(self, now: float) -> bool:
        """Whether a message is admitted."""
        admitted = self._admitted
        if len(admitted) == admitted.maxlen and admitted[0] > now - self._within_s:
            return False
        admitted.append(now)
        return True
