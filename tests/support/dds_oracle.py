"""The messages of RMF by somebody else's hand: rosbags, given the field lists of the .msg files.

Fields of rmf_lift_msgs as on humble, iron, jazzy, kilted and main, where the files are the same (open-rmf 1.1); of
rmf_fleet_msgs as on kilted and main.
"""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from lift_manager.rmf.messages import LiftRequest, LiftState

LIFT_REQUEST, LIFT_STATE = "rmf_lift_msgs/msg/LiftRequest", "rmf_lift_msgs/msg/LiftState"
EMERGENCY_SIGNAL = "rmf_fleet_msgs/msg/EmergencySignal"
TIME, BOOL, CLOCK = "builtin_interfaces/msg/Time", "std_msgs/msg/Bool", "rosgraph_msgs/msg/Clock"

TEXTS = {
    LIFT_REQUEST: """
        string lift_name
        builtin_interfaces/Time request_time
        string session_id
        uint8 request_type
        uint8 REQUEST_END_SESSION=0
        uint8 REQUEST_AGV_MODE=1
        uint8 REQUEST_HUMAN_MODE=2
        string destination_floor
        uint8 door_state
        uint8 DOOR_CLOSED=0
        uint8 DOOR_OPEN=2
    """,
    LIFT_STATE: """
        builtin_interfaces/Time lift_time
        string lift_name
        string[] available_floors
        string current_floor
        string destination_floor
        uint8 door_state
        uint8 DOOR_CLOSED=0
        uint8 DOOR_MOVING=1
        uint8 DOOR_OPEN=2
        uint8 motion_state
        uint8 MOTION_STOPPED=0
        uint8 MOTION_UP=1
        uint8 MOTION_DOWN=2
        uint8 MOTION_UNKNOWN=3
        uint8[] available_modes
        uint8 current_mode
        uint8 MODE_UNKNOWN=0
        uint8 MODE_HUMAN=1
        uint8 MODE_AGV=2
        uint8 MODE_FIRE=3
        uint8 MODE_OFFLINE=4
        uint8 MODE_EMERGENCY=5
        string session_id
    """,
    EMERGENCY_SIGNAL: """
        string[] fleet_names
        bool is_emergency
    """,
}


@cache
def _types() -> Any:
    """The types of ROS and those above, read once in a process."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in TEXTS.items():
        lines = "\n".join(line.strip() for line in text.strip().splitlines())
        store.register(get_types_from_msg(lines, name))
    return store


class Oracle:
    """Encodes, decodes and hashes as ROS 2 does."""

    @property
    def _store(self) -> Any:
        return _types()

    def hash_of(self, name: str) -> str:
        return str(self._store.hash_rihs01(name))

    def constants_of(self, name: str) -> dict[str, int]:
        return {constant: value for constant, _, value in self._store.fielddefs[name][0]}

    def fields_of(self, name: str) -> list[str]:
        return [field for field, _ in self._store.fielddefs[name][1]]

    def request(self, request: LiftRequest) -> bytes:
        return self.encoded(
            LIFT_REQUEST,
            request.lift_name,
            self._time(request.request_time),
            request.session_id,
            request.request_type,
            request.destination_floor,
            request.door_state,
        )

    def state(self, state: LiftState) -> bytes:
        return self.encoded(
            LIFT_STATE,
            self._time(state.lift_time),
            state.lift_name,
            list(state.available_floors),
            state.current_floor,
            state.destination_floor,
            state.door_state,
            state.motion_state,
            self._octets(state.available_modes),
            state.current_mode,
            state.session_id,
        )

    def encoded(self, name: str, *fields: object) -> bytes:
        return bytes(self._store.serialize_cdr(self._store.types[name](*fields), name))

    def decoded(self, name: str, data: bytes) -> Any:
        return self._store.deserialize_cdr(data, name)

    def clock(self, sec: int, nanosec: int) -> bytes:
        return self.encoded(CLOCK, self._store.types[TIME](sec, nanosec))

    def _time(self, time: Any) -> Any:
        return self._store.types[TIME](time.sec, time.nanosec)

    def _octets(self, numbers: tuple[int, ...]) -> Any:
        import numpy as np

        return np.array(numbers, dtype=np.uint8)
