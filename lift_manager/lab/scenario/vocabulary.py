"""Every kind of entry that a trace has, with its fields: what a match in a scenario file may name, and what docs/reference/scenarios.md lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum, unique

from drivers.model import Proof, Result
from lift_manager.lab.world.fault_names import every_device_fault, fault_name, kind_name
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Advice, EndReason
from lift_manager.lift.state import Quality
from register_maps.words import Door, Mode, Motion, Side
from simulator.wire_faults import WIRE_FAULTS


@unique
class ValueType(StrEnum):
    """What the value of a field is."""

    TEXT = "text"
    WORD = "a word of a list"
    """One of a closed list."""
    FLOOR = "floor"
    NUMBER = "number"
    FLAG = "true or false"
    FLOORS = "floors"
    COMMANDS = "commands"


LISTS = frozenset({ValueType.FLOORS, ValueType.COMMANDS})
"""Fields with several values; a match with one of them is a match."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of an entry."""

    sort: ValueType
    about: str
    words: tuple[str, ...] = ()
    """Of a closed list, all of it."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of entry."""

    about: str
    lasts: bool
    """Whether an entry holds until the next one of its kind; otherwise it is over in a moment."""
    fields: Mapping[str, Field]


@unique
class RequestedDoor(StrEnum):
    """What a request wants of the door."""

    OPEN = "open"
    CLOSED = "closed"


@unique
class OperatorAction(StrEnum):
    """An action of a person on the manager."""

    ACKNOWLEDGE = "acknowledge"
    LOCK_OUT = "lock_out"
    END_LOCKOUT = "end_lockout"
    DRAIN = "drain"
    END_DRAIN = "end_drain"


@unique
class RobotProgress(StrEnum):
    """How far a robot is, by its own account."""

    CALLS = "calls"
    ENTERS = "enters"
    RIDES = "rides"
    LEAVES = "leaves"
    DONE = "done"
    GIVES_UP = "gives_up"


def _words(values: Iterable[str], about: str) -> Field:
    return Field(ValueType.WORD, about, tuple(str(value) for value in values))


def _text(about: str) -> Field:
    return Field(ValueType.TEXT, about)


def _floor(about: str) -> Field:
    return Field(ValueType.FLOOR, about)


def _flag(about: str) -> Field:
    return Field(ValueType.FLAG, about)


_HOLDER = _text("whose session, such as `fleet:r1`")
_BEGAN = _flag("false when it ends")
_ACCEPTED = _flag("whether the answer was yes")
_CODE = _words(Refusal, "why not")
_MESSAGE = _text("why not, in words")

KINDS: Mapping[str, Kind] = {
    "state": Kind(
        "what every face shows, whenever it changes in more than its age",
        lasts=True,
        fields={
            "quality": _words(Quality, "whether it may be acted on"),
            "reason": _text("why it is offline"),
            "age_s": Field(ValueType.NUMBER, "age of the reading behind it, when it was published"),
            "floor": _floor("where the car stands or passes"),
            "standing": _flag("the car stands at `floor`"),
            "destination": _floor("the floor of the session, else `floor`"),
            "robot_door": _words(RobotDoor, "the door for robots; `open` is an invitation"),
            **{f"door.{side}": _words(Door, "the door itself") for side in Side},
            "motion": _words(Motion, "what the car does"),
            "mode": _words(Mode, "the service that the lift tells"),
            "holder": _text("who holds the lift"),
            "fire_latched": _flag("a fire that nobody has acknowledged"),
            "lockout": _text("who keeps robots off, and why"),
            "drain": _text("who lets sessions end and no new one begin, and why"),
            "maybe_aboard": _text("whose robot may be in the car"),
            "waiting_for": _text("what the session waits for"),
        },
    ),
    "truth": Kind(
        "what the simulated lift really does, by its own physics, whenever that changes",
        lasts=True,
        fields={
            "floor": _floor("in whose door zone the car is"),
            "open_at": _floor("where every door is fully open"),
            "standing": _flag("the car does not move"),
            "doors_shut": _flag("every door is fully closed"),
            "mode": _words(Mode, "the service that the lift is in"),
            "robot_mode": _flag("robot mode is granted"),
            "calls": Field(ValueType.FLOORS, "car calls that are not served yet"),
            "commands": Field(ValueType.COMMANDS, "what is written to the controller, whether or not it obeys"),
        },
    ),
    "press": Kind(
        "a write that newly asks the controller for something",
        lasts=False,
        fields={"command": _text("as in the map"), "floor": _floor("of a call")},
    ),
    "release": Kind(
        "what the controller was asked for is written no more, whoever let go of it",
        lasts=False,
        fields={"command": _text("as in the map"), "floor": _floor("of a call")},
    ),
    "outcome": Kind(
        "what became of a command",
        lasts=False,
        fields={
            "command": _text("as in the map"),
            "floor": _floor("of a call"),
            "result": _words(Result, "how it ended"),
            "proof": _words(Proof, "what confirmed it"),
            "reason": _text("why it was not confirmed"),
        },
    ),
    "session": Kind(
        "somebody holds the lift, or no longer does",
        lasts=True,
        fields={
            "open": _flag("false when it ends"),
            "holder": _HOLDER,
            "floor": _floor("wanted when it began"),
            "reason": _words(EndReason, "why it ended"),
            "text": _text("why it ended, in words"),
            "advice": _words(Advice, "what its robot does best"),
        },
    ),
    "advice": Kind(
        "a robot is told what to do before everything is let go",
        lasts=False,
        fields={"holder": _HOLDER, "advice": _words(Advice, "what"), "text": _text("in words")},
    ),
    "alarm": Kind(
        "something a person should know of",
        lasts=False,
        fields={"text": _text("in words"), "holder": _HOLDER},
    ),
    "request": Kind(
        "a request to the manager, with the answer",
        lasts=False,
        fields={
            "holder": _text("who asks"),
            "floor": _floor("wanted"),
            "door": _words(RequestedDoor, "`open` holds it, `closed` releases the lift"),
            "robot": _words(RobotWord, "what the robot says about itself"),
            "accepted": _ACCEPTED,
            "code": _CODE,
            "message": _MESSAGE,
        },
    ),
    "person": Kind(
        "what a person says to the manager, with the answer",
        lasts=False,
        fields={
            "says": _words(OperatorAction, "what"),
            "by": _text("their name"),
            "accepted": _ACCEPTED,
            "code": _CODE,
            "message": _MESSAGE,
        },
    ),
    "robot": Kind(
        "how far a robot of the scenario is, by its own account",
        lasts=False,
        fields={
            "holder": _text("as whom it asks"),
            "does": _words(RobotProgress, "what it begins; `done`: it is out at its destination"),
            "floor": _floor("where it calls, enters, rides to, leaves"),
        },
    ),
    "fault": Kind(
        "a fault of the lift or its controller begins or ends",
        lasts=True,
        fields={
            "fault": _words(
                dict.fromkeys(
                    (*(fault_name(fault) for fault in every_device_fault()), "foreign_writer", "foreign_cell")
                ),
                "as under `fault:`",
            ),
            "began": _BEGAN,
        },
    ),
    "wire": Kind(
        "a fault on the wire begins or ends",
        lasts=True,
        fields={
            "fault": _words(map(kind_name, WIRE_FAULTS), "as under `wire:`"),
            "controller": _text("on whose wire"),
            "began": _BEGAN,
        },
    ),
}
