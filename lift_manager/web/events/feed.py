"""Events for all readers: each is encoded once, and kept for a while for those whose connection breaks."""

from __future__ import annotations

import asyncio
import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

from lift_manager.api.events import Lost, Snapshot
from lift_manager.api.lifts import Lift
from lift_manager.api.rides import Ride
from lift_manager.lift.state import Quality
from lift_manager.rides import ride as rides
from lift_manager.rides.inputs import RideChanged
from lift_manager.runtime.bus import Event, Occurrence, StateChanged
from lift_manager.runtime.errors import NotFound
from lift_manager.runtime.site import Site
from lift_manager.web.events import sse
from lift_manager.web.events.encoding import ages, invites_for_s, shown
from lift_manager.web.events.readers import OpenStreams, Reader

KEPT = 4096
"""Events kept for readers that come back. Chosen: 20 s of a hundred lifts that all move, when a reader comes back within two; 8 MB at most."""
KEPT_S = 300.0
"""Chosen: whoever was away for longer is better served with how things are."""
MaxAge = Callable[[str], float]
"""Returns the `max_age_s` of a lift."""
FRESH_S = 0.25
"""Ages and times left in an event are at most so much older than the moment at which it is handed to a connection."""


@dataclass(frozen=True, slots=True)
class StreamScope:
    """What a reader wants to hear of: one lift, one ride with the states of its lift, or, with neither, everything."""

    lift: str | None = None
    ride: str | None = None


class PublishedEvent:
    """One event; its bytes are made when the first reader wants them, and made again when the ages in them have passed."""

    __slots__ = ("_ages", "_at", "_event", "_good_until", "_id", "_max_age_of", "_wire", "lifts", "number", "ride")

    def __init__(self, event_id: str, at: float, event: Event, lifts: tuple[str, ...], max_age_of: MaxAge) -> None:
        """`lifts` are those that it concerns."""
        self._id, self._at, self._event, self._max_age_of = event_id, at, event, max_age_of
        self._ages = ages(event)
        self._wire = b""
        self._good_until = at
        """Until when these bytes may be handed out."""
        self.number = int(event_id.rpartition("-")[2] or 0)
        self.lifts = lifts
        self.ride = event.ride.id if isinstance(event, RideChanged) else ""

    @property
    def at(self) -> float:
        """Loop time at which it was published."""
        return self._at

    @property
    def is_state(self) -> bool:
        """Whether it says how a lift is."""
        return isinstance(self._event, StateChanged)

    def wire(self, now: float) -> bytes:
        """Return its bytes; the ages in them are right, and they invite nobody once they are too old."""
        if not self._wire or (self._ages and now > self._good_until):
            max_age_s = self._max_age_of(self._event.lift) if self._ages else math.inf
            said = shown(self._event, max_age_s, now - self._at)
            self._wire, self._good_until = sse.event(said.event, said, self._id), now + FRESH_S
            turns_at = self._at + invites_for_s(self._event, max_age_s)
            if turns_at >= now:
                self._good_until = min(self._good_until, turns_at)
        return self._wire


class _Taken(NamedTuple):
    """A snapshot, for all who want the same one within a moment."""

    wire: bytes
    number: int
    """Of the newest event that is in it."""
    at: float
    good_until: float
    """From then on it is as old as FRESH_S, or a lift in it is too old."""


