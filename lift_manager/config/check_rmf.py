"""Whether every lift and every floor has a name of its own in RMF's building map, what is told of a fire makes sense, and doors stay open."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift, LiftRmf, Rmf, Site
from register_maps.schema import CALLS, RegisterMap
from register_maps.words import Side

_WHILE_ABOARD = ("robot_in_place", "robot_left")
"""A call that ends with one of these words of the robot is what keeps the door open until then."""


def check_rmf(site: Site) -> Iterator[Problem]:
    """Yield names that two lifts or two floors share, floors that a lift does not have, and settings that do nothing."""
    yield from _alarms(site.rmf)
    named: dict[str, str] = {}
    for name, lift in site.lifts.items():
        key, said = ("lifts", name), lift.rmf.name
        in_rmf = said or name
        if in_rmf in named:
            where: Key = (*key, "rmf", "name") if said else key
            message = (
                f"RMF knows {in_rmf} as the lift {named[in_rmf]} already; give one of them another name with `rmf: {{name: ...}}`,"
                " as RMF's building map has it"
            )
            yield Problem(where, message)
        named.setdefault(in_rmf, name)
        yield from _floors(key, name, lift)


def is_in_rmf(lift: Lift) -> bool:
    """Whether the site says what RMF calls a lift or its floors."""
    return lift.rmf != LiftRmf()


def unheld_doors(name: str, lift: Lift, source: RegisterMap) -> Iterator[str]:
    """Yield what an installer has to know of doors that RMF is told are open, and that nothing here keeps open."""
    if lift.access == "monitor" or any(
        command in source.commands and source.commands[command].until in _WHILE_ABOARD for command in CALLS
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


def _floors(key: Key, name: str, lift: Lift) -> Iterator[Problem]:
    said = lift.rmf.floors
    for floor in (floor for floor in said if floor not in lift.floors):
        message = (
            f"{name} has no floor {floor}; write one of its floors, {', '.join(lift.floors)}, and behind it RMF's name"
        )
        yield Problem((*key, "rmf", "floors", floor), message)
    named: dict[str, str] = {}
    for floor in lift.floors:
        in_rmf = said.get(floor, floor)
        if in_rmf in named:
            at = floor if floor in said else named[in_rmf]
            message = (
                f"RMF knows {in_rmf} as the floor {named[in_rmf]} of {name} already; each floor needs a name of its own"
            )
            yield Problem((*key, "rmf", "floors", at), message)
        named.setdefault(in_rmf, floor)


def _alarms(rmf: Rmf) -> Iterator[Problem]:
    if rmf.emergency_fleets and not rmf.emergency_signal:
        message = "names the fleets of a signal that is not sent; add `emergency_signal: true`, or remove this line"
        yield Problem(("rmf", "emergency_fleets"), message)
    if rmf.clear_on_acknowledge and not (rmf.fire_alarm or rmf.emergency_signal):
        message = "clears an alarm that is not sent; add `fire_alarm: true`, or remove this line"
        yield Problem(("rmf", "clear_on_acknowledge"), message)
