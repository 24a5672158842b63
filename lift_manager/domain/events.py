"""What the bus carries: facts about lifts, as values."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.model import Outcome
from lift_manager.domain.ride import Phase, Ride
from lift_manager.domain.service import (
    Acknowledged,
    Advice,
    Drain,
    DrainEnded,
    EndReason,
    ForceReleased,
    Lockout,
    LockoutEnded,
)
from lift_manager.domain.session_requests import Followed
from lift_manager.domain.state import Holder, LiftState


@dataclass(frozen=True, slots=True)
class StateChanged:
    """What a lift publishes has changed in more than its age."""

    lift: str
    state: LiftState


@dataclass(frozen=True, slots=True)
class SessionOpened:
    """A caller holds the lift now."""

    lift: str
    holder: Holder
    floor: str


@dataclass(frozen=True, slots=True)
class SessionRestored:
    """A caller holds the lift from before a restart of the manager."""

    lift: str
    holder: Holder
    floor: str
    text: str
    """What it was restored with."""


@dataclass(frozen=True, slots=True)
class HandedOver:
    """The session goes on with another holder."""

    lift: str
    holder: Holder
    to: Holder


@dataclass(frozen=True, slots=True)
class SessionEnded:
    """The lift is free; the car is not moved by it."""

    lift: str
    holder: Holder
    reason: EndReason
    text: str
    """The reason in words."""
    advice: Advice | None
    """What its robot does best; None where the holder ended it."""


@dataclass(frozen=True, slots=True)
class Advised:
    """The robot of a session is told what to do before anything is let go: there is a fire."""

    lift: str
    holder: Holder
    advice: Advice
    text: str


@dataclass(frozen=True, slots=True)
class LockedOut:
    """A person keeps robots off the lift."""

    lift: str
    lockout: Lockout


@dataclass(frozen=True, slots=True)
class LockoutOver:
    """A person lets robots on the lift again."""

    lift: str
    ended: LockoutEnded


@dataclass(frozen=True, slots=True)
class DrainBegun:
    """A person lets sessions on the lift end and no new one begin."""

    lift: str
    drain: Drain


@dataclass(frozen=True, slots=True)
class DrainOver:
    """A person lets sessions begin again."""

    lift: str
    ended: DrainEnded


@dataclass(frozen=True, slots=True)
class PersonAcknowledged:
    """A person has checked the lift."""

    lift: str
    acknowledged: Acknowledged


@dataclass(frozen=True, slots=True)
class ReleasedByPerson:
    """A person took the lift from its holder."""

    lift: str
    released: ForceReleased


@dataclass(frozen=True, slots=True)
class CommandEnded:
    """A command has its outcome."""

    lift: str
    outcome: Outcome
    holder: Holder | None = None
    """For whom it was given; None after their session."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something a person should know of."""

    lift: str
    text: str
    holder: Holder | None = None
    """Whose session it concerns."""


@dataclass(frozen=True, slots=True)
class RequestFollowed:
    """A request within a session was taken, or has ended."""

    lift: str
    followed: Followed


@dataclass(frozen=True, slots=True)
class RideChanged:
    """A ride has begun, changed in more than the passing of time, or ended."""

    lift: str
    """The lift that it is on now."""
    ride: Ride
    before: Phase | None = None
    """Its phase before; None for one that has just begun."""


Event = (
    StateChanged
    | SessionOpened
    | SessionRestored
    | HandedOver
    | SessionEnded
    | Advised
    | LockedOut
    | LockoutOver
    | DrainBegun
    | DrainOver
    | PersonAcknowledged
    | ReleasedByPerson
    | CommandEnded
    | Alarm
    | RequestFollowed
    | RideChanged
)


@dataclass(frozen=True, slots=True)
class Occurrence:
    """An event as it was published."""

    id: str
    """`<boot>-<number>`: the number rises by one with each event of one process, the boot tells processes apart. The same in log,
    journal and event stream."""
    at: float
    """Monotonic seconds of the event loop."""
    event: Event
