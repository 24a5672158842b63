"""Play a scenario: the whole manager and its simulated lifts on virtual time, with the judge watching."""

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
"""How long the loop may go on after the end while everything is let go."""


@dataclass(slots=True)
class ScenarioResult:
    """What became of a scenario."""

    scenario: LoadedScenario
    seed: int
    trace: list[Entry]
    findings: list[Finding]
    """What the judge found."""
    problems: list[str] = field(default_factory=list)
    """Steps that could not be done."""
    excused: Mapping[tuple[str, str, str], int] = field(default_factory=dict)
    """What the judge let pass, by lift, rule and fault, and how often."""
    judged: int = 0
    """Published states that the judge compared with the truth."""
    invitations: int = 0
    """Of these, those that said open."""
    released: bool = False
    """Whether everything was seen to be let go at the end."""


def play(loaded: LoadedScenario, *, seed: int | None = None) -> ScenarioResult:
    """Play a scenario to its end; a crash of anything is a finding. The same seed gives the same trace.

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
    except Exception as error:  # noqa: BLE001  a crash fails the scenario, with all that is known about it
        text = "".join(traceback.format_exception(error))
        oracle.findings.append(Finding(lasts_s, next(iter(site.site.lifts)), "crash", text))
    played.excused, played.judged, played.invitations = oracle.excused, oracle.judged, oracle.invitations
    return played


def _settings(simulated: Simulated) -> Parameters:
    return Parameters(**{name: value for name, value in simulated if value is not None})
