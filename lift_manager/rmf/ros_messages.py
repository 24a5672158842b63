"""Converts the two messages of rmf_lift_msgs between ROS and the adapter."""

from __future__ import annotations

from rmf_lift_msgs.msg import LiftRequest as RosLiftRequest
from rmf_lift_msgs.msg import LiftState as RosLiftState

from lift_manager.rmf.messages import LiftRequest, LiftState, Time


def request_of(message: RosLiftRequest) -> LiftRequest:
    """Convert a request from ROS, with any content."""
    return LiftRequest(
        lift_name=message.lift_name,
        request_time=Time(message.request_time.sec, message.request_time.nanosec),
        session_id=message.session_id,
        request_type=message.request_type,
        destination_floor=message.destination_floor,
        door_state=message.door_state,
    )


def state_of(message: RosLiftState) -> LiftState:
    """Convert a state from ROS."""
    return LiftState(
        lift_time=Time(message.lift_time.sec, message.lift_time.nanosec),
        lift_name=message.lift_name,
        available_floors=tuple(message.available_floors),
        current_floor=message.current_floor,
        destination_floor=message.destination_floor,
        door_state=message.door_state,
        motion_state=message.motion_state,
        available_modes=tuple(message.available_modes),
        current_mode=message.current_mode,
        session_id=message.session_id,
    )


def message_of(state: LiftState) -> RosLiftState:
    """Convert a state to ROS."""
    message = RosLiftState(
        lift_name=state.lift_name,
        available_floors=list(state.available_floors),
        current_floor=state.current_floor,
        destination_floor=state.destination_floor,
        door_state=state.door_state,
        motion_state=state.motion_state,
        available_modes=list(state.available_modes),
        current_mode=state.current_mode,
        session_id=state.session_id,
    )
    message.lift_time.sec = state.lift_time.sec
    message.lift_time.nanosec = state.lift_time.nanosec
    return message
