"""The pages about scenarios say what the code does, and every block in them can be used as it stands."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from lift_manager.lab.scenario.editors import json_schema
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE, WIRE_FAULT_KEYS, model_of
from lift_manager.lab.scenario.matching import COMPARISONS
from lift_manager.lab.scenario.play import play
from lift_manager.lab.scenario.schema import Expectation, Inputs, Options, Request, Robot, Scenario, Simulated, Step
from lift_manager.lab.scenario.verdict import verdict_of
from lift_manager.lab.scenario.vocabulary import KINDS, Field
from tests.lift_manager.lab.scenario.scenario_files import HEAD, ROOT, loaded, text_of
from tests.support.pages import blocks
from tests.support.rows import each_row

PAGE = (ROOT / "docs" / "reference" / "scenarios.md").read_text()
FIRST, *_ = blocks(ROOT / "docs" / "how-to" / "fault-testing.md", "yaml")
BLOCKS = blocks(ROOT / "docs" / "reference" / "scenarios.md", "yaml")


def keys_of(section: str) -> list[str]:
    """Return the keys of the first table of a section, several in one row included."""
    body = PAGE.split(f"\n## {section}\n")[1].split("\n## ")[0]
    table = body.split("|---|---|\n")[1].split("\n\n")[0]
    return [key for row in table.splitlines() for key in re.findall(r"`(\w+)`", row.split("|")[1])]


def names_of(model: type[Scenario | Step | Expectation]) -> list[str]:
    return sorted(field.alias or name for name, field in model.model_fields.items())


def test_the_first_scenario_is_one() -> None:
    assert len(FIRST.splitlines()) == 12


def test_the_first_scenario_is_as_it_says(tmp_path: Path) -> None:
    assert verdict_of(play(loaded(tmp_path, FIRST))).ok


def test_every_block_can_be_used_as_it_stands(tmp_path: Path) -> None:
    assert [block.splitlines()[0] for block in BLOCKS] == ["do:", "expect:"]
    for block in BLOCKS:
        name, body = block.split(":\n", 1)
        text = text_of(do=body, head=HEAD) if name == "do" else text_of(expect=body, head=HEAD)
        assert loaded(tmp_path, text).expected


@pytest.mark.parametrize(("section", "model"), [("Keys", Scenario), ("Steps", Step), ("Expectations", Expectation)])
def test_every_key_is_listed_and_no_other(section: str, model: type[Scenario | Step | Expectation]) -> None:
    assert sorted(keys_of(section)) == names_of(model)


@each_row("model", [Options, Simulated, Request, Robot, Inputs])
def test_every_part_of_a_key_is_named(model: type[Options | Simulated | Request | Robot | Inputs]) -> None:
    missing = [name for name, field in model.model_fields.items() if f"`{field.alias or name}`" not in PAGE]
    assert missing == []


def said(field: Field) -> str:
    return ", ".join(f"`{word}`" for word in field.words) if 0 < len(field.words) <= 12 else str(field.sort)


def rows(first: str) -> list[str]:
    table = PAGE.split(f"{first}\n")[1].split("\n", 1)[1].split("\n\n")[0]
    return table.splitlines()


def test_the_table_of_kinds_is_what_a_trace_has() -> None:
    assert rows("| kind | lasts | what |") == [
        f"| `{kind}` | {'until the next' if about.lasts else 'a moment'} | {about.about} |"
        for kind, about in KINDS.items()
    ]


def test_the_table_of_fields_is_what_entries_have() -> None:
    assert rows("| kind | field | what | values |") == [
        f"| `{kind}` | `{name}` | {field.about} | {said(field)} |"
        for kind, about in KINDS.items()
        for name, field in about.fields.items()
    ]


def test_every_fault_is_listed_with_its_values() -> None:
    def listed(kinds: dict[str, type]) -> str:
        told = []
        for name, kind in kinds.items():
            values = ", ".join(f"`{field}`" for field in model_of(kind).model_fields)
            told.append(f"`{name}` ({values})" if values else f"`{name}`")
        return " · ".join(told)

    assert f"`fault:` {listed(dict(DEVICE_FAULTS))}\n" in PAGE
    assert f"`wire:` {listed(dict(WIRE))}\n" in PAGE
    ready = " · ".join(f"`{name}`" for name in READY if name not in DEVICE_FAULTS)
    assert f"By name alone, too: {ready}\n" in PAGE
    assert all(f"`{name}`" in PAGE for name in WIRE_FAULT_KEYS)


def test_every_comparison_is_shown() -> None:
    assert all(f"{{{comparison}: " in PAGE for comparison in COMPARISONS)


def test_the_command_that_writes_the_json_schema_works_as_printed() -> None:
    (line,) = re.findall(r"^    (python -c .*)$", PAGE, re.MULTILINE)
    words = shlex.split(line)
    assert words[3:] == [">", "lift_manager/lab/scenario/scenario.schema.json"]
    command = [sys.executable, *words[1:3]]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=True)
    assert result.stdout == json_schema()
