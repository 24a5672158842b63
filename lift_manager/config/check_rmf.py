"""Whether every lift and every floor has a name of its own in RMF's building map, and what is told of a fire makes sense."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift, Rmf, Site


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
