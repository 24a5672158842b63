"""What the manager publishes about one lift."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, unique

from drivers.model import FloorName
from register_maps.words import Door, Mode, Motion, Side


@unique
class Quality(StrEnum):
    """Whether the state may be acted on."""

    LIVE = "live"
    OFFLINE = "offline"
    """No reading younger than `max_age_s`: floor, door and motion are not known."""


@unique
class RobotDoor(StrEnum):
    """The one door word for robots: OPEN is an invitation to drive."""

    CLOSED = "closed"
    MOVING = "moving"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class Holder:
    """Who holds a lift: the face it came through and the caller's name there."""

    face: str
    name: str

    def __str__(self) -> str:
        return self.name if self.face == self.name else f"{self.face}:{self.name}"


@dataclass(frozen=True, slots=True)
class Restrictions:
    """What keeps robots off a lift, or lets them wait, beside what the lift itself says."""

    fire_latched: bool = False
    """There was a fire, and no person has acknowledged it."""
    lockout: str = ""
    """Who locked the lift out, since when and why; empty when nobody did."""
    drain: str = ""
    """Who lets sessions end and no new one begin, since when and why; empty when nobody does."""
    maybe_aboard: Holder | None = None
    """Whose robot may be in the car; others are refused while it holds no session."""
    distrusted: str = ""
    """Which of its signals contradicted each other, and what ends that; no door counts as open meanwhile. Empty where none did."""
    waiting_for: str = ""
    """What the session waits for before anything is pressed; empty when it does not."""


PERMISSIONS = ("may_enter", "may_leave", "robot_mode_on", "robots_allowed", "ready")
"""Flags of a lift that say what a robot may do."""


@dataclass(frozen=True, slots=True)
class LiftState:
    """One lift at one moment, as every face shows it."""

    lift: str
    floors: tuple[FloorName, ...]
    quality: Quality
    reason: str
    """Why it is offline; empty while live."""
    age_s: float | None
    """Age of the last whole reading; None when there never was one."""
    floor: FloorName | None
    """The floor the car stands at or passes; None when nobody reports it. Never the destination before arrival."""
    standing: bool
    """By the map's evidence the car stands at `floor`."""
    destination: FloorName | None
    """The session's floor, else the current floor."""
    robot_door: RobotDoor
    doors: Mapping[Side, Door]
    motion: Motion
    mode: Mode
    holder: Holder | None
    held_since_s: float | None
    """Seconds since the session began."""
    not_visible: Mapping[str, str]
    """Safety signals this lift's interface does not show, with the reason."""
    restrictions: Restrictions = Restrictions()
    permissions: Mapping[str, bool] = field(default_factory=dict)
    """What the lift itself says of robots: those of `PERMISSIONS` that it tells."""
    waiting: int = 0
    """How many rides and faces wait for the lift."""
    ending: bool = False
    """The session is over in a moment, until which door and robot mode stay: its holder ended it, a person did, or the manager stops."""
    releases_in_s: float | None = None
    """Seconds until the manager releases the door by itself at the earliest, as far as it knows; None while nobody holds the lift."""
    releases_at: float | None = None
    """The same as monotonic seconds of the event loop, which only a renewal moves."""
