"""What the holder of a session of /api/v1 may ask for, and what became of it. Pure values."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import FloorName, Proof
from lift_manager.domain.asking import RobotWord
from lift_manager.domain.boarding import Who
from lift_manager.domain.service import Advice, EndReason
from lift_manager.domain.state import Holder
from register_maps.words import Side


@dataclass(frozen=True, slots=True)
class OpenSession:
    """A caller wants the lift for itself. The session goes on until it is closed or its time is over: arrival does not end it."""

    lift: str
    holder: Holder
    key: str = ""
    """Idempotency key: the same one of the same holder gives the same session, as long as that is remembered; empty for none."""
    ttl_s: float | None = None
    """The lease it asks for; the site's is the longest, and what is given where it asks for none."""


@dataclass(frozen=True, slots=True)
class SessionOver:
    """Why a session is over."""

    reason: EndReason
    text: str
    """The reason in words."""
    advice: Advice | None
    """What its robot does best; None where the holder ended it."""
    at: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionInfo:
    """A session as its holder sees it."""

    id: str
    """Not to be guessed, and told to nobody but the holder."""
    lift: str
    holder: Holder
    floor: FloorName | None
    """Where the car is wanted; None before the first floor was asked for."""
    hold_door: bool
    opened_at: datetime
    lease_ends_in_s: float | None
    """None for faces without a lease, and for one that is over."""
    ends_in_s: float | None
    """Until the session is over however often it is renewed (`max_session_s`); None for one that is over."""
    hold_ends_in_s: float | None
    """Until the door is let go whatever the holder wants; None while it is not held."""
    releases_in_s: float | None = None
    """Until the manager releases the door by itself at the earliest, as far as it knows; None for one that is over."""
    releasing: bool = False
    """That is so soon that the door invites nobody any more."""
    arrived: bool
    """The car is there for it."""
    door_held: bool
    robot: Who
    """Where its robot is, as far as that is known."""
    waiting_for: str
    """What it waits for before anything is pressed; empty when it does not."""
    restored: bool
    """It is from before a restart, and waits to hear its holder."""
    over: SessionOver | None = None
    """None while it goes on."""


@dataclass(frozen=True, slots=True)
class SessionBegun:
    """The answer yes to `OpenSession`."""

    session: SessionInfo
    anew: bool
    """False where the idempotency key gave one that was there already."""


@unique
class Do(StrEnum):
    """What may be asked within a session."""

    GO_TO = "go_to"
    """Bring the car to a floor: the empty car to the robot, or the robot along."""
    HOLD_DOOR = "hold_door"
    """Hold the door open at the session's floor, or once the car is there; bounded by the site."""
    LET_GO_DOOR = "let_go_door"
    CLOSE_DOOR = "close_door"
    """Press the close button. Its word is that nothing stands in the doorway; refused while a robot may be there."""
    ROBOT_IN_PLACE = "robot_in_place"
    ROBOT_LEFT = "robot_left"


WORDS = {Do.ROBOT_IN_PLACE: RobotWord.IN_PLACE, Do.ROBOT_LEFT: RobotWord.LEFT}
"""What a robot says about itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionRequest:
    """One thing asked for within a session."""

    lift: str
    session: str
    """Its id."""
    holder: Holder
    do: Do
    floor: FloorName | None = None
    """With `go_to`, and only there."""
    hold_door: bool = True
    """With `go_to`: hold the door once the car is there."""
    side: Side | None = None
    """With `close_door`: one door; all doors of the floor where it is None."""
    key: str = ""
    """Idempotency key: the same one of the same session gives the same outcome; empty for none."""


@unique
class Status(StrEnum):
    """Where a request within a session is. Acknowledged is not done."""

    PENDING = "pending"
    CONFIRMED = "confirmed"
    """The lift shows that it has taken it; for `go_to` that it has the call or the car is there, which is not arrival."""
    REJECTED = "rejected"
    """It was not carried out: nothing was sent, the controller said no, or another request took its place before it was pressed."""
    UNCONFIRMED = "unconfirmed"
    """It was sent, or may have been, and nothing shows that it took effect."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """A request within a session, and what has become of it."""

    id: str
    lift: str
    holder: Holder
    do: Do
    floor: FloorName | None
    status: Status
    reason: str
    """Why it was rejected or is unconfirmed; while pending, what it waits for; empty otherwise."""
    proof: Proof
    """What confirmed it; `none` where the lift need not be told, because its map has no signal for it or it is so already."""
    asked_at: datetime
    ended_at: datetime | None
