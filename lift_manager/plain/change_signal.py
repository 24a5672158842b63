"""Whether something happened that the newest answer does not show yet: between who hears events and who asks."""

from __future__ import annotations

import threading
import time

EventNumber = tuple[str, int]
"""Boot of the manager, and number within it."""


def event_number(event_id: str) -> EventNumber | None:
    """Read the id of an event; None where it is not one of a manager."""
    boot, _, number = event_id.rpartition("-")
    return (boot, int(number)) if number.isdecimal() and len(number) < 20 else None


class ChangeSignal:
    """Any thread may tell; one waits, and says what it was shown."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._told_at = 0.0
        self._told: EventNumber | None = None
        self._shown: EventNumber = ("", 0)
        self._is_due = False

    def tell(self, event: EventNumber | None) -> None:
        """Something happened; None where nobody knows what."""
        with self._changed:
            if event is None or not self._is_shown(event):
                self._told_at, self._told = time.monotonic(), event
                self._is_due = True
                self._changed.notify_all()

    def shown(self, newest: EventNumber, asked_at: float) -> None:
        """An answer came that shows all up to `newest`. What was told before its question left is in it, whatever it was."""
        with self._changed:
            self._shown = newest
            if self._told_at <= asked_at or (self._told is not None and self._is_shown(self._told)):
                self._is_due = False

    def wait(self, within_s: float) -> None:
        """Return as soon as there is news, or once the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_due, max(0.0, within_s))

    def _is_shown(self, event: EventNumber) -> bool:
        return event[0] == self._shown[0] and event[1] <= self._shown[1]
