"""A ride as the manager keeps it, what is seen while it goes on, and what is to be done for it. Pure values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from drivers.model import FloorName
from lift_manager.domain.boarding import Who
from lift_manager.domain.ride import OVER, Guidance, Phase, Ride, RideRequest
from lift_manager.domain.service import Advice
from lift_manager.domain.session_requests import SessionInfo
from lift_manager.domain.state import Holder, LiftState

UNHEARD_S = 30.0
"""So long after a restart a queued ride keeps its place in the line although its robot has not been heard. Chosen: a robot that
still waits asks every few seconds, and those behind it wait for nothing."""


@dataclass(frozen=True, slots=True)
class Clearing:
    """Why a robot that may be inside is being let out, and what the ride is afterwards."""

    ending: Phase
    """`cancelled` or `gave_up`."""
    cause: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RideRecord:
    """One ride. Times without a zone are monotonic seconds of the event loop."""

    id: str
    wish: RideRequest
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
    entered: bool = False
    """The robot has said that it is inside."""
    could_leave_at: FloorName | None = None
    """Where the door last stood open for a robot inside; None once the car is seen elsewhere."""
    maybe_aboard: bool = False
    clearing: Clearing | None = None
    clear_at: FloorName | None = None
    """Where the robot is let out."""
    stands: tuple[FloorName, float] | None = None
    """Where the car is seen to stand, and since when."""
    unheard_since: float | None = None
    """Since a restart its robot has not been heard, and nothing is asked for it."""
    spoke_at: float = -math.inf
    """When a robot that has a name began the ride, or any said `here`: it knew then what had become of its rides before."""
    asked_at: float = -math.inf
    """When the lift was last asked for something."""
    trouble: str = ""
    """Why the newest thing asked for came to nothing; empty where it did not."""
    ended_at: float | None = None

    @property
    def over(self) -> bool:
        """Whether it goes on no more."""
        return self.phase in OVER

    @property
    def holder(self) -> Holder:
        """Who holds the lift for it."""
        return holder_of(self.wish)

    @property
    def ends_at(self) -> float:
        """When the manager gives the phase up."""
        limits = self.wish.limits
        limit_s = {
            Phase.QUEUED: limits.queued_s,
            Phase.CALLED: limits.called_s,
            Phase.BOARDING: limits.boarding_s,
            Phase.RIDING: limits.riding_s,
        }.get(self.phase, limits.alighting_s)
        return self.phase_since + limit_s


def holder_of(wish: RideRequest) -> Holder:
    """Return who holds a lift for a wish. Two robots of one caller are two holders: one may be in the car while the other waits."""
    caller, robot = wish.caller.name, wish.robot
    own = not robot or robot == caller or caller.endswith(f"/{robot}")
    return Holder("ride", caller if own else f"{caller}/{robot}")


def in_line(record: RideRecord, now: float) -> bool:
    """Whether a ride waits in the line of its lift."""
    since = record.unheard_since
    return record.phase is Phase.QUEUED and (since is None or now - since < UNHEARD_S)


def shown(record: RideRecord, now: float) -> Ride:
    """Return a ride as everybody sees it."""
    wish = record.wish
    return Ride(
        id=record.id,
        lift=record.lift,
        any_lift=wish.any_lift,
        start=wish.start,
        destination=wish.destination,
        door=wish.door,
        robot=wish.robot,
        caller=wish.caller,
        phase=record.phase,
        guidance=record.guidance,
        reason=record.reason,
        advice=record.advice,
        ahead=record.ahead if record.phase is Phase.QUEUED else None,
        phase_ends_in_s=None if record.over else max(0.0, record.ends_at - now),
        maybe_aboard=record.maybe_aboard,
        begun_at=record.begun_at,
        changed_at=record.changed_at,
    )


@dataclass(frozen=True, slots=True)
class Doubt:
    """Another ride of the same holder whose robot may be in a car."""

    ride: str
    lift: str
    since: float
    """When that ride gave up; infinite for one that goes on."""

    @property
    def goes_on(self) -> bool:
        """Whether that ride is not over."""
        return math.isinf(self.since)


@dataclass(frozen=True, slots=True, kw_only=True)
class RideSight:
    """What is known of the lift of a ride at one moment."""

    state: LiftState
    session: SessionInfo | None
    """The ride's session, over or not; None where it has none, or nobody can say yet."""
    gone: str = ""
    """Why nobody knows the ride's session any more; empty otherwise."""
    ahead: int = 0
    """How many wait in the line before the ride."""
    busy: str = ""
    """Which other ride has the lift, in words; empty for none."""
    doubt: Doubt | None = None
    """What speaks against a start of the ride, unless its robot has spoken since."""
    offline_since: str = ""
    """The time of day of the last reading of a lift that is offline."""
    now: float
    at: datetime
    """The time of day at `now`."""

    @property
    def robot(self) -> Who:
        """Where the session's robot is, as the lift's keeper knows it."""
        return self.session.robot if self.session is not None else Who.EMPTY


