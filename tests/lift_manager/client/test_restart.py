"""A robot on its ride while the manager is killed and started again: what it is told meanwhile, and that it gets there."""

import asyncio
import json
import signal
from collections.abc import Callable
from pathlib import Path

from lift_manager.client import ActiveRide, LiftManagerClient, Step
from lift_manager.rides.ride import Guidance
from tests.support.programs import HANGS_S, Program, Started, free_port

PORT = r"127\.0\.0\.1:(\d+)"


class Building:
    """A simulated lift, and its manager on a port that stays the same."""

    def __init__(self, start: Started, folder: Path) -> None:
        simulator = start("simulate", "generic-registers", "--port", "0", "--floors", "L1=1,L2=2", "--speed", "5")
        content = {
            "schema": 1,
            "name": "A building",
            "state": "kept",
            "controllers": {
                "plc": {"host": "127.0.0.1", "port": int(simulator.says(PORT)[1]), "map": "generic-registers"}
            },
            "lifts": {"main": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}, "poll_s": 0.1}},
        }
        (folder / "site.yaml").write_text(json.dumps(content), "utf-8")  # JSON is YAML
        self._start, self._file, self._port = start, folder / "site.yaml", free_port()
        self.url = f"http://127.0.0.1:{self._port}"
        self.manager = self._serve()

    def kill(self) -> None:
        self.manager.tell(signal.SIGKILL)
        self.manager.ended()

    def start_again(self) -> None:
        self.manager = self._serve()

    def _serve(self) -> Program:
        manager = self._start("serve", self._file, "--port", str(self._port))
        manager.says(r"/docs")
        return manager


async def until(ride: ActiveRide, wanted: Callable[[Step], bool]) -> Step:
    async with asyncio.timeout(HANGS_S):
        async for step in ride:
            if wanted(step):
                return step
    raise AssertionError(f"the ride ended: {ride.now}")


def test_a_robot_is_told_the_truth_over_two_kills_of_the_manager_and_gets_there(tmp_path: Path) -> None:
    async def main(building: Building) -> None:
        async with LiftManagerClient(building.url) as client, client.ride("any", "L2", "L1", robot="amr-7") as ride:
            for stands, kept in ((Guidance.ENTER, Guidance.WAIT), (Guidance.STAY, Guidance.STAY)):
                if stands is Guidance.STAY:
                    await ride.entered()
                await until(ride, lambda step: step.is_current and step.guidance is stands)  # noqa: B023
                await asyncio.to_thread(building.kill)
                assert (await until(ride, lambda step: not step.is_current)).guidance is kept
                await asyncio.to_thread(building.start_again)
                # it says by itself that it is here: nothing is pressed before
                await until(ride, lambda step: step.is_current)
            await until(ride, lambda step: step.guidance is Guidance.LEAVE)
            assert (await ride.left()).guidance is Guidance.DONE

    with Started() as start:
        asyncio.run(main(Building(start, tmp_path)))
