"""What a robot may act on now, from what was heard last and how long ago. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.api.rides import Ride
from lift_manager.lift.session import Advice
from lift_manager.plain.aging import SILENT_S, is_too_old
from lift_manager.rides.ride import OVER, Guidance, Phase, RideWord

INVITATIONS = frozenset({Guidance.ENTER, Guidance.LEAVE})
"""A robot drives through a door on these; all other guidance keeps it where it is."""
_INSIDE = frozenset({Phase.RIDING, Phase.ALIGHTING})
_AFTER_BOARDING = frozenset({*_INSIDE, Phase.CLEARING, *OVER})


@dataclass(frozen=True)
class Step:
    """What the robot is to do now. Of `client.ride`; nothing older may be acted on."""

    guidance: Guidance
    reason: str
    advice: Advice | None
    """With `gave_up`: what the robot does best."""
    heard: bool
    """The manager said so a moment ago; otherwise it is what a robot does that hears nothing."""
    ride: Ride
    """As the manager told it last. Its own guidance may be old."""
    over: bool = False
    """Nothing follows."""


@dataclass(frozen=True)
class KnownRide:
    """The newest answer about a ride."""

    ride: Ride
    asked_at: float
    """When its question left, in monotonic seconds."""
    gone: str = ""
    """The manager knows no such ride any more, in its words; empty while it does."""


def good_for_s(ride: Ride, max_age_s: float) -> float:
    """Return for how long an answer may be acted on: an invitation no longer than the state of a lift."""
    return max_age_s if ride.guidance in INVITATIONS else max(max_age_s, SILENT_S)


def step_at(known: KnownRide, said: RideWord | None, max_age_s: float, now: float, trouble: str) -> Step:
    """Return what holds now. `said` is the newest word of the robot, heard or not; `trouble` why nothing was heard since."""
    ride = known.ride
    if known.gone:
        advice = Advice.CLEAR_DOORWAY if _may_be_at_door(ride) else None
        return Step(Guidance.GAVE_UP, known.gone, advice, heard=True, ride=ride, over=True)
    if ride.phase in OVER:
        return Step(ride.guidance, ride.reason, ride.advice, heard=True, ride=ride, over=True)
    silent_s = now - known.asked_at
    if is_too_old(silent_s, good_for_s(ride, max_age_s)):
        because = f" ({trouble})" if trouble else ""
        reason = (
            f"the manager has not been heard for {silent_s:.1f} s{because}: nothing is known of the door; keep out of the"
            " doorway until it is heard"
        )
        return Step(_keep(ride, said), reason, None, heard=False, ride=ride)
    if contradicts(ride, said):
        reason = f"the manager has yet to hear that the robot has {said}"
        return Step(_keep(ride, said), reason, None, heard=True, ride=ride)
    return Step(ride.guidance, ride.reason, ride.advice, heard=True, ride=ride)


def is_owed(ride: Ride, word: RideWord) -> bool:
    """Whether a ride shows that the manager has not heard this word yet."""
    if word is RideWord.ENTERED:
        return ride.phase not in _AFTER_BOARDING
    return word is RideWord.LEFT and (ride.phase not in OVER or ride.maybe_aboard)


def contradicts(ride: Ride, said: RideWord | None) -> bool:
    """Whether the guidance invites a robot to do what it has done already."""
    return (ride.guidance is Guidance.ENTER and said is not None) or (
        ride.guidance is Guidance.LEAVE and said is RideWord.LEFT
    )


def _keep(ride: Ride, said: RideWord | None) -> Guidance:
    if said is RideWord.LEFT:
        return Guidance.WAIT
    inside = ride.phase in _INSIDE or ride.guidance is Guidance.STAY
    return Guidance.STAY if inside or said is RideWord.ENTERED else Guidance.WAIT


def _may_be_at_door(ride: Ride) -> bool:
    return ride.maybe_aboard or ride.phase in {Phase.BOARDING, Phase.CLEARING, *_INSIDE}
