"""The maps of a site: read once for each lift, with what the site file says about them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lift_manager.config.site import is_parameter_value
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.source import KeyPath, Source


@dataclass(slots=True)
class Maps:
    """Every map that a site file names, as far as it could be read."""

    lifts: dict[str, LoadedMap] = field(default_factory=dict)
    """By lift, with the site's changes."""
    unchanged: dict[str, LoadedMap] = field(default_factory=dict)
    """By lift, for those whose changes have mistakes: the map as it is."""
    spare: dict[str, LoadedMap] = field(default_factory=dict)
    """By controller, for those that no lift is on."""
    findings: list[Finding] = field(default_factory=list)
    """Mistakes of a map, at their places in its own file, and of the changes, at theirs in the site file."""


def load_maps(source: Source, near: Path) -> Maps:
    """Load the map of every lift; works on the raw file, for it may not be a site yet, and its number keys are still numbers."""
    named = dict(_named_maps(source.data))
    found = Maps()
    plain = _Plain(source, near, named)
    used: set[str] = set()
    for name, lift in tables(source.data, "lifts"):
        controller = lift.get("controller")
        if not isinstance(controller, str) or controller not in named:
            continue
        used.add(controller)
        changes = _changes(source, name, lift)
        if not changes.are_any:
            if (loaded := plain.load(controller, found.findings)) is not None:
                found.lifts[name] = loaded
        elif not _spoiled(source, name):
            _load_changed(_Place(source, name, controller, near), named[controller], changes, plain, found)
    for controller in named.keys() - used:
        if (loaded := plain.load(controller, found.findings)) is not None:
            found.spare[controller] = loaded
    return found


def tables(data: object, key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the named tables under a key, as far as the file has them."""
    table = data.get(key) if isinstance(data, dict) else None
    for name, item in table.items() if isinstance(table, dict) else ():
        if isinstance(item, dict):
            yield name, item


def is_value_table(path: KeyPath) -> bool:
    """Whether the keys of a table in a site file may be numbers: the codes and positions of a signal that a lift overrides."""
    return (
        len(path) == 6
        and (path[0], *path[2:4]) == ("lifts", "override", "signals")
        and path[5] in ("values", "positions")
    )


@dataclass(frozen=True, slots=True)
class _Place:
    source: Source
    lift: str
    controller: str
    near: Path


class _Plain:
    """Maps as they are, each read once."""

    def __init__(self, source: Source, near: Path, named: dict[str, str]) -> None:
        self._source = source
        self._near = near
        self._named = named
        self._read: dict[str, LoadedMap | tuple[Finding, ...]] = {}
        """By the name or path that controllers give; many controllers are of one sort."""

    def load(self, controller: str, findings: list[Finding]) -> LoadedMap | None:
        """Return the map of a controller; where it has mistakes, they are added to `findings`."""
        known = self.known(controller)
        if isinstance(known, LoadedMap):
            return known
        findings += [finding for finding in known if finding not in findings]
        return None

    def known(self, controller: str) -> LoadedMap | tuple[Finding, ...]:
        named = self._named[controller]
        if named not in self._read:
            try:
                self._read[named] = load(named, near=self._near)
            except MapFileError as error:
                self._read[named] = error.findings
        read = self._read[named]
        if isinstance(read, LoadedMap):
            return read
        return tuple(_at_map_key(self._source, controller, finding) for finding in read)


def _load_changed(place: _Place, named: str, changes: MapChanges, plain: _Plain, found: Maps) -> None:
    try:
        found.lifts[place.lift] = load(named, near=place.near, changes=changes)
    except MapFileError as error:
        known = plain.known(place.controller)
        if isinstance(known, LoadedMap):
            found.unchanged[place.lift] = known
        for finding in _of_changes(place, named, changes, error, known):
            if finding not in found.findings:
                found.findings.append(finding)


def _of_changes(
    place: _Place, named: str, changes: MapChanges, error: MapFileError, known: LoadedMap | tuple[Finding, ...]
) -> Iterator[Finding]:
    """Say a mistake that a map has only under the site's changes where the site makes it."""
    misfits = list(_misfits(place, changes, known)) if isinstance(known, LoadedMap) else []
    yield from misfits
    own = () if isinstance(known, LoadedMap) else known
    unset = isinstance(known, LoadedMap) and not changes.parameters.keys() >= set(known.unset)
    for finding in (_at_map_key(place.source, place.controller, finding) for finding in error.findings):
        if finding.file == place.source.file or finding in own:
            yield finding
        elif not misfits and not unset:  # else it may well be what follows from a value that is wrong, or not there
            message = f"with this, {finding.key} of {named} is wrong: {finding.message}"
            yield place.source.finding(("lifts", place.lift, *_cause(changes, finding)), message)


def _misfits(place: _Place, changes: MapChanges, known: LoadedMap) -> Iterator[Finding]:
    """Yield parameters out of range, in the words of the map's own check: that is silent where they leave no map to check."""
    for name, value in changes.parameters.items():
        about = known.map.parameters.get(name)
        if about is not None and (problem := about.find_problem(value)) is not None:
            yield place.source.finding(("lifts", place.lift, "parameters", name), f"{problem} ({about.help})")


def _at_map_key(source: Source, controller: str, finding: Finding) -> Finding:
    """Findings of a map stay where they are in its file; a map that cannot be found is a mistake of the site file."""
    return source.finding(("controllers", controller, "map"), finding.message) if finding.line is None else finding


def _cause(changes: MapChanges, finding: Finding) -> KeyPath:
    words = set(re.findall(r"[\w.]*\w", finding.message))
    for section, change in changes.override.items():
        for name in change if isinstance(change, dict) else ():
            if str(name) in words:
                return ("override", section, name)
    if changes.parameters:
        return ("parameters", *(changes.parameters if len(changes.parameters) == 1 else ()))
    return ("override",)


def _changes(source: Source, lift: str, said: dict[str, Any]) -> MapChanges:
    parameters, override = said.get("parameters"), said.get("override")
    return MapChanges(
        {name: value for name, value in parameters.items() if is_parameter_value(value)}
        if isinstance(parameters, dict)
        else {},
        override if isinstance(override, dict) else {},
        lambda path, message: source.finding(("lifts", lift, *path), message),
    )


def _spoiled(source: Source, lift: str) -> bool:
    """Whether a value of the changes could not be read: what a map says about its stand-in is nobody's mistake."""
    return any(path[:2] == ("lifts", lift) and path[2:3] in (("parameters",), ("override",)) for path in source.spoiled)


def _named_maps(data: object) -> Iterator[tuple[str, str]]:
    for name, controller in tables(data, "controllers"):
        if isinstance(named := controller.get("map"), str) and named:
            yield name, named
