"""A bounded queue of calls from one thread to another: in order, and without waiting."""

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
"""The most characters of a call that must not be lost: longer than any name, and few enough for all of them to fit."""
_AT_ONCE = 100
"""Calls in one batch; the receiving thread can do something else between two batches."""


class Inbox:
    """Calls from one thread to another. On overflow the oldest are dropped, those to be kept last of all."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._lock = Lock()
        self._calls: OrderedDict[int, tuple[int, Call]] = OrderedDict()
        """By number of arrival: the size of the text, and the call."""
        self._droppable: deque[int] = deque()
        """The numbers of those that may be dropped."""
        self._arrived = 0
        self._text = 0
        self._newest: dict[str, Call] = {}
        self._is_delivery_requested = False
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """The least number of calls that were dropped."""
        return self._dropped

    def put(self, call: Call, text: int, *, keep: bool = False) -> None:
        """Queue a call with `text` characters. One to `keep` is dropped only after all others."""
        with self._lock:
            if self._closed:
                return
            self._arrived += 1
            self._calls[self._arrived] = (text, call)
            if not keep or text > _KEPT_TEXT:
                self._droppable.append(self._arrived)
            self._text += text
            while self._is_too_full():
                self._give_up()
        self._request_delivery()

    def overrun(self) -> None:
        """Count calls that were lost before they arrived here; their number is unknown, so one is counted."""
        with self._lock:
            self._count_lost()

    def put_newest(self, key: str, call: Call) -> None:
        """Queue a call before all others; of several with the same key only the newest remains."""
        with self._lock:
            if self._closed:
                return
            self._newest[key] = call
        self._request_delivery()

    def close(self) -> None:
        """Deliver nothing more."""
        with self._lock:
            self._closed = True
            self._calls.clear()
            self._droppable.clear()
            self._newest.clear()
        if self._dropped:
            _log.warning("at least %d messages of RMF were dropped unread in total", self._dropped)

    def _is_too_full(self) -> bool:
        """Whether a call has to be dropped. The newest one stays, whatever its size."""
        if len(self._calls) > MOST_CALLS:
            return True
        return self._text > MOST_TEXT and bool(self._droppable) and self._droppable[0] != self._arrived

    def _give_up(self) -> None:
        oldest = self._droppable.popleft() if self._droppable else next(iter(self._calls))
        text, _ = self._calls.pop(oldest)
        self._text -= text
        self._count_lost()

    def _count_lost(self) -> None:
        self._dropped += 1
        if self._dropped == 1:
            _log.warning("messages of RMF arrive faster than they can be processed: the oldest are dropped unread")

    def _request_delivery(self) -> None:
        with self._lock:
            if self._is_delivery_requested or not (self._calls or self._newest):
                return
            self._is_delivery_requested = True
        self._deliver(self._deliver_batch)

    def _deliver_batch(self) -> None:
        """Run a batch of calls. One that raises does not affect the others."""
        try:
            for _ in range(_AT_ONCE):
                call = self._next()
                if call is None:
                    break
                call()
        finally:
            with self._lock:
                self._is_delivery_requested = False
            self._request_delivery()

    def _next(self) -> Call | None:
        with self._lock:
            if self._newest:
                return self._newest.pop(next(iter(self._newest)))
            if not self._calls:
                return None
            number, (text, call) = self._calls.popitem(last=False)
            if self._droppable and self._droppable[0] == number:
                self._droppable.popleft()
            self._text -= text
            return call
