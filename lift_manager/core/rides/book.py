"""Every ride that goes on, and those that ended not long ago."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import replace
from typing import TypeVar

from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import RideRequest
from lift_manager.domain.ride_record import RideRecord
from lift_manager.domain.state import Holder

MOST = 200
"""Rides that go on at once. Chosen: two for every lift of a building of a hundred."""
MOST_OF_ONE = 10
"""Rides of one caller that go on at once. Chosen: a robot needs one, and a caller that repeats itself without an idempotency key keeps
nobody else out."""
MOST_ENDED = 100
ENDED_FOR_S = 3600.0
"""How long a ride that is over can still be asked for, and its robot still be heard to have left."""


class RideBook:
    """Rides by their id, the oldest first."""

    def __init__(self) -> None:
        self._rides: dict[str, RideRecord] = {}
        self._on: dict[str, dict[str, RideRecord]] = {}
        """By lift."""
        self._under_way: dict[str, dict[str, RideRecord]] = {}
        """Those that have a session, by lift."""
        self._aboard: dict[Holder, dict[str, RideRecord]] = {}
        """Those whose robot may be in a car, over or not, by holder."""

    def __iter__(self) -> Iterator[RideRecord]:
        return iter(tuple(self._rides.values()))

    def get(self, ride: str) -> RideRecord | None:
        """Return a ride; None for one that is not in the book."""
        return self._rides.get(ride)

    def put(self, record: RideRecord) -> None:
        """Write a ride down as it is."""
        before = self._rides.get(record.id)
        if before is not None and before.lift != record.lift:
            self._drop(before)
        self._rides[record.id] = record
        self._on.setdefault(record.lift, {})[record.id] = record
        _file(self._under_way, record.lift, record, wanted=bool(record.session) and not record.over)
        _file(self._aboard, record.holder, record, wanted=record.maybe_aboard)

    def _drop(self, record: RideRecord) -> None:
        for index in (self._on, self._under_way):
            index.get(record.lift, {}).pop(record.id, None)
        self._aboard.get(record.holder, {}).pop(record.id, None)

    def on(self, lift: str) -> tuple[RideRecord, ...]:
        """Return the rides of one lift."""
        return tuple(self._on.get(lift, {}).values())

    def under_way(self, lift: str) -> tuple[RideRecord, ...]:
        """Return the rides of one lift that have left the queue and are not over."""
        return tuple(self._under_way.get(lift, {}).values())

    def maybe_aboard(self, holder: Holder) -> tuple[RideRecord, ...]:
        """Return the rides of one holder whose robot may be in a car, over or not."""
        return tuple(self._aboard.get(holder, {}).values())

    def going_on(self) -> tuple[RideRecord, ...]:
        """Return the rides that are not over."""
        return tuple(record for record in self._rides.values() if not record.over)

    def too_many(self, caller: Holder) -> Refused | None:
        """Refuse to begin another ride of a caller, where it or all together have as many as may go on."""
        going_on = self.going_on()
        own = [record.id for record in going_on if record.wish.caller == caller]
        if len(own) >= MOST_OF_ONE:
            text = (
                f"{len(own)} rides of {caller} go on, and one caller may have {MOST_OF_ONE} at once; cancel those that no robot"
                f" waits for: {', '.join(own)}"
            )
            return Refused(Refusal.TOO_MANY, text)
        if len(going_on) >= MOST:
            text = f"{MOST} rides of all callers go on, and this manager keeps no more; ask again when some are over"
            return Refused(Refusal.TOO_MANY, text)
        return None

    def of_key(self, caller: Holder, key: str) -> RideRecord | None:
        """Return the ride that a caller began with this idempotency key; None for no key."""
        if not key:
            return None
        mine = (one for one in self._rides.values() if one.wish.caller == caller and one.wish.key == key)
        return next(mine, None)

    def forget(self, now: float) -> frozenset[str]:
        """Forget what ended long ago with its robot outside; return the lifts of these rides."""
        ended = sorted(
            (record for record in self._rides.values() if record.over and not record.maybe_aboard),
            key=lambda one: one.ended_at or now,
            reverse=True,
        )
        old = [record for place, record in enumerate(ended) if place >= MOST_ENDED or _is_old(record, now)]
        for record in old:
            self._drop(self._rides.pop(record.id))
        return frozenset(record.lift for record in old)


_Key = TypeVar("_Key", bound=Hashable)


def _file(index: dict[_Key, dict[str, RideRecord]], key: _Key, record: RideRecord, *, wanted: bool) -> None:
    if wanted:
        index.setdefault(key, {})[record.id] = record
    elif record.id in (filed := index.get(key, {})):
        del filed[record.id]
        if not filed:
            del index[key]


def reused(record: RideRecord, wish: RideRequest) -> Refused | None:
    """Refuse another wish with the idempotency key of a ride."""
    was = record.wish
    # which lifts `any` stands for may change with the key and with the site
    lifts = was.lifts if was.any_lift and wish.any_lift else wish.lifts
    if replace(wish, lifts=lifts) == was:
        return None
    lift = "any lift" if was.any_lift else was.lifts[0]
    door = "" if was.door is None else f", boarding by the {was.door} door"
    limits = "" if (wish.limits) == was.limits else ", with other limits"
    text = (
        f"this idempotency key was used for ride {record.id} from {was.start} to {was.destination} with {lift}{door}{limits};"
        " another wish needs another key"
    )
    return Refused(Refusal.KEY_REUSED, text)


def _is_old(record: RideRecord, now: float) -> bool:
    return record.ended_at is not None and now - record.ended_at > ENDED_FOR_S


def is_kept(record: RideRecord) -> bool:
    """Whether a restart must know a ride: what is over and can be neither asked for again nor cleared is not kept."""
    return not record.over or bool(record.wish.key) or record.maybe_aboard


def to_keep(record: RideRecord) -> tuple[object, ...]:
    """Return what of a ride is written down at once when it changes."""
    return (
        record.lift,
        record.phase,
        record.session,
        record.entered,
        record.could_leave_at,
        record.maybe_aboard,
        record.clearing,
        record.clear_at,
    )


def to_tell(record: RideRecord) -> tuple[object, ...]:
    """Return what of a ride everybody is told when it changes."""
    return (
        record.lift,
        record.phase,
        record.guidance,
        record.reason,
        record.advice,
        record.ahead,
        record.maybe_aboard,
    )
