"""The closed lists of what a map may name: signals with their kinds, and commands. Explained in GRAMMAR.md of this folder."""

from __future__ import annotations

from enum import StrEnum, unique

from register_maps.words import Door, Mode, Motion, Side


@unique
class Kind(StrEnum):
    """What sort of value a signal carries."""

    FLOOR = "floor"
    FLOORS = "set of floors"
    DOOR = "door"
    MOTION = "motion"
    MODE = "mode"
    FLAG = "flag"
    NUMBER = "number"
    COUNTER = "counter"


_FLAGS = [
    "level",
    "door_zone",
    "robot_mode_on",
    "may_enter",
    "may_leave",
    "ready",
    "fire",
    "fireman",
    "emergency_power",
    "inspection",
    "independent",
    "attendant",
    "overload",
    "nudging",
    "out_of_service",
    "robots_allowed",
    "passenger_alarm",
    "fault",
    "watchdog_tripped",
]

SIGNALS: dict[str, Kind] = {
    "car_floor": Kind.FLOOR,
    "destination": Kind.FLOOR,
    "call_accepted": Kind.FLOOR,
    "calls_registered": Kind.FLOORS,
    "motion": Kind.MOTION,
    "mode": Kind.MODE,
    "alive": Kind.COUNTER,
    "car_position": Kind.NUMBER,
    "load": Kind.NUMBER,
    "fault_code": Kind.NUMBER,
    "identity": Kind.NUMBER,
    "watchdog_time": Kind.NUMBER,
    **{f"door.{side}": Kind.DOOR for side in Side},
    **{f"obstruction.{side}": Kind.FLAG for side in Side},
    **dict.fromkeys(_FLAGS, Kind.FLAG),
    # at the end: the items of an acceptance test are numbered in this order
    "epoch": Kind.NUMBER,
    "owner": Kind.NUMBER,
}
"""Every signal a map may declare, and its kind. Nothing else is accepted."""

CALLS: tuple[str, ...] = ("go_to", *(f"go_to.{side}" for side in Side), "call", "go")
"""Commands that carry a floor. `call` moves the empty car and `go` the occupied one; `go_to` does not distinguish them."""

COMMANDS: tuple[str, ...] = (
    *CALLS,
    "robot_mode",
    "robot_in_place",
    "robot_left",
    "heartbeat",
    *(f"hold_door.{side}" for side in Side),
    *(f"close_door.{side}" for side in Side),
)
"""Every command a map may declare: only what a passenger can do, the controller's own robot signals, and our heartbeat."""

HANDSHAKE = frozenset({"call", "go", "robot_in_place", "robot_left"})
"""Commands that distinguish the empty car from the occupied one."""

LAMPS = ("calls_registered", "call_accepted")
"""Signals that may lie where a call is written: the lamp in the button shows what the controller registered."""

WORDS: dict[Kind, type[StrEnum]] = {Kind.DOOR: Door, Kind.MOTION: Motion, Kind.MODE: Mode}

FLAG_MODES: tuple[tuple[Mode, tuple[str, ...]], ...] = (
    (Mode.INSPECTION, ("inspection",)),
    (Mode.FIRE, ("fire", "fireman")),
    (Mode.EMERGENCY, ("emergency_power", "passenger_alarm")),
    (Mode.OUT_OF_SERVICE, ("out_of_service", "fault")),
    (Mode.INDEPENDENT, ("independent",)),
    (Mode.ATTENDANT, ("attendant",)),
    (Mode.ROBOT, ("robot_mode_on",)),
)
"""The modes that flags report, highest first: the table in GRAMMAR.md."""

SAFETY_FLAGS = frozenset(flag for mode, flags in FLAG_MODES if mode is not Mode.ROBOT for flag in flags)
"""Flags that put the lift in a mode without robots; one that cannot be read counts against robots."""
