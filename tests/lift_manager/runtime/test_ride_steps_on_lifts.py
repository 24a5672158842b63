"""A ride through every step of guidance, on the real spine over simulated lifts of many kinds."""

import pytest

from lift_manager.rides.ride import Guidance, Phase
from register_maps.load import shipped
from register_maps.schema import CALLS
from tests.support.ride_rig import MortalPlant, Robot, rig
from tests.support.trip_sites import NO_TRIP, site_of, stops
from tests.support.virtual_time import elapse, run_virtual

MAPS = (
    "adam-io",
    "generic-registers",
    "robotnik-il-eth",
    "seer-generic",
    "seer-lps3-two-stop",
    "seer-siemens-chengdu",
    "two-stop-agv",
)
"""Pulsed calls, also with robot mode that the lift tells and that it does not; calls that stay on; a handshake by level and by pulses; a key."""
SEEN = frozenset({"may_enter", "may_leave", "robot_mode_on", "motion"})


def kind(name: str) -> object:
    """What a ride depends on: the commands, what ends and permits the calls, and what tells where the car is and for whom it is open.

    Where all of it lies in the controller does not matter to a ride; `tests/trips` makes a trip on every map.
    """
    source = site_of(name).codec.map
    commands = {
        (name, spec.action, spec.until, frozenset(spec.requires if name in CALLS else ()))
        for name, spec in source.commands.items()
        if not name.startswith("close_door.")
    }
    return frozenset(commands), source.at_floor_evidence.kind, SEEN.intersection(source.signals)


def test_every_map_is_of_a_kind_that_a_ride_is_made_on() -> None:
    assert {kind(name) for name in set(shipped()) - set(NO_TRIP)} == {kind(name) for name in MAPS}
    assert len({kind(name) for name in MAPS}) == len(MAPS)


@pytest.mark.parametrize("name", MAPS)
def test_a_ride_goes_through_every_step_on_a_map_of_every_kind(name: str) -> None:
    site = site_of(name)
    start, destination = stops(site)

    async def main() -> None:
        async with rig(MortalPlant(site, speed=3.0)) as made:
            ride = made.begin(start, destination)
            robot = Robot(ride.id)
            over = await robot.ride_out(made)
            assert (over.phase, over.guidance, over.maybe_aboard) == (Phase.DONE, Guidance.DONE, False)
            made.true()
            assert made.invited > 20
            phases = [one.phase for one in made.told]
            order = [phase for place, phase in enumerate(phases) if place == 0 or phases[place - 1] is not phase]
            assert order == [
                Phase.QUEUED,
                Phase.CALLED,
                Phase.BOARDING,
                Phase.RIDING,
                Phase.ALIGHTING,
                Phase.DONE,
            ]
            assert {one.guidance for one in made.told} == set(Guidance) - {Guidance.GAVE_UP}
            await elapse(15)
            assert made.made.state.holder is None
            assert made.made.state.restrictions.maybe_aboard is None
            assert made.alarms == []

    run_virtual(main, limit_s=900)
