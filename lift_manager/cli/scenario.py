"""`lift-manager scenario`: play what a file says on virtual time, and judge the trace."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import fail, refused, say
from lift_manager.lab.scenario.load import LoadedScenario, load_scenario
from lift_manager.lab.scenario.play import ScenarioResult, play
from lift_manager.lab.scenario.verdict import Verdict, lines, summary, verdict_of
from lift_manager.lab.world.world import WorldError
from register_maps.errors import Finding, MapFileError

app = typer.Typer(
    no_args_is_help=True, help="Play requests, faults and people against a simulated site, and judge what comes of it."
)


@app.callback()
def group() -> None:
    """Play requests, faults and people against a simulated site, and judge what comes of it."""


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
    """Play scenarios; exits 1 if an expectation fails, and 2 if a file has mistakes. Takes no real time."""
    if trace is not None and len(files) > 1:
        raise typer.BadParameter("a trace is of one scenario; give one file", param_hint="--trace")
    for name in ("lift_manager", "drivers"):  # what they tell a log is in the trace
        logging.getLogger(name).addHandler(logging.NullHandler())
    verdicts = []
    for loaded in _loaded(files):
        played = _played(loaded, seed)
        if trace is not None:
            _write(trace, played)
        verdicts.append(verdict_of(played))
        if not as_json:
            say(lines(verdicts[-1]))
    ok = all(verdict.ok for verdict in verdicts)
    if as_json:
        say([json.dumps({"ok": ok, "scenarios": [asdict(verdict) for verdict in verdicts]}, indent=2)])
    elif len(verdicts) > 1:
        say(_sum(verdicts))
    if not ok:
        raise typer.Exit(1)


def _loaded(files: list[Path]) -> list[LoadedScenario]:
    """Read every file before any is played; mistakes of all of them are told at once."""
    loaded, findings = [], list[Finding]()
    for file in files:
        try:
            loaded.append(load_scenario(file))
        except MapFileError as error:
            findings += error.findings
    if findings:
        raise refused(MapFileError(findings))
    return loaded


def _played(loaded: LoadedScenario, seed: int | None) -> ScenarioResult:
    try:
        return play(loaded, seed=seed)
    except WorldError as error:
        raise refused(MapFileError([Finding(str(loaded.path), None, "site", str(error))])) from error


def _write(trace: Path, played: ScenarioResult) -> None:
    try:
        trace.write_text("".join(f"{entry.as_json()}\n" for entry in played.trace), encoding="utf-8")
    except OSError as error:
        raise fail(f"{trace}: cannot be written: {error.strerror or error}") from error


def _sum(verdicts: list[Verdict]) -> list[str]:
    failed = sum(not verdict.ok for verdict in verdicts)
    return [
        "",
        *map(summary, verdicts),
        f"{len(verdicts)} scenarios, {failed} failed" if failed else f"{len(verdicts)} scenarios, all ok",
    ]
