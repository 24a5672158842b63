"""Counts durations in a few fixed ranges, cheaply enough for every request."""

from __future__ import annotations

from bisect import bisect_left

BOUNDS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
"""Upper bound of each range; one more range has none. Chosen: controllers answer within 20 to 100 ms, a network takes less than 1 ms, and
by default no answer is awaited for longer than 2 s."""


class Histogram:
    """Counts of durations by range; they only rise."""

    __slots__ = ("counts", "total_s")

    def __init__(self) -> None:
        self.counts = [0] * (len(BOUNDS_S) + 1)
        """Durations by range; the last count is that of all beyond the last bound."""
        self.total_s = 0.0

    def add(self, took_s: float) -> None:
        """Count one duration."""
        self.counts[bisect_left(BOUNDS_S, took_s)] += 1
        self.total_s += took_s
