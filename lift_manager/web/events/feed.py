"""Publishes events to all readers: each is encoded once, and kept for readers whose connection breaks."""

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
from lift_manager.web.events.encoding import actionable_for_s, encode_event, has_ages
from lift_manager.web.events.readers import OpenStreams, Reader

MAX_KEPT_EVENTS = 4096
"""Events kept for readers that reconnect. Chosen: 20 s of a hundred moving lifts, while readers reconnect within two; 8 MB at most."""
KEEP_EVENTS_S = 300.0
"""Chosen: after a longer absence a snapshot serves a reader better."""
MaxAge = Callable[[str], float]
"""Returns the `max_age_s` of a lift."""
FRESH_S = 0.25
"""How far ages and remaining times in an event may lag behind the moment at which it is handed to a connection."""


@dataclass(frozen=True, slots=True)
class StreamScope:
    """What a stream covers: one lift, one ride with the states of its lift, or, with neither, everything."""

    lift: str | None = None
    ride: str | None = None


class PublishedEvent:
    """One event, encoded for the first reader, and again once the ages in the encoded bytes are out of date."""

    __slots__ = ("_ages", "_at", "_event", "_good_until", "_id", "_max_age_of", "_wire", "lifts", "number", "ride")

    def __init__(self, event_id: str, at: float, event: Event, lifts: tuple[str, ...], max_age_of: MaxAge) -> None:
        """`lifts` are the lifts that the event concerns."""
        self._id, self._at, self._event, self._max_age_of = event_id, at, event, max_age_of
        self._ages = has_ages(event)
        self._wire = b""
        self._good_until = at
        """Until when the encoded bytes are valid."""
        self.number = int(event_id.rpartition("-")[2] or 0)
        self.lifts = lifts
        self.ride = event.ride.id if isinstance(event, RideChanged) else ""

    @property
    def at(self) -> float:
        """Loop time of the publication."""
        return self._at

    @property
    def is_state(self) -> bool:
        """Whether it is the state of a lift."""
        return isinstance(self._event, StateChanged)

    def wire(self, now: float) -> bytes:
        """Return the encoded event with correct ages; once it is too old, it invites no robot."""
        if not self._wire or (self._ages and now > self._good_until):
            max_age_s = self._max_age_of(self._event.lift) if self._ages else math.inf
            data = encode_event(self._event, max_age_s, now - self._at)
            self._wire, self._good_until = sse.event(data.event, data, self._id), now + FRESH_S
            stale_at = self._at + actionable_for_s(self._event, max_age_s)
            if stale_at >= now:
                self._good_until = min(self._good_until, stale_at)
        return self._wire


class _CachedSnapshot(NamedTuple):
    """A snapshot, shared by all readers with the same scope for a moment."""

    wire: bytes
    number: int
    """Number of the newest event in it."""
    at: float
    good_until: float
    """When it becomes older than FRESH_S, or a lift in it too old."""


