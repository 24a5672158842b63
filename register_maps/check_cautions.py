"""Warns about what may be right in a map but deserves a second look; warnings do not refuse a map."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from register_maps.check_confirm import is_known
from register_maps.codec import compile_map
from register_maps.errors import Problem
from register_maps.points import UNLISTED
from register_maps.schema import SAFETY_FLAGS, SIGNALS, Kind, RegisterMap
from register_maps.words import Door, Mode, Side

_HEALTHY = (Door.OPEN, Door.CLOSED, Mode.NORMAL, Mode.ROBOT)


def check_cautions(source: RegisterMap, wrong: Collection[str] = ()) -> Iterator[Problem]:
    """Yield warnings; `wrong` are the signals that have mistakes of their own."""
    if not is_known(source, "car_floor"):
        yield _warning(
            "no car_floor: the lift does not report where its car is, and no robot can use it by this map alone"
        )
    if not any(is_known(source, f"door.{side}") for side in Side):
        yield _warning("no door signal: no door can be shown open, and no robot can use the lift by this map alone")
    if is_known(source, "may_leave") and not is_known(source, "may_enter"):
        cure = "declare `may_enter` too, if the controller has it; without it an open door alone invites a robot in"
        yield _warning(f"may_leave without may_enter: entering needs no permission, and leaving does; {cure}")
    if "robot_mode" in source.commands and is_known(source, "robot_mode_on") and not _waits_for_robot_mode(source):
        cure = "give robot_mode `granted_by: robot_mode_on`, and `requires: [robot_mode_on]` to calls that the lift takes in that mode only"
        yield _warning(f"no command waits until robot mode is granted, which robot_mode_on shows; {cure}")
    if not source.needs and not any(_safe_at_zero(source, name) for name in source.signals if name not in wrong):
        cure = "let a code of 0 be `unknown`, or fire `active: low`, where the controller can do that"
        yield _warning(f"a controller that serves only zeros would pass for a healthy lift; {cure}")


def _waits_for_robot_mode(source: RegisterMap) -> bool:
    return any(
        command.granted_by == "robot_mode_on" or "robot_mode_on" in command.requires
        for command in source.commands.values()
    )


def _warning(message: str) -> Problem:
    return Problem(("signals",), message, warning=True)


def _safe_at_zero(source: RegisterMap, name: str) -> bool:
    """Whether this signal alone keeps robots out when it reads zero."""
    alone = {"signals": {name: source.signals[name]}, "commands": {}, "write_blocks": ()}
    value = compile_map(source.model_copy(update=alone)).signals[name].decode(0)
    kind = SIGNALS[name]
    if kind is Kind.FLAG:
        return _flag_is_safe(source, name, yes=value is True, no=value is False)
    if kind in (Kind.DOOR, Kind.MODE):
        return value not in _HEALTHY
    return kind is Kind.COUNTER or (name == "car_floor" and (value is None or value is UNLISTED))


def _flag_is_safe(source: RegisterMap, name: str, *, yes: bool, no: bool) -> bool:
    if name in SAFETY_FLAGS:
        return not no
    if name == "level":
        return source.at_floor_evidence.kind == "level" and not yes
    return name in ("may_enter", "may_leave") and not yes and {"may_enter", "may_leave"} <= source.signals.keys()
