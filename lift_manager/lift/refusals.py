"""Why a request is not taken: a stable code, a message that names the remedy, and what stands in the way as values."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from enum import StrEnum, unique

from lift_manager.lift.session import Holder
from register_maps.words import Mode


@unique
class Refusal(StrEnum):
    """Why a request was refused; stable codes for faces."""

    UNKNOWN_LIFT = "unknown_lift"
    UNKNOWN_FLOOR = "unknown_floor"
    HELD = "held"
    OFFLINE = "offline"
    MODE = "mode"
    FIRE_LATCHED = "fire_latched"
    LOCKED_OUT = "locked_out"
    OUTSIDE_HOURS = "outside_hours"
    MONITOR_ONLY = "monitor_only"
    NOT_POSSIBLE = "not_possible"
    OCCUPANCY_UNKNOWN = "occupancy_unknown"
    """A robot may be aboard: nobody has reported whether one is, or it is not the caller's."""
    STOPPING = "stopping"
    FIRE_ACTIVE = "fire_active"
    """A fire cannot be acknowledged while the lift still reports it."""
    NOTHING_TO_ACKNOWLEDGE = "nothing_to_acknowledge"
    NOT_LOCKED_OUT = "not_locked_out"
    DRAINING = "draining"
    """A drain: sessions end and no new one begins."""
    NOT_DRAINING = "not_draining"
    NOT_HELD = "not_held"
    """Nobody holds the lift, so there is no session to end or to hand over."""
    NOT_RECORDED = "not_recorded"
    """The action cannot be recorded, so nothing is pressed."""
    TOO_OFTEN = "too_often"
    """The caller changed its floor so often that people and the journal have to be protected."""
    QUEUED = "queued"
    """The lift is free, and others who waited for it come first."""
    NO_SUCH_SESSION = "no_such_session"
    """There is none of that id here; one that is over is remembered for a while."""
    SESSION_OVER = "session_over"
    """The session of that id is over; the message says why."""
    NO_SUCH_COMMAND = "no_such_command"
    UNKNOWN_RIDE = "unknown_ride"
    NOT_YOUR_RIDE = "not_your_ride"
    """Only the caller that began it, or an operator, may speak for it."""
    NOT_NOW = "not_now"
    """It makes no sense where the session is; the message says where that is."""
    TOO_MANY = "too_many"
    """More rides are under way than this manager keeps, of this caller or of all."""
    KEY_REUSED = "key_reused"
    """The idempotency key stands for another request of the same caller; the message says for which."""


@dataclass(frozen=True, slots=True)
class Blocking:
    """What stands in the way of a request, as values for programs; None for what does not."""

    holder: Holder | None = None
    mode: Mode | None = None
    since_s: float | None = None
    """For how long the holder has held the lift, or the mode has lasted."""
    age_s: float | None = None
    """How old the last whole reading of the lift is."""
    ahead: int | None = None
    """How many callers wait before."""


@dataclass(frozen=True, slots=True)
class Refused:
    """A request that is not taken, with the reason in words that name the allowed values."""

    code: Refusal
    message: str
    blocking: Blocking | None = None


@dataclass(frozen=True, slots=True)
class Accepted:
    """A request that is taken. Acceptance is not arrival."""


STOPPING = Refused(Refusal.STOPPING, "the manager is stopping")


def how_to_acknowledge(lift: str) -> str:
    """Return the command line with which a person acknowledges that a lift was checked."""
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
