"""Every example is a scenario that is as it says."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from lift_manager.lab.scenario.load import load_scenario
from lift_manager.lab.scenario.play import ScenarioResult, play
from lift_manager.lab.scenario.verdict import lines, verdict_of
from lift_manager.lab.scenario.vocabulary import KINDS
from tests.lift_manager.lab.scenario.scenario_files import EXAMPLES
from tests.support.rows import each_row

FILES = sorted(EXAMPLES.glob("*.yaml"))


def test_there_are_examples() -> None:
    assert len(FILES) >= 6


@cache
def run_of(path: Path) -> ScenarioResult:
    """An example as it is played, once for everybody who asks."""
    return play(load_scenario(path))


@each_row("path", FILES)
def test_an_example_is_as_it_says(path: Path) -> None:
    verdict = verdict_of(run_of(path))
    assert verdict.ok, "\n".join(lines(verdict))
    assert verdict.invitations > 0
    # what a foreign writer presses in an example is on for as long as it presses
    assert all("foreign_writer" in line for line in verdict.undetectable)


@each_row("path", FILES)
def test_an_example_says_what_it_is_about_and_names_its_schema(path: Path) -> None:
    first, about, *rest = path.read_text().splitlines()
    assert first == "# yaml-language-server: $schema=../../lift_manager/lab/scenario/scenario.schema.json"
    assert about.startswith("# ")
    assert about.endswith(".")
    assert 10 <= len(rest) <= 40


def kinds() -> Iterator[str]:
    for path in FILES:
        loaded = load_scenario(path)
        yield from (step.action for step in loaded.steps)
        yield from (type(expected.demand).__name__ for expected in loaded.expected)


def test_the_examples_together_show_what_there_is() -> None:
    assert {"robot", "fault", "wire", "people", "inputs", "acknowledge"} <= set(kinds())
    assert {"Never", "Eventually", "Ordered", "Count"} <= set(kinds())


@each_row("path", FILES)
def test_every_word_in_a_trace_is_in_the_vocabulary(path: Path) -> None:
    for entry in run_of(path).trace:
        for field, value in entry.fields.items():
            words = KINDS[entry.kind].fields[field].words
            assert not words or value is None or value in words, (entry, field)
