"""Before a map is validated: a site's changes are laid over it, and its parameters are filled in. Pure.

Works on plain data as it was read, because a parameter may stand where the schema wants a number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from register_maps import command_schema, signal_schema
from register_maps.errors import Problem
from register_maps.plain import closest

KeyPath = tuple[str | int, ...]
ParameterValue = int | float | str

_USE = re.compile(r"\{(?P<name>[a-z][a-z0-9_]*)(?P<plus>[+-][0-9]+)?\}")
_PLACES = {
    "signals": frozenset(key for keys in signal_schema.PLACE_KEYS for key in keys),
    "commands": frozenset(key for keys in command_schema.PLACE_KEYS + command_schema.READ_KEYS for key in keys),
}
CHANGEABLE = (
    *("signals", "commands", "served", "endpoints", "write_blocks"),
    *("at_floor_evidence", "at_same_floor", "door_opens_within_s", "not_visible"),
)
"""What a site may change of a map. What the device needs of a link is said at its controller."""


@dataclass(frozen=True, slots=True)
class Filled:
    """A map with its parameters in place."""

    data: Any
    values: Mapping[str, ParameterValue]
    """What every parameter is."""
    unset: tuple[str, ...]
    """Parameters without a default that nobody has set: their example stands in."""
    problems: tuple[Problem, ...]


def overlay(data: Any, changes: Mapping[str, Any]) -> Any:
    """Lay a site's changes over a map, key by key; null takes an entry away.

    A signal or command that gets a new place loses its old one. A signal that is added is no longer missing: it leaves
    `needs`, and `not_visible`.
    """
    if not isinstance(data, dict):
        return data
    merged = dict(data)
    for section, change in changes.items():
        entries = merged.get(section)
        if section in _PLACES and isinstance(entries, dict) and isinstance(change, dict):
            moved = {name: _moved(entries.get(name), entry, _PLACES[section]) for name, entry in change.items()}
            merged[section] = _present(entries | moved)
        elif isinstance(entries, dict) and isinstance(change, dict) and section != "at_floor_evidence":
            merged[section] = _present(entries | change)
        else:
            merged[section] = change
    added = changes.get("signals")
    for section in ("needs", "not_visible"):
        entries = merged.get(section)
        if isinstance(entries, dict) and isinstance(added, dict):
            merged[section] = {name: why for name, why in entries.items() if added.get(name) is None}
    return merged


def fill(data: Any, given: Mapping[str, ParameterValue] | None = None) -> Filled:
    """Put parameters where the map uses them; what `given` leaves out takes its default, else its example."""
    declared = data.get("parameters") if isinstance(data, dict) else None
    table = declared if isinstance(declared, dict) else {}
    values, unset = {}, []
    for name, parameter in table.items():
        about = parameter if isinstance(parameter, dict) else {}
        if given is not None and name in given:
            values[name] = given[name]
        elif about.get("default") is not None:
            values[name] = about["default"]
        else:
            values[name] = about.get("example", 0)
            unset.append(name)
    run = _Run(values)
    filled = data
    if isinstance(data, dict):
        filled = {key: item if key == "parameters" else run.walk((key,), item) for key, item in data.items()}
    run.problems += [
        Problem(("parameters", name), f"nothing in the map uses {{{name}}}; use it, or remove it")
        for name in table
        if name not in run.used
    ]
    return Filled(filled, values, tuple(unset), tuple(run.problems))


@dataclass(slots=True)
class _Run:
    values: Mapping[str, ParameterValue]
    used: set[str] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)

    def walk(self, path: KeyPath, item: Any) -> Any:
        if isinstance(item, dict):
            return {key: self.walk((*path, key), value) for key, value in item.items()}
        if isinstance(item, list):
            return [self.walk((*path, index), value) for index, value in enumerate(item)]
        return self._text(path, item) if isinstance(item, str) else item

    def _text(self, path: KeyPath, text: str) -> ParameterValue:
        alone = _USE.fullmatch(text)
        if alone is not None:
            return self._value(path, alone)
        return _USE.sub(lambda use: str(self._value(path, use)), text)

    def _value(self, path: KeyPath, use: re.Match[str]) -> ParameterValue:
        name, plus = use["name"], use["plus"]
        if name not in self.values:
            self.problems.append(Problem(path, f"the map has no parameter {name}{closest(name, self.values)}"))
            return use[0]
        self.used.add(name)
        value = self.values[name]
        if plus is None:
            return value
        if isinstance(value, str):
            self.problems.append(Problem(path, f"{name} is text, and nothing can be added to it; write {{{name}}}"))
            return value
        return value + int(plus)


def _present(entries: Mapping[Any, Any]) -> dict[Any, Any]:
    return {name: entry for name, entry in entries.items() if entry is not None}


def _moved(before: Any, change: Any, places: frozenset[str]) -> Any:
    if not isinstance(before, dict) or not isinstance(change, dict):
        return change
    kept = {key: item for key, item in before.items() if not (change.keys() & places and key in places)}
    return kept | change
