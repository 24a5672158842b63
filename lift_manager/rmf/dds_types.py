"""The messages for Cyclone DDS, with the names, field order and type hashes of ROS 2 (open-rmf 5.1 to 5.3).

Structs are @final and encoded as XCDR1, the only form that every ROS 2 can read. Annotations are evaluated when a class is
created, hence no `from __future__`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import cdrv0, final
from cyclonedds.idl.types import int32, sequence, uint8, uint32

from lift_manager.rmf.messages import LiftRequest, LiftState, Time

Strings = Annotated[Sequence[str], sequence(str)]
Octets = Annotated[Sequence[int], sequence(uint8)]


@dataclass
@final
@cdrv0
class WireTime(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
@final
@cdrv0
class WireLiftRequest(IdlStruct, typename="rmf_lift_msgs::msg::dds_::LiftRequest_"):
    lift_name: str
    request_time: WireTime
    session_id: str
    request_type: uint8
    destination_floor: str
    door_state: uint8


@dataclass
@final
@cdrv0
class WireLiftState(IdlStruct, typename="rmf_lift_msgs::msg::dds_::LiftState_"):
    lift_time: WireTime
    lift_name: str
    available_floors: Strings
    current_floor: str
    destination_floor: str
    door_state: uint8
    motion_state: uint8
    available_modes: Octets
    current_mode: uint8
    session_id: str


@dataclass
@final
@cdrv0
class WireBool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool


@dataclass
@final
@cdrv0
class WireEmergencySignal(IdlStruct, typename="rmf_fleet_msgs::msg::dds_::EmergencySignal_"):
    fleet_names: Strings
    is_emergency: bool


@dataclass
@final
@cdrv0
class WireClock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: WireTime


TYPE_HASHES: dict[type[IdlStruct], str] = {
    WireTime: "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    WireLiftRequest: "RIHS01_e8f1e0aa4d172703d0d7840c1876448c6c5d75ab58955faf7de7dddc17c096ac",
    WireLiftState: "RIHS01_ce0553cd08eeeb321bdae554efdb6d2ebb2be9755df2e34895cbef55b51f4c06",
    WireBool: "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    WireEmergencySignal: "RIHS01_2bcead0701ac71c292f12ba705ad9164b796b2660ae48cbf74204515fe5156e0",
    WireClock: "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
}
"""Published to ROS in USER_DATA. Advisory: a wrong hash causes a warning in its log, never a refusal."""


def request_of(wire: WireLiftRequest) -> LiftRequest:
    return LiftRequest(
        lift_name=wire.lift_name,
        request_time=_time_of(wire.request_time),
        session_id=wire.session_id,
        request_type=wire.request_type,
        destination_floor=wire.destination_floor,
        door_state=wire.door_state,
    )


def wire_request(request: LiftRequest) -> WireLiftRequest:
    return WireLiftRequest(
        lift_name=request.lift_name,
        request_time=_wire_time(request.request_time),
        session_id=request.session_id,
        request_type=request.request_type,
        destination_floor=request.destination_floor,
        door_state=request.door_state,
    )


def state_of(wire: WireLiftState) -> LiftState:
    return LiftState(
        lift_time=_time_of(wire.lift_time),
        lift_name=wire.lift_name,
        available_floors=tuple(wire.available_floors),
        current_floor=wire.current_floor,
        destination_floor=wire.destination_floor,
        door_state=wire.door_state,
        motion_state=wire.motion_state,
        available_modes=tuple(wire.available_modes),
        current_mode=wire.current_mode,
        session_id=wire.session_id,
    )


def wire_state(state: LiftState) -> WireLiftState:
    return WireLiftState(
        lift_time=_wire_time(state.lift_time),
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


def seconds_of(wire: WireClock) -> float:
    return wire.clock.sec + wire.clock.nanosec / 1e9


def _time_of(wire: WireTime) -> Time:
    return Time(wire.sec, wire.nanosec)


def _wire_time(time: Time) -> WireTime:
    return WireTime(time.sec, time.nanosec)
