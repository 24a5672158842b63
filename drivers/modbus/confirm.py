"""Decides whether a command took effect, from later readings and never from the echo of its write. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.model import Command, CommandKind, FloorName, LiftValues, Proof
from register_maps.schema import Command as CommandSpec
from register_maps.schema import Confirm
from register_maps.words import Door, Motion

_MOVES = (Motion.UP, Motion.DOWN, Motion.MOVING)
_READ_BACK = Confirm(any_of=("readback",), within_s=2.0)
"""The rule for a command whose map names no confirmation. The time is that of the shipped maps."""


def confirmation_of(spec: CommandSpec) -> Confirm:
    """Return the rule that confirms a command of the map."""
    return spec.confirm or _READ_BACK


@dataclass(frozen=True, slots=True)
class Expectation:
    """The evidence that would confirm one command."""

    command: Command
    any_of: tuple[str, ...]
    """As in the map: signal names, `effect`, `readback`."""
    before: LiftValues | None
    """The values when the press was sent, or from when its car stood for the first time after that."""
    floors: Sequence[FloorName]
    """Lowest first."""
    was_standing: bool = False
    """The car stood then. A car already under way proves nothing by driving on: it serves another call."""


def find_proof(expected: Expectation, now: LiftValues, *, read_back: bool) -> Proof:
    """Return the strongest proof that the newest reading gives."""
    for name in expected.any_of:
        if name == "effect" and _takes_effect(expected, now):
            return Proof.EFFECT
        if name == "readback" and read_back:
            return Proof.READBACK
        if _shows(name, expected, now):
            return Proof.LAMP
    return Proof.NONE


def _shows(signal: str, expected: Expectation, now: LiftValues) -> bool:
    command = expected.command
    match signal:
        case "car_floor":
            shown = now.floor
        case "destination":
            shown = now.destination
        case "call_accepted":
            shown = now.call_accepted
        case "calls_registered":
            return command.floor in now.calls
        case _:
            # a flag that was set before the press would prove every press
            earlier = expected.before is not None and expected.before.flags.get(signal, False)
            return now.flags.get(signal, False) and not earlier
    return shown is not None and shown == command.floor


def _takes_effect(expected: Expectation, now: LiftValues) -> bool:
    command = expected.command
    match command.kind:
        case CommandKind.GO_TO | CommandKind.CALL | CommandKind.GO:
            return _goes(expected, now)
        case CommandKind.HOLD_DOOR:
            return command.side is not None and now.doors.get(command.side) in (Door.OPEN, Door.OPENING)
        case CommandKind.CLOSE_DOOR:
            return command.side is not None and now.doors.get(command.side) in (Door.CLOSED, Door.CLOSING)
        case CommandKind.ROBOT_MODE:
            return now.flags.get("robot_mode_on", False)
        case CommandKind.ROBOT_IN_PLACE | CommandKind.ROBOT_LEFT:
            return False


def _may_leave(now: LiftValues) -> bool:
    """Whether the car may be under way: one that has just departed still reports the floor it leaves.

    Without a motion signal, a car with its doors shut may stand or drive.
    """
    if now.motion is None:
        return _is_shut(now)
    return now.motion in _MOVES


def _is_shut(now: LiftValues) -> bool:
    return all(door is Door.CLOSED for door in now.doors.values())


def _goes(expected: Expectation, now: LiftValues) -> bool:
    """Whether the car is at the target, or on its way there."""
    target, before = expected.command.floor, expected.before
    if target is None:
        return False
    ends = (expected.floors[0], expected.floors[-1])
    if now.floor == target:
        # a car already under way may only pass the target, except at an end of the shaft
        came = before is None or (before.floor != target and (expected.was_standing or target in ends))
        return came or not _may_leave(now)
    if before is None or before.floor is None or not expected.was_standing:
        return False
    upwards = expected.floors.index(target) > expected.floors.index(before.floor)
    if now.motion in (Motion.UP, Motion.DOWN):
        return (now.motion is Motion.UP) is upwards
    if now.floor is None:
        # from an end of the shaft there is only one direction; and a motion signal without a direction gives no other evidence
        return _is_shut(now) and (before.floor in ends or now.motion is Motion.MOVING)
    return (
        now.floor != before.floor
        and (expected.floors.index(now.floor) > expected.floors.index(before.floor)) is upwards
    )
