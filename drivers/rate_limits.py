"""Limits how many repeated events get a row or log line of their own; the others are counted. Times are monotonic seconds."""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

SUMMARY_EVERY_S = 60.0
"""How long events are counted before a row sums them up. Chosen: robots repeat a request once a second, and one row a minute shows that
they still do."""

OF_MANY = 6
"""A source that used more than its share gets one sixth of it in the next minute. Chosen: a condition that lasts for weeks must not fill a journal."""


class RowRateLimiter:
    """Admits a few rows a minute; repeats of the last one and any beyond the limit are counted."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._last: Hashable = None
        self._began = -math.inf
        self._used = 0
        self._share = rows
        self._counted: Counter[str] = Counter()
        self._since = 0.0
        self.repeats_only = True
        """Whether only repeats of the row admitted last were counted."""

    def admits(self, row: Hashable, now: float, *, differs: bool = False) -> bool:
        """Whether this gets a row of its own; `differs` if it ended differently from an equal last one."""
        if row == self._last and not differs:
            return False
        if now - self._began >= SUMMARY_EVERY_S:
            had_more = self._used > self._share and now - self._began < 2 * SUMMARY_EVERY_S
            self._share = max(1, self._rows // OF_MANY) if had_more else self._rows
            self._began, self._used = now, 0
        self._used += 1
        if self._used > self._share:
            self.repeats_only = False
            return False
        self._last = row
        return True

    def is_last(self, row: Hashable) -> bool:
        """Whether this row was admitted last."""
        return row == self._last

    def count(self, word: str, now: float) -> None:
        """Count a row that was not admitted, under its `word`."""
        if not self._counted:
            self._since = now
        self._counted[word] += 1

    @property
    def has_counts(self) -> bool:
        """Whether rows were counted since the last summary."""
        return bool(self._counted)

    def is_due(self, now: float) -> bool:
        """Whether a summary is due."""
        return bool(self._counted) and now - self._since >= SUMMARY_EVERY_S

    def take_counts(self, now: float) -> tuple[Counter[str], float]:
        """Return the counts and the seconds they cover, and reset them."""
        counted, self._counted = self._counted, Counter()
        self.repeats_only = True
        return counted, now - self._since


class ChangeRateLimiter:
    """Admits a few changes of one thing a minute. Once one is counted all are, so that the last summary gives the current state."""

    def __init__(self, rows: int) -> None:
        self._rows = RowRateLimiter(rows)

    def admits(self, word: str, now: float) -> bool:
        """Whether this change is reported by itself; otherwise it is counted under its `word`."""
        if not self._rows.has_counts and self._rows.admits(object(), now):
            return True
        self._rows.count(word, now)
        return False

    @property
    def has_counts(self) -> bool:
        """Whether changes were counted since the last summary."""
        return self._rows.has_counts

    def summary(self, now: float, *, end: bool = False) -> tuple[Counter[str], float] | None:
        """Return the counts and the seconds they cover, if a summary is due or this is the `end`."""
        return self._rows.take_counts(now) if self._rows.has_counts and (end or self._rows.is_due(now)) else None


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


TURNS = 30
TURN_EVERY_S = 3.0
"""How often one caller may open a session or change its floor: `TURNS` at once, then once every `TURN_EVERY_S`. Chosen: a ride takes longer, and
a caller that requests another floor 900 times a second must wear out neither the lift nor the journal."""


class CallerTurns:
    """Limits how often each caller may open a session or change its floor."""

    def __init__(self) -> None:
        self._used: OrderedDict[Hashable, tuple[float, float]] = OrderedDict()
        """Turns used, and when that was counted; an absent caller has all of its turns."""

    def wait_s(self, caller: Hashable, now: float) -> float:
        """Return how long a caller has to wait for its next turn; 0 if it has one."""
        return max(0.0, (self._spent(caller, now) - (TURNS - 1)) * TURN_EVERY_S)

    def take(self, caller: Hashable, now: float) -> None:
        """Use one turn."""
        spent = self._spent(caller, now) + 1
        get_or_add(self._used, caller, lambda: (0.0, now))
        self._used[caller] = (spent, now)

    def _spent(self, caller: Hashable, now: float) -> float:
        used, at = self._used.get(caller, (0.0, now))
        return max(0.0, used - (now - at) / TURN_EVERY_S)
