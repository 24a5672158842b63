"""Pauses between attempts to reconnect. Pure."""

from __future__ import annotations

import random

FIRST_S = 1.0
LONGEST_S = 15.0
"""Chosen: a restarted manager is found within a quarter of a minute, and a hundred clients do not overload it."""


class Backoff:
    """Doubles the pause up to the longest, each with random jitter, so that clients cut off together do not reconnect together."""

    def __init__(
        self, chance: random.Random | None = None, *, first_s: float = FIRST_S, longest_s: float = LONGEST_S
    ) -> None:
        """`chance` is seeded by tests."""
        # nothing here is a secret
        self._chance = chance or random.Random()  # noqa: S311  spreads clients, guards nothing
        self._first_s, self._longest_s = first_s, longest_s
        self._next_s = first_s

    def reset(self) -> None:
        """Start again with the first pause, after a success."""
        self._next_s = self._first_s

    def next_s(self) -> float:
        """Return the pause before the next attempt, and double the one after it."""
        pause, self._next_s = self._next_s, min(2 * self._next_s, self._longest_s)
        return pause * self._chance.uniform(0.5, 1.0)
