"""Checks that robots can use a lift as configured: the signals and conditions that its map must have."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from lift_manager.lift.hours import superfluous
from register_maps.expand import added_signals
from register_maps.load import LoadedMap
from register_maps.schema import CALLS, Parameter, RegisterMap
from register_maps.vocabulary import HANDSHAKE
from register_maps.words import Side

_INDEPENDENCE_FLAGS = frozenset({"robot_mode_on", "independent"})
"""Flags of which one shows that a car ignores the landing calls of its group."""


def check_unset(key: Key, lift: Lift, loaded: LoadedMap) -> Iterator[Problem]:
    """Yield parameters and signals that the map leaves to the site, and that the site does not set."""
    source = loaded.map
    for name in loaded.unset:
        if name not in lift.parameters:
            parameter = source.parameters[name]
            message = f"is not set, and {source.name} cannot know it: {parameter.help} ({_allowed_values(parameter)})"
            yield Problem((*key, "parameters", name), message)
    added = added_signals(lift.override)
    for name, reason in source.needs.items():
        if name not in added:
            yield Problem(
                (*key, "override", "signals", name), f"{_missing_text(source, name)} ({reason}); {_add_advice(name)}"
            )


def check_use(key: Key, lift: Lift, source: RegisterMap) -> Iterator[Problem]:
    """Yield what prevents monitoring or commanding this lift."""
    if "car_floor" not in source.signals and "car_floor" not in source.needs:
        yield Problem(
            (*key, "override", "signals", "car_floor"),
            f"{_missing_text(source, 'car_floor')}; {_add_advice('car_floor')}",
        )
    uses_handshake = source.needs_occupancy or bool(HANDSHAKE & source.commands.keys())
    if (lift.rmf.name or lift.rmf.floors) and uses_handshake and not lift.infer_occupancy and lift.access == "control":
        message = f"{source.name} has to learn when a robot is in place, and RMF cannot report that: no request of RMF would be accepted; add `infer_occupancy: true` to this lift"
        yield Problem((*key, "rmf"), message)
    if lift.infer_occupancy and not uses_handshake:
        message = f"{source.name} takes no report about a robot aboard, so there is nothing to infer; remove this line"
        yield Problem((*key, "infer_occupancy"), message)
    for index, covered_by in superfluous(lift.robot_hours or ()):
        message = f"adds nothing, because {covered_by} has these hours already; remove this line"
        yield Problem((*key, "robot_hours", index), message)
    if lift.access == "control":
        yield from _door(key, source)
        yield from _latching(key, lift, source)
        yield from _group(key, lift, source)


def _missing_text(source: RegisterMap, signal: str) -> str:
    if signal == "car_floor":
        return f"{source.name} does not report where its car is"
    return f"{source.name} does not report {signal}"


def _add_advice(signal: str) -> str:
    return f"add {signal} under `override: signals`, on a second endpoint if need be"


def _allowed_values(parameter: Parameter) -> str:
    if parameter.choices is not None:
        return f"one of {', '.join(parameter.choices)}"
    if parameter.range is not None:
        return f"{parameter.range[0]:g} to {parameter.range[1]:g}"
    return "text" if isinstance(parameter.value, str) else "a number"


def _door(key: Key, source: RegisterMap) -> Iterator[Problem]:
    doors = [f"door.{side}" for side in Side]
    if not any(door in source.signals or door in source.needs for door in doors):
        message = f"{source.name} does not report whether a door is open, and no robot may guess; {_add_advice(doors[0])}, or use `access: monitor`"
        yield Problem((*key, "access"), message)


def _latching(key: Key, lift: Lift, source: RegisterMap) -> Iterator[Problem]:
    latching = [name for name, command in source.commands.items() if command.on_link_loss == "latches"]
    if latching and lift.accept_latching is None:
        outputs = ", ".join(latching)
        message = (
            f"{outputs} of {source.name} stay on when this manager is lost, and nothing lets them go; "
            "say why that is acceptable here with `accept_latching: ...`, or use `access: monitor`"
        )
        yield Problem((*key, "access"), message)


def _group(key: Key, lift: Lift, source: RegisterMap) -> Iterator[Problem]:
    unguarded = [
        name
        for name, command in source.commands.items()
        if name in CALLS and name != "go" and not _INDEPENDENCE_FLAGS & set(command.requires)
    ]
    if lift.group is not None and unguarded:
        message = (
            f"{lift.group} may send this car elsewhere while a robot waits for it or rides in it, and {', '.join(unguarded)} of {source.name} "
            "does not check whether the car is taken out of the group; where the controller can do that, add "
            f"`requires: [robot_mode_on]` (or `independent`) to {', '.join(unguarded)} under `override: commands`, else use `access: monitor`"
        )
        yield Problem((*key, "access"), message)
