"""Limits how many repeated events get a row or log line of their own; the others are counted. Times are monotonic seconds."""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TypeVar

SUMMARY_EVERY_S = 60.0
"""How long events are counted before a row sums them up. Chosen: robots repeat a request once a second, and one row a minute shows that
they still do."""

OF_MANY = 6
"""A source that used more than its share gets one sixth of it in the next minute. Chosen: a condition that lasts for weeks must not fill a journal."""


@dataclass(frozen=True, slots=True)
class RowRateLimiter:
    """Admits a few rows a minute; repeats of the last one and any beyond the limit are counted. A value: each method returns the next."""

    rows: int
    last: Hashable = None
    """The row admitted last."""
    counts: Mapping[str, int] = field(default_factory=dict)
    """Rows counted since the last summary, by word."""
    counted_since: float = 0.0
    repeats_only: bool = True
    """Whether only repeats of the row admitted last were counted."""
    _began: float = -math.inf
    _used: int = 0
    _share: int | None = None
    """None before the first minute."""

    def admit(self, row: Hashable, now: float, *, differs: bool = False) -> tuple[RowRateLimiter, bool]:
        """Return whether this gets a row of its own; `differs` if it ended differently from an equal last one."""
        if row == self.last and not differs:
            return self, False
        share, began, used = self.rows if self._share is None else self._share, self._began, self._used
        if now - began >= SUMMARY_EVERY_S:
            had_more = used > share and now - began < 2 * SUMMARY_EVERY_S
            share, began, used = max(1, self.rows // OF_MANY) if had_more else self.rows, now, 0
        is_admitted = used < share
        last, repeats_only = (row, self.repeats_only) if is_admitted else (self.last, False)
        after = replace(self, last=last, repeats_only=repeats_only, _share=share, _began=began, _used=used + 1)
        return after, is_admitted

    def count(self, word: str, now: float) -> RowRateLimiter:
        """Count a row that was not admitted, under its `word`."""
        counts = {**self.counts, word: self.counts.get(word, 0) + 1}
        return replace(self, counts=counts, counted_since=self.counted_since if self.counts else now)

    def is_due(self, now: float) -> bool:
        """Whether a summary is due."""
        return bool(self.counts) and now - self.counted_since >= SUMMARY_EVERY_S

    def cleared(self) -> RowRateLimiter:
        """Return it after the summary of what was counted."""
        return replace(self, counts={}, repeats_only=True) if self.counts or not self.repeats_only else self


@cache
def _unused(rows: int) -> RowRateLimiter:
    """Return a limiter that has admitted nothing. A lift has four, and most stay like this."""
    return RowRateLimiter(rows)


class ChangeRateLimiter:
    """Admits a few changes of one thing a minute. Once one is counted all are, so that the last summary gives the current state."""

    def __init__(self, rows: int) -> None:
        self._rows = _unused(rows)

    def admits(self, word: str, now: float) -> bool:
        """Whether this change is reported by itself; otherwise it is counted under its `word`."""
        is_admitted = False
        if not self._rows.counts:
            self._rows, is_admitted = self._rows.admit(object(), now)
        if not is_admitted:
            self._rows = self._rows.count(word, now)
        return is_admitted

    @property
    def has_counts(self) -> bool:
        """Whether changes were counted since the last summary."""
        return bool(self._rows.counts)

    def summary(self, now: float, *, end: bool = False) -> tuple[Counter[str], float] | None:
        """Return the counts and the seconds they cover, if a summary is due or this is the `end`."""
        rows = self._rows
        if not rows.counts or not (end or rows.is_due(now)):
            return None
        self._rows = rows.cleared()
        return Counter(rows.counts), now - rows.counted_since


CALLERS = 64
"""Callers that are counted separately. Chosen: far more robots than wait for one lift."""

Key = TypeVar("Key", bound=Hashable)
Entry = TypeVar("Entry")


def get_or_add(
    kept: OrderedDict[Key, Entry], key: Key, make: Callable[[], Entry]
) -> tuple[Entry, tuple[Key, Entry] | None]:
    """Return the entry of a key, made if missing, and the entry dropped for it: the one unused for longest."""
    found = kept.setdefault(key, make())
    kept.move_to_end(key)
    return found, kept.popitem(last=False) if len(kept) > CALLERS else None
