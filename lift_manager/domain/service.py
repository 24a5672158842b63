"""What people say about a lift, what outlives the manager, and what robots are told when people come first. Pure."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum, unique
from typing import TYPE_CHECKING

from lift_manager.domain.contradictions import Trust
from lift_manager.domain.session import KeptSession
from lift_manager.domain.state import Holder
from register_maps.words import Door, Side

if TYPE_CHECKING:
    # a ride that is kept has an advice, which is of this module
    from lift_manager.domain.ride_record import KeptRide


@unique
class EndReason(StrEnum):
    """Why a session is over; stable codes for faces."""

    RELEASED = "released"
    ARRIVED = "arrived"
    """It wanted no more than to get there."""
    LEASE = "lease"
    NOT_GRANTED = "not_granted"
    """The lift did not grant what the call needs, such as robot mode."""
    MODE = "mode"
    FIRE = "fire"
    LOCKOUT = "lockout"
    STOPPING = "stopping"
    """The manager ends. The session is taken up again when it starts, if its time is not over by then."""
    FORCED = "forced"
    """A person ended it."""
    TAKEN_OVER = "taken_over"
    """Its holder was silent for as long as the site allows, and another asked."""
    MAX_SESSION = "max_session"
    """It lasted for as long as the site allows."""
    UNCLAIMED = "unclaimed"
    """It is from before a restart, and another caller was heard first."""
    NOT_RESTORED = "not_restored"
    """It is from before a restart, and the site file no longer has what it needs."""


ITS_OWN_WORD = frozenset({EndReason.RELEASED, EndReason.ARRIVED})
"""The holder wanted it so, and needs no advice."""


@unique
class Advice(StrEnum):
    """What a robot does best when the lift is taken from it."""

    CLEAR_DOORWAY = "clear_doorway"
    """Keep out of the doorway: leave it by the nearer side, and do not enter it."""
    STAY_ABOARD = "stay_aboard"
    """The door is shut: a robot inside stays where it is, and says so to its people."""


def advise(doors: Mapping[Side, Door] | None, *, may_be_aboard: bool) -> Advice:
    """Return what to tell the robot of a session. `doors` is None while nobody knows them.

    Behind a door that is not seen to be shut the doorway decides, for that is where a robot is hurt and where it keeps people
    in. A robot that cannot be inside has nothing to do but keep out.
    """
    shut = bool(doors) and doors is not None and all(door is Door.CLOSED for door in doors.values())
    return Advice.STAY_ABOARD if shut and may_be_aboard else Advice.CLEAR_DOORWAY


def how_to_acknowledge(lift: str) -> str:
    """Return the command line with which a person says that a lift was checked."""
    return f"`lift-manager ack {shlex.quote(lift)} --by NAME`"


def how_to_end_lockout(lift: str) -> str:
    """Return the command line with which a person ends a lockout."""
    return f"`lift-manager lockout {shlex.quote(lift)} --by NAME --end`"


def how_to_end_drain(lift: str) -> str:
    """Return the command line with which a person ends a drain."""
    return f"`lift-manager drain {shlex.quote(lift)} --by NAME --end`"


def how_to_release(lift: str) -> str:
    """Return the command line with which a person takes a lift from its holder."""
    return f"`lift-manager release {shlex.quote(lift)} --by NAME --reason TEXT`"


def silent_text(lift: str, holder: Holder, asker: Holder, silent_s: float) -> str:
    """Return the alarm of a holder that is not heard of while another waits for the lift."""
    return (
        f"silent_holder: {holder} holds the lift and has not been heard for {silent_s:.0f} s, and {asker} asks for it; if"
        f" {holder} needs it no more, a person ends its session: {how_to_release(lift)}"
    )


def unclaimed_text(lift: str) -> str:
    """Return what is told with the refusal of a lift whose holder was not heard since a restart."""
    return (
        "it was not heard since a restart of the manager, and its robot may be in the car; if it needs the lift no more, a"
        f" person ends its session: {how_to_release(lift)}"
    )


STOPPING_TEXT = "the manager is stopping; the session is kept and goes on at the next start"


def stopping_text(holder: Holder) -> str:
    """Return the alarm of a manager that ends while a robot may be in the car."""
    return (
        f"stopping: the manager ends while a robot of {holder} may be in the car; everything is let go, and the session is"
        " kept: it goes on at the next start"
    )


def abandoned_text(holder: Holder, reason: str) -> str:
    """Return the alarm of a session that ended with its robot aboard."""
    return (
        f"aboard_abandoned: the session of {holder} is over with its robot aboard ({reason});"
        " everything is let go, and the lift is not told that the robot left"
    )


def maybe_occupied_text(lift: str, holder: Holder, reason: str) -> str:
    """Return the alarm of a session that ended after its robot could have entered."""
    return (
        f"maybe_occupied: the session of {holder} is over ({reason}), and its robot may have entered the car; others are"
        f" refused until {holder} asks again or a person has looked: {how_to_acknowledge(lift)}"
    )


@dataclass(frozen=True, slots=True)
class Lockout:
    """A person's word that no robot may command a lift."""

    by: str
    reason: str
    since: datetime