@dataclass(frozen=True, slots=True)
class Open:
    """Take the lift."""


@dataclass(frozen=True, slots=True)
class GoTo:
    """Ask for a floor, and for the door to be held there."""

    floor: FloorName


@dataclass(frozen=True, slots=True)
class InPlace:
    """Say that the robot is inside."""


@dataclass(frozen=True, slots=True)
class Renew:
    """Begin the lease of the session anew."""


@dataclass(frozen=True, slots=True)
class Close:
    """End the session."""

    left: bool
    """The robot has said that it is outside."""
    clears: bool = False
    """Hold the door for `clear_s` more, inviting nobody: the robot may be on its way through it."""


@dataclass(frozen=True, slots=True)
class Warn:
    """Tell people."""

    text: str


Action = Open | GoTo | InPlace | Renew | Close | Warn


@dataclass(frozen=True, slots=True)
class Step:
    """A ride as it goes on, and what is to be done for it, in this order."""

    record: RideRecord
    actions: tuple[Action, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptRide:
    """A ride as it outlives the manager. Times are wall-clock times."""

    id: str
    wish: RideRequest
    phase: Phase
    phase_since: datetime
    begun_at: datetime
    changed_at: datetime
    kept_at: datetime
    reason: str
    advice: Advice | None
    session: str
    entered: bool
    could_leave_at: FloorName | None
    maybe_aboard: bool
    clearing: Clearing | None
    clear_at: FloorName | None
    ended_at: datetime | None


def kept(record: RideRecord, *, at: datetime, now: float) -> KeptRide:
    """Return what a restart must know, in UTC. `at` is the wall clock at the monotonic time `now`."""
    at = at.astimezone(UTC)

    def wall(when: float) -> datetime:
        return at + timedelta(seconds=when - now)

    return KeptRide(
        id=record.id,
        wish=record.wish,
        phase=record.phase,
        phase_since=wall(record.phase_since),
        begun_at=record.begun_at.astimezone(UTC),
        changed_at=record.changed_at.astimezone(UTC),
        kept_at=at,
        reason=record.reason,
        advice=record.advice,
        session=record.session,
        entered=record.entered,
        could_leave_at=record.could_leave_at,
        maybe_aboard=record.maybe_aboard,
        clearing=record.clearing,
        clear_at=record.clear_at,
        ended_at=None if record.ended_at is None else wall(record.ended_at),
    )


_GUIDANCE_AFTER = {Phase.DONE: Guidance.DONE, Phase.CANCELLED: Guidance.DONE, Phase.GAVE_UP: Guidance.GAVE_UP}


def restored(kept: KeptRide, lift: str, *, at: datetime, now: float) -> RideRecord:
    """Return a ride after a restart, at the wall clock `at` and the monotonic time `now`; the clock rule of `session.restored`."""
    kept_at = kept.kept_at.astimezone(UTC)
    gone_s = max(0.0, (at.astimezone(UTC) - kept_at).total_seconds())

    def monotonic(when: datetime) -> float:
        return now - gone_s - max(0.0, (kept_at - when.astimezone(UTC)).total_seconds())

    over = kept.phase in OVER
    inside = Guidance.STAY if kept.entered else Guidance.WAIT
    return RideRecord(
        id=kept.id,
        wish=kept.wish,
        lift=lift,
        phase=kept.phase,
        phase_since=monotonic(kept.phase_since),
        begun_at=kept.begun_at,
        changed_at=kept.changed_at,
        guidance=_GUIDANCE_AFTER.get(kept.phase, inside),
        reason=kept.reason if over else "",
        advice=kept.advice,
        session=kept.session,
        entered=kept.entered,
        could_leave_at=kept.could_leave_at,
        maybe_aboard=kept.maybe_aboard,
        clearing=kept.clearing,
        clear_at=kept.clear_at,
        unheard_since=None if over else now,
        ended_at=None if kept.ended_at is None else monotonic(kept.ended_at),
    )
