"""What consecutive readings add up to: where the car stands, what its doors do, and whether a robot may pass them.

Opening is believed slowly and closing at once: a robot drives on one message that says "open at L2".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import Capabilities, FloorName, LiftReading, LiftValues
from lift_manager.lift.modes import robots_forbidden
from register_maps.words import Door, Motion, Side

MOVING = frozenset({Motion.UP, Motion.DOWN, Motion.MOVING})
"""Motions of a car that does not stand."""


@dataclass(frozen=True, slots=True)
class Moment:
    """When something is decided, and how old the newest reading is by then.

    The time of the newest reading is here and not in the record, so that a reading without news changes nothing.
    """

    now: float
    """Monotonic seconds."""
    clock: datetime
    """The time of day in the building, with its zone."""
    read_at: float = -math.inf
    """When the newest whole reading was requested from the controller; no signal is older."""


@unique
class RobotDoor(StrEnum):
    """The door state for robots: OPEN is an invitation to drive."""

    CLOSED = "closed"
    MOVING = "moving"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class Observation:
    """The newest values of a lift, with what only several readings show. Its age is `Moment.read_at`."""

    values: LiftValues
    epoch: int
    """The connection that the newest reading came over."""
    floor_since: float
    """Since when the car has been reported at the same floor without a break."""
    mode_since: float
    """When the present mode was first read."""
    evidence_since: float
    """Since when the evidence for an open door has been read without a change."""
    is_standing: bool
    """By the map's evidence the car stands at `values.floor`."""
    is_agreed: bool
    """That evidence came in one piece, or readings agree on it that are far enough apart to be two for the controller too."""
    is_settled: bool
    """Another reading with the same values would change nothing."""
    follows: bool = False
    """It continues the reading before it: on the same connection, and without a gap longer than a reading counts."""
    not_open_since: Mapping[Side, float] = field(default_factory=dict)
    """Since when each door with an open contact only has read "not open"."""
    may_be_closing: frozenset[Side] = frozenset()
    """Of these, the doors that may still be closing."""
    doubt: str = ""
    """Why a door that reads open is not trusted; empty while it is."""
    must_close: bool = False
    """Its door has to be read closed before it is trusted: holding it open would prevent that."""

    @property
    def floor(self) -> FloorName | None:
        """The floor that the car reports."""
        return self.values.floor

    @property
    def doors(self) -> Mapping[Side, Door]:
        """The doors; one with an open contact only counts as closed once it has had time to close."""
        doors = self.values.doors
        if not self.may_be_closing:
            return doors
        return {side: Door.MOVING if side in self.may_be_closing else door for side, door in doors.items()}


def observe(
    before: Observation | None, reading: LiftReading, capabilities: Capabilities, *, gap_s: float, apart_s: float
) -> Observation:
    """Add one reading to what was known before it, `gap_s` seconds earlier.

    Readings that are not `apart_s` apart may be the same to a gateway, which answers from a memory that it fills at its own pace.
    """
    values, previous = reading.values, None
    if before is not None and before.epoch == reading.epoch and gap_s <= capabilities.max_age_s:
        previous = before
    same_floor = previous is not None and previous.values.floor == values.floor
    floor_since = previous.floor_since if previous is not None and same_floor else reading.at
    same_evidence = previous is not None and _evidence(previous.values) == _evidence(values)
    evidence_since = previous.evidence_since if previous is not None and same_evidence else reading.at
    agreed = capabilities.one_block or (same_evidence and reading.at - evidence_since >= apart_s)
    standing = values.floor is not None and _stands(values, capabilities, reading.at - floor_since)
    waits = capabilities.evidence == "position_stable" and values.floor is not None and not standing
    not_open = _not_open_since(previous, values, capabilities, reading.at) if capabilities.open_contacts else {}
    closing = {side for side, since in not_open.items() if reading.at - since < capabilities.door_closes_within_s}
    same_mode = before is not None and before.values.mode is values.mode
    return Observation(
        values,
        reading.epoch,
        floor_since,
        before.mode_since if before is not None and same_mode else reading.at,
        evidence_since,
        standing,
        agreed,
        is_settled=agreed and not waits and not closing,
        follows=previous is not None,
        not_open_since=not_open,
        may_be_closing=frozenset(closing),
    )


# -- what robots may do


