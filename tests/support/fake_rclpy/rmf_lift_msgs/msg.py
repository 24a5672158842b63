"""Fields and constants in the order of the .msg text, which is the same on every distribution (open-rmf 1.1)."""

import array
from collections.abc import Mapping
from typing import Any, ClassVar

from builtin_interfaces.msg import Time
from ros_messages import Message


class LiftRequest(Message):
    FIELDS: ClassVar[Mapping[str, Any]] = {
        "lift_name": "string",
        "request_time": Time,
        "session_id": "string",
        "request_type": "uint8",
        "destination_floor": "string",
        "door_state": "uint8",
    }
    REQUEST_END_SESSION = 0
    REQUEST_AGV_MODE = 1
    REQUEST_HUMAN_MODE = 2
    DOOR_CLOSED = 0
    DOOR_OPEN = 2
    lift_name: str
    request_time: Time
    session_id: str
    request_type: int
    destination_floor: str
    door_state: int


class LiftState(Message):
    FIELDS: ClassVar[Mapping[str, Any]] = {
        "lift_time": Time,
        "lift_name": "string",
        "available_floors": "string[]",
        "current_floor": "string",
        "destination_floor": "string",
        "door_state": "uint8",
        "motion_state": "uint8",
        "available_modes": "uint8[]",
        "current_mode": "uint8",
        "session_id": "string",
    }
    DOOR_CLOSED = 0
    DOOR_MOVING = 1
    DOOR_OPEN = 2
    MOTION_STOPPED = 0
    MOTION_UP = 1
    MOTION_DOWN = 2
    MOTION_UNKNOWN = 3
    MODE_UNKNOWN = 0
    MODE_HUMAN = 1
    MODE_AGV = 2
    MODE_FIRE = 3
    MODE_OFFLINE = 4
    MODE_EMERGENCY = 5
    lift_time: Time
    lift_name: str
    available_floors: list[str]
    current_floor: str
    destination_floor: str
    door_state: int
    motion_state: int
    available_modes: "array.array[int]"
    current_mode: int
    session_id: str
