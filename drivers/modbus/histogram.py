"""How often something took how long, in a few fixed ranges: cheap enough to count every request."""

from __future__ import annotations

from bisect import bisect_left

BOUNDS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
"""Longest duration of each range; the last range has no end. Chosen: controllers answer within 20 to 100 ms, a network takes less than one
of them, and no answer is waited for longer than 2 s by itself."""


class Histogram:
    """Durations by range. Rises only."""

    __slots__ = ("counts", "total_s")

    def __init__(self) -> None:
        self.counts = [0] * (len(BOUNDS_S) + 1)
        """By range, each duration once; the last count is that of all beyond the last bound."""
        self.total_s = 0.0

    def add(self, took_s: float) -> None:
        """Count one duration."""
        self.counts[bisect_left(BOUNDS_S, took_s)] += 1
        self.total_s += took_s
