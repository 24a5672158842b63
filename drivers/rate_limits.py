"""How much of what comes again and again is written down or logged one by one, and what is only counted. Times are monotonic seconds."""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

TOLD_EVERY_S = 60.0
"""How long something is counted before a row tells of it. Chosen: robots repeat themselves once a second, and one row a minute shows
that they still do."""

OF_MANY = 6
"""Who had more than its share gets this part of it in the next minute. Chosen: what goes on for weeks must not fill a journal."""


class RowRateLimiter:
    """Admits some rows a minute one by one; repeats of the last, and what is beyond, are counted."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._last: Hashable = None
        self._began = -math.inf
        self._used = 0
        self._share = rows
        self._counted: Counter[str] = Counter()
        self._since = 0.0
        self.repeats_only = True
        """Whether all that was counted is what was admitted last."""

    def admits(self, what: Hashable, now: float, *, anew: bool = False) -> bool:
        """Whether this is to have a row of its own; `anew` where the last one did not end like this."""
        if what == self._last and not anew:
            return False
        if now - self._began >= TOLD_EVERY_S:
            had_more = self._used > self._share and now - self._began < 2 * TOLD_EVERY_S
            self._share = max(1, self._rows // OF_MANY) if had_more else self._rows
            self._began, self._used = now, 0
        self._used += 1
        if self._used > self._share:
            self.repeats_only = False
            return False
        self._last = what
        return True

    def is_last(self, what: Hashable) -> bool:
        """Whether this is what was admitted last."""
        return what == self._last

    def count(self, word: str, now: float) -> None:
        """Count one that was not admitted, by what it was."""
        if not self._counted:
            self._since = now
        self._counted[word] += 1

    @property
    def counts(self) -> bool:
        """Whether there is something to tell."""
        return bool(self._counted)

    def due(self, now: float) -> bool:
        """Whether there is, for long enough."""
        return bool(self._counted) and now - self._since >= TOLD_EVERY_S

    def told(self, now: float) -> tuple[Counter[str], float]:
        """Return what was counted, and within how many seconds, and begin anew."""
        counted, self._counted = self._counted, Counter()
        self.repeats_only = True
        return counted, now - self._since


class ChangeRateLimiter:
    """Admits some changes of one thing a minute one by one. While some are counted all are: the last summary then says how it is."""

    def __init__(self, rows: int) -> None:
        self._sparing = RowRateLimiter(rows)

    def admits(self, word: str, now: float) -> bool:
        """Whether this change is to be told by itself; else it is counted by its `word`."""
        if not self._sparing.counts and self._sparing.admits(object(), now):
            return True
        self._sparing.count(word, now)
        return False

    @property
    def counts(self) -> bool:
        """Whether there is something to sum up."""
        return self._sparing.counts

    def summary(self, now: float, *, end: bool = False) -> tuple[Counter[str], float] | None:
        """Return what was counted for long enough, or at the end all of it, and within how many seconds."""
        return self._sparing.told(now) if self._sparing.counts and (end or self._sparing.due(now)) else None


CALLERS = 64
"""Callers that are told apart. Chosen: far more robots than wait for one lift."""

Key = TypeVar("Key", bound=Hashable)
Kept = TypeVar("Kept")


def newest(kept: OrderedDict[Key, Kept], key: Key, make: Callable[[], Kept]) -> tuple[Kept, tuple[Key, Kept] | None]:
    """Return what is kept of one, made if there is nothing, and who went for it: the one that was silent for longest."""
    found = kept.setdefault(key, make())
    kept.move_to_end(key)
    return found, kept.popitem(last=False) if len(kept) > CALLERS else None


TURNS = 30
TURN_EVERY_S = 3.0
"""So often one caller may begin a session or change its floor: `TURNS` at once, then one in so many seconds. Chosen: a ride takes longer,
and whoever wants another floor 900 times a second has neither the lift nor the journal worn out."""


class CallerTurns:
    """How many turns each caller has left."""

    def __init__(self) -> None:
        self._used: OrderedDict[Hashable, tuple[float, float]] = OrderedDict()
        """Turns used up, and when that was so; what is not here has all."""

    def wait_s(self, caller: Hashable, now: float) -> float:
        """Return how long a caller has to wait for its next turn; 0 where it has one."""
        return max(0.0, (self._spent(caller, now) - (TURNS - 1)) * TURN_EVERY_S)

    def take(self, caller: Hashable, now: float) -> None:
        """Use a turn up."""
        spent = self._spent(caller, now) + 1
        newest(self._used, caller, lambda: (0.0, now))
        self._used[caller] = (spent, now)

    def _spent(self, caller: Hashable, now: float) -> float:
        used, at = self._used.get(caller, (0.0, now))
        return max(0.0, used - (now - at) / TURN_EVERY_S)
