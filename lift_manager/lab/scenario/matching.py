"""Matches, which select entries of a trace. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.scenario.trace import Entry, Value
from lift_manager.lab.scenario.vocabulary import KINDS, LISTS, Field, ValueType
from register_maps.error_texts import closest
from register_maps.source import KeyPath

COMPARISONS = ("above", "below", "contains", "not")
"""Keys that a field may have instead of a value."""

_SORTS = {ValueType.FLAG: "true or false", ValueType.NUMBER: "a number"}


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition on one field; all of its parts must hold."""

    any_of: tuple[Value, ...] | None = None
    none_of: tuple[Value, ...] | None = None
    above: float | None = None
    below: float | None = None
    contains: str | None = None

    def holds(self, value: Value) -> bool:
        """Whether a value meets the condition; of a field with several values, whether one of them does."""
        values: tuple[Value, ...] = (value or (None,)) if isinstance(value, tuple) else (value,)
        if self.any_of is not None and not any(one in self.any_of for one in values):
            return False
        if self.none_of is not None and any(one in self.none_of for one in values):
            return False
        if self.contains is not None and not (isinstance(value, str) and self.contains in value):
            return False
        return self._is_between(value)

    def _is_between(self, value: Value) -> bool:
        if self.above is None and self.below is None:
            return True
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return (self.above is None or value > self.above) and (self.below is None or value < self.below)

    def __str__(self) -> str:
        parts = [
            "" if self.any_of is None else " or ".join(map(_shown, self.any_of)),
            "" if self.none_of is None else "not " + " or ".join(map(_shown, self.none_of)),
            "" if self.above is None else f"above {self.above:g}",
            "" if self.below is None else f"below {self.below:g}",
            "" if self.contains is None else f"with {self.contains!r}",
        ]
        return " and ".join(part for part in parts if part)


@dataclass(frozen=True, slots=True)
class Match:
    """Selects the entries of one kind whose fields meet all conditions."""

    kind: str
    conditions: Mapping[str, Condition]

    @property
    def lasts(self) -> bool:
        """Whether its kind of entry holds for a time."""
        return KINDS[self.kind].lasts

    def fits(self, entry: Entry) -> bool:
        """Whether an entry is selected."""
        if entry.kind != self.kind:
            return False
        return all(condition.holds(entry.fields[name]) for name, condition in self.conditions.items())

    def __str__(self) -> str:
        return " ".join(
            [self.kind, ", ".join(f"{name} {condition}" for name, condition in self.conditions.items())]
        ).strip()


def read_match(raw: object, path: KeyPath, mistakes: Mistakes, floors: tuple[str, ...] | None) -> Match | None:
    """Read a match from a file; None if it has mistakes. `floors` are those of its lift, if they are known."""
    if not isinstance(raw, dict):
        mistakes.add(path, "must be a match, such as {kind: state, robot_door: open}")
        return None
    kind = raw.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        there = f"; there is {', '.join(KINDS)}"
        hint = (closest(kind, KINDS) if isinstance(kind, str) else "") or there
        if "kind" in raw:
            mistakes.add((*path, "kind"), f"must be a kind of entry, not {kind!r}{hint}")
        else:
            mistakes.add(path, f"must name a `kind` of entry{there}")
        return None
    fields, before = KINDS[kind].fields, len(mistakes.findings)
    conditions = {}
    for name, value in raw.items():
        if name == "kind":
            continue
        if name not in fields:
            hint = closest(str(name), fields) or f"; it has {', '.join(fields)}"
            mistakes.add((*path, name), f"{kind} has no such field{hint}")
            continue
        conditions[str(name)] = _condition(value, (*path, name), _Reading(fields[name], mistakes, floors))
    return Match(kind, conditions) if len(mistakes.findings) == before else None


@dataclass(frozen=True, slots=True)
class _Reading:
    field: Field
    mistakes: Mistakes
    floors: tuple[str, ...] | None

    def values(self, raw: object, path: KeyPath) -> tuple[Value, ...]:
        if isinstance(raw, list):
            if not raw:
                self.mistakes.add(path, "an empty list matches nothing; `null` matches a field without a value")
            return tuple(self.value(item, (*path, index)) for index, item in enumerate(raw))
        return (self.value(raw, path),)

    def value(self, raw: object, path: KeyPath) -> Value:
        """Return one value; add what is wrong with it to the mistakes."""
        sort, words = self.field.sort, self.field.words
        if raw is None:
            return None
        if sort in _SORTS:
            is_right = isinstance(raw, bool) if sort is ValueType.FLAG else _is_number(raw)
            if not is_right:
                self.mistakes.add(path, f"must be {_SORTS[sort]}, not {raw!r}")
            return raw if isinstance(raw, bool | int | float) else None
        if not isinstance(raw, str):
            self.mistakes.add(path, f'must be text, not {raw!r}; quote it: "{raw}"')
            return None
        if sort is ValueType.WORD and raw not in words:
            self.mistakes.add(path, f"must be one of {', '.join(words)}, not {raw!r}{closest(raw, words)}")
        if sort in (ValueType.FLOOR, ValueType.FLOORS) and self.floors is not None and raw not in self.floors:
            self.mistakes.add(path, f"no floor {raw!r}; there is {', '.join(self.floors)}")
        return raw


def _condition(raw: object, path: KeyPath, reading: _Reading) -> Condition:
    if not isinstance(raw, dict):
        return Condition(any_of=reading.values(raw, path))
    if not raw:
        reading.mistakes.add(path, f"must have one of {', '.join(COMPARISONS)}")
    found: dict[str, Any] = {}
    for name, value in raw.items():
        here = (*path, name)
        if name not in COMPARISONS:
            reading.mistakes.add(here, f"is not a comparison; there is {', '.join(COMPARISONS)}")
        elif name == "not":
            found["none_of"] = reading.values(value, here)
        elif name == "contains":
            found["contains"] = _contained(value, here, reading)
        else:
            found[str(name)] = _bound(value, here, reading)
    return Condition(**found)


def _contained(raw: object, path: KeyPath, reading: _Reading) -> str:
    if reading.field.sort is not ValueType.TEXT:
        many = "; a list matches when one of its entries does" if reading.field.sort in LISTS else ""
        reading.mistakes.add(path, f"only text contains something, and this is {reading.field.sort}{many}")
    if not isinstance(raw, str) or not raw:
        reading.mistakes.add(path, "must be the text to look for")
    return str(raw)


def _bound(raw: object, path: KeyPath, reading: _Reading) -> float:
    if reading.field.sort is not ValueType.NUMBER:
        reading.mistakes.add(path, f"only numbers are above or below, and this is {reading.field.sort}")
    if not _is_number(raw):
        reading.mistakes.add(path, f"must be a number, not {raw!r}")
    return float(raw) if isinstance(raw, int | float) else 0.0


def _is_number(raw: object) -> bool:
    return isinstance(raw, int | float) and not isinstance(raw, bool)


def _shown(value: Value) -> str:
    if value is None:
        return "nothing"
    return str(value).lower() if isinstance(value, bool) else str(value)
