"""What a caller may ask of a lift, and what it is told at once."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique

from drivers.model import FloorName
from lift_manager.domain.state import Holder


@unique
class RobotWord(StrEnum):
    """What a robot says about itself; faces that cannot say it leave it out."""

    IN_PLACE = "in_place"
    """It is in the car and may be taken along."""
    LEFT = "left"
    """It is out of the car and clear of the door."""


@dataclass(frozen=True, slots=True)
class Ask:
    """A request for one lift."""

    lift: str
    holder: Holder
    floor: FloorName
    hold_door: bool
    """Hold the door open at `floor`; otherwise the session ends on arrival."""
    robot: RobotWord | None = None


@unique
class Refusal(StrEnum):
    """Why a request was refused; stable codes for faces."""

    UNKNOWN_LIFT = "unknown_lift"
    UNKNOWN_FLOOR = "unknown_floor"
    HELD = "held"
    OFFLINE = "offline"
    MODE = "mode"
    FIRE_LATCHED = "fire_latched"
    MONITOR_ONLY = "monitor_only"
    NOT_POSSIBLE = "not_possible"
    OCCUPANCY_UNKNOWN = "occupancy_unknown"
    """Whether a robot is aboard decides what is pressed, and nobody has said it."""
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Refused:
    """The answer no, with the reason in words that name the allowed values."""

    code: Refusal
    message: str


@dataclass(frozen=True, slots=True)
class Accepted:
    """The answer yes: the wish is noted. Acceptance is not arrival."""