def permissions_needed(capabilities: Capabilities, *, aboard: bool | None) -> frozenset[str]:
    """Return the flags of this map of which one must be set before the robot drives; `aboard` is None if that is unknown."""
    wanted = {True: {"may_leave"}, False: {"may_enter"}, None: {"may_enter", "may_leave"}}
    return capabilities.signals & wanted[aboard]


def door_by_signals(observation: Observation, doors_here: tuple[Side, ...], needed: frozenset[str]) -> RobotDoor:
    """Return the door state for robots by the lift's own signals; sessions and restrictions may only weaken it.

    `needed` are the permissions of which one must be given; empty if the map has none.
    """
    doors, flags = observation.doors, observation.values.flags
    if doors and all(door is Door.CLOSED for door in doors.values()):
        return RobotDoor.CLOSED
    is_open = bool(doors_here) and all(doors.get(side) is Door.OPEN for side in doors_here)
    is_permitted = not needed or any(flags.get(flag, False) for flag in needed)
    is_believed = observation.is_standing and observation.is_agreed and not observation.doubt
    is_safe = is_believed and is_permitted and not robots_forbidden(observation.values.mode)
    return RobotDoor.OPEN if is_open and is_safe else RobotDoor.MOVING


def robot_mode_granted(observation: Observation, capabilities: Capabilities) -> bool:
    """Whether the lift is in robot mode, or does not report it."""
    return "robot_mode_on" not in capabilities.signals or observation.values.flags.get("robot_mode_on", False)


def doubt_at(observation: Observation | None, floor: FloorName | None) -> str:
    """Return what a robot waits for at a floor whose door reads open and is not trusted; empty otherwise."""
    if observation is None or observation.floor != floor:
        return ""
    return observation.doubt if Door.OPEN in observation.values.doors.values() else ""


# -- the car and its doors


def is_shut(values: LiftValues) -> bool:
    """Whether every door of the car reads closed; never for a car without doors."""
    return bool(values.doors) and all(door is Door.CLOSED for door in values.doors.values())


def has_no_open_door(doors: Mapping[Side, Door]) -> bool:
    """Whether every one of these doors is closed, or there is none: as it reads, or in `Observation.doors` once it had time to close."""
    return all(door is Door.CLOSED for door in doors.values())


def may_be_moving(observation: Observation) -> bool:
    """Whether the car moves or may move: anything but a clear "stopped", or not seen to stand where no motion is reported."""
    motion = observation.values.motion
    return not observation.is_standing if motion is None else motion is not Motion.STOPPED


def is_under_way(values: LiftValues) -> bool:
    """Whether the lift reports that the car moves, and every door is shut."""
    return is_shut(values) and values.motion in MOVING


def has_departed(observation: Observation, floor: FloorName) -> bool:
    """Whether the car is seen elsewhere, or moving; re-levelling at the floor with the door open is neither."""
    is_here, motion = observation.floor == floor, observation.values.motion
    if observation.floor is not None and not is_here:
        return True
    levels = is_here and any(door is not Door.CLOSED for door in observation.values.doors.values())
    return motion in MOVING and not levels


def is_closing(observation: Observation, sides: tuple[Side, ...]) -> bool:
    """Whether any of these doors is seen shut or closing: whatever holds it has no effect."""
    return any(observation.values.doors.get(side) in (Door.CLOSED, Door.CLOSING) for side in sides)


def _stands(values: LiftValues, capabilities: Capabilities, floor_for_s: float) -> bool:
    if values.motion not in (None, Motion.STOPPED):
        return False
    match capabilities.evidence:
        case "level":
            return values.flags.get("level", False)
        case "motion_stopped":
            return values.motion is Motion.STOPPED
        case "door_open":
            return Door.OPEN in values.doors.values()
        case "door_limit":
            return True
        case _:
            return floor_for_s >= capabilities.evidence_for_s


def _not_open_since(
    before: Observation | None, values: LiftValues, capabilities: Capabilities, at: float
) -> dict[Side, float]:
    known = {} if before is None else before.not_open_since
    return {side: known.get(side, at) for side in capabilities.open_contacts if values.doors.get(side) is Door.CLOSED}


def _evidence(values: LiftValues) -> tuple[FloorName | None, Mapping[Side, Door], Motion | None, bool]:
    return values.floor, values.doors, values.motion, values.flags.get("level", False)
