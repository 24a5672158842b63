"""Finding and reading a register map; every mistake names file, line and key."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from register_maps.check import Problem, check
from register_maps.errors import Finding, MapFileError
from register_maps.plain import closest
from register_maps.schema import COMMANDS, SIGNALS, RegisterMap
from register_maps.source import KeyPath, Source, read, try_validate

MAPS = Path(__file__).parent / "maps"
"""The shipped maps; what lies here is the list of supported models."""


@dataclass(frozen=True, slots=True)
class LoadedMap:
    """A map that has passed every check, and the file it came from."""

    map: RegisterMap
    path: Path
    sha256: str
    """Of the file's bytes: what a checkout record is about."""
    warnings: tuple[Finding, ...]


def shipped() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.stem for path in MAPS.glob("*.yaml")))


def load(name_or_path: str | Path, *, near: Path | None = None) -> LoadedMap:
    """Load a shipped map by its name, or a file by its path, relative to the folder `near`.

    Raises MapFileError with every finding.
    """
    path = _find(name_or_path, near or Path())
    source = read(path, number_keys=_is_value_table)
    model, findings = try_validate(source, RegisterMap, spare=("signals", "commands"))
    if model is None:
        raise MapFileError(findings)
    problems = _certain(check(model), source, model)
    refused = [source.finding(problem.path, problem.message) for problem in problems if not problem.warning]
    if findings or refused:
        raise MapFileError([*findings, *refused])
    warnings = tuple(source.finding(problem.path, problem.message) for problem in problems)
    return LoadedMap(model, path, source.sha256, warnings)


def json_schema() -> str:
    """JSON Schema of a map, draft 7, for editors; the text of register_map.schema.json."""
    schema = RegisterMap.model_json_schema()
    _enumerate(schema["properties"]["signals"], {name: f"A {kind} signal." for name, kind in SIGNALS.items()})
    _enumerate(schema["properties"]["commands"], dict.fromkeys(COMMANDS, "A command."))
    old = {"$schema": "http://json-schema.org/draft-07/schema#", **_draft_7(schema)}
    return json.dumps(old, indent=2) + "\n"


def _find(name_or_path: str | Path, near: Path) -> Path:
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or "/" in text or "\\" in text or text.endswith((".yaml", ".yml")):
        return near / name_or_path
    if text in shipped():
        return MAPS / f"{text}.yaml"
    message = f"no map has this name{closest(text, shipped())}; shipped are {', '.join(shipped())}; a file is given by its path, such as ./{text}.yaml"
    raise MapFileError([Finding(text, None, "", message)])


def _certain(problems: list[Problem], source: Source, model: RegisterMap) -> list[Problem]:
    """Keep the problems that cannot come from signals and commands that were left out because they are wrong themselves."""
    given = source.data if isinstance(source.data, dict) else {}
    left_out = {str(name) for table in ("signals", "commands") for name in given.get(table) or ()}
    left_out -= {*model.signals, *model.commands}
    if not left_out:
        return problems
    named = re.compile(rf"(?<![\w.])({'|'.join(map(re.escape, left_out))})(?![\w.])")
    return [
        problem
        for problem in problems
        if len(problem.path) > 1 and problem.path[0] != "write_blocks" and not named.search(problem.message)
    ]


def _is_value_table(path: KeyPath) -> bool:
    return len(path) == 3 and path[0] == "signals" and path[2] == "values"


def _enumerate(table: dict[str, Any], names: Mapping[str, str]) -> None:
    """List the names a table may have, so that an editor completes them."""
    entry = table["additionalProperties"]
    # in draft 7 a `$ref` silences its neighbours, the description among them
    table["properties"] = {name: {"description": about, "allOf": [entry]} for name, about in names.items()}
    table["additionalProperties"] = False


def _draft_7(node: Any) -> Any:
    """Say the same in the older words: `definitions` for `$defs`, `items` and `additionalItems` for `prefixItems`."""
    if isinstance(node, list):
        return [_draft_7(item) for item in node]
    if not isinstance(node, Mapping):
        return node.replace("#/$defs/", "#/definitions/") if isinstance(node, str) else node
    new = {{"$defs": "definitions", "prefixItems": "items"}.get(key, key): _draft_7(item) for key, item in node.items()}
    if "prefixItems" in node:
        new["additionalItems"] = False
    return new
