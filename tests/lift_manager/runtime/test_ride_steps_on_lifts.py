"""A ride through every step of guidance, on the real spine over simulated lifts of many kinds."""

import pytest

from lift_manager.rides.ride import Guidance, Phase
from register_maps.load import shipped
from tests.support.ride_rig import MortalPlant, Robot, rig
from tests.support.trip_sites import NO_TRIP, site_of, stops
from tests.support.virtual_time import elapse, run_virtual

MAPS = sorted(set(shipped()) - set(NO_TRIP))


@pytest.mark.parametrize("name", MAPS)
def test_a_ride_goes_through_every_step_on_every_map(name: str) -> None:
    site = site_of(name)
    start, destination = stops(site)

    async def main() -> None:
        async with rig(MortalPlant(site)) as made:
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
