"""The JSON Schema from which editors complete scenario files: in step with the code."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft7Validator

from lift_manager.lab.scenario import editors
from lift_manager.lab.scenario.editors import json_schema
from tests.lift_manager.lab.scenario.scenario_files import EXAMPLES, text_of
from tests.support.rows import each_row

FILE = Path(editors.__file__).parent / "scenario.schema.json"


@cache
def schema() -> Any:
    """What is written; not made where these tests are only collected."""
    return json.loads(json_schema())


def errors_of(text: str) -> list[str]:
    document: Any = json.loads(json.dumps(yaml.safe_load(text)))
    return [error.message for error in Draft7Validator(schema()).iter_errors(document)]


def test_the_file_is_what_the_code_says() -> None:
    assert FILE.read_text() == json_schema(), "write it anew with the command in docs/reference/scenarios.md"


def test_it_is_a_draft_7_schema() -> None:
    Draft7Validator.check_schema(schema())


@each_row("path", sorted(EXAMPLES.glob("*.yaml")))
def test_it_accepts_the_examples(path: Path) -> None:
    assert errors_of(path.read_text()) == []


@each_row(
    "step",
    [
        "{at: 1, fault: stuck_door}",
        "{at: 1, fault: in_mode.fire}",
        "{at: 1, fault: {in_mode: fire}}",
        "{at: 1, wire: {late_answer: {seconds: 0.8}, times: 3, only: {access: reads}}, for_s: 3}",
        "{at: 1, wire: half_open}",
        "{at: 1, people: {}}",
        "{when: {kind: state, floor: [L1, null], age_s: {above: 1}, reason: {contains: answer}}, fault: overload}",
    ],
)
def test_it_accepts_what_the_loader_accepts(step: str) -> None:
    assert errors_of(text_of(do=f"  - {step}\n")) == []


@each_row(
    "step",
    [
        "{at: 1, fault: stuk_door}",
        "{at: 1, fault: {in_mode: normal_}}",
        "{at: 1, fault: {stuck_door: {speed: 1}}}",
        "{at: 1, wire: {late_answer: {secs: 1}}}",
        "{at: 1, wire: {half_open: {}, on: {}}}",
        "{at: 1, people: {per_minut: 3}}",
        "{when: {kind: state, robot_doors: open}, fault: overload}",
        "{when: {kind: state, robot_door: opened}, fault: overload}",
        "{when: {kind: press, floor: {above: 1}}, fault: overload}",
        "{at: 1, robots: 3}",
    ],
)
def test_it_refuses_what_the_loader_refuses(step: str) -> None:
    assert errors_of(text_of(do=f"  - {step}\n")) != []
