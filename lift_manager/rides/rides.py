"""All rides of a site as one value: those under way and those that ended recently, their places in queues, and whose turn it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from lift_manager.lift.commands import CommandStatus, SessionInfo
from lift_manager.lift.events import Acknowledged, Advised, Cause, CommandFollowed
from lift_manager.lift.events import Event as LiftEvent
from lift_manager.lift.inputs import JoinQueue, LeaveQueue
from lift_manager.lift.observation import Moment
from lift_manager.lift.queue import ahead_of, place_of, waiting
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.rides.inputs import FoundOutside, Input, QueueChange
from lift_manager.rides.observation import Lifts, LiftView, RideInDoubt, RideObservation
from lift_manager.rides.record import RideRecord, SavedRide, must_outlive, save, waits_in_queue
from lift_manager.rides.ride import Phase, RideRequest
from lift_manager.rides.step import Step

MOST = 200
"""Most rides under way at once. Chosen: two for every lift of a building of a hundred."""
MOST_OF_ONE = 10
"""Most rides of one caller under way at once. Chosen: a robot needs one, and a caller that repeats itself without an idempotency
key keeps nobody else out."""
MOST_ENDED = 100
ENDED_FOR_S = 3600.0
"""How long a ride that is over is known, and its robot may still report that it left."""
REFUSED_FOR_S = 30.0
"""How long a lift that refused a ride counts as taking no robots, where a ride may choose another."""

Place = tuple[str, Holder]
"""The place of a holder in the queue of a lift."""


@dataclass(frozen=True, slots=True)
class LiftRefused:
    """A lift refused a ride for a reason of its own."""

    at: float
    why: str


@dataclass(frozen=True, slots=True)
class Rides:
    """Every ride. Changed by the functions of this module only."""

    by_id: Mapping[str, RideRecord] = field(default_factory=dict)
    """The oldest first."""
    by_lift: Mapping[str, Mapping[str, RideRecord]] = field(default_factory=dict)
    places: Mapping[str, Place] = field(default_factory=dict)
    """Of rides that wait. Those of one holder have one place in a queue."""
    refused: Mapping[str, LiftRefused] = field(default_factory=dict)
    """By lift, the newest."""
    held: frozenset[str] = frozenset()
    """Lifts that somebody held when they were last looked at (`freed`)."""
    departures: Mapping[str, int] = field(default_factory=dict)
    """How far the queue of each lift had moved up when it was last looked at (`due`)."""

    def on(self, lift: str) -> tuple[RideRecord, ...]:
        """Return the rides of one lift."""
        return tuple(self.by_lift.get(lift, {}).values())

    def of_holder_maybe_aboard(self, holder: Holder) -> tuple[RideRecord, ...]:
        """Return the rides of one holder whose robot may be in a car, over or not."""
        return tuple(one for one in self.by_id.values() if one.maybe_aboard and one.holder == holder)

    def going_on(self) -> tuple[RideRecord, ...]:
        """Return the rides that are not over."""
        return tuple(one for one in self.by_id.values() if not one.is_over)

    def matter(self) -> bool:
        """Whether a lift has to be watched: a ride is under way, or its robot may be in a car."""
        return any(not one.is_over or one.maybe_aboard for one in self.by_id.values())


def put(rides: Rides, record: RideRecord) -> Rides:
    """Return the rides with this one in its present state."""
    before = rides.by_id.get(record.id)
    by_lift = dict(rides.by_lift)
    if before is not None and before.lift != record.lift:
        by_lift[before.lift] = {key: one for key, one in by_lift[before.lift].items() if key != record.id}
    by_lift[record.lift] = {**by_lift.get(record.lift, {}), record.id: record}
    return replace(rides, by_id={**rides.by_id, record.id: record}, by_lift=by_lift)


def take(rides: Rides, done: Step, lifts: Lifts, moment: Moment) -> tuple[Rides, tuple[QueueChange, ...]]:
    """Return the rides after a step of one of them, and the changes of queues that follow."""
    rides = put(rides, done.record)
    if done.lift_refusal:
        refused = LiftRefused(moment.now, done.lift_refusal)
        rides = replace(rides, refused={**rides.refused, done.record.lift: refused})
    return place(rides, done.record, lifts, moment.now)


def forget(rides: Rides, now: float) -> tuple[Rides, tuple[str, ...]]:
    """Forget what ended long ago with its robot outside; return the lifts of these rides too."""
    ended = sorted(
        (one for one in rides.by_id.values() if one.is_over and not one.maybe_aboard),
        key=lambda one: now if one.ended_at is None else one.ended_at,
        reverse=True,
    )
    old = {one.id: one.lift for number, one in enumerate(ended) if number >= MOST_ENDED or _is_old(one, now)}
    if not old:
        return rides, ()
    by_lift = {lift: _without(some, old) for lift, some in rides.by_lift.items()}
    return replace(rides, by_id=_without(rides.by_id, old), by_lift=by_lift), tuple(dict.fromkeys(old.values()))


def saved(rides: Rides, lift: str, moment: Moment) -> tuple[SavedRide, ...]:
    """Return the rides that outlive the manager with the record of a lift."""
    return tuple(save(one, moment) for one in rides.on(lift) if must_outlive(one))


def _is_old(record: RideRecord, now: float) -> bool:
    return record.ended_at is not None and now - record.ended_at > ENDED_FOR_S


def _without(some: Mapping[str, RideRecord], old: Iterable[str]) -> dict[str, RideRecord]:
    gone = frozenset(old)
    return {key: one for key, one in some.items() if key not in gone}


# -- who may begin a ride, or report for one


def repeated(rides: Rides, request: RideRequest) -> RideRecord | Refused | None:
    """Return the ride that a caller began with this idempotency key; refuse another request with it."""
    if not request.key:
        return None
    for record in rides.by_id.values():
        if (record.request.caller, record.request.key) == (request.caller, request.key):
            return _key_reused(record, request) or record
    return None


def too_many(rides: Rides, caller: Holder) -> Refused | None:
    """Refuse another ride of a caller if it, or all callers together, have as many under way as allowed."""
    going_on = rides.going_on()
    own = [one.id for one in going_on if one.request.caller == caller]
    if len(own) >= MOST_OF_ONE:
        text = (
            f"{len(own)} rides of {caller} are under way, and one caller may have {MOST_OF_ONE} at once; cancel those that no robot"
            f" waits for: {', '.join(own)}"
        )
        return Refused(Refusal.TOO_MANY, text)
    if len(going_on) >= MOST:
        text = f"{MOST} rides of all callers are under way, and this manager keeps no more; send the request again when some are over"
        return Refused(Refusal.TOO_MANY, text)
    return None


def find(rides: Rides, ride: str, caller: Holder | None) -> RideRecord | Refused:
    """Return a ride to a caller that may report for it; `caller` None is an operator."""
    record = rides.by_id.get(ride)
    if record is None:
        text = f"no ride {ride!r} is under way here, and none ended within the last hour"
        return Refused(Refusal.UNKNOWN_RIDE, text)
    if caller not in (None, record.request.caller):
        return Refused(Refusal.NOT_YOUR_RIDE, f"ride {ride} is that of {record.request.caller}")
    return record


def heirs(rides: Rides, record: RideRecord) -> tuple[RideRecord, ...]:
    """Return the rides that may have taken over the car of one that is over: `left` is reported for the one whose robot may be in it."""
    if not (record.is_over and record.maybe_aboard and record.request.robot):
        return ()
    return tuple(one for one in rides.on(record.lift) if one.has_session and one.holder == record.holder)


def _key_reused(record: RideRecord, request: RideRequest) -> Refused | None:
    was = record.request
    # which lifts `any` stands for may change with the key and with the site
    lifts = was.lifts if was.any_lift and request.any_lift else request.lifts
    if replace(request, lifts=lifts) == was:
        return None
    lift = "any lift" if was.any_lift else was.lifts[0]
    door = "" if was.door is None else f", boarding by the {was.door} door"
    limits = "" if request.limits == was.limits else ", with other limits"
    text = (
        f"this idempotency key was used for ride {record.id} from {was.start} to {was.destination} with {lift}{door}{limits};"
        " another request needs another key"
    )
    return Refused(Refusal.KEY_REUSED, text)


# -- what rides know of each other


def observe(
    rides: Rides, lifts: Lifts, record: RideRecord, session: SessionInfo | Refused | None, moment: Moment
) -> RideObservation:
    """Return what a ride sees of its lift now. `session` is the lift's reply about the ride's session; None if it has none."""
    lift = lifts[record.lift]
    has_session, is_queued = record.has_session, record.phase is Phase.QUEUED
    return RideObservation(
        state=lift.state,
        clear_s=lift.config.clear_s,
        session=session if has_session and isinstance(session, SessionInfo) else None,
        gone=f"its session is over: {session.message}" if has_session and isinstance(session, Refused) else "",
        ahead=ahead_of(lift.queue, record.holder, moment.now),
        busy=_busy(rides, record) if is_queued else "",
        doubt=_doubt(rides, lifts, record) if is_queued else None,
    )


def in_doubt(rides: Rides, lift: str, holder: Holder | None = None) -> tuple[RideRecord, ...]:
    """Return the rides that are over and whose robot may be in the car of a lift: those of a holder, or of everybody."""
    doubted = (one for one in rides.on(lift) if one.is_over and one.maybe_aboard)
    return tuple(one for one in doubted if holder in (None, one.holder))


def concerned(rides: Rides, event: LiftEvent) -> tuple[tuple[str, Input], ...]:
    """Return the rides to which an event of a lift is an input, each with that input."""
    match event:
        case Advised(lift, holder) | CommandFollowed(lift, CommandStatus(holder=holder)):
            return tuple((one.id, event) for one in rides.on(lift) if one.has_session and one.holder == holder)
        case Acknowledged(lift, causes=causes) if Cause.OCCUPIED in causes:
            return tuple((one.id, FoundOutside()) for one in in_doubt(rides, lift))
        case _:
            return ()


def _busy(rides: Rides, record: RideRecord) -> str:
    for other in rides.on(record.lift):
        if other.has_session and other.id != record.id:
            return f"ride {other.id} of {other.holder} has {record.lift}"
    return ""


def _doubt(rides: Rides, lifts: Lifts, record: RideRecord) -> RideInDoubt | None:
    """Return the newest other ride of the same holder whose robot may be in a car."""
    doubts = [
        RideInDoubt(one.id, one.lift, math.inf if one.ended_at is None else one.ended_at)
        for one in rides.of_holder_maybe_aboard(record.holder)
        if one.id != record.id and _speaks_against(one, record, lifts)
    ]
    return max(doubts, key=lambda one: one.since, default=None)


def _speaks_against(other: RideRecord, record: RideRecord, lifts: Lifts) -> bool:
    """Whether another ride blocks this one: a robot with a name is known to be that of its own ride under way."""
    if not other.is_over:
        return not record.request.robot
    return lifts[other.lift].state.restrictions.maybe_aboard == record.holder


# -- places in queues


def place(rides: Rides, record: RideRecord, lifts: Lifts, now: float) -> tuple[Rides, tuple[QueueChange, ...]]:
    """Give a ride a place in the queue of its lift for as long as it waits, and in no other.

    The rides of one holder have one place. Once one of them has left it the others wait at the end of the queue, so that one
    caller with many rides does not keep everybody else waiting.
    """
    requested = (record.lift, record.holder) if waits_in_queue(record, now) else None
    present, changes = rides.places.get(record.id), list[QueueChange]()
    if present is not None and present != requested:
        rides = replace(rides, places={key: one for key, one in rides.places.items() if key != record.id})
        lift, holder = present
        changes.append(QueueChange(lift, LeaveQueue(holder)))
        if rides_at(rides, present):
            changes.append(QueueChange(lift, JoinQueue(holder)))
    if requested is not None:
        if present != requested:
            rides = replace(rides, places={**rides.places, record.id: requested})
        if place_of(record.holder) not in lifts[record.lift].queue.places:
            changes.append(QueueChange(record.lift, JoinQueue(record.holder)))
    return rides, tuple(changes)


def rides_at(rides: Rides, requested: Place) -> tuple[str, ...]:
    """Return the rides at a place, the one that has waited for longest first."""
    return tuple(ride for ride, present in rides.places.items() if present == requested)


# -- for which rides news of a lift matters


def freed(rides: Rides, lifts: Lifts, names: Iterable[str]) -> tuple[Rides, frozenset[str]]:
    """Return those of these lifts that had a holder when they were last examined, and have none any more."""
    names = frozenset(names)
    held = frozenset(name for name in names if lifts[name].state.holder is not None)
    return replace(rides, held=(rides.held - names) | held), (rides.held & names) - held


def due(
    rides: Rides, lifts: Lifts, names: Iterable[str], freed_lifts: frozenset[str], now: float
) -> tuple[Rides, tuple[str, ...]]:
    """Return the rides for which news of these lifts matters.

    Those are the rides with a session and the next one; where the queue has moved up, all of that lift; and the flexible ones that may
    take a lift that was freed.
    """
    found: dict[str, None] = {}
    departures = dict(rides.departures)
    for name in names:
        lift = lifts[name]
        if departures.get(name) != lift.queue.departures:
            departures[name] = lift.queue.departures
            found.update((one.id, None) for one in rides.on(name) if not one.is_over)
            continue
        found.update((one.id, None) for one in rides.on(name) if one.has_session)
        if (holder := _next_holder(lift, now)) is not None:
            found.update(dict.fromkeys(rides_at(rides, (name, holder))))
    if freed_lifts:
        flexible = (one for one in rides.by_id.values() if one.is_flexible)
        found.update((one.id, None) for one in flexible if freed_lifts.intersection(one.request.lifts))
    return replace(rides, departures=departures), tuple(found)


def _next_holder(lift: LiftView, now: float) -> Holder | None:
    """Return whose turn is next at a lift that nobody holds: a robot inside first, then the head of the queue."""
    inside = lift.state.restrictions.maybe_aboard
    if lift.state.holder is None and inside is not None:
        return inside
    head = next(iter(waiting(lift.queue, now)), None)
    return head if isinstance(head, Holder) else None
