"""Compares floor, motion, mode and doors of a live state with the lift since the data of that state was requested. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lift_manager.lab.world.lift_under_test import MODES_WITHOUT_ROBOTS, DoorEvidence, MapEvidence, SuspectValues
from lift_manager.lab.world.truth import Truth
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftState
from register_maps.words import Door, Mode, Motion, Side

FalseClaim = tuple[str, str, SuspectValues]
"""The rule, the text of the finding, and what is wrong."""

_HEADING = {Motion.UP: 1, Motion.DOWN: -1}


def false_claims(state: LiftState, shows: MapEvidence, truths: Sequence[Truth]) -> Iterator[FalseClaim]:
    """Yield every claim of a live state that was true at none of these moments."""

    def ever(claim: Callable[[Truth], bool]) -> bool:
        return any(map(claim, truths))

    now = truths[0]
    if state.floor is not None and not ever(lambda truth: truth.passed in (state.floor, None)):
        yield "said another floor", f"{state.floor}, and the car was at {now.passed} last", SuspectValues.FLOOR
    if state.standing and not ever(lambda truth: _may_stand(truth, shows)):
        yield "said standing and moved", f"standing at {state.floor}", SuspectValues.FLOOR
    if not _is_motion_true(state.motion, shows, truths):
        yield (
            "said another motion",
            f"{state.motion}, and the car {'stood' if now.standing else 'moved'}",
            SuspectValues.SHOWN,
        )
    if not ever(lambda truth: may_report_mode(state.mode, truth.mode, shows)):
        yield "said another mode", f"{state.mode}, and it was {now.mode}", SuspectValues.MODE
    for side, word in state.doors.items():
        if not _is_door_true(word, {_door(truth, side) for truth in truths}, shows):
            yield "said another door", f"{side} {word}, and it was {_door(now, side)}", SuspectValues.SHOWN
    if state.robot_door is RobotDoor.CLOSED and not ever(lambda truth: _may_be_closed(truth, shows)):
        yield "said another door", f"closed for robots, and the doors were {dict(now.doors)}", SuspectValues.SHOWN


def may_report_mode(published: Mode, mode: Mode, shows: MapEvidence) -> bool:
    """Whether a mode may be published for a lift in `mode`. `unknown` claims nothing; a mode without a signal looks like normal."""
    if published is Mode.UNKNOWN:
        return True
    if mode in MODES_WITHOUT_ROBOTS:
        return published is mode or (mode not in shows.modes and published in (Mode.NORMAL, Mode.ROBOT))
    if mode is Mode.ROBOT and not shows.robot_mode:
        return published in (Mode.NORMAL, Mode.ROBOT)
    return published is mode


def _may_stand(truth: Truth, shows: MapEvidence) -> bool:
    """Whether a car may count as standing.

    With open doors it only re-levels. Without a motion signal it counts as standing until it leaves its floor switch.
    """
    return truth.standing or (truth.at is not None and (not truth.doors_shut or not shows.motion))


def _is_motion_true(motion: Motion, shows: MapEvidence, truths: Sequence[Truth]) -> bool:
    match motion:
        case Motion.STOPPED if shows.direction:
            return any(truth.standing for truth in truths)
        case Motion.STOPPED:
            return any(_may_stand(truth, shows) for truth in truths)
        case Motion.UP | Motion.DOWN:
            return any(truth.heading == _HEADING[motion] for truth in truths)
        case Motion.MOVING:
            return any(not truth.standing for truth in truths)
        case _:
            return True


def _door(truth: Truth, side: Side) -> Door | None:
    return next((word for one, word in truth.doors if one is side), None)


def _is_door_true(published: Door, doors: set[Door | None], shows: MapEvidence) -> bool:
    """Whether a door was in this state. A door that was open and closed was also in between."""
    if any(_may_report_door(published, door, shows) for door in doors):
        return True
    return published not in (Door.OPEN, Door.CLOSED) and {Door.OPEN, Door.CLOSED} <= doors


def _may_report_door(published: Door, door: Door | None, shows: MapEvidence) -> bool:
    """Whether this may be published for a door. The direction between open and closed does not matter: nobody acts on it."""
    if door is None or published in (Door.FAULT, Door.UNKNOWN):
        return True
    if published is Door.OPEN:
        return door is Door.OPEN
    match shows.door_by:
        case DoorEvidence.OPEN_LIMITS:
            return (
                True  # the limit works at its floor only: a car that is not level shows none, though its door is open
            )
        case DoorEvidence.OPEN_CONTACT:
            return door is not Door.OPEN
        case DoorEvidence.BOTH_ENDS:
            return door is Door.CLOSED if published is Door.CLOSED else door not in (Door.OPEN, Door.CLOSED)


def _may_be_closed(truth: Truth, shows: MapEvidence) -> bool:
    return all(_may_report_door(Door.CLOSED, door, shows) for _, door in truth.doors)
