"""The meaning of every signal and command, for the schema, the I/O list and the tools."""

from __future__ import annotations

from collections.abc import Mapping

SIGNAL_MEANINGS: Mapping[str, str] = {
    "car_floor": "the floor at which the car stands, or which it passed last",
    "destination": "the stop to which the car is travelling",
    "call_accepted": "the call that the controller has taken and not yet served",
    "calls_registered": "every call that is registered: the lamps of the call buttons",
    "motion": "what the car is doing: standing, going up, going down",
    "mode": "the service that the lift is in",
    "alive": "a number that changes as long as the program of the controller runs",
    "car_position": "where the car is in the shaft, as a length or a count of steps",
    "load": "the load in the car",
    "fault_code": "the number of the fault, as the controller gives it",
    "identity": "a number by which the controller or its program can be recognised",
    "watchdog_time": "after how much silence the module lets its outputs fall; 0 = its watchdog is off",
    "epoch": "the highest epoch in which the controller has obeyed a manager; it keeps it without power",
    "owner": "the machine whose manager the controller obeys, by its number",
    "door.front": "position of the front car door, as seen by somebody in the car",
    "door.rear": "position of the rear car door, as seen by somebody in the car",
    "obstruction.front": "something is in the front doorway: light curtain or safety edge",
    "obstruction.rear": "something is in the rear doorway: light curtain or safety edge",
    "level": "the car stands level at a floor",
    "door_zone": "the car is within the door zone of a floor",
    "robot_mode_on": "the controller has granted robot (AGV) mode",
    "may_enter": "the controller permits a robot to drive in; an open door alone does not",
    "may_leave": "the controller permits a robot to drive out; an open door alone does not",
    "ready": "the controller takes commands",
    "fire": "fire alarm or fire recall",
    "fireman": "firefighters' service",
    "emergency_power": "the lift runs on emergency power, or is in an emergency that is not fire",
    "inspection": "the lift is under inspection; somebody may be on the car roof",
    "independent": "a person has the car by key (independent service)",
    "attendant": "a person operates the car (attendant service)",
    "overload": "too much load in the car",
    "nudging": "the door closes slowly against an obstruction",
    "out_of_service": "the lift is switched off or taken out of service",
    "robots_allowed": "the key switch that permits robots is on",
    "passenger_alarm": "somebody in the car has pressed the alarm button",
    "fault": "the lift has failed",
    "watchdog_tripped": "the watchdog of the module has run out and has let its outputs fall",
}
"""By signal; complete over `vocabulary.SIGNALS`. Of a flag, what yes means."""

COMMAND_MEANINGS: Mapping[str, str] = {
    "go_to": "brings the car to a floor",
    "go_to.front": "brings the car to a floor and opens its front door there",
    "go_to.rear": "brings the car to a floor and opens its rear door there",
    "call": "calls the empty car to the floor of the robot",
    "go": "takes the car to a floor with the robot aboard",
    "robot_mode": "requests robot (AGV) mode",
    "robot_in_place": "reports that the robot stands in the car",
    "robot_left": "reports that the robot has left the car",
    "heartbeat": "the heartbeat of the lift manager",
    "hold_door.front": "opens the front door and keeps it open, as the door-open button does",
    "hold_door.rear": "opens the rear door and keeps it open, as the door-open button does",
    "close_door.front": "the door-close button of the front door",
    "close_door.rear": "the door-close button of the rear door",
}
"""By command; complete over `vocabulary.COMMANDS`."""
