"""Decides which commands from the network the controller acts on. Pure.

A command is present with a value, or absent. Settings of the controller make it ignore one:
a watchdog, robot mode, a button that is stuck, a press without an edge.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from simulator.quick_replace import quick_replace
from simulator.shaft import NEGLIGIBLE_S

if TYPE_CHECKING:
    from simulator.state import Parameters

Given = Mapping[str, int]
"""Commands that are present, by name: the index of the floor for a call, 1 for all others."""


@dataclass(frozen=True, slots=True)
class Level:
    """The history of one command. Seconds are real."""

    value: int | None = None
    """None: at rest."""
    for_s: float = inf
    """How long it has had this value, as far as any setting depends on it."""
    counts: bool = True
    """Whether its press was accepted."""


@dataclass(frozen=True, slots=True)
class TimedHold:
    """A hold that the controller releases after a time. Seconds are real."""

    for_s: float = 0.0
    """Since its press, no longer than its limit."""
    absent_s: float = 0.0
    """The pause between two of its pulses, so far."""


@quick_replace
class NetworkMemory(NamedTuple):
    """The memory of the controller about its network. A tuple, as its `State` is."""

    given: Given = MappingProxyType({})
    """Commands that it acts on."""
    levels: Mapping[str, Level] = MappingProxyType({})
    """Commands whose past a setting depends on; an absent command has been at rest for long enough."""
    timed_holds: Mapping[str, TimedHold] = MappingProxyType({})
    expired: frozenset[str] = frozenset()
    """Holds that the controller has released because their time was over."""
    signs_of_life: int = 0
    silent_s: float = 0.0
    """Since the last sign of life, as far as the watchdog needs to know."""
    tripped: bool = False
    """The watchdog has released a command that is still present."""


def listen(
    memory: NetworkMemory, commands: Given, signs_of_life: int, parameters: Parameters, *, robot_mode: bool
) -> NetworkMemory:
    """Return the memory after one scan; the same object if nothing has changed."""
    limit_s = parameters.hold_watchdog_s
    silent_s = 0.0
    if limit_s is not None and signs_of_life == memory.signs_of_life:
        silent_s = min(memory.silent_s + parameters.scan_s, limit_s)
    alive = limit_s is None or silent_s < limit_s - NEGLIGIBLE_S
    in_mode = robot_mode or parameters.robot_mode_only.isdisjoint(commands)
    if alive and in_mode and commands == memory.given and not (memory.tripped or parameters.times_commands):
        # what counted counts on
        if (signs_of_life, silent_s) == (memory.signs_of_life, memory.silent_s):
            return memory
        return memory._replace(signs_of_life=signs_of_life, silent_s=silent_s)
    levels = _levels(memory.levels, commands, parameters)
    timed_holds = dict(_timed_holds(memory.timed_holds, commands, parameters))
    expired = frozenset(
        name for name, one in timed_holds.items() if one.for_s >= parameters.released_after_s[name] - NEGLIGIBLE_S
    )
    fallen = frozenset() if alive else parameters.watched & commands.keys()
    given = {
        name: value
        for name, value in commands.items()
        if name not in fallen | expired
        and (robot_mode or name not in parameters.robot_mode_only)
        and _is_believed(name, levels.get(name), parameters)
    }
    return NetworkMemory(given, levels, timed_holds, expired, signs_of_life, silent_s, tripped=bool(fallen))


def _timed_holds(
    before: Mapping[str, TimedHold], commands: Given, parameters: Parameters
) -> Iterator[tuple[str, TimedHold]]:
    for name, limit_s in parameters.released_after_s.items():
        past = before.get(name)
        absent_s = 0.0 if name in commands or past is None else past.absent_s + parameters.scan_s
        if past is None and name in commands:
            yield name, TimedHold()
        elif past is not None and absent_s <= parameters.pauses_s.get(name, 0.0):
            yield name, TimedHold(min(past.for_s + parameters.scan_s, limit_s), absent_s)


def _levels(before: Mapping[str, Level], commands: Given, parameters: Parameters) -> Mapping[str, Level]:
    if parameters.needs_edge_s is None and parameters.drops_stuck_button_s is None:
        return {}
    after = {
        name: _next(before.get(name, Level()), commands.get(name), parameters) for name in commands.keys() | before
    }
    return {name: level for name, level in after.items() if level != Level()}


def _next(level: Level, value: int | None, parameters: Parameters) -> Level:
    edge_s = parameters.needs_edge_s or 0.0
    if value == level.value:
        for_s = level.for_s + parameters.scan_s
        if value is None:
            return Level() if for_s >= edge_s - NEGLIGIBLE_S else Level(for_s=for_s)
        return Level(value, min(for_s, parameters.drops_stuck_button_s or 0.0), level.counts)
    if value is None:
        return Level(for_s=parameters.scan_s) if edge_s > parameters.scan_s else Level()
    # a press between two looks may be up to one scan older than it looks
    rested = level.value is None and level.for_s + parameters.scan_s >= edge_s - NEGLIGIBLE_S
    return Level(value, 0.0, counts=parameters.needs_edge_s is None or rested)


def _is_believed(name: str, level: Level | None, parameters: Parameters) -> bool:
    if level is None:
        return True
    limit_s = parameters.drops_stuck_button_s
    stuck = limit_s is not None and name.startswith("hold_door.") and level.for_s >= limit_s - NEGLIGIBLE_S
    return level.counts and not stuck
