"""What one thread heard, on its way to another one: in order, never waiting, never more than fits."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from threading import Lock

_log = logging.getLogger(__name__)

Call = Callable[[], None]
Deliver = Callable[[Call], object]
"""Has a callable called in the thread that the hearer lives in, as `loop.call_soon_threadsafe` does."""

MOST_CALLS = 1000
"""A hundred lifts with a replay of ten old requests each."""
MOST_TEXT = 4_000_000
"""Characters in all of them: a few of 1 MB do not matter, a thousand would."""
_AT_ONCE = 100
"""Then the thread gets a turn for something else."""


class Inbox:
    """Calls from one thread to another. The oldest ones are given up when nobody takes them."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._lock = Lock()
        self._calls: deque[tuple[int, Call]] = deque()
        self._text = 0
        self._newest: dict[str, Call] = {}
        self._asked = False
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Calls given up because nobody took them."""
        return self._dropped

    def put(self, call: Call, text: int) -> None:
        """Queue a call that brings `text` characters along."""
        with self._lock:
            if self._closed:
                return
            self._calls.append((text, call))
            self._text += text
            self._make_room()
        self._ask()

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
            self._newest.clear()
        if self._dropped:
            _log.warning("%d messages of RMF were given up unread in all", self._dropped)

    def _make_room(self) -> None:
        """Leave the newest one whatever its size: what becomes of it is not decided here."""
        while len(self._calls) > MOST_CALLS or (self._text > MOST_TEXT and len(self._calls) > 1):
            text, _ = self._calls.popleft()
            self._text -= text
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
            text, call = self._calls.popleft()
            self._text -= text
            return call
