"""A door that the controller shows as a position in percent."""

import pytest

from lift_manager.lift.observation import RobotDoor
from register_maps.codec import compile_map
from register_maps.load import MapChanges, load
from tests.support.trip import Trip, on_trip
from tests.support.trip_simulator import SimulatedPlant
from tests.support.trip_sites import Site, site_of, stops

POSITION = {"values": None, "unit": "%", "open_at": 90, "closed_at": 2, "range": [1, 100]}


@pytest.mark.parametrize("counts_down", [False, True])
def test_a_robot_makes_its_trip_through_it(*, counts_down: bool) -> None:
    ends = {"open_at": 10, "closed_at": 98} if counts_down else {}
    name = "generic-registers"
    changes = MapChanges({}, {"signals": {"door.front": {**POSITION, **ends}}})
    site = Site(name, compile_map(load(name, changes=changes).map), site_of(name).floors)
    pickup, destination = stops(site)

    async def check(made: Trip) -> None:
        assert made.state.robot_door is RobotDoor.CLOSED
        assert made.driver.capabilities.open_contacts == frozenset()
        await made.make(pickup=pickup, destination=destination)

    assert on_trip(check, site, SimulatedPlant(site)).opened > 50
