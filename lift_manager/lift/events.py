"""What a step publishes: facts about one lift for faces, the journal and the log, as values."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import FloorName, Outcome
from lift_manager.lift.commands import CommandStatus
from lift_manager.lift.config import HoldLimit
from lift_manager.lift.refusals import how_to_acknowledge, how_to_release
from lift_manager.lift.session import Advice, EndReason, Holder


@unique
class RestrictionKind(StrEnum):
    """How a person keeps robots off a lift."""

    LOCKOUT = "lockout"
    """No robot commands the lift; a session that goes on ends."""
    DRAIN = "drain"
    """No new session begins; the present one continues to its end."""


@dataclass(frozen=True, slots=True)
class Restriction:
    """A person keeps robots off a lift until a person ends that, over restarts too."""

    kind: RestrictionKind
    by: str
    reason: str
    since: datetime


@unique
class Cause(StrEnum):
    """What a person acknowledges."""

    FIRE = "fire"
    OCCUPIED = "occupied"
    """The person has looked, and no robot is in the car."""
    CONTRADICTION = "contradiction"
    """The person has checked the wiring and the map: the signals of the lift may be trusted."""


@dataclass(frozen=True, slots=True)
class SessionOpened:
    """A caller holds the lift now."""

    lift: str
    holder: Holder
    floor: FloorName | None


@dataclass(frozen=True, slots=True)
class SessionRestored:
    """A caller still holds the lift after a restart of the manager."""

    lift: str
    holder: Holder
    floor: FloorName | None
    text: str
    """What it was restored with."""


@dataclass(frozen=True, slots=True)
class HandedOver:
    """The session continues with another holder."""

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
    """The robot's best course; None where the holder ended it."""


@dataclass(frozen=True, slots=True)
class Advised:
    """The robot of a session is informed before anything is released: there is a fire."""

    lift: str
    holder: Holder
    advice: Advice
    text: str


@dataclass(frozen=True, slots=True)
class RestrictionBegun:
    """A person keeps robots off the lift."""

    lift: str
    restriction: Restriction


@dataclass(frozen=True, slots=True)
class RestrictionEnded:
    """A person lets robots on the lift again."""

    lift: str
    by: str
    at: datetime
    restriction: Restriction


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """A person has checked the lift."""

    lift: str
    by: str
    at: datetime
    causes: tuple[Cause, ...]


@dataclass(frozen=True, slots=True)
class ForceReleased:
    """A person has ended a session."""

    lift: str
    by: str
    at: datetime
    reason: str
    holder: Holder
    """Whose session it was."""
    maybe_aboard: bool
    """Its robot may be in the car: others are refused until a person has looked."""
    clear_s: float = 0.0
    """In how many seconds the door is released: a robot may be in the doorway."""

    @property
    def text(self) -> str:
        """The reply to the person."""
        done = f"the session of {self.holder} on {self.lift} is over; everything is released, and the car is not moved"
        if self.clear_s:
            done = (
                f"{self.lift} no longer invites the robot of {self.holder}; its door is released in {self.clear_s:g} s, when the"
                " session ends, and the car is not moved"
            )
        if not self.maybe_aboard:
            return done
        return (
            f"{done}. A robot of {self.holder} may be in the car: others are refused until {self.holder} sends another request or a"
            f" person has looked: {how_to_acknowledge(self.lift)}"
        )


@dataclass(frozen=True, slots=True)
class CommandEnded:
    """A press has its outcome."""

    lift: str
    outcome: Outcome
    holder: Holder | None = None
    """For whom it was given; None after their session."""


@dataclass(frozen=True, slots=True)
class CommandFollowed:
    """A command within a session was taken, or has ended."""

    lift: str
    status: CommandStatus
    is_recorded: bool
    """The journal has a row of it."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something that a person should know."""

    lift: str
    text: str
    holder: Holder | None = None
    """Whose session it concerns."""


Event = (
    SessionOpened
    | SessionRestored
    | SessionEnded
    | HandedOver
    | Advised
    | RestrictionBegun
    | RestrictionEnded
    | Acknowledged
    | ForceReleased
    | CommandEnded
    | CommandFollowed
    | Alarm
)


# -- the texts of alarms


def fire_text(*, control: bool) -> str:
    """Return the alarm of a fire; of a lift that is only watched nothing is ever held."""
    done = "everything is released, robots are refused" if control else "this lift is only watched; robots are refused"
    return f"fire: {done} until a person has checked the lift"


def stopping_text(holder: Holder) -> str:
    """Return the alarm of a manager that stops while a robot may be in the car."""
    return (
        f"stopping: the manager ends while a robot of {holder} may be in the car; everything is released, and the session is"
        " kept: it continues at the next start"
    )


def abandoned_text(holder: Holder, reason: str) -> str:
    """Return the alarm of a session that ended with its robot aboard."""
    return (
        f"aboard_abandoned: the session of {holder} is over with its robot aboard ({reason});"
        " everything is released, and the lift gets no report that the robot left"
    )


def maybe_occupied_text(lift: str, holder: Holder, reason: str) -> str:
    """Return the alarm of a session that ended after its robot could have entered."""
    return (
        f"maybe_occupied: the session of {holder} is over ({reason}), and its robot may have entered the car; others are"
        f" refused until {holder} sends another request or a person has looked: {how_to_acknowledge(lift)}"
    )


def silent_text(lift: str, holder: Holder, caller: Holder, silent_s: float) -> str:
    """Return the alarm about a holder that is silent while another caller requests the lift."""
    return (
        f"silent_holder: {holder} holds the lift and has sent nothing for {silent_s:.0f} s, and {caller} requests it; if"
        f" {holder} no longer needs it, a person ends its session: {how_to_release(lift)}"
    )


def unclaimed_text(lift: str, where: str) -> str:
    """Return what a refusal adds if the holder of the lift was silent since a restart; `where` its robot may be."""
    return (
        f"it has sent nothing since a restart of the manager, and its robot may be in the {where}; if it no longer needs the lift, a"
        f" person ends its session: {how_to_release(lift)}"
    )


def hold_spent_text(holder: Holder, limit: HoldLimit) -> str:
    """Return the alarm of a door that was held for as long as its limit allows."""
    return f"the door was held for {limit.seconds:g} s, as long as {limit.set_by} allows; it is released, {holder} keeps the lift"