@dataclass(frozen=True, slots=True)
class LockoutEnded:
    """A person's word that robots may command it again."""

    by: str
    at: datetime
    lockout: Lockout


@dataclass(frozen=True, slots=True)
class Drain:
    """A person's request that no new session begins, while the present one goes on to its end."""

    by: str
    reason: str
    since: datetime


@dataclass(frozen=True, slots=True)
class DrainEnded:
    """A person's request that sessions may begin again."""

    by: str
    at: datetime
    drain: Drain


@dataclass(frozen=True, slots=True)
class Occupied:
    """A robot may be in the car, and its session is over or may end with this process."""

    holder: Holder
    aboard: bool
    """It was said to be aboard, or inferred; otherwise it was merely possible."""
    since: datetime


@dataclass(frozen=True, slots=True)
class ForceReleased:
    """A person's word that a session is over."""

    by: str
    at: datetime
    reason: str
    holder: Holder
    """Whose session it was."""
    maybe_aboard: bool
    """Its robot may be in the car: others are refused until a person has looked."""
    clear_s: float = 0.0
    """In how many seconds the door is released: a robot may be in the doorway."""

    def text(self, lift: str) -> str:
        """Return what the person is told."""
        done = f"the session of {self.holder} on {lift} is over; everything is let go, and the car is not moved"
        if self.clear_s:
            done = (
                f"{lift} no longer invites the robot of {self.holder}; its door is released in {self.clear_s:g} s, when the session"
                " ends, and the car is not moved"
            )
        if not self.maybe_aboard:
            return done
        return (
            f"{done}. A robot of {self.holder} may be in the car: others are refused until {self.holder} asks again or a"
            f" person has looked: {how_to_acknowledge(lift)}"
        )


@unique
class Cause(StrEnum):
    """What a person acknowledges."""

    FIRE = "fire"
    OCCUPIED = "occupied"
    """The person has looked, and no robot is in the car."""
    CONTRADICTION = "contradiction"
    """The person has checked the wiring and the map: the signals of the lift may be trusted."""


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """A person's word that the lift was checked."""

    by: str
    at: datetime
    what: tuple[Cause, ...]


@dataclass(frozen=True, slots=True)
class Remembered:
    """What of one lift outlives the manager."""

    fire_since: datetime | None = None
    """When the fire was seen that nobody has acknowledged."""
    lockout: Lockout | None = None
    drain: Drain | None = None
    occupied: Occupied | None = None
    left_untold: datetime | None = None
    """Since when the lift has not taken the word that a robot left; None where it is owed none."""
    robot_mode_until: datetime | None = None
    """Until when robot mode is kept at the most although its session is over; None where it is not."""
    acknowledged: Acknowledged | None = None
    """The newest one."""
    session: KeptSession | None = None
    """Who holds the lift."""
    rides: tuple[KeptRide, ...] = ()
    """Rides on it that go on, and those of the last hour that may still be asked for; the oldest first."""

    trust: Trust = field(default_factory=Trust)
    """What its readings have proved, and what they contradicted."""

    @property
    def keeps_robots_out(self) -> bool:
        """Whether some robot is refused, or not let through the door, because of it."""
        reasons = (self.fire_since, self.lockout, self.drain, self.occupied)
        return any(reason is not None for reason in reasons) or bool(self.trust.distrust)