class Feed:
    """One for an application. It begins to listen with the first reader, and goes on for those that come back."""

    def __init__(self, site: Site, places: OpenStreams) -> None:
        self._site = site
        self._places = places
        self._kept: deque[PublishedEvent] = deque(maxlen=KEPT)
        self._everything: dict[Reader, None] = {}
        self._of_lift: defaultdict[str, dict[Reader, None]] = defaultdict(dict)
        self._of_ride: defaultdict[str, dict[Reader, None]] = defaultdict(dict)
        self._riding: dict[str, str] = {}
        """The lift of each ride that goes on."""
        self._watched: dict[str, str] = {}
        """The lift of each ride that somebody hears of."""
        self._moved: dict[int, PublishedEvent] = {}
        """By the number of the event that tells of another lift for a ride: how that lift was then."""
        self._taken: dict[tuple[StreamScope, bool], _Taken] = {}
        """The snapshots of the last moment: a hundred readers that come back at once cost one."""
        self._listening: ExitStack | None = None

    @contextmanager
    def reader(self, about: StreamScope, last_id: str | None, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader for as long as the context lasts.

        `last_id` is the newest event that it has heard: it hears what came after, or where that is gone, how things are. `admits`
        says whether it may still read.
        """
        self._listen()
        first, missed = sse.retry(self._places.retry_ms), None
        if last_id is not None:
            missed = self._missed(last_id, about)
        if missed is None:
            taken, missed = self._snapshot(about, lost=last_id is not None)
            first += taken
        reader = Reader(first, missed, lambda lost, since: self._renew(about, lost, since))
        readers = self._everything
        if about.ride is not None:
            readers = self._of_ride[about.ride]
            self._watched[about.ride] = self._lift_of(about.ride)
        elif about.lift is not None:
            readers = self._of_lift[about.lift]
        readers[reader] = None
        try:
            with self._places.taken(reader, admits):
                yield reader
        finally:
            del readers[reader]
            if about.ride is not None and not readers:
                del self._of_ride[about.ride], self._watched[about.ride]

    def _listen(self) -> None:
        if self._listening is None:
            self._listening = ExitStack()
            self._riding = {ride.id: ride.lift for ride in self._site.rides.all() if ride.phase not in rides.OVER}
            self._listening.enter_context(self._site.tap(self._hear))

    def _hear(self, occurrence: Occurrence) -> None:
        event = occurrence.event
        lifts: tuple[str, ...] = (event.lift,)
        if isinstance(event, RideChanged) and (left := self._follow(event)) != event.lift:
            lifts = (event.lift, left)
        heard = PublishedEvent(occurrence.id, occurrence.at, event, lifts, self._max_age_s)
        self._keep(heard)
        if len(lifts) > 1:
            there = StateChanged(event.lift, self._site.state(event.lift))
            now_there = PublishedEvent("", occurrence.at, there, lifts, self._max_age_s)
            self._moved[heard.number] = now_there
            for reader in self._of_ride.get(heard.ride, ()):
                reader.put(now_there)
        for readers in (self._everything, *(self._of_lift[lift] for lift in lifts if lift in self._of_lift)):
            for reader in readers:
                reader.put(heard)
        self._tell_riders(heard)

    def _tell_riders(self, heard: PublishedEvent) -> None:
        if heard.ride:
            for reader in self._of_ride.get(heard.ride, ()):
                reader.put(heard)
        elif heard.is_state:
            for ride, lift in self._watched.items():
                if lift in heard.lifts:
                    for reader in self._of_ride[ride]:
                        reader.put(heard)

    def _follow(self, event: RideChanged) -> str:
        """Return the lift that a ride was on before this event."""
        ride = event.ride
        before = self._riding.get(ride.id, event.lift)
        if ride.id in self._watched:
            self._watched[ride.id] = event.lift
        if ride.phase in rides.OVER:
            self._riding.pop(ride.id, None)
        else:
            self._riding[ride.id] = event.lift
        return before

    def _lift_of(self, ride: str) -> str:
        if ride in self._riding:
            return self._riding[ride]
        found = self._find(ride)
        return "" if found is None else found.lift

    def _find(self, ride: str) -> rides.Ride | None:
        """Return a ride; None for one that is not known any more."""
        try:
            return self._site.rides.ride(ride)
        except NotFound:
            return None

    def _keep(self, heard: PublishedEvent) -> None:
        if len(self._kept) == KEPT:
            self._moved.pop(self._kept[0].number, None)
        self._kept.append(heard)
        while self._kept[0].at < heard.at - KEPT_S:
            self._moved.pop(self._kept.popleft().number, None)

    def _missed(self, last_id: str, about: StreamScope) -> list[PublishedEvent] | None:
        """Return what came after an event; None where that cannot be told."""
        number, newest = number_of(last_id, self._site.boot), self._site.newest
        if number is None or number > newest or not self._reaches(number):
            return None
        return self._after(number, about)

    def _after(self, number: int, about: StreamScope) -> list[PublishedEvent]:
        after = list(takewhile(lambda heard: heard.number > number, reversed(self._kept)))[::-1]
        if about.ride is not None:
            return list(self._missed_of_ride(after, about.ride))
        if about.lift is not None:
            return [heard for heard in after if about.lift in heard.lifts]
        return after

    def _missed_of_ride(self, after: list[PublishedEvent], ride: str) -> Iterator[PublishedEvent]:
        changes = (heard for heard in after if heard.ride == ride)
        first = next(changes, None)
        # the last of these is the lift that it was on before
        lift = self._lift_of(ride) if first is None else first.lifts[-1]
        for heard in after:
            if heard.ride == ride:
                if heard.number in self._moved:
                    yield self._moved[heard.number]
                lift = heard.lifts[0]
                yield heard
            elif heard.is_state and lift in heard.lifts:
                yield heard

    def _renew(self, about: StreamScope, lost: int, since: float) -> tuple[bytes, list[PublishedEvent]]:
        taken, after = self._snapshot(about, lost=False, since=since)
        # what came after it was counted as lost, and comes all the same
        return sse.event("lost", Lost(events=lost - len(after))) + taken, after

    def _snapshot(
        self, about: StreamScope, *, lost: bool, since: float = -math.inf
    ) -> tuple[bytes, list[PublishedEvent]]:
        """Return how things are, or were a moment ago but after `since`, and what came after it."""
        now = asyncio.get_running_loop().time()
        taken = self._taken.get((about, lost))
        if taken is None or taken.good_until < now or taken.at <= since or not self._reaches(taken.number):
            self._taken = {key: kept for key, kept in self._taken.items() if kept.good_until >= now}
            said = self._take(about, lost=lost)
            wire = sse.event("snapshot", said, f"{self._site.boot}-{self._site.newest}")
            left_s = (lift.max_age_s - (lift.age_s or 0.0) for lift in said.lifts if lift.quality is Quality.LIVE)
            self._taken[about, lost] = _Taken(wire, self._site.newest, now, now + min([FRESH_S, *left_s]))
            return wire, []
        return taken.wire, self._after(taken.number, about)

    def _reaches(self, number: int) -> bool:
        """Whether everything after this event is kept."""
        return number == self._site.newest or (bool(self._kept) and self._kept[0].number <= number + 1)

    def _take(self, about: StreamScope, *, lost: bool) -> Snapshot:
        site = self._site
        site.freshen()
        if about.ride is not None:
            named = self._find(about.ride)
            found: tuple[rides.Ride, ...] = () if named is None else (named,)
            lifts: tuple[str, ...] = tuple(ride.lift for ride in found)
        else:
            lifts = site.lift_names() if about.lift is None else (about.lift,)
            found = tuple(ride for ride in site.rides.all() if ride.phase not in rides.OVER and ride.lift in lifts)
        return Snapshot(
            lifts=tuple(Lift.of(site.state(lift), max_age_s=self._max_age_s(lift)) for lift in lifts),
            rides=tuple(Ride.of(ride) for ride in found),
            lost=lost,
        )

    def _max_age_s(self, lift: str) -> float:
        return self._site.config(lift).capabilities.max_age_s


def number_of(event_id: str, boot: str) -> int | None:
    """Return the number in the id of an event; None for one of another process, and for what is none."""
    of, _, number = event_id.rpartition("-")
    if of != boot or not number.isascii() or not number.isdigit() or len(number) > 18:
        return None
    return int(number)
