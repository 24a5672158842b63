"""Who waits for one lift: first come, first served. People never wait in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from drivers.rate_limits import CALLERS
from lift_manager.lift.refusals import Blocking, Refusal, Refused
from lift_manager.lift.session import RMF, Holder

WAITS_AS_ONE = frozenset({RMF, "workshop"})
"""Faces whose callers can only repeat their request while another one holds the lift: each waits as one, for all its callers."""
WAITS_BY_REPEATING = WAITS_AS_ONE | {"api"}
"""Faces whose callers wait because they were refused, for as long as they repeat the request. Rides join and leave by themselves."""
LAPSES_AFTER_S = 5.0
"""A caller that has to repeat its request leaves the queue after this silence. RMF requests once a second (open-rmf 1.6)."""

Place = Holder | str
"""Who has a place: a holder, or a face whose callers wait as one."""


@dataclass(frozen=True, slots=True)
class Queue:
    """The places before one lift, the first one in front."""

    places: tuple[Place, ...] = ()
    requested_at: Mapping[Place, float] = field(default_factory=dict)
    """When each of those that have to repeat their request last did so."""
    departures: int = 0
    """How many have left the queue so far; each of them let those behind it move up."""


def join(queue: Queue, holder: Holder, now: float) -> Queue:
    """Add a caller at the end; one that waits already keeps its place."""
    queue, place = lapse(queue, now), place_of(holder)
    if place not in queue.places:
        queue = replace(queue, places=(*queue.places, place))
    if holder.face in WAITS_BY_REPEATING:
        queue = replace(queue, requested_at={**queue.requested_at, place: now})
    return queue


def leave(queue: Queue, holder: Holder) -> Queue:
    """Remove a caller whose turn has come, or that no longer needs the lift."""
    return _without(queue, place_of(holder))


def join_if_refused(queue: Queue, holder: Holder, refused: Refused, now: float) -> Queue:
    """Add a caller that was refused because it has to wait; beyond `CALLERS` nobody is added."""
    if holder.face not in WAITS_BY_REPEATING or refused.code not in (Refusal.HELD, Refusal.QUEUED):
        return queue
    has_room = place_of(holder) in queue.requested_at or len(queue.requested_at) < CALLERS
    return join(queue, holder, now) if has_room else queue


def lapse(queue: Queue, now: float) -> Queue:
    """Remove the callers that have to repeat their request and have not."""
    for place, at in tuple(queue.requested_at.items()):
        if now >= at + LAPSES_AFTER_S:
            queue = _without(queue, place)
    return queue


def waiting(queue: Queue, now: float) -> tuple[Place, ...]:
    """Return who waits, the first one in front."""
    return lapse(queue, now).places


def ahead_of(queue: Queue, holder: Holder, now: float) -> int:
    """Return how many come before this caller, whether or not it waits."""
    places, place = waiting(queue, now), place_of(holder)
    return places.index(place) if place in places else len(places)


def why_not_yet(lift: str, queue: Queue, holder: Holder, now: float) -> Refused | None:
    """Refuse a free lift to everybody but the first in the queue."""
    if (ahead := ahead_of(queue, holder, now)) == 0:
        return None
    text = f"{lift} is free, and {ahead} that waited for it {'comes' if ahead == 1 else 'come'} first; send another request"
    return Refused(Refusal.QUEUED, text, Blocking(ahead=ahead))


def next_lapse(queue: Queue) -> float:
    """Return when the next caller leaves because it is silent; infinity if none does."""
    return min((at + LAPSES_AFTER_S for at in queue.requested_at.values()), default=float("inf"))


def place_of(holder: Holder) -> Place:
    """Return the place of a caller. Each adapter of RMF has a place of its own."""
    if holder.face == RMF:
        _, found, adapter = holder.name.rpartition("@")
        return f"{RMF}@{adapter}" if found and adapter else RMF
    return holder.face if holder.face in WAITS_AS_ONE else holder


def _without(queue: Queue, place: Place) -> Queue:
    if place not in queue.places:
        return queue
    requested_at = {other: at for other, at in queue.requested_at.items() if other != place}
    return Queue(tuple(other for other in queue.places if other != place), requested_at, queue.departures + 1)
