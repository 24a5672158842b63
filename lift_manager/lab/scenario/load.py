"""Reads a scenario file with its map or site. Reports every mistake at once, each with file, line and key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from lift_manager.config.check import check_site
from lift_manager.config.load import LoadedSite, load_site
from lift_manager.config.problem import Key
from lift_manager.config.site import Site, is_parameter_value
from lift_manager.lab.plant import default_floors, simulated_lift
from lift_manager.lab.scenario.expectations import ReadyExpectation, read_expectations
from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.scenario.schema import Scenario
from lift_manager.lab.scenario.steps import PlannedStep, read_steps
from lift_manager.lab.scenario.trace import TracedLift
from register_maps.codec import Codec
from register_maps.errors import Finding, MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.source import KeyPath, read, try_validate
from register_maps.vocabulary import HANDSHAKE
from simulator.faults import Fault

LIFT = "lift"
"""The name of the lift in a scenario that names a map."""
CONTROLLER = "controller"
"""The name of the controller of that lift. The endpoints of its map keep their names."""
_IS_SITE = "this is a site file and not a scenario; a scenario names it, as its `site`"
_NOT_WITH_SITE = ("floors", "parameters", "override", "options")


@dataclass(frozen=True)
class LoadedScenario:
    """A checked scenario, ready to be played."""

    path: Path
    scenario: Scenario
    site: LoadedSite
    lifts: dict[str, TracedLift]
    steps: tuple[PlannedStep, ...]
    expected: tuple[ReadyExpectation, ...]


def load_scenario(path: Path) -> LoadedScenario:
    """Read and check a scenario file. Raises MapFileError with all findings."""
    source = read(path, number_keys=_is_value_table)
    if isinstance(source.data, dict) and "controllers" in source.data:
        raise MapFileError([Finding(str(path), None, "", _IS_SITE)])
    tried = try_validate(source, Scenario)
    scenario, found = tried.model, tried.findings
    mistakes = Mistakes(source, list(found))
    site = None if scenario is None else _site(scenario, path.parent, mistakes)
    lifts = {} if site is None else known_lifts(site)
    steps = read_steps(scenario, lifts, mistakes)
    expected = read_expectations(scenario, lifts, mistakes)
    if mistakes.findings or scenario is None or site is None:
        raise MapFileError(mistakes.findings)
    return LoadedScenario(path, scenario, site, lifts, steps, expected)


def known_lifts(site: LoadedSite) -> dict[str, TracedLift]:
    """Return the facts about every lift of a site."""
    found = {}
    for name, spec in site.site.lifts.items():
        codec = site.codecs[name]
        commands = codec.commands
        places = (spec.controller, *(endpoint.controller for endpoint in spec.endpoints.values()))
        found[name] = TracedLift(
            floors=tuple(spec.floors),
            commands=frozenset(commands),
            calls=frozenset(command for command, codec in commands.items() if codec.is_call),
            controllers=tuple(dict.fromkeys(places)),
            objection=partial(_objection, codec, {floor: entry.code for floor, entry in spec.floors.items()}),
        )
    return found


def _objection(codec: Codec, floors: Mapping[str, int], fault: Fault) -> str:
    try:
        simulated_lift(codec, floors).begin(fault, 0.0)
    except ValueError as error:
        return str(error)
    return ""


def _site(scenario: Scenario, near: Path, mistakes: Mistakes) -> LoadedSite | None:
    if (scenario.map is None) == (scenario.site is None):
        mistakes.add((), "must name either a `map`, for one lift, or a `site`")
        return None
    if scenario.site is None:
        return _one_lift(scenario, near, mistakes)
    for key in _NOT_WITH_SITE:
        if key in scenario.model_fields_set:
            mistakes.add((key,), "is set by the site file; remove it here, or name a `map`")
    try:
        return _at_any_hour(load_site(near / scenario.site))
    except MapFileError as error:
        _take_over(("site",), error, mistakes)
        return None


def _at_any_hour(site: LoadedSite) -> LoadedSite:
    """Leave out `robot_hours`: a run that depends on the time of day cannot be repeated."""
    lifts = {name: lift.model_copy(update={"robot_hours": None}) for name, lift in site.site.lifts.items()}
    return replace(site, site=site.site.model_copy(update={"lifts": lifts}))


def _one_lift(scenario: Scenario, near: Path, mistakes: Mistakes) -> LoadedSite | None:
    raw: Any = mistakes.source.data
    given = {name: value for name, value in scenario.parameters.items() if is_parameter_value(value)}
    changes = MapChanges(given, raw.get("override", {}), mistakes.source.finding)
    try:
        loaded = load(str(scenario.map), near=near, changes=changes)
        floors: Mapping[str, object] = scenario.floors or default_floors(loaded.map)
    except MapFileError as error:
        _take_over(("map",), error, mistakes)
        return None
    except ValueError as error:
        mistakes.add(("map",), str(error).replace("--floors", "`floors`"))
        return None
    site = Site.model_validate(_site_of(scenario, loaded, floors))
    problems = check_site(site, {LIFT: loaded}, {}, {})
    for problem in problems:
        mistakes.add(_here(problem.key, scenario), problem.message)
    return None if problems else LoadedSite(site, {LIFT: loaded}, Path(mistakes.source.file))


def _site_of(scenario: Scenario, loaded: LoadedMap, floors: object) -> dict[str, Any]:
    """Return the contents of a site file for one lift. Its addresses lead nowhere."""
    source = loaded.map
    infers = source.needs_occupancy or bool(HANDSHAKE & source.commands.keys())
    lift = {
        "controller": CONTROLLER,
        "access": "control",
        "accept_latching": "the controller is simulated",
        "parameters": scenario.parameters,
        "override": scenario.override,
        "floors": floors,
        "endpoints": {endpoint: {"controller": endpoint} for endpoint in source.endpoints},
        "infer_occupancy": infers,
        **scenario.options.model_dump(exclude_none=True),
    }
    controllers = {CONTROLLER: {"host": "memory", "port": 1, "map": scenario.map}} | {
        endpoint: {"host": "memory", "port": number} for number, endpoint in enumerate(source.endpoints, start=2)
    }
    return {"schema": 1, "name": scenario.title[:64], "controllers": controllers, "lifts": {LIFT: lift}}


def _here(key: Key, scenario: Scenario) -> KeyPath:
    """Return the key of the scenario that set this key of its site."""
    part = key[2:]
    if part[:1] in (("floors",), ("parameters",), ("override",)):
        return part if part[0] in scenario.model_fields_set or part[0] != "floors" else ("map",)
    return ("options", *part) if part and str(part[0]) in scenario.options.model_fields_set else ("map",)


def _take_over(key: KeyPath, error: MapFileError, mistakes: Mistakes) -> None:
    """Add the findings of another file at their own lines. A finding without a line, such as a missing file, is one of this file."""
    for finding in error.findings:
        if finding.line is None:
            mistakes.add(key, f"{finding.file}: {finding.message}")
        else:
            mistakes.findings.append(finding)


def _is_value_table(path: KeyPath) -> bool:
    """Whether the keys of a table may be numbers, as the codes of an overridden signal are."""
    return len(path) == 4 and (*path[:2], path[3]) == ("override", "signals", "values")
