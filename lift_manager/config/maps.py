"""Loads and compiles the maps of a site, with the changes of the site file for each lift."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lift_manager.config.site import Site, is_parameter_value
from register_maps.codec import Codec, compile_map
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.schema import RegisterMap
from register_maps.source import KeyPath, Source
from register_maps.words import Table


@dataclass(slots=True)
class Maps:
    """All maps that a site file names, as far as they could be read."""

    lifts: dict[str, LoadedMap] = field(default_factory=dict)
    """By lift, with the changes of the site."""
    unchanged: dict[str, LoadedMap] = field(default_factory=dict)
    """By lift, if its changes have mistakes: the map without the changes."""
    spare: dict[str, LoadedMap] = field(default_factory=dict)
    """By controller, if no lift uses it."""
    findings: list[Finding] = field(default_factory=list)
    """Mistakes of a map, located in its own file, and of the changes, located in the site file."""


def load_maps(source: Source, base: Path) -> Maps:
    """Load the map of every lift; works on the raw file, which may not be valid yet, and whose number keys are still numbers."""
    named = dict(_named_maps(source.data))
    found = Maps()
    unchanged_maps = _UnchangedMaps(source, base, named)
    used: set[str] = set()
    for name, lift in tables(source.data, "lifts"):
        controller = lift.get("controller")
        if not isinstance(controller, str) or controller not in named:
            continue
        used.add(controller)
        changes = _map_changes(source, name, lift)
        if not changes.are_any:
            if (loaded := unchanged_maps.load(controller, found.findings)) is not None:
                found.lifts[name] = loaded
        elif not _has_unreadable_changes(source, name):
            _load_changed(
                _LiftLocation(source, name, controller, base), named[controller], changes, unchanged_maps, found
            )
    for controller in named.keys() - used:
        if (loaded := unchanged_maps.load(controller, found.findings)) is not None:
            found.spare[controller] = loaded
    return found


def compile_maps(site: Site, maps: Mapping[str, RegisterMap]) -> dict[str, Codec]:
    """Compile maps by lift. Lifts with the same map in the same place share one codec: it is most of what a lift would take."""
    compiled: dict[tuple[int, frozenset[tuple[Table, int]]], Codec] = {}
    found = {}
    for name, source in maps.items():
        offset = site.lifts[name].offset
        place = id(source), frozenset(offset.items())
        if place not in compiled:
            compiled[place] = compile_map(source, offset=offset)
        found[name] = compiled[place]
    return found


def tables(data: object, key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the tables under a key, by name, as far as the file has them."""
    table = data.get(key) if isinstance(data, dict) else None
    for name, item in table.items() if isinstance(table, dict) else ():
        if isinstance(item, dict):
            yield name, item


def is_value_table(path: KeyPath) -> bool:
    """Whether the keys of a table may be numbers: the codes and positions of a signal that a lift overrides."""
    return (
        len(path) == 6
        and (path[0], *path[2:4]) == ("lifts", "override", "signals")
        and path[5] in ("values", "positions")
    )


@dataclass(frozen=True, slots=True)
class _LiftLocation:
    source: Source
    lift: str
    controller: str
    base: Path


class _UnchangedMaps:
    """Maps without changes, each read once."""

    def __init__(self, source: Source, base: Path, named: dict[str, str]) -> None:
        self._source = source
        self._near = base
        self._named = named
        self._read: dict[str, LoadedMap | tuple[Finding, ...]] = {}
        """By the name or path that controllers give; many controllers share a map."""

    def load(self, controller: str, findings: list[Finding]) -> LoadedMap | None:
        """Return the map of a controller; if it has mistakes, add them to `findings`."""
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
        return tuple(_as_site_finding(self._source, controller, finding) for finding in read)


def _load_changed(
    place: _LiftLocation, named: str, changes: MapChanges, unchanged_maps: _UnchangedMaps, found: Maps
) -> None:
    try:
        found.lifts[place.lift] = load(named, near=place.base, changes=changes)
    except MapFileError as error:
        known = unchanged_maps.known(place.controller)
        if isinstance(known, LoadedMap):
            found.unchanged[place.lift] = known
        for finding in _findings_of_changes(place, named, changes, error, known):
            if finding not in found.findings:
                found.findings.append(finding)


def _findings_of_changes(
    place: _LiftLocation, named: str, changes: MapChanges, error: MapFileError, known: LoadedMap | tuple[Finding, ...]
) -> Iterator[Finding]:
    """Locate mistakes that a map has only with the changes of the site at these changes."""
    misfits = list(_parameter_findings(place, changes, known)) if isinstance(known, LoadedMap) else []
    yield from misfits
    known_findings = () if isinstance(known, LoadedMap) else known
    unset = isinstance(known, LoadedMap) and not changes.parameters.keys() >= set(known.unset)
    for finding in (_as_site_finding(place.source, place.controller, finding) for finding in error.findings):
        if finding.file == place.source.file or finding in known_findings:
            yield finding
        elif not misfits and not unset:  # otherwise it may be a consequence of a wrong or missing value
            message = f"with this, {finding.key} of {named} is wrong: {finding.message}"
            yield place.source.finding(("lifts", place.lift, *_cause(changes, finding)), message)


def _parameter_findings(place: _LiftLocation, changes: MapChanges, known: LoadedMap) -> Iterator[Finding]:
    """Yield parameters out of range, with the messages of the map check, which does not run if they leave no valid map."""
    for name, value in changes.parameters.items():
        parameter = known.map.parameters.get(name)
        if parameter is not None and (problem := parameter.find_problem(value)) is not None:
            yield place.source.finding(("lifts", place.lift, "parameters", name), f"{problem} ({parameter.help})")


def _as_site_finding(source: Source, controller: str, finding: Finding) -> Finding:
    """Return a finding of a map as it is, but locate a missing map in the site file."""
    if finding.line is not None:
        return finding
    return source.finding(("controllers", controller, "map"), f"{finding.file}: {finding.message}")


def _cause(changes: MapChanges, finding: Finding) -> KeyPath:
    words = set(re.findall(r"[\w.]*\w", finding.message))
    for section, change in changes.override.items():
        for name in change if isinstance(change, dict) else ():
            if str(name) in words:
                return ("override", section, name)
    if changes.parameters:
        return ("parameters", *(changes.parameters if len(changes.parameters) == 1 else ()))
    return ("override",)


def _map_changes(source: Source, lift: str, lift_table: dict[str, Any]) -> MapChanges:
    parameters, override = lift_table.get("parameters"), lift_table.get("override")
    return MapChanges(
        {name: value for name, value in parameters.items() if is_parameter_value(value)}
        if isinstance(parameters, dict)
        else {},
        override if isinstance(override, dict) else {},
        lambda path, message: source.finding(("lifts", lift, *path), message),
    )


def _has_unreadable_changes(source: Source, lift: str) -> bool:
    """Whether a value of the changes could not be read; findings about its substitute would be misleading."""
    return any(path[:2] == ("lifts", lift) and path[2:3] in (("parameters",), ("override",)) for path in source.spoiled)


def _named_maps(data: object) -> Iterator[tuple[str, str]]:
    for name, controller in tables(data, "controllers"):
        if isinstance(named := controller.get("map"), str) and named:
            yield name, named
