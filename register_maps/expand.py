"""Applies a site's changes and parameters to a map before validation. Pure.

Works on plain data, because a parameter may stand where the schema requires a number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from register_maps import signal_schema
from register_maps.error_texts import closest
from register_maps.errors import Problem

KeyPath = tuple[str | int, ...]
ParameterValue = int | float | str

_USE = re.compile(r"\{(?P<name>[a-z][a-z0-9_]*)(?P<plus>[+-][0-9]+)?\}")
PlaceForms = tuple[tuple[str, ...], ...]
_PLACES: Mapping[str, PlaceForms] = {
    "signals": signal_schema.PLACE_KEYS,
    # the outputs of a call and their read-back change together
    "commands": (("at", "read_at"), ("one_of", "read_one_of")),
}
_LARGEST = 2**53
"""Chosen: beyond it a number read with a fraction is no longer exact."""
_DIGITS = len(str(_LARGEST))
CHANGEABLE = (
    *("signals", "commands", "served", "endpoints", "write_blocks", "arbitration", "watchdog_s"),
    *("at_floor_evidence", "at_same_floor", "door_opens_within_s", "door_closes_within_s", "not_visible"),
)
"""What a site may change of a map. The needs of the link are set at its controller."""


@dataclass(frozen=True, slots=True)
class ExpandedMap:
    """A map with its parameters filled in."""

    data: Any
    values: Mapping[str, ParameterValue]
    """The value of every parameter."""
    unset: tuple[str, ...]
    """Used parameters without a default and without a value of the site: their example is used."""
    problems: tuple[Problem, ...]


def overlay(data: Any, changes: Mapping[str, Any]) -> Any:
    """Apply a site's changes to a map, key by key; null removes an entry.

    A signal or command that gets a place of another form loses its old place, and a signal its coding too. An added signal is
    removed from `needs` and `not_visible`.
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
    added = added_signals(changes)
    for section in ("needs", "not_visible"):
        entries = merged.get(section)
        if isinstance(entries, dict):
            merged[section] = {name: why for name, why in entries.items() if name not in added}
    return merged


def added_signals(changes: Mapping[str, Any]) -> frozenset[str]:
    """Return the signals that a site adds or changes; a table of positions adds `car_floor` too."""
    signals = changes.get("signals")
    given = {name: entry for name, entry in signals.items() if entry is not None} if isinstance(signals, dict) else {}
    position = given.get("car_position")
    by_position = {"car_floor"} if isinstance(position, dict) and position.get("positions") is not None else set()
    return frozenset(given.keys() | by_position)


def fill(data: Any, given: Mapping[str, ParameterValue] | None = None) -> ExpandedMap:
    """Fill in the parameters of a map: the values in `given`, else the defaults, else the examples."""
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
    return ExpandedMap(filled, values, tuple(name for name in unset if name in run.used), tuple(run.problems))


def find_unused(data: Any) -> list[Problem]:
    """Return the parameters that a map declares and does not use; takes the map without a site's changes."""
    declared = data.get("parameters") if isinstance(data, dict) else None
    names = list(declared) if isinstance(declared, dict) else []
    run = _Run(dict.fromkeys(names, 0))
    run.walk((), {key: item for key, item in data.items() if key != "parameters"} if isinstance(data, dict) else data)
    return [
        Problem(("parameters", name), f"nothing in the map uses {{{name}}}; use it, or remove it")
        for name in names
        if name not in run.used
    ]


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
        return _USE.sub(lambda use: self._within(path, use), text)

    def _within(self, path: KeyPath, use: re.Match[str]) -> str:
        """Insert a value into a text, where a fraction would be read as a bit: `holding:1.5`."""
        value = self._value(path, use)
        if isinstance(value, float) and not value.is_integer():
            self.problems.append(Problem(path, f"{use['name']} is {value:g}, and only a whole number fits in here"))
        return str(int(value)) if isinstance(value, float) else str(value)

    def _value(self, path: KeyPath, use: re.Match[str]) -> ParameterValue:
        name, plus = use["name"], use["plus"]
        if name not in self.values:
            self.problems.append(Problem(path, f"the map has no parameter {name}{closest(name, self.values)}"))
            return use[0]
        self.used.add(name)
        value = self.values[name]
        if not isinstance(value, int | float):
            if plus is not None:
                self.problems.append(Problem(path, f"{name} is text, and nothing can be added to it; write {{{name}}}"))
            return value
        # Python refuses to parse a number of thousands of digits
        result = value if plus is None else value + int(plus[: _DIGITS + 2])
        if not is_usable(result):
            self.problems.append(Problem(path, f"{use[0]} is not a number that can be used; correct {name}"))
            return use[0]
        return result


def is_usable(number: float) -> bool:
    """Whether a number is finite, and exact if it is whole."""
    return abs(number) <= _LARGEST


def _present(entries: Mapping[Any, Any]) -> dict[Any, Any]:
    return {name: entry for name, entry in entries.items() if entry is not None}


def _moved(before: Any, change: Any, forms: PlaceForms) -> Any:
    """Apply a change to one entry. A place of another form replaces the entry with its coding."""
    if not isinstance(before, dict) or not isinstance(change, dict):
        return change
    form = next((keys for keys in forms if any(change.get(key) is not None for key in keys)), ())
    if form and not any(key in before for key in form) and forms is signal_schema.PLACE_KEYS:
        return _present(change)
    old = {key for keys in forms if keys != form for key in keys} if form else set()
    return _present({key: item for key, item in before.items() if key not in old} | change)
