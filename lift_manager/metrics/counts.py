"""Counts the events of the manager."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from re import sub

from lift_manager.lift.events import (
    Acknowledged,
    Alarm,
    CommandEnded,
    CommandFollowed,
    ForceReleased,
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.outcome_reasons import UNCONFIRMED, Reason, reason_of
from lift_manager.metrics.exposition import Family, Kind, format_labels
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import OVER, Ride
from lift_manager.runtime.bus import Event

RIDES = 1000
"""How many ended rides are remembered, so that none is counted twice. Chosen: more than end while one of them can still change."""
_EVENTS = (
    "state_changed",
    "session_opened",
    "session_restored",
    "handed_over",
    "session_ended",
    "advised",
    "locked_out",
    "lockout_over",
    "drain_begun",
    "drain_over",
    "person_acknowledged",
    "released_by_person",
    "command_ended",
    "alarm",
    "request_followed",
    "ride_changed",
)
"""The label values of events."""


@dataclass(slots=True)
class _Tally:
    """Counts by labels."""

    name: str
    text: str
    labels: tuple[str, ...]
    known: Callable[[], Iterable[tuple[str, ...]]] = tuple
    """Returns labels whose counts begin at 0, so that the first one shows as an increase; kept as counts they would take 0.7 KB a lift."""
    counts: Counter[tuple[str, ...]] = field(default_factory=Counter)

    def family(self) -> Family:
        family = Family(self.name, Kind.COUNTER, self.text)
        for values in dict.fromkeys(chain(self.known(), self.counts)):
            family.add(format_labels(**dict(zip(self.labels, values, strict=True))), self.counts[values])
        return family


class EventCounts:
    """Counts events by closed sets of label values: never by holder, session, ride or text."""

    def __init__(self, commands: Mapping[str, Iterable[str]]) -> None:
        """`commands` are the possible commands of each lift."""
        no_evidence = UNCONFIRMED, Reason.NO_EVIDENCE.value
        self._events = _Tally(
            "lift_manager_events_total", "Events published.", ("event",), lambda: [(word,) for word in _EVENTS]
        )
        self._commands = _Tally(
            "lift_manager_commands_total",
            "Commands by outcome.",
            ("lift", "command", "result", "reason"),
            lambda: ((lift, name, *no_evidence) for lift, names in commands.items() for name in names),
        )
        self._opened = _Tally("lift_manager_sessions_opened_total", "Sessions that began.", ("lift", "face"))
        self._ended = _Tally(
            "lift_manager_sessions_ended_total", "Sessions that are over, by why.", ("lift", "face", "reason")
        )
        self._rides = _Tally(
            "lift_manager_rides_ended_total",
            "Rides that are over, by how.",
            ("lift", "end"),
            lambda: ((lift, phase.value) for lift in commands for phase in OVER),
        )
        self._alarms = _Tally(
            "lift_manager_alarms_total",
            "Things that a person should know of.",
            ("lift",),
            lambda: ((lift,) for lift in commands),
        )
        self._over: OrderedDict[str, None] = OrderedDict()

    def count_event(self, event: Event) -> None:
        """Count one event."""
        self._events.counts[event_label(event),] += 1
        match event:
            case CommandEnded(lift, outcome):
                self._commands.counts[lift, outcome.command.name, outcome.result.value, reason_of(outcome).value] += 1
            case SessionOpened(lift, holder) | SessionRestored(lift, holder):
                self._opened.counts[lift, holder.face] += 1
            case SessionEnded(lift, holder, reason):
                self._ended.counts[lift, holder.face, reason.value] += 1
            case RideChanged(lift, ride):
                self._count_ride(lift, ride)
            case Alarm(lift):
                self._alarms.counts[lift,] += 1
            case _:
                pass

    def families(self) -> Iterator[Family]:
        """Yield all counters."""
        for tally in (self._events, self._commands, self._opened, self._ended, self._rides, self._alarms):
            yield tally.family()

    def _count_ride(self, lift: str, ride: Ride) -> None:
        """Count the end of a ride once: later changes of it are events, too."""
        if ride.phase not in OVER or ride.id in self._over:
            return
        self._over[ride.id] = None
        if len(self._over) > RIDES:
            self._over.popitem(last=False)
        self._rides.counts[lift, ride.phase.value] += 1


def event_label(event: Event) -> str:
    """Return the label value of an event, one of `_EVENTS`."""
    match event:
        case RestrictionBegun(_, Restriction(kind)):
            return "locked_out" if kind is RestrictionKind.LOCKOUT else "drain_begun"
        case RestrictionEnded(_, _, _, Restriction(kind)):
            return "lockout_over" if kind is RestrictionKind.LOCKOUT else "drain_over"
        case Acknowledged():
            return "person_acknowledged"
        case ForceReleased():
            return "released_by_person"
        case CommandFollowed():
            return "request_followed"
        case _:
            return sub(r"(?<!^)(?=[A-Z])", "_", type(event).__name__).lower()
