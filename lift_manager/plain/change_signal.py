"""Signals a change that the newest answer does not include yet, from the thread with the event stream to the thread that polls."""

from __future__ import annotations

import threading
import time

EventNumber = tuple[str, int]
"""Boot of the manager, and number within it."""


def event_number(event_id: str) -> EventNumber | None:
    """Parse the id of an event; None if it is not the id of a manager's event."""
    boot, _, number = event_id.rpartition("-")
    return (boot, int(number)) if number.isdecimal() and len(number) < 20 else None


class ChangeSignal:
    """Any thread may announce a change; one thread waits for it, and marks what its answers have shown."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._announced_at = 0.0
        self._announced: EventNumber | None = None
        self._shown: EventNumber = ("", 0)
        self._is_due = False

    def announce(self, event: EventNumber | None) -> None:
        """Announce an event; None for a change of unknown number."""
        with self._changed:
            if event is None or not self._is_shown(event):
                self._announced_at, self._announced = time.monotonic(), event
                self._is_due = True
                self._changed.notify_all()

    def mark_shown(self, newest: EventNumber, sent_at: float) -> None:
        """Mark all events up to `newest` as shown by an answer. Anything announced before its request was sent is included."""
        with self._changed:
            self._shown = newest
            if self._announced_at <= sent_at or (self._announced is not None and self._is_shown(self._announced)):
                self._is_due = False

    def wait(self, within_s: float) -> None:
        """Return as soon as a change is announced, or after this time."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_due, max(0.0, within_s))

    def _is_shown(self, event: EventNumber) -> bool:
        return event[0] == self._shown[0] and event[1] <= self._shown[1]
