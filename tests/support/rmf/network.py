"""Messages between programs on virtual time: RELIABLE, in the order of their writer, each after a delay of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random
from typing import Generic, TypeVar

M = TypeVar("M")

APART_S = 1e-6
"""Between two messages that would arrive at the same time: the order of timers of one moment is nobody's promise."""


class Channel(Generic[M]):
    """From one writer to one reader."""

    def __init__(self, dice: Random, most_s: float, deliver: Callable[[M], None]) -> None:
        """`most_s` is the longest delay."""
        self._dice = dice
        self._most_s = most_s
        self._deliver = deliver
        self._last = 0.0
        self._waiting: list[asyncio.TimerHandle] = []
        self.sent = 0

    def send(self, message: M) -> None:
        """Let a message arrive some time later, after all that was sent before it."""
        loop = asyncio.get_running_loop()
        self._last = max(self._last + APART_S, loop.time() + self._dice.uniform(0.0, self._most_s))
        self.sent += 1
        self._waiting = [one for one in self._waiting if one.when() > loop.time() and not one.cancelled()]
        self._waiting.append(loop.call_at(self._last, self._deliver, message))

    def cut(self) -> None:
        """Lose what is under way: one of the two is gone."""
        for handle in self._waiting:
            handle.cancel()
        self._waiting.clear()
