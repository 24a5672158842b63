"""What one thread heard, on its way to another one: in order, never waiting, never more than fits."""

from __future__ import annotations

import logging
from collections import OrderedDict, deque
from collections.abc import Callable
from threading import Lock

from lift_manager.rmf.port import Deliver

_log = logging.getLogger(__name__)

Call = Callable[[], None]

MOST_CALLS = 1000
"""A hundred lifts with a replay of ten old requests each."""
MOST_TEXT = 4_000_000
"""Characters in all of them: a few of 1 MB do not matter, a thousand would."""
_KEPT_TEXT = 1000
"""Characters of a call that must not be lost: longer than names are, and so few that all of them fit."""
_AT_ONCE = 100
"""Then the thread gets a turn for something else."""


class Inbox:
    """Calls from one thread to another. When nobody takes them, the oldest are given up, those to be kept last of all."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._lock = Lock()
        self._calls: OrderedDict[int, tuple[int, Call]] = OrderedDict()
        """By number of arrival: how much text, and what is called."""
        self._loose: deque[int] = deque()
        """The numbers of those that may be given up."""
        self._arrived = 0
        self._text = 0
        self._newest: dict[str, Call] = {}
        self._asked = False
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Calls given up because nobody took them, at least so many."""
        return self._dropped

    def put(self, call: Call, text: int, *, kept: bool = False) -> None:
        """Queue a call that brings `text` characters along. One to be `kept` is given up when all others are gone."""
        with self._lock:
            if self._closed:
                return
            self._arrived += 1
            self._calls[self._arrived] = (text, call)
            if not kept or text > _KEPT_TEXT:
                self._loose.append(self._arrived)
            self._text += text
            while self._is_too_full():
                self._give_up()
        self._ask()

    def overrun(self) -> None:
        """Tell of calls that were lost before they came here; how many is not known, so one is counted."""
        with self._lock:
            self._count_lost()

    def put_newest(self, key: str, call: Call) -> None:
        """Have it called before all that is queued; of several with one key only the newest is left."""
        with self._lock:
            if self._closed:
                return
            self._newest[key] = call
        self._ask()

    def close(self) -> None:
        """Deliver nothing more."""
        with self._lock:
            self._closed = True
            self._calls.clear()
            self._loose.clear()
            self._newest.clear()
        if self._dropped:
            _log.warning("at least %d messages of RMF were given up unread in all", self._dropped)

    def _is_too_full(self) -> bool:
        """The newest one is left whatever its size: what becomes of it is not decided here."""
        if len(self._calls) > MOST_CALLS:
            return True
        return self._text > MOST_TEXT and bool(self._loose) and self._loose[0] != self._arrived

    def _give_up(self) -> None:
        oldest = self._loose.popleft() if self._loose else next(iter(self._calls))
        text, _ = self._calls.pop(oldest)
        self._text -= text
        self._count_lost()

    def _count_lost(self) -> None:
        self._dropped += 1
        if self._dropped == 1:
            _log.warning("messages of RMF come faster than they can be taken: the oldest are given up unread")

    def _ask(self) -> None:
        with self._lock:
            if self._asked or not (self._calls or self._newest):
                return
            self._asked = True
        self._deliver(self._take)

    def _take(self) -> None:
        """A call that raises costs none of the others."""
        try:
            for _ in range(_AT_ONCE):
                call = self._next()
                if call is None:
                    break
                call()
        finally:
            with self._lock:
                self._asked = False
            self._ask()

    def _next(self) -> Call | None:
        with self._lock:
            if self._newest:
                return self._newest.pop(next(iter(self._newest)))
            if not self._calls:
                return None
            number, (text, call) = self._calls.popitem(last=False)
            if self._loose and self._loose[0] == number:
                self._loose.popleft()
            self._text -= text
            return call
