"""The two messages of rmf_lift_msgs, with the numbers of their .msg text (the same on humble, iron, jazzy, kilted and rolling)."""

from __future__ import annotations

from dataclasses import dataclass

END_SESSION, AGV_MODE, HUMAN_MODE = 0, 1, 2
"""LiftRequest.request_type. Not the numbers of LiftState.current_mode."""
REQUEST_TYPES = (END_SESSION, AGV_MODE, HUMAN_MODE)

DOOR_CLOSED, DOOR_MOVING, DOOR_OPEN = 0, 1, 2
"""LiftState.door_state; a LiftRequest never has 1."""
REQUEST_DOORS = (DOOR_CLOSED, DOOR_OPEN)

MOTION_STOPPED, MOTION_UP, MOTION_DOWN, MOTION_UNKNOWN = 0, 1, 2, 3
"""LiftState.motion_state."""

MODE_UNKNOWN, MODE_HUMAN, MODE_AGV, MODE_FIRE, MODE_OFFLINE, MODE_EMERGENCY = 0, 1, 2, 3, 4, 5
"""LiftState.current_mode and available_modes."""

_NS = 1_000_000_000


@dataclass(frozen=True)
class Time:
    """builtin_interfaces/Time."""

    sec: int = 0
    nanosec: int = 0

    @classmethod
    def of(cls, seconds: float) -> Time:
        """Convert to the nanosecond. Times that the message cannot hold (before 1970, after 2038) are clamped."""
        whole = max(0, min(round(seconds * _NS), (2**31 - 1) * _NS))
        return cls(whole // _NS, whole % _NS)


@dataclass(frozen=True)
class LiftRequest:
    """rmf_lift_msgs/LiftRequest, fields in the order of the wire."""

    lift_name: str
    request_time: Time
    session_id: str
    request_type: int
    destination_floor: str
    door_state: int


@dataclass(frozen=True)
class LiftState:
    """rmf_lift_msgs/LiftState, fields in the order of the wire."""

    lift_time: Time
    lift_name: str
    available_floors: tuple[str, ...]
    current_floor: str
    destination_floor: str
    door_state: int
    motion_state: int
    available_modes: tuple[int, ...]
    current_mode: int
    session_id: str
