"""Everything the manager remembers about one ride, as one frozen value; and `SavedRide`, the part that outlives the manager."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from drivers.model import FloorName
from lift_manager.lift.observation import Moment
from lift_manager.lift.session import Advice, Holder
from lift_manager.rides.ride import OVER, Guidance, Phase, Ride, RideRequest

RESTORED_FOR_S = 30.0
"""How long after a restart, or after a remote begin, a queued ride keeps its place although its robot has not reported. Chosen: a
robot that waits sends a request every few seconds, and those behind it would wait in vain."""


@dataclass(frozen=True, slots=True)
class Clearing:
    """Why a robot that may be inside is being let out, and how the ride ends afterwards."""

    ending: Phase
    """`cancelled` or `gave_up`."""
    cause: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RideRecord:
    """One ride. Times without a zone are monotonic seconds."""

    id: str
    request: RideRequest
    lift: str
    phase: Phase = Phase.QUEUED
    phase_since: float
    begun_at: datetime
    changed_at: datetime
    guidance: Guidance = Guidance.WAIT
    reason: str = ""
    advice: Advice | None = None
    ahead: int | None = None
    session: str = ""
    """The id of its session; empty before it has one."""
    has_entered: bool = False
    """The robot has reported that it is inside."""
    could_exit_at: FloorName | None = None
    """Where the door last stood open for a robot inside; None once the car is seen elsewhere."""
    maybe_aboard: bool = False
    clearing: Clearing | None = None
    clear_at: FloorName | None = None
    """Where the robot is let out."""
    stands: tuple[FloorName, float] | None = None
    """Where the car is seen to stand, and since when."""
    offline_since: str = ""
    """The time of day of the last reading of a lift that is offline; empty while it is not."""
    silent_since: float | None = None
    """Since a restart, or since a remote caller began the ride, its robot has not reported, and nothing is requested for it."""
    present_at: float = -math.inf
    """When a robot that has a name began the ride, or any robot reported `here`: it knew then how its earlier rides had ended."""
    requested_at: float = -math.inf
    """When a floor was last requested of the lift."""
    failure: str = ""
    """Why the newest request failed; empty if it did not."""
    ended_at: float | None = None

    @property
    def is_over(self) -> bool:
        """Whether it is over."""
        return self.phase in OVER

    @property
    def has_session(self) -> bool:
        """Whether it is under way and no longer queued."""
        return bool(self.session) and not self.is_over

    @property
    def is_flexible(self) -> bool:
        """Whether it may still take another lift."""
        return self.request.any_lift and self.phase is Phase.QUEUED and self.silent_since is None

    @property
    def holder(self) -> Holder:
        """The holder of the lift for this ride."""
        return self.request.holder

    @property
    def ends_at(self) -> float:
        """When the manager gives the phase up."""
        limits = self.request.limits
        limit_s = {
            Phase.QUEUED: limits.queued_s,
            Phase.CALLED: limits.called_s,
            Phase.BOARDING: limits.boarding_s,
            Phase.RIDING: limits.riding_s,
        }.get(self.phase, limits.alighting_s)
        return self.phase_since + limit_s


def waits_in_queue(record: RideRecord, now: float) -> bool:
    """Whether a ride has a place in the queue of its lift."""
    since = record.silent_since
    return record.phase is Phase.QUEUED and (since is None or now - since < RESTORED_FOR_S)


def published(record: RideRecord, now: float) -> Ride:
    """Return a ride as every face shows it."""
    request = record.request
    return Ride(
        id=record.id,
        lift=record.lift,
        any_lift=request.any_lift,
        start=request.start,
        destination=request.destination,
        door=request.door,
        robot=request.robot,
        caller=request.caller,
        phase=record.phase,
        guidance=record.guidance,
        reason=record.reason,
        advice=record.advice,
        ahead=record.ahead if record.phase is Phase.QUEUED else None,
        phase_ends_in_s=None if record.is_over else max(0.0, record.ends_at - now),
        maybe_aboard=record.maybe_aboard,
        begun_at=record.begun_at,
        changed_at=record.changed_at,
    )


def differs_in_public(one: RideRecord, other: RideRecord) -> bool:
    """Whether the difference between two records of a ride is published."""
    return _public(one) != _public(other)


def _public(record: RideRecord) -> tuple[object, ...]:
    return (
        record.lift,
        record.phase,
        record.guidance,
        record.reason,
        record.advice,
        record.ahead,
        record.maybe_aboard,
    )


# -- what outlives the manager


@dataclass(frozen=True, slots=True, kw_only=True)
class SavedRide:
    """A ride as it outlives the manager, with the record of its lift. Times are wall-clock times in UTC, taken at `saved_at`."""

    id: str
    request: RideRequest
    phase: Phase
    phase_since: datetime
    begun_at: datetime
    changed_at: datetime
    saved_at: datetime
    reason: str
    advice: Advice | None
    session: str
    has_entered: bool
    could_exit_at: FloorName | None
    maybe_aboard: bool
    clearing: Clearing | None
    clear_at: FloorName | None
    ended_at: datetime | None


def must_outlive(record: RideRecord) -> bool:
    """Whether a restart has to know a ride: not one that is over and can be neither requested again nor cleared."""
    return not record.is_over or bool(record.request.key) or record.maybe_aboard


def differs_on_disk(one: RideRecord, other: RideRecord) -> bool:
    """Whether the difference between two records of a ride is saved at once."""
    return _durable(one) != _durable(other)


def _durable(record: RideRecord) -> tuple[object, ...]:
    return (
        record.lift,
        record.phase,
        record.session,
        record.has_entered,
        record.could_exit_at,
        record.maybe_aboard,
        record.clearing,
        record.clear_at,
    )


def save(record: RideRecord, moment: Moment) -> SavedRide:
    """Return what of a ride outlives the manager."""
    clock = moment.clock.astimezone(UTC)

    def wall(when: float) -> datetime:
        return clock + timedelta(seconds=when - moment.now)

    return SavedRide(
        id=record.id,
        request=record.request,
        phase=record.phase,
        phase_since=wall(record.phase_since),
        begun_at=record.begun_at.astimezone(UTC),
        changed_at=record.changed_at.astimezone(UTC),
        saved_at=clock,
        reason=record.reason,
        advice=record.advice,
        session=record.session,
        has_entered=record.has_entered,
        could_exit_at=record.could_exit_at,
        maybe_aboard=record.maybe_aboard,
        clearing=record.clearing,
        clear_at=record.clear_at,
        ended_at=None if record.ended_at is None else wall(record.ended_at),
    )


_GUIDANCE_AFTER = {Phase.DONE: Guidance.DONE, Phase.CANCELLED: Guidance.DONE, Phase.GAVE_UP: Guidance.GAVE_UP}


def restore(saved: SavedRide, lift: str, moment: Moment) -> RideRecord:
    """Return a ride after a restart. A clock that was set back counts as one that stood still."""
    saved_at, now = saved.saved_at.astimezone(UTC), moment.now
    gone_s = max(0.0, (moment.clock.astimezone(UTC) - saved_at).total_seconds())

    def monotonic(when: datetime) -> float:
        return now - gone_s - max(0.0, (saved_at - when.astimezone(UTC)).total_seconds())

    is_over = saved.phase in OVER
    inside = Guidance.STAY if saved.has_entered else Guidance.WAIT
    return RideRecord(
        id=saved.id,
        request=saved.request,
        lift=lift,
        phase=saved.phase,
        phase_since=monotonic(saved.phase_since),
        begun_at=saved.begun_at,
        changed_at=saved.changed_at,
        guidance=_GUIDANCE_AFTER.get(saved.phase, inside),
        reason=saved.reason if is_over else "",
        advice=saved.advice,
        session=saved.session,
        has_entered=saved.has_entered,
        could_exit_at=saved.could_exit_at,
        maybe_aboard=saved.maybe_aboard,
        clearing=saved.clearing,
        clear_at=saved.clear_at,
        silent_since=None if is_over else now,
        ended_at=None if saved.ended_at is None else monotonic(saved.ended_at),
    )
