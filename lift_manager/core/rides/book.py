"""Every ride that goes on, and those that ended not long ago."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.domain.ride_record import RideRecord
from lift_manager.domain.state import Holder

MOST = 200
"""Rides that go on at once. Chosen: two for every lift of a building of a hundred."""
MOST_ENDED = 100
ENDED_FOR_S = 3600.0
"""How long a ride that is over can still be asked for, and its robot still be heard to have left."""


class RideBook:
    """Rides by their id, the oldest first."""

    def __init__(self) -> None:
        self._rides: dict[str, RideRecord] = {}

    def __iter__(self) -> Iterator[RideRecord]:
        return iter(tuple(self._rides.values()))

    def get(self, ride: str) -> RideRecord | None:
        """Return a ride; None for one that is not in the book."""
        return self._rides.get(ride)

    def put(self, record: RideRecord) -> None:
        """Write a ride down as it is."""
        self._rides[record.id] = record

    def on(self, lift: str) -> tuple[RideRecord, ...]:
        """Return the rides of one lift."""
        return tuple(record for record in self._rides.values() if record.lift == lift)

    def going_on(self) -> tuple[RideRecord, ...]:
        """Return the rides that are not over."""
        return tuple(record for record in self._rides.values() if not record.over)

    @property
    def full(self) -> bool:
        """Whether no more may begin."""
        return len(self.going_on()) >= MOST

    def of_key(self, caller: Holder, key: str) -> RideRecord | None:
        """Return the ride that a caller began with this idempotency key; None for no key."""
        if not key:
            return None
        mine = (one for one in self._rides.values() if one.wish.caller == caller and one.wish.key == key)
        return next(mine, None)

    def forget(self, now: float) -> frozenset[str]:
        """Forget what ended long ago; return the lifts of these rides."""
        ended = sorted(
            (record for record in self._rides.values() if record.over),
            key=lambda one: one.ended_at or now,
            reverse=True,
        )
        old = [record for place, record in enumerate(ended) if place >= MOST_ENDED or _is_old(record, now)]
        for record in old:
            del self._rides[record.id]
        return frozenset(record.lift for record in old)


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
