"""`lift-manager scenario`: play scenario files in virtual time, and judge the trace."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import fail, print_lines, report_mistakes
from lift_manager.lab.scenario.load import LoadedScenario, load_scenario
from lift_manager.lab.scenario.play import ScenarioResult, play
from lift_manager.lab.scenario.verdict import Verdict, lines, summary, verdict_of
from lift_manager.lab.world.world import WorldError
from register_maps.errors import Finding, MapFileError

app = typer.Typer(no_args_is_help=True)


@app.callback()
def group() -> None:
    """Play faults and people against a simulated site."""


@app.command()
def run(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Scenario files.")],
    *,
    seed: Annotated[int | None, typer.Option(min=0, help="Play with this seed instead of the file's.")] = None,
    trace: Annotated[
        Path | None,
        typer.Option(metavar="FILE.jsonl", help="Write the whole trace, an entry a line; for one scenario."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for other programs.")] = False,
) -> None:
    """Play scenarios, and judge the outcome.

    Takes no real time. Exits 1 if an expectation fails, and 2 if a file has mistakes.

    Example: lift-manager scenario run examples/scenarios/fire-while-waiting.yaml
    """
    if trace is not None and len(files) > 1:
        raise typer.BadParameter("a trace is of one scenario; give one file", param_hint="--trace")
    for name in ("lift_manager", "drivers"):  # their log is part of the trace
        logging.getLogger(name).addHandler(logging.NullHandler())
    verdicts = []
    for loaded in _load_all(files):
        result = _play(loaded, seed)
        if trace is not None:
            _write_trace(trace, result)
        verdicts.append(verdict_of(result))
        if not as_json:
            print_lines(lines(verdicts[-1]))
    ok = all(verdict.ok for verdict in verdicts)
    if as_json:
        print_lines([json.dumps({"ok": ok, "scenarios": [asdict(verdict) for verdict in verdicts]}, indent=2)])
    elif len(verdicts) > 1:
        print_lines(_summary_lines(verdicts))
    if not ok:
        raise typer.Exit(1)


def _load_all(files: list[Path]) -> list[LoadedScenario]:
    """Read every file before any is played; the mistakes of all of them are reported together."""
    loaded, findings = [], list[Finding]()
    for file in files:
        try:
            loaded.append(load_scenario(file))
        except MapFileError as error:
            findings += error.findings
    if findings:
        raise report_mistakes(MapFileError(findings))
    return loaded


def _play(loaded: LoadedScenario, seed: int | None) -> ScenarioResult:
    try:
        return play(loaded, seed=seed)
    except WorldError as error:
        raise report_mistakes(MapFileError([Finding(str(loaded.path), None, "site", str(error))])) from error


def _write_trace(trace: Path, result: ScenarioResult) -> None:
    try:
        trace.write_text("".join(f"{entry.as_json()}\n" for entry in result.trace), encoding="utf-8")
    except OSError as error:
        raise fail(f"{trace}: cannot be written: {error.strerror or error}") from error


def _summary_lines(verdicts: list[Verdict]) -> list[str]:
    failed = sum(not verdict.ok for verdict in verdicts)
    return [
        "",
        *map(summary, verdicts),
        f"{len(verdicts)} scenarios, {failed} failed" if failed else f"{len(verdicts)} scenarios, all ok",
    ]
