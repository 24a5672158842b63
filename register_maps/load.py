"""Finds, reads and checks register maps; every mistake names file, line and key."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from register_maps.check import check
from register_maps.check_places import check_served, find_unreadable
from register_maps.draft_7 import draft_7_text
from register_maps.error_texts import closest
from register_maps.errors import Finding, MapFileError, Problem
from register_maps.expand import CHANGEABLE, ParameterValue, fill, find_unused, overlay
from register_maps.meanings import COMMAND_MEANINGS, SIGNAL_MEANINGS
from register_maps.schema import RegisterMap
from register_maps.source import LEFT_OUT, KeyPath, Source, StandIns, read, try_validate

MAPS = Path(__file__).parent / "maps"
"""The shipped maps: the list of supported models."""


@dataclass(frozen=True, slots=True)
class MapChanges:
    """A site's changes of a map: values for its parameters, and entries that override it."""

    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    override: Mapping[str, Any] = field(default_factory=dict)
    finding: Callable[[KeyPath, str], Finding] | None = None
    """Makes a finding in the site's file, for a path under its `parameters` or `override`."""

    @property
    def keys(self) -> tuple[str, ...]:
        """What the site changed, such as `signals.car_floor`."""
        return tuple(
            f"{section}.{name}" if isinstance(change, Mapping) else section
            for section, change in self.override.items()
            for name in (change if isinstance(change, Mapping) else [section])
        )

    @property
    def are_any(self) -> bool:
        """Whether there are any changes."""
        return bool(self.parameters or self.override)


AS_IT_IS = MapChanges()

_HEAD: StandIns = {
    ("name",): "unnamed",
    ("title",): "untitled",
    ("provenance",): {"trust": "template", "sources": ["none"]},
    ("addressing",): {"base": 0},
    ("served",): {},
    ("link",): LEFT_OUT,
    ("at_floor_evidence",): {"kind": "position_stable", "for_s": 1.0},
}
"""Replaces missing or wrong parts of the head, so that the rest is checked as well."""


_IS_SITE = "this is a site file and not a map; check it with `lift-manager check`"


@dataclass(frozen=True, slots=True)
class LoadedMap:
    """A map that has passed every check, and the file it came from."""

    map: RegisterMap
    path: Path
    sha256: str
    """Hash of the file's bytes and the site's changes, by which the journal identifies the map."""
    warnings: tuple[Finding, ...]
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    """The value of every parameter."""
    unset: tuple[str, ...] = ()
    """Parameters that a site must set and this one has not: their example is used."""


def shipped() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.stem for path in MAPS.glob("*.yaml")))


def load(name_or_path: str | Path, *, near: Path | None = None, changes: MapChanges = AS_IT_IS) -> LoadedMap:
    """Load a shipped map by its name, or a file by its path, relative to the folder `near`, with a site's changes.

    Raises MapFileError with every finding.
    """
    path = _find(name_or_path, near or Path())
    source = _ChangedSource.of(read(path, number_keys=_is_value_table), changes)
    if isinstance(source.data, dict) and "lifts" in source.data and "signals" not in source.data:
        raise MapFileError([Finding(str(path), None, "", _IS_SITE)])
    wrong = [
        source.finding(("override", key), _not_changeable(key)) for key in changes.override if key not in CHANGEABLE
    ]
    wrong += [source.finding(problem.path, problem.message) for problem in find_unused(source.data)]
    filled = fill(overlay(source.data, changes.override), changes.parameters)
    source = replace(source, data=filled.data)
    wrong += [source.finding(problem.path, problem.message) for problem in filled.problems]
    tried = try_validate(source, RegisterMap, spare=("signals", "commands"), stand_ins=_stand_ins(source))
    model, findings = tried.model, tried.findings
    if model is None:
        raise MapFileError([*wrong, *findings])
    wrong += [source.finding(("given", name), message) for name, message in _misfits(model, changes.parameters)]
    hidden = find_unreadable(model)
    if hidden and ("addressing",) in tried.replaced:
        raise MapFileError([*wrong, *findings])  # the notation of its addresses is unknown
    model = _without(model, hidden)
    problems = [*hidden, *_certain(_without_stand_ins(check(model), model, tried.replaced), source, model)]
    refused = [source.finding(problem.path, problem.message) for problem in problems if not problem.warning]
    if wrong or findings or refused:
        raise MapFileError([*wrong, *findings, *refused])
    warnings = tuple(source.finding(problem.path, problem.message) for problem in problems)
    return LoadedMap(model, path, _fingerprint(source, changes), warnings, filled.values, filled.unset)


def json_schema() -> str:
    """JSON Schema of a map, draft 7, for editors; the text of register_map.schema.json."""
    schema = RegisterMap.model_json_schema()
    _enumerate(schema["properties"]["signals"], SIGNAL_MEANINGS)
    _enumerate(schema["properties"]["commands"], COMMAND_MEANINGS)
    for name in (
        "signals",
        "commands",
        "served",
        "endpoints",
        "link",
        "write_blocks",
        "at_floor_evidence",
        "watchdog_s",
        "door_opens_within_s",
        "door_closes_within_s",
    ):
        schema["properties"][name] = _or_parameter(schema["properties"][name])
    schema["$defs"] = {
        name: part if name in ("Parameter", "Provenance", "Table") else _or_parameter(part)
        for name, part in schema["$defs"].items()
    }
    return draft_7_text(schema)


def _find(name_or_path: str | Path, near: Path) -> Path:
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or "/" in text or "\\" in text or text.endswith((".yaml", ".yml")):
        return near / name_or_path
    if text in shipped():
        return MAPS / f"{text}.yaml"
    message = f"no map has this name{closest(text, shipped())}; shipped are {', '.join(shipped())}; a file is given by its path, such as ./{text}.yaml"
    raise MapFileError([Finding(text, None, "", message)])