class Feed:
    """The events of an application. It subscribes with the first reader, and stays subscribed for readers that reconnect."""

    def __init__(self, site: Site, open_streams: OpenStreams) -> None:
        self._site = site
        self._open_streams = open_streams
        self._kept: deque[PublishedEvent] = deque(maxlen=MAX_KEPT_EVENTS)
        self._everything: dict[Reader, None] = {}
        self._of_lift: defaultdict[str, dict[Reader, None]] = defaultdict(dict)
        self._of_ride: defaultdict[str, dict[Reader, None]] = defaultdict(dict)
        self._lift_of_active: dict[str, str] = {}
        """The lift of each ride that is not over."""
        self._lift_of_watched: dict[str, str] = {}
        """The lift of each ride that has readers."""
        self._lift_states: dict[int, PublishedEvent] = {}
        """The state of the new lift of a ride, by the number of the event that moved the ride there."""
        self._snapshots: dict[tuple[StreamScope, bool], _CachedSnapshot] = {}
        """Snapshots of the last moment: a hundred readers that reconnect at once share one."""
        self._listening: ExitStack | None = None

    @contextmanager
    def reader(self, scope: StreamScope, last_id: str | None, admits: Callable[[], bool]) -> Iterator[Reader]:
        """Serve a reader for as long as the context lasts.

        `last_id` is the newest event that it has received: it gets the events after it, or a snapshot if they are no longer kept.
        `admits` returns whether it may still read.
        """
        self._listen()
        first, backlog = sse.retry(self._open_streams.retry_ms), None
        if last_id is not None:
            backlog = self._missed_events(last_id, scope)
        if backlog is None:
            cached, backlog = self._snapshot(scope, lost=last_id is not None)
            first += cached
        reader = Reader(first, backlog, lambda lost, since: self._renew(scope, lost, since))
        readers = self._everything
        if scope.ride is not None:
            readers = self._of_ride[scope.ride]
            self._lift_of_watched[scope.ride] = self._lift_of(scope.ride)
        elif scope.lift is not None:
            readers = self._of_lift[scope.lift]
        readers[reader] = None
        try:
            with self._open_streams.register(reader, admits):
                yield reader
        finally:
            del readers[reader]
            if scope.ride is not None and not readers:
                del self._of_ride[scope.ride], self._lift_of_watched[scope.ride]

    def _listen(self) -> None:
        if self._listening is None:
            self._listening = ExitStack()
            self._lift_of_active = {
                ride.id: ride.lift for ride in self._site.rides.all() if ride.phase not in rides.OVER
            }
            self._listening.enter_context(self._site.tap(self._publish))

    def _publish(self, occurrence: Occurrence) -> None:
        event = occurrence.event
        lifts: tuple[str, ...] = (event.lift,)
        if isinstance(event, RideChanged) and (lift_before := self._update_ride_lift(event)) != event.lift:
            lifts = (event.lift, lift_before)
        published = PublishedEvent(occurrence.id, occurrence.at, event, lifts, self._max_age_s)
        self._store(published)
        if len(lifts) > 1:
            state = StateChanged(event.lift, self._site.state(event.lift))
            state_event = PublishedEvent("", occurrence.at, state, lifts, self._max_age_s)
            self._lift_states[published.number] = state_event
            for reader in self._of_ride.get(published.ride, ()):
                reader.put(state_event)
        for readers in (self._everything, *(self._of_lift[lift] for lift in lifts if lift in self._of_lift)):
            for reader in readers:
                reader.put(published)
        self._put_to_ride_readers(published)

    def _put_to_ride_readers(self, published: PublishedEvent) -> None:
        if published.ride:
            for reader in self._of_ride.get(published.ride, ()):
                reader.put(published)
        elif published.is_state:
            for ride, lift in self._lift_of_watched.items():
                if lift in published.lifts:
                    for reader in self._of_ride[ride]:
                        reader.put(published)

    def _update_ride_lift(self, event: RideChanged) -> str:
        """Return the lift that a ride was on before this event."""
        ride = event.ride
        before = self._lift_of_active.get(ride.id, event.lift)
        if ride.id in self._lift_of_watched:
            self._lift_of_watched[ride.id] = event.lift
        if ride.phase in rides.OVER:
            self._lift_of_active.pop(ride.id, None)
        else:
            self._lift_of_active[ride.id] = event.lift
        return before

    def _lift_of(self, ride: str) -> str:
        if ride in self._lift_of_active:
            return self._lift_of_active[ride]
        found = self._find(ride)
        return "" if found is None else found.lift

    def _find(self, ride: str) -> rides.Ride | None:
        """Return a ride; None for one that is no longer known."""
        try:
            return self._site.rides.ride(ride)
        except NotFound:
            return None

    def _store(self, published: PublishedEvent) -> None:
        if len(self._kept) == MAX_KEPT_EVENTS:
            self._lift_states.pop(self._kept[0].number, None)
        self._kept.append(published)
        while self._kept[0].at < published.at - KEEP_EVENTS_S:
            self._lift_states.pop(self._kept.popleft().number, None)

    def _missed_events(self, last_id: str, scope: StreamScope) -> list[PublishedEvent] | None:
        """Return the events after this one; None if they are not all known."""
        number, newest = number_of(last_id, self._site.boot), self._site.newest
        if number is None or number > newest or not self._has_all_after(number):
            return None
        return self._events_after(number, scope)

    def _events_after(self, number: int, scope: StreamScope) -> list[PublishedEvent]:
        after = list(takewhile(lambda published: published.number > number, reversed(self._kept)))[::-1]
        if scope.ride is not None:
            return list(self._missed_events_of_ride(after, scope.ride))
        if scope.lift is not None:
            return [published for published in after if scope.lift in published.lifts]
        return after

    def _missed_events_of_ride(self, after: list[PublishedEvent], ride: str) -> Iterator[PublishedEvent]:
        changes = (published for published in after if published.ride == ride)
        first = next(changes, None)
        # the last entry is the lift that it was on before
        lift = self._lift_of(ride) if first is None else first.lifts[-1]
        for published in after:
            if published.ride == ride:
                if published.number in self._lift_states:
                    yield self._lift_states[published.number]
                lift = published.lifts[0]
                yield published
            elif published.is_state and lift in published.lifts:
                yield published

    def _renew(self, scope: StreamScope, lost: int, since: float) -> tuple[bytes, list[PublishedEvent]]:
        cached, after = self._snapshot(scope, lost=False, since=since)
        # events after the snapshot were counted as lost, but are sent after all
        return sse.event("lost", Lost(events=lost - len(after))) + cached, after

    def _snapshot(
        self, scope: StreamScope, *, lost: bool, since: float = -math.inf
    ) -> tuple[bytes, list[PublishedEvent]]:
        """Return a snapshot taken now, or a moment ago but after `since`, and the events after it."""
        now = asyncio.get_running_loop().time()
        cached = self._snapshots.get((scope, lost))
        if cached is None or cached.good_until < now or cached.at <= since or not self._has_all_after(cached.number):
            self._snapshots = {key: kept for key, kept in self._snapshots.items() if kept.good_until >= now}
            snapshot = self._make_snapshot(scope, lost=lost)
            wire = sse.event("snapshot", snapshot, f"{self._site.boot}-{self._site.newest}")
            fresh_for_s = (
                lift.max_age_s - (lift.age_s or 0.0) for lift in snapshot.lifts if lift.quality is Quality.LIVE
            )
            self._snapshots[scope, lost] = _CachedSnapshot(
                wire, self._site.newest, now, now + min([FRESH_S, *fresh_for_s])
            )
            return wire, []
        return cached.wire, self._events_after(cached.number, scope)

    def _has_all_after(self, number: int) -> bool:
        """Whether every event after this one is kept."""
        return number == self._site.newest or (bool(self._kept) and self._kept[0].number <= number + 1)

    def _make_snapshot(self, scope: StreamScope, *, lost: bool) -> Snapshot:
        site = self._site
        site.freshen()
        if scope.ride is not None:
            ride_found = self._find(scope.ride)
            found: tuple[rides.Ride, ...] = () if ride_found is None else (ride_found,)
            lifts: tuple[str, ...] = tuple(ride.lift for ride in found)
        else:
            lifts = site.lift_names() if scope.lift is None else (scope.lift,)
            found = tuple(ride for ride in site.rides.all() if ride.phase not in rides.OVER and ride.lift in lifts)
        return Snapshot(
            lifts=tuple(Lift.of(site.state(lift), max_age_s=self._max_age_s(lift)) for lift in lifts),
            rides=tuple(Ride.of(ride) for ride in found),
            lost=lost,
        )

    def _max_age_s(self, lift: str) -> float:
        return self._site.config(lift).capabilities.max_age_s


def number_of(event_id: str, boot: str) -> int | None:
    """Return the number in the id of an event; None for the id of another process, or an invalid one."""
    of, _, number = event_id.rpartition("-")
    if of != boot or not number.isascii() or not number.isdigit() or len(number) > 18:
        return None
    return int(number)
