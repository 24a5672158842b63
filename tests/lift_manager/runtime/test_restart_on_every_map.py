"""The manager is killed and started again on every shipped map: what was on for the robot stays on, on the wire."""

import asyncio

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import Quality
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.load import shipped
from tests.support.trip import trip
from tests.support.trip_simulator import SimulatedPlant
from tests.support.trip_sites import NO_TRIP, Site, site_of
from tests.support.virtual_time import elapse, run_virtual

MAPS = sorted(set(shipped()) - set(NO_TRIP))


def stays(site: Site) -> set[str]:
    """Name the commands that are on as long as the robot needs them: not the calls that end on arrival."""
    commands = site.codec.map.commands
    held = {name for name in commands if name == "robot_mode" or name.startswith("hold_door.")}
    return held | {name for name in commands if commands[name].until in ("robot_in_place", "robot_left")}


def lost_by_a_restart(name: str, *, door_open_s: float | None, silent_s: float) -> list[str]:
    """Kill the manager under way, or so long after the door stood open; list what was on then and was let go of after it."""
    site = site_of(name)
    plant, memory, pickup = SimulatedPlant(site, speed=3.0), MemoryRecorder(), tuple(site.floors)[1]

    async def main() -> list[str]:
        async with trip(site, plant, recorder=memory, door_proven=True) as before:
            before.ask(pickup)
            if door_open_s is None:
                await elapse(1.5)
            else:
                await before.until(lambda state: state.robot_door is RobotDoor.OPEN, asking=pickup)
                await elapse(door_open_s)
            kept = before.exchanges[-1].truth.asked & stays(site)
        assert kept or door_open_s is None
        await elapse(0.5)
        async with trip(site, plant, recorder=memory, start_s=silent_s) as after:
            began = asyncio.get_running_loop().time()
            while asyncio.get_running_loop().time() < began + 4:
                if after.state.quality is Quality.LIVE:
                    after.ask(pickup)
                await elapse(1)
            assert not [text for text in after.wrong if not text.startswith("offline")]
            if door_open_s is not None:
                assert (after.state.robot_door, after.state.floor) == (RobotDoor.OPEN, pickup)
            return [f"{one.at:.2f} s: {kept - one.truth.asked}" for one in after.exchanges if kept - one.truth.asked]

    return run_virtual(main, limit_s=600)


@pytest.mark.parametrize("name", MAPS)
def test_what_was_on_for_the_robot_stays_on_over_a_restart(name: str) -> None:
    for door_open_s, silent_s in ((None, 6.0), (0.1, 0.05), (4.0, 6.0)):
        assert lost_by_a_restart(name, door_open_s=door_open_s, silent_s=silent_s) == [], (door_open_s, silent_s)