@dataclass(frozen=True, slots=True)
class _ChangedSource(Source):
    """A map's file with a site's changes; reports a finding in the file that contains the mistake."""

    changes: MapChanges = AS_IT_IS

    @classmethod
    def of(cls, source: Source, changes: MapChanges) -> _ChangedSource:
        return cls(**{part.name: getattr(source, part.name) for part in fields(source)}, changes=changes)

    def finding(self, path: KeyPath, message: str) -> Finding:
        elsewhere = self.changes.finding
        if elsewhere is None or not path:
            return Source.finding(self, path, message)
        if path[0] == "given":
            return elsewhere(("parameters", *path[1:]), message)
        if path[0] == "override":
            return elsewhere(path, message)
        change = self.changes.override.get(str(path[0]))
        if change is not None and (not isinstance(change, Mapping) or len(path) < 2 or path[1] in change):
            return elsewhere(("override", *path), message)
        return Source.finding(self, path, message)


def _not_changeable(key: str) -> str:
    return f"a site cannot change {key!r} of a map; it may change {', '.join(CHANGEABLE)}"


def _misfits(model: RegisterMap, given: Mapping[str, ParameterValue]) -> Iterable[tuple[str, str]]:
    """Yield what is wrong with the values a site gave."""
    for name, value in given.items():
        if name not in model.parameters:
            hint = closest(name, model.parameters) or f"; it has {', '.join(model.parameters) or 'none'}"
            yield name, f"{model.name} has no parameter {name}{hint}"
        elif (problem := model.parameters[name].find_problem(value)) is not None:
            yield name, f"{problem} ({model.parameters[name].help})"


def _without(model: RegisterMap, hidden: Iterable[Problem]) -> RegisterMap:
    """Return the map without the parts whose address cannot be parsed, so that the rest can be checked."""
    gone: set[KeyPath] = {problem.path[:2] for problem in hidden}
    if any(path[0] == "arbitration" for path in gone):
        gone |= {("signals", "epoch"), ("signals", "owner")}
    gone |= {("signals", name) for name, basis in model.derived.items() if ("signals", basis) in gone}
    return model.model_copy(
        update={
            "signals": {name: part for name, part in model.signals.items() if ("signals", name) not in gone},
            "commands": {name: part for name, part in model.commands.items() if ("commands", name) not in gone},
            "write_blocks": tuple(
                block for index, block in enumerate(model.write_blocks) if ("write_blocks", index) not in gone
            ),
            "arbitration": None if any(path[0] == "arbitration" for path in gone) else model.arbitration,
        }
    )


def _stand_ins(source: Source) -> StandIns:
    """Return the replacements for missing or wrong parts of the head; a map of another schema is not read at all."""
    has_schema = isinstance(source.data, dict) and "schema" in source.data
    return _HEAD if has_schema else {**_HEAD, ("schema",): 1}


def _without_stand_ins(problems: list[Problem], model: RegisterMap, replaced: Collection[KeyPath]) -> list[Problem]:
    """Return the problems without those that replaced parts may have caused."""
    caused = set(check_served(model)) if ("served",) in replaced else set()
    gone = {str(path[0]) for path in replaced} | ({"write_blocks"} if caused else set())
    return [problem for problem in problems if problem.path[0] not in gone and problem not in caused]


def _fingerprint(source: Source, changes: MapChanges) -> str:
    if not changes.are_any:
        return source.sha256
    changes_text = json.dumps([dict(changes.parameters), dict(changes.override)], sort_keys=True, default=str)
    return hashlib.sha256(f"{source.sha256} {changes_text}".encode()).hexdigest()


def _certain(problems: list[Problem], source: Source, model: RegisterMap) -> list[Problem]:
    """Return the problems that omitted wrong signals and commands cannot have caused."""
    given = source.data if isinstance(source.data, dict) else {}
    left_out = {str(name) for table in ("signals", "commands") for name in given.get(table) or ()}
    left_out -= {*model.signals, *model.commands}
    if "car_position" in left_out and "car_floor" not in model.signals:
        left_out.add("car_floor")
    if not left_out:
        return problems
    named = re.compile(rf"(?<![\w.])({'|'.join(map(re.escape, left_out))})(?![\w.])")
    return [
        problem
        for problem in problems
        if len(problem.path) > 1 and problem.path[0] != "write_blocks" and not named.search(problem.message)
    ]


def _is_value_table(path: KeyPath) -> bool:
    return len(path) == 3 and path[0] == "signals" and path[2] in ("values", "positions")


def _enumerate(table: dict[str, Any], names: Mapping[str, str]) -> None:
    """List the names a table may have, so that an editor completes them."""
    entry = table["additionalProperties"]
    # in draft 7 a `$ref` silences its neighbours, the description among them
    table["properties"] = {name: {"description": about, "allOf": [entry]} for name, about in names.items()}
    table["additionalProperties"] = False


def _or_parameter(node: Any) -> Any:
    """Allow `{name}` wherever a number is expected."""
    if isinstance(node, list):
        return [_or_parameter(item) for item in node]
    if not isinstance(node, Mapping):
        return node
    if node.get("type") in ("integer", "number") or "enum" in node:
        about = {key: node[key] for key in ("default", "description", "title") if key in node}
        rest = {key: item for key, item in node.items() if key not in about}
        return about | {"anyOf": [rest, {"type": "string", "pattern": "^\\{[a-z][a-z0-9_]*([+-][0-9]+)?\\}$"}]}
    return {key: _or_parameter(item) for key, item in node.items()}
