"""Plays a scenario: the whole manager and its simulated lifts on virtual time, watched by the judge."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field

from lift_manager.lab.scenario.load import LoadedScenario
from lift_manager.lab.scenario.schema import Simulated
from lift_manager.lab.scenario.stage import Stage
from lift_manager.lab.scenario.trace import Entry, Recorder
from lift_manager.lab.virtual_time import run_virtual
from lift_manager.lab.world.lift_under_test import Finding
from lift_manager.lab.world.oracle_setup import oracle_of
from lift_manager.lab.world.rules import Rules
from lift_manager.lab.world.world import World, WorldError
from simulator.state import Parameters

AFTER_THE_END_S = 3600.0
"""How long the loop may run after the end, while everything is released."""


@dataclass(slots=True)
class ScenarioResult:
    """The result of playing a scenario."""

    scenario: LoadedScenario
    seed: int
    trace: list[Entry]
    findings: list[Finding]
    """What the judge found."""
    problems: list[str] = field(default_factory=list)
    """Steps that were not carried out."""
    excused: Mapping[tuple[str, str, str], int] = field(default_factory=dict)
    """How often the judge excused a finding, by lift, rule and fault."""
    judged: int = 0
    """How many published states the judge compared with the truth."""
    invitations: int = 0
    """How many of them had an open door for robots."""
    released: bool = False
    """Whether the release of every output was verified at the end."""


def play(loaded: LoadedScenario, *, seed: int | None = None) -> ScenarioResult:
    """Play a scenario to its end. Any crash is a finding. The same seed gives the same trace.

    Raises WorldError for a site that cannot be simulated.
    """
    lasts_s = loaded.scenario.lasts_s
    seed = loaded.scenario.seed if seed is None else seed
    site = loaded.site
    oracle, recorder = oracle_of(site), Recorder(loaded.lifts)
    played = ScenarioResult(loaded, seed, recorder.entries, oracle.findings)

    async def main() -> None:
        settings = {name: _settings(loaded.scenario.simulator) for name in site.site.lifts}
        world = World(site, (oracle, Rules(oracle), recorder), seed=seed, settings=settings)
        async with world.running():
            stage = Stage(world, recorder, seed)
            async with asyncio.TaskGroup() as tasks:
                acting = [tasks.create_task(stage.act(planned)) for planned in loaded.steps]
                await asyncio.sleep(lasts_s)
                recorder.close()
                for task in acting:
                    task.cancel()
            played.problems = stage.problems(loaded.steps)
        played.released = world.released

    try:
        run_virtual(main, limit_s=lasts_s + AFTER_THE_END_S)
    except WorldError:
        raise
    except Exception as error:  # noqa: BLE001  a crash fails the scenario and is reported with its traceback
        text = "".join(traceback.format_exception(error))
        oracle.findings.append(Finding(lasts_s, next(iter(site.site.lifts)), "crash", text))
    played.excused, played.judged, played.invitations = oracle.excused, oracle.judged, oracle.invitations
    return played


def _settings(simulated: Simulated) -> Parameters:
    return Parameters(**{name: value for name, value in simulated if value is not None})
