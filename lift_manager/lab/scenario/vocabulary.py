"""Every kind of trace entry with its fields. A match in a scenario file names these; docs/reference/scenarios.md lists them."""

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
    """The type of a field's value."""

    TEXT = "text"
    WORD = "one of a list"
    """One of a closed list of words."""
    FLOOR = "floor"
    NUMBER = "number"
    FLAG = "true or false"
    FLOORS = "floors"
    COMMANDS = "commands"


LISTS = frozenset({ValueType.FLOORS, ValueType.COMMANDS})
"""Types with several values. A field matches if one of its values does."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field of an entry."""

    sort: ValueType
    about: str
    words: tuple[str, ...] = ()
    """All words of a closed list."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of entry."""

    about: str
    lasts: bool
    """Whether an entry holds until the next one about the same; otherwise it is over in a moment."""
    fields: Mapping[str, Field]


@unique
class RequestedDoor(StrEnum):
    """What a request needs of the door."""

    OPEN = "open"
    CLOSED = "closed"


@unique
class OperatorAction(StrEnum):
    """An operator action."""

    ACKNOWLEDGE = "acknowledge"
    LOCK_OUT = "lock_out"
    END_LOCKOUT = "end_lockout"
    DRAIN = "drain"
    END_DRAIN = "end_drain"


@unique
class RobotProgress(StrEnum):
    """What a robot is doing, by its own account."""

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
_ACCEPTED = _flag("whether the manager accepted it")
_CODE = _words(Refusal, "why it was refused")
_MESSAGE = _text("why it was refused, in words")

KINDS: Mapping[str, Kind] = {
    "state": Kind(
        "what every face publishes, whenever it changes in more than its age",
        lasts=True,
        fields={
            "quality": _words(Quality, "whether it is current enough to act on"),
            "reason": _text("why it is offline"),
            "age_s": Field(ValueType.NUMBER, "age of the reading behind it at publication"),
            "floor": _floor("where the car stands or passes"),
            "standing": _flag("the car stands at `floor`"),
            "destination": _floor("the floor of the session, else `floor`"),
            "robot_door": _words(RobotDoor, "the door for robots; `open` is an invitation"),
            **{f"door.{side}": _words(Door, "the door itself") for side in Side},
            "motion": _words(Motion, "what the car does"),
            "mode": _words(Mode, "the mode that the lift reports"),
            "holder": _text("whose session holds the lift"),
            "fire_latched": _flag("a fire that nobody has acknowledged"),
            "lockout": _text("who keeps robots off, and why"),
            "drain": _text("who drains the lift, and why: sessions end, and no new one begins"),
            "maybe_aboard": _text("whose robot may be in the car"),
            "waiting_for": _text("what the session waits for"),
        },
    ),
    "truth": Kind(
        "the physical state of the simulated lift, whenever it changes",
        lasts=True,
        fields={
            "floor": _floor("the floor in whose door zone the car is"),
            "open_at": _floor("the floor at which every door is fully open"),
            "standing": _flag("the car does not move"),
            "doors_shut": _flag("every door is fully closed"),
            "mode": _words(Mode, "the mode that the lift is in"),
            "robot_mode": _flag("robot mode is granted"),
            "calls": Field(ValueType.FLOORS, "car calls that are not served yet"),
            "commands": Field(ValueType.COMMANDS, "what is written to the controller, whether or not it obeys"),
        },
    ),
    "press": Kind(
        "a write that gives the controller a new command",
        lasts=False,
        fields={"command": _text("as in the map"), "floor": _floor("the floor of a call")},
    ),
    "release": Kind(
        "a command is no longer written to the controller, no matter who released it",
        lasts=False,
        fields={"command": _text("as in the map"), "floor": _floor("the floor of a call")},
    ),
    "outcome": Kind(
        "what became of a command",
        lasts=False,
        fields={
            "command": _text("as in the map"),
            "floor": _floor("the floor of a call"),
            "result": _words(Result, "how it ended"),
            "proof": _words(Proof, "what confirmed it"),
            "reason": _text("why it was not confirmed"),
        },
    ),
    "session": Kind(
        "a session begins or ends",
        lasts=True,
        fields={
            "open": _flag("false when it ends"),
            "holder": _HOLDER,
            "floor": _floor("the floor requested when it began"),
            "reason": _words(EndReason, "why it ended"),
            "text": _text("why it ended, in words"),
            "advice": _words(Advice, "what its robot should do"),
        },
    ),
    "advice": Kind(
        "advice to a robot before the manager releases its outputs",
        lasts=False,
        fields={"holder": _HOLDER, "advice": _words(Advice, "what its robot should do"), "text": _text("in words")},
    ),
    "alarm": Kind(
        "something that a person should know about",
        lasts=False,
        fields={"text": _text("in words"), "holder": _HOLDER},
    ),
    "request": Kind(
        "a request to the manager, with its answer",
        lasts=False,
        fields={
            "holder": _text("the caller"),
            "floor": _floor("the requested floor"),
            "door": _words(RequestedDoor, "`open` holds the door, `closed` releases the lift"),
            "robot": _words(RobotWord, "what the robot reports"),
            "accepted": _ACCEPTED,
            "code": _CODE,
            "message": _MESSAGE,
        },
    ),
    "person": Kind(
        "an operator action, with its answer",
        lasts=False,
        fields={
            "says": _words(OperatorAction, "the action"),
            "by": _text("their name"),
            "accepted": _ACCEPTED,
            "code": _CODE,
            "message": _MESSAGE,
        },
    ),
    "robot": Kind(
        "what a robot of the scenario is doing, by its own account",
        lasts=False,
        fields={
            "holder": _text("the caller in whose name it sends requests"),
            "does": _words(RobotProgress, "what it begins to do; `done`: it has left the car at its destination"),
            "floor": _floor("where it calls, enters, rides to or leaves"),
        },
    ),
    "fault": Kind(
        "a fault of the lift or its controller begins or ends",
        lasts=True,
        fields={
            "fault": _words(
                dict.fromkeys(
                    (
                        *(fault_name(fault) for fault in every_device_fault()),
                        "disconnected_signal",
                        "foreign_writer",
                        "foreign_cell",
                    )
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
            "controller": _text("the controller at the end of the wire"),
            "began": _BEGAN,
        },
    ),
}
