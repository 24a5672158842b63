"""Scenario files for these tests, and a way to play them."""

from collections.abc import Iterable
from pathlib import Path

from lift_manager.lab.scenario.load import LoadedScenario, load_scenario
from lift_manager.lab.scenario.play import ScenarioResult, play
from lift_manager.lab.scenario.trace import Entry, Value
from lift_manager.lab.scenario.verdict import Verdict, verdict_of

ROOT = Path(__file__).parents[4]
EXAMPLES = ROOT / "examples" / "scenarios"

HEAD = """\
schema: 1
title: A test
map: generic-registers
lasts_s: 60
"""
NOTHING = "  - {at: 1, request: {floor: L1}}\n"
ANYTHING = "  - {eventually: {kind: state}}\n"


def text_of(*, do: str = NOTHING, expect: str = ANYTHING, head: str = HEAD) -> str:
    return f"{head}do:\n{do}expect:\n{expect}"


def loaded(folder: Path, text: str) -> LoadedScenario:
    path = folder / "scenario.yaml"
    path.write_text(text)
    return load_scenario(path)


def played(folder: Path, text: str) -> ScenarioResult:
    return play(loaded(folder, text))


def verdict(folder: Path, text: str) -> Verdict:
    return verdict_of(played(folder, text))


def first(entries: Iterable[Entry], kind: str, **fields: Value) -> float:
    """Return when an entry first says this."""
    for entry in entries:
        if entry.kind == kind and all(entry.fields[name] == value for name, value in fields.items()):
            return entry.at_s
    raise AssertionError(f"no {kind} with {fields}")
