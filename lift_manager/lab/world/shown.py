"""Whether floor, motion, mode and doors of a live state are those of the lift at some moment since its data was asked for. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lift_manager.lab.world.judged import FORBIDDEN, DoorBy, MapEvidence, SuspectValues
from lift_manager.lab.world.truth import Truth
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftState
from register_maps.words import Door, Mode, Motion, Side

Untrue = tuple[str, str, SuspectValues]
"""The rule, what was said and was not so, and what kind of thing it is."""

_HEADING = {Motion.UP: 1, Motion.DOWN: -1}


def untrue(state: LiftState, shows: MapEvidence, truths: Sequence[Truth]) -> Iterator[Untrue]:
    """Yield everything that a live state says and that was so in none of these moments."""

    def ever(claim: Callable[[Truth], bool]) -> bool:
        return any(map(claim, truths))

    now = truths[0]
    if state.floor is not None and not ever(lambda truth: truth.passed in (state.floor, None)):
        yield "said another floor", f"{state.floor}, and the car was at {now.passed} last", SuspectValues.FLOOR
    if state.standing and not ever(lambda truth: _may_stand(truth, shows)):
        yield "said standing and moved", f"standing at {state.floor}", SuspectValues.FLOOR
    if not _moves_as_said(state.motion, shows, truths):
        yield (
            "said another motion",
            f"{state.motion}, and the car {'stood' if now.standing else 'moved'}",
            SuspectValues.SHOWN,
        )
    if not ever(lambda truth: is_said_of(state.mode, truth.mode, shows)):
        yield "said another mode", f"{state.mode}, and it was {now.mode}", SuspectValues.MODE
    for side, word in state.doors.items():
        if not _is_door_as_said(word, {_door(truth, side) for truth in truths}, shows):
            yield "said another door", f"{side} {word}, and it was {_door(now, side)}", SuspectValues.SHOWN
    if state.robot_door is RobotDoor.CLOSED and not ever(lambda truth: _may_be_shut(truth, shows)):
        yield "said another door", f"closed for robots, and the doors were {dict(now.doors)}", SuspectValues.SHOWN


def is_said_of(said: Mode, mode: Mode, shows: MapEvidence) -> bool:
    """Whether this may be said of a lift in a mode. What is unknown is no claim; a mode that nothing tells looks like normal."""
    if said is Mode.UNKNOWN:
        return True
    if mode in FORBIDDEN:
        return said is mode or (mode not in shows.modes and said in (Mode.NORMAL, Mode.ROBOT))
    if mode is Mode.ROBOT and not shows.robot_mode:
        return said in (Mode.NORMAL, Mode.ROBOT)
    return said is mode


def _may_stand(truth: Truth, shows: MapEvidence) -> bool:
    """With its doors open a car only re-levels; where nothing tells motion, one that has just set out is still at its switch."""
    return truth.standing or (truth.at is not None and (not truth.doors_shut or not shows.motion))


def _moves_as_said(motion: Motion, shows: MapEvidence, truths: Sequence[Truth]) -> bool:
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


def _is_door_as_said(said: Door, doors: set[Door | None], shows: MapEvidence) -> bool:
    """Whether a door was like this, or at both of its ends: then it was between them as well, and nobody happened to look."""
    if any(_may_say(said, door, shows) for door in doors):
        return True
    return said not in (Door.OPEN, Door.CLOSED) and {Door.OPEN, Door.CLOSED} <= doors


def _may_say(said: Door, door: Door | None, shows: MapEvidence) -> bool:
    """Whether a door may be said to be like this; which way it goes between its ends is no claim that anybody acts on."""
    if door is None or said in (Door.FAULT, Door.UNKNOWN):
        return True
    if said is Door.OPEN:
        return door is Door.OPEN
    match shows.door_by:
        case DoorBy.OPEN_LIMITS:
            return True  # made at its floor only: a car that is not level shows no limit though its door is open
        case DoorBy.OPEN_CONTACT:
            return door is not Door.OPEN
        case DoorBy.BOTH_ENDS:
            return door is Door.CLOSED if said is Door.CLOSED else door not in (Door.OPEN, Door.CLOSED)


def _may_be_shut(truth: Truth, shows: MapEvidence) -> bool:
    return all(_may_say(Door.CLOSED, door, shows) for _, door in truth.doors)
