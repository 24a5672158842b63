"""Checks the names of lifts and floors in RMF's building map, the settings of fire alarms, and door holds."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift, LiftRmf, Rmf, Site
from register_maps.schema import CALLS, RegisterMap
from register_maps.words import Side

_ROBOT_REPORTS = ("robot_in_place", "robot_left")
"""A call that lasts until one of these reports of the robot keeps the door open until then."""


def check_rmf(site: Site) -> Iterator[Problem]:
    """Yield names that two lifts or floors share, unknown floors, and settings without effect."""
    yield from _check_alarms(site.rmf)
    taken: dict[str, str] = {}
    for name, lift in site.lifts.items():
        key, rmf_names = ("lifts", name), lift.rmf.name
        in_rmf = rmf_names or name
        if in_rmf in taken:
            where: Key = (*key, "rmf", "name") if rmf_names else key
            message = (
                f"RMF knows {in_rmf} as the lift {taken[in_rmf]} already; give one of them another name with `rmf: {{name: ...}}`,"
                " as RMF's building map has it"
            )
            yield Problem(where, message)
        taken.setdefault(in_rmf, name)
        yield from _check_floors(key, name, lift)


def uses_rmf_names(lift: Lift) -> bool:
    """Whether the site file names a lift or its floors for RMF."""
    return lift.rmf != LiftRmf()


def unheld_doors(name: str, lift: Lift, source: RegisterMap) -> Iterator[str]:
    """Yield cautions about doors that are announced to RMF as open and that no command holds open."""
    if lift.access == "monitor" or any(
        command in source.commands and source.commands[command].until in _ROBOT_REPORTS for command in CALLS
    ):
        return
    served = {side for floor in lift.floors.values() for side in floor.doors or tuple(Side)}
    shown = [side for side in Side if side in served and f"door.{side}" in source.signals]
    if missing := [f"hold_door.{side}" for side in shown if f"hold_door.{side}" not in source.commands]:
        yield (
            f"{name}: map {source.name} has no {' and no '.join(missing)}: RMF sends robots in when the door is open, and it closes"
            " by its own timer, perhaps on a robot in the doorway; connect an output to the door-open button and add the"
            " command, or set the timer longer than the slowest robot needs"
        )


def _check_floors(key: Key, name: str, lift: Lift) -> Iterator[Problem]:
    rmf_names = lift.rmf.floors
    for floor in (floor for floor in rmf_names if floor not in lift.floors):
        message = (
            f"{name} has no floor {floor}; write one of its floors, {', '.join(lift.floors)}, and behind it RMF's name"
        )
        yield Problem((*key, "rmf", "floors", floor), message)
    taken: dict[str, str] = {}
    for floor in lift.floors:
        in_rmf = rmf_names.get(floor, floor)
        if in_rmf in taken:
            at = floor if floor in rmf_names else taken[in_rmf]
            message = (
                f"RMF knows {in_rmf} as the floor {taken[in_rmf]} of {name} already; each floor needs a name of its own"
            )
            yield Problem((*key, "rmf", "floors", at), message)
        taken.setdefault(in_rmf, floor)


def _check_alarms(rmf: Rmf) -> Iterator[Problem]:
    if rmf.emergency_fleets and not rmf.emergency_signal:
        message = "names the fleets of a signal that is not sent; add `emergency_signal: true`, or remove this line"
        yield Problem(("rmf", "emergency_fleets"), message)
    if rmf.clear_on_acknowledge and not (rmf.fire_alarm or rmf.emergency_signal):
        message = "clears an alarm that is not sent; add `fire_alarm: true`, or remove this line"
        yield Problem(("rmf", "clear_on_acknowledge"), message)
