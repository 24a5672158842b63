"""The enums that maps, drivers, simulator and manager share.

Standard library only. Values are the words written in a map's YAML file and shown on every face.
"""

from __future__ import annotations

from enum import StrEnum, unique


@unique
class Door(StrEnum):
    """The state of one door of the car; `OPEN` and `CLOSED` mean fully open and fully closed."""

    CLOSED = "closed"
    OPENING = "opening"
    OPEN = "open"
    CLOSING = "closing"
    MOVING = "moving"
    """Between its limits, direction unknown."""
    FAULT = "fault"
    """Its limits contradict each other, or the controller reports a door fault."""
    UNKNOWN = "unknown"


@unique
class Motion(StrEnum):
    """What the car is doing."""

    STOPPED = "stopped"
    UP = "up"
    DOWN = "down"
    MOVING = "moving"
    """Moving, direction unknown."""
    UNKNOWN = "unknown"


@unique
class Mode(StrEnum):
    """Which service the lift is in; exactly one at a time, see the precedence table in GRAMMAR.md."""

    NORMAL = "normal"
    """In service for people."""
    ROBOT = "robot"
    """The controller has granted robot (AGV) mode."""
    INDEPENDENT = "independent"
    ATTENDANT = "attendant"
    INSPECTION = "inspection"
    FIRE = "fire"
    EMERGENCY = "emergency"
    """Emergency power, passenger alarm or any emergency that is not fire."""
    OUT_OF_SERVICE = "out_of_service"
    UNKNOWN = "unknown"


ROBOT_FORBIDDEN_MODES = frozenset(
    {Mode.INDEPENDENT, Mode.ATTENDANT, Mode.INSPECTION, Mode.FIRE, Mode.EMERGENCY, Mode.OUT_OF_SERVICE, Mode.UNKNOWN}
)
"""No press is sent and no robot is invited in these modes (DESIGN: people and fire come first)."""


@unique
class Side(StrEnum):
    """Which door of the car, seen by someone standing in it."""

    FRONT = "front"
    REAR = "rear"


@unique
class Table(StrEnum):
    """The four tables of the Modbus data model (Modbus Application Protocol V1.1b3, 4.3)."""

    COIL = "coil"
    DISCRETE = "discrete"
    HOLDING = "holding"
    INPUT = "input"


BIT_TABLES = frozenset({Table.COIL, Table.DISCRETE})
WRITABLE_TABLES = frozenset({Table.COIL, Table.HOLDING})
READ_FUNCTION = {Table.COIL: 1, Table.DISCRETE: 2, Table.HOLDING: 3, Table.INPUT: 4}
