"""How often one caller may begin a ride, and what its idempotency key stands for."""

from dataclasses import replace
from typing import Any

import pytest

from lift_manager.core.memory import ShortMemory
from lift_manager.core.rides.book import MOST_OF_ONE
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.ride import RideBegun, RideLimits
from lift_manager.domain.state import Holder
from register_maps.words import Side
from tests.lift_manager.core.ride_building import FLEET, Building, in_building


def test_one_caller_has_few_rides_at_once_and_keeps_nobody_else_from_riding() -> None:
    async def check(made: Building) -> None:
        rides = [made.begin("A", robot=f"amr-{n}") for n in range(MOST_OF_ONE)]
        refused = made.manager.begin_ride(made.wish("B", robot="one-more"))
        assert isinstance(refused, Refused)
        assert refused.code is Refusal.TOO_MANY
        assert refused.message.startswith(f"{MOST_OF_ONE} rides of ride:fleet go on")
        assert all(ride.id in refused.message for ride in rides)
        other = replace(made.wish("B"), caller=Holder("ride", "another"))
        assert isinstance(made.manager.begin_ride(other), RideBegun)
        made.manager.cancel_ride(rides[0].id, FLEET, "no order")
        made.begin("B", robot="one-more")

    in_building(check, "A", "B")


@pytest.mark.parametrize(
    "change",
    [
        {"destination": "L4"},
        {"start": "L2"},
        {"door": Side.REAR},
        {"lifts": ("B",)},
        {"lifts": ("A", "B"), "any_lift": True},
        {"limits": RideLimits(queued_s=1.0)},
    ],
)
def test_a_key_that_was_used_for_another_ride_is_refused_even_after_a_restart(change: dict[str, Any]) -> None:
    memory = ShortMemory()

    async def check(made: Building) -> None:
        wish = made.wish("A", key="k1")
        begun = made.manager.begin_ride(wish)
        assert isinstance(begun, RideBegun)
        refused = made.manager.begin_ride(replace(wish, **change))
        assert isinstance(refused, Refused)
        assert refused.code is Refusal.KEY_REUSED
        assert f"was used for ride {begun.ride.id} from L1 to L3 with A" in refused.message
        assert len(made.manager.rides()) == 1

    in_building(check, "A", "B", memory=memory)
    in_building(check, "A", "B", memory=memory)


def test_any_lift_may_stand_for_other_lifts_when_a_key_is_used_again() -> None:
    async def check(made: Building) -> None:
        wish = made.wish(key="k1")
        begun = made.manager.begin_ride(wish)
        again = made.manager.begin_ride(replace(wish, lifts=("A",)))
        assert isinstance(begun, RideBegun)
        assert isinstance(again, RideBegun)
        assert (again.anew, again.ride.id) == (False, begun.ride.id)

    in_building(check, "A", "B")
