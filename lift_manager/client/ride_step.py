"""Derives what a robot may act on now from the latest reply and its age. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.api.rides import Ride
from lift_manager.lift.session import Advice
from lift_manager.plain.client_aging import SILENT_S, is_too_old
from lift_manager.rides.ride import OVER, Guidance, Phase, RideWord

INVITATIONS = frozenset({Guidance.ENTER, Guidance.LEAVE})
"""A robot drives through a door only on these; all other guidance keeps it where it is."""
_ABOARD = frozenset({Phase.RIDING, Phase.ALIGHTING})
_AFTER_BOARDING = frozenset({*_ABOARD, Phase.CLEARING, *OVER})


@dataclass(frozen=True)
class Step:
    """What the robot has to do now, from `ActiveRide.now`; do not act on an older step."""

    guidance: Guidance
    reason: str
    advice: Advice | None
    """With `gave_up`: what the robot should do."""
    is_current: bool
    """Whether it comes from a recent reply; otherwise it is what a robot does without contact."""
    ride: Ride
    """The ride in the latest reply; its own guidance may be old."""
    over: bool = False
    """Whether this is the last step."""


@dataclass(frozen=True)
class KnownRide:
    """The latest reply about a ride."""

    ride: Ride
    requested_at: float
    """When its request was sent, in monotonic seconds."""
    unknown_reason: str = ""
    """Why the manager no longer knows the ride; empty while it does."""


def valid_for_s(ride: Ride, max_age_s: float) -> float:
    """Return how long a reply is valid: an invitation only as long as the state of a lift."""
    return max_age_s if ride.guidance in INVITATIONS else max(max_age_s, SILENT_S)


def step_at(known: KnownRide, reported: RideWord | None, max_age_s: float, now: float, trouble: str) -> Step:
    """Return the current step. `reported` is the latest report of the robot, accepted or not; `trouble` why there was no reply since."""
    ride = known.ride
    if known.unknown_reason:
        advice = Advice.CLEAR_DOORWAY if _may_be_at_door(ride) else None
        return Step(Guidance.GAVE_UP, known.unknown_reason, advice, is_current=True, ride=ride, over=True)
    if ride.phase in OVER:
        return Step(ride.guidance, ride.reason, ride.advice, is_current=True, ride=ride, over=True)
    silent_s = now - known.requested_at
    if is_too_old(silent_s, valid_for_s(ride, max_age_s)):
        cause = f" ({trouble})" if trouble else ""
        reason = (
            f"the manager has not replied for {silent_s:.1f} s{cause}: the state of the door is unknown; keep out of the"
            " doorway until it replies"
        )
        return Step(_safe_guidance(ride, reported), reason, None, is_current=False, ride=ride)
    if contradicts(ride, reported):
        reason = f"the manager has not received yet that the robot has {reported}"
        return Step(_safe_guidance(ride, reported), reason, None, is_current=True, ride=ride)
    return Step(ride.guidance, ride.reason, ride.advice, is_current=True, ride=ride)


def is_unacknowledged(ride: Ride, word: RideWord) -> bool:
    """Whether a ride shows that the manager has not received this report yet."""
    if word is RideWord.ENTERED:
        return ride.phase not in _AFTER_BOARDING
    return word is RideWord.LEFT and (ride.phase not in OVER or ride.maybe_aboard)


def contradicts(ride: Ride, reported: RideWord | None) -> bool:
    """Whether the guidance invites a robot to do what it has done already."""
    return (ride.guidance is Guidance.ENTER and reported is not None) or (
        ride.guidance is Guidance.LEAVE and reported is RideWord.LEFT
    )


def _safe_guidance(ride: Ride, reported: RideWord | None) -> Guidance:
    if reported is RideWord.LEFT:
        return Guidance.WAIT
    inside = ride.phase in _ABOARD or ride.guidance is Guidance.STAY
    return Guidance.STAY if inside or reported is RideWord.ENTERED else Guidance.WAIT


def _may_be_at_door(ride: Ride) -> bool:
    return ride.maybe_aboard or ride.phase in {Phase.BOARDING, Phase.CLEARING, *_ABOARD}
