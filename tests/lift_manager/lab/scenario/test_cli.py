"""`lift-manager scenario run`: what it prints, what it writes, and how it exits."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lift_manager.cli.main import app
from tests.lift_manager.lab.scenario.scenario_files import EXAMPLES, HEAD, text_of

GOOD = text_of(expect="  - {eventually: {kind: state, quality: live}, within_s: 5}\n", head=HEAD.replace("60", "10"))
FAILS = text_of(
    expect="""\
  - never: {kind: request}
    because: nobody should ask
  - {eventually: {kind: state, mode: fire}}
""",
    head=HEAD.replace("60", "10"),
)


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str


def call(*words: str | Path) -> Done:
    result = CliRunner().invoke(app, ["scenario", "run", *map(str, words)], env={"COLUMNS": "100", "TERM": "dumb"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return Done(result.exit_code, result.stdout, result.stderr)


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    return path


@pytest.fixture
def fails(tmp_path: Path) -> Path:
    path = tmp_path / "fails.yaml"
    path.write_text(FAILS)
    return path


def test_what_is_as_expected_exits_with_0(good: Path) -> None:
    done = call(good)
    assert (done.code, done.err) == (0, "")
    head, expectation, judge = done.out.splitlines()
    assert head.startswith(f"{good}: A test (seed 0, 10 s, ")
    assert expectation.startswith("  ok      line 8: eventually state quality live, within 5 s: at ")
    assert judge.startswith("  ok      judge: compared ")


def test_what_is_not_as_expected_exits_with_1_and_shows_where(fails: Path) -> None:
    done = call(fails)
    assert done.code == 1
    lines = [line.strip() for line in done.out.splitlines()]
    assert lines[1:4] == ["FAILED  line 8: never request", "it happened at 1.000 s", "because: nobody should ask"]
    (marked,) = [line for line in lines if line.startswith(">")]
    assert marked.startswith(">     1.000 s  request  holder workshop, floor L1, door open, accepted")
    assert "FAILED  line 10: eventually state mode fire" in lines
    assert "it did not happen at 10.000 s" in lines


def test_a_file_with_mistakes_exits_with_2_before_anything_is_played(good: Path, tmp_path: Path) -> None:
    bad, worse = tmp_path / "bad.yaml", tmp_path / "worse.yaml"
    bad.write_text(GOOD.replace("quality: live", "qualty: live"))
    worse.write_text(GOOD.replace("generic-registers", "generic-register"))
    done = call(good, bad, worse, tmp_path / "none.yaml")
    assert (done.code, done.out) == (2, "")
    assert f"{bad}:8: expect[0].eventually.qualty: state has no such field; did you mean `quality`?" in done.err
    assert f"{worse}:3: map: generic-register: no map has this name" in done.err
    assert f"{tmp_path / 'none.yaml'}: there is no such file" in done.err
    assert done.err.endswith("3 mistakes\n")


def test_several_files_have_a_line_each_and_a_sum(good: Path, fails: Path) -> None:
    done = call(good, fails)
    assert done.code == 1
    assert done.out.splitlines()[-3:] == [
        f"ok      {good}: A test",
        f"FAILED  {fails}: A test (2 failed)",
        "2 scenarios, 1 failed",
    ]
    assert call(good, good).out.splitlines()[-1] == "2 scenarios, all ok"


def test_json_is_for_programs(good: Path, fails: Path) -> None:
    done = call("--json", good, fails)
    found = json.loads(done.out)
    assert (done.code, found["ok"]) == (1, False)
    assert [one["ok"] for one in found["scenarios"]] == [True, False]
    never, eventually = found["scenarios"][1]["expectations"]
    assert (never["line"], never["at_s"], never["because"]) == (8, 1.0, "nobody should ask")
    assert (eventually["ok"], eventually["at_s"]) == (False, 10.0)


def test_the_trace_is_written_an_entry_a_line(good: Path, tmp_path: Path) -> None:
    path = tmp_path / "trace.jsonl"
    assert call(good, "--trace", path).code == 0
    entries = [json.loads(line) for line in path.read_text().splitlines()]
    times = [entry["at_s"] for entry in entries]
    assert times == sorted(times)
    assert {"truth", "state", "request"} <= {entry["kind"] for entry in entries}
    assert all(entry["lift"] == "lift" for entry in entries)


def test_a_trace_is_of_one_scenario_and_of_a_place_that_can_be_written(good: Path, tmp_path: Path) -> None:
    assert call(good, good, "--trace", tmp_path / "trace.jsonl").code == 2
    done = call(good, "--trace", tmp_path / "none" / "trace.jsonl")
    assert done.code == 1
    assert "cannot be written" in done.err


def test_a_seed_can_be_given(good: Path) -> None:
    assert "(seed 12, 10 s, " in call(good, "--seed", "12").out


def test_what_nobody_can_see_is_printed(tmp_path: Path) -> None:
    path = tmp_path / "blind.yaml"
    do = "  - {at: 0, fault: in_mode.fire}\n  - {at: 2, request: {floor: L2}, every_s: 1}\n"
    path.write_text(text_of(do=do, head=HEAD.replace("generic-registers", "seer-siemens-chengdu").replace("60", "20")))
    done = call(path)
    assert done.code == 0
    assert "excused as undetectable: lift: pressed in a forbidden mode, after in_mode.fire: " in done.out


def test_a_site_that_cannot_be_simulated_is_a_mistake(tmp_path: Path) -> None:
    lift = "{controller: plc, floors: {G: 1, U: 2}}"
    site = "schema: 1\nname: Two\ncontrollers:\n  plc: {host: 192.0.2.1, map: generic-registers}\nlifts:\n"
    (tmp_path / "site.yaml").write_text(f"{site}  a: {lift}\n  b: {lift}\n")
    path = tmp_path / "scenario.yaml"
    do = "  - {at: 1, lift: a, fault: overload}\n"
    head = HEAD.replace("map: generic-registers", "site: site.yaml")
    path.write_text(text_of(do=do, expect="  - {never: {kind: alarm}}\n", head=head))
    done = call(path)
    assert done.code == 2
    assert "site: b: unit 1 of plc is another lift already" in done.err


def test_an_example_runs_from_the_command_line() -> None:
    assert call(EXAMPLES / "plain-ride.yaml").code == 0
