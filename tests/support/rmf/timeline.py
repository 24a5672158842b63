"""Values over time: each lasts until the next."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from typing import Generic, TypeVar

V = TypeVar("V")


class Timeline(Generic[V]):
    """What something was, and since when. Times never go back."""

    def __init__(self, first: V) -> None:
        self._times = [float("-inf")]
        self._values = [first]

    @property
    def last(self) -> V:
        """The newest value."""
        return self._values[-1]

    @property
    def since(self) -> float:
        """When the newest value began."""
        return self._times[-1]

    def add(self, at: float, value: V) -> None:
        """Note a value; one that is the same as the last goes on."""
        if value != self._values[-1]:
            self._times.append(at)
            self._values.append(value)

    def during(self, since: float, until: float) -> Iterator[V]:
        """Yield every value that it had at some time in here, newest first."""
        for _, value in self.spans(since, until):
            yield value

    def spans(self, since: float, until: float) -> Iterator[tuple[float, V]]:
        """Yield the same with the time at which each began."""
        index = bisect_right(self._times, until) - 1
        while index >= 0:
            yield self._times[index], self._values[index]
            if self._times[index] <= since:
                return
            index -= 1

    def at(self, when: float) -> V:
        """Return what it was at one moment."""
        return self._values[bisect_right(self._times, when) - 1]
