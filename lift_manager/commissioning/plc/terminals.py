"""The terminals of the PLC by name, contact and meaning, for the program and the wiring sheet.

Signals that keep robots away are wired so that a broken wire keeps them away too: alarms through normally closed contacts, which open
on an alarm, and permissions through normally open ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum, unique

from register_maps.codec import Codec


@unique
class Contact(StrEnum):
    """The kind of contact, as in a wiring diagram."""

    NO = "NO"
    """Normally open: closed while the signal is on."""
    NC = "NC"
    """Normally closed: open while the signal is on."""


@dataclass(frozen=True, slots=True)
class Terminal:
    """One wire between the PLC and the lift."""

    name: str
    """The name of its variable in the program."""
    contact: Contact
    wire_to: str
    when_on: str
    """What TRUE means; for an output, what it does."""
    when_cut: str
    """How the program reads a broken wire; for an output, what the lift does then."""
    shows: str | None = None
    """The signal or command of the map that it belongs to."""


_LIMITS = (
    Terminal("DoorOpenLimit", Contact.NO, "door-open limit", "door fully open", "door not fully open", "door.front"),
    Terminal("DoorClosedLimit", Contact.NO, "door-closed limit", "door fully closed", "door not closed", "door.front"),
)
_RUNS = (
    Terminal("MovesUp", Contact.NO, "auxiliary contact of the up direction", "car runs up", "car stands", "motion"),
    Terminal(
        "MovesDown", Contact.NO, "auxiliary contact of the down direction", "car runs down", "car stands", "motion"
    ),
)
_SINGLE = (
    Terminal("LevelSwitch", Contact.NO, "levelling switch", "car level at a floor", "car not level", "level"),
    Terminal(
        "DoorwayClear",
        Contact.NC,
        "light curtain or safety edge",
        "nothing in the doorway",
        "doorway obstructed",
        "obstruction.front",
    ),
    Terminal("LoadOk", Contact.NC, "overload device", "load within the limit", "overloaded", "overload"),
)
_GUARDS = (
    Terminal("NoFire", Contact.NC, "fire alarm or fire recall", "no fire", "fire", "fire"),
    Terminal("NoInspection", Contact.NC, "inspection switches", "no inspection", "inspection", "inspection"),
    Terminal(
        "NoIndependent",
        Contact.NC,
        "independent-service key",
        "nobody has the key",
        "independent service",
        "independent",
    ),
    Terminal(
        "InService", Contact.NC, "controller fault or out of service", "in service", "out of service", "out_of_service"
    ),
    Terminal(
        "MainsOn", Contact.NC, "emergency power or passenger alarm", "no emergency", "emergency", "emergency_power"
    ),
    Terminal(
        "RobotsAllowed", Contact.NO, "key switch for robots", "robots allowed", "robots refused", "robots_allowed"
    ),
)
"""Inputs that end robot mode when they fall. They are wired whether or not the map shows them."""
_GRANT = Terminal(
    "RobotModeGranted",
    Contact.NO,
    "the controller's answer to RobotMode; without one, bridge it to the output RobotMode",
    "the lift is in robot mode",
    "not in robot mode",
    "robot_mode_on",
)

GUARDS = tuple(terminal.name for terminal in _GUARDS)
"""Inputs that must all be TRUE for a robot to command the lift."""


def inputs(codec: Codec, floors: Sequence[str]) -> tuple[Terminal, ...]:
    """Return every input of the program, in the order of its terminals; `floors` are names, lowest first."""
    found = [
        Terminal(
            f"AtFloor{number}", Contact.NO, f"floor switch of {name}", f"car at {name}", "car not here", "car_floor"
        )
        for number, name in enumerate(floors, start=1)
        if "car_floor" in codec.signals
    ]
    found += [
        Terminal(
            f"CallLamp{number}",
            Contact.NO,
            f"lamp of the car call {name}",
            f"call {name} registered",
            "call not registered",
            "call_accepted",
        )
        for number, name in enumerate(floors, start=1)
        if shows_lamps(codec)
    ]
    found += [terminal for terminal in (*_LIMITS, *_RUNS, *_SINGLE) if terminal.shows in codec.signals]
    return (*found, *_GUARDS, _GRANT)


def outputs(codec: Codec, floors: Sequence[str]) -> tuple[Terminal, ...]:
    """Return every output of the program, in the order of its terminals; `floors` are names, lowest first."""
    found = [
        Terminal(
            f"CallButton{number}",
            Contact.NO,
            f"in parallel to the car button {name}",
            f"presses {name}",
            "not pressed",
            "go_to",
        )
        for number, name in enumerate(floors, start=1)
    ]
    button = "in parallel to the door-{} button"
    doors = (
        Terminal(
            "DoorOpenButton", Contact.NO, button.format("open"), "holds the door open", "not pressed", "hold_door.front"
        ),
        Terminal(
            "DoorCloseButton", Contact.NO, button.format("close"), "presses it", "not pressed", "close_door.front"
        ),
    )
    found += [terminal for terminal in doors if terminal.shows in codec.commands]
    wire_to = "the controller's input for robot service, such as its key for an attendant or priority trips"
    found.append(
        Terminal("RobotMode", Contact.NO, wire_to, "requests robot mode", "in service for people", "robot_mode")
    )
    return tuple(found)


def shows_lamps(codec: Codec) -> bool:
    """Whether the map shows which call the lift has accepted."""
    return "call_accepted" in codec.signals or "destination" in codec.signals
