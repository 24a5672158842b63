"""Records the events and refusals of a manager for a test."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from drivers.model import Outcome
from lift_manager.lift.events import Alarm, CommandEnded
from lift_manager.lift.refusals import Refused
from lift_manager.runtime.bus import Bus, Event


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One event other than a change of state."""

    at_s: float
    """In seconds of `time.monotonic`."""
    lift: str
    what: Event | Refused


class Log:
    """All events, oldest first."""

    def __init__(self) -> None:
        self.entries: list[LogEntry] = []
        self.news: Bus[LogEntry] = Bus()

    def add(self, lift: str, what: Event | Refused) -> None:
        """Record an event now."""
        entry = LogEntry(asyncio.get_running_loop().time(), lift, what)
        self.entries.append(entry)
        self.news.publish(entry)

    @property
    def alarms(self) -> tuple[str, ...]:
        """The texts of alarms."""
        return tuple(entry.what.text for entry in self.entries if isinstance(entry.what, Alarm))

    @property
    def refusals(self) -> tuple[Refused, ...]:
        """All refusals."""
        return tuple(entry.what for entry in self.entries if isinstance(entry.what, Refused))

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes of commands."""
        return tuple(entry.what.outcome for entry in self.entries if isinstance(entry.what, CommandEnded))
