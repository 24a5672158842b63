"""How often one caller may begin a ride, and what its idempotency key stands for."""

from dataclasses import replace
from typing import Any

import pytest

from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import RideLimits
from lift_manager.rides.rides import ENDED_FOR_S, MOST_OF_ONE
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Side
from tests.lift_manager.runtime.ride_building import Building, in_building
from tests.support.virtual_time import elapse


def test_one_caller_has_few_rides_at_once_and_keeps_nobody_else_from_riding() -> None:
    async def check(made: Building) -> None:
        rides = [made.begin("A", robot=f"amr-{n}") for n in range(MOST_OF_ONE)]
        refused = made.refuse(made.request("B", robot="one-more"))
        assert refused.code is Refusal.TOO_MANY
        assert refused.message.startswith(f"{MOST_OF_ONE} rides of ride:fleet are under way")
        assert all(ride.id in refused.message for ride in rides)
        other = replace(made.request("B"), caller=Holder("ride", "another"))
        assert made.site.rides.begin(other).is_new
        made.cancel(rides[0])
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
    recorder = MemoryRecorder()

    async def check(made: Building) -> None:
        request = made.request("A", key="k1")
        begun = made.site.rides.begin(request)
        refused = made.refuse(replace(request, **change))
        assert refused.code is Refusal.KEY_REUSED
        assert f"was used for ride {begun.ride.id} from L1 to L3 with A" in refused.message
        assert len(made.site.rides.all()) == 1

    in_building(check, "A", "B", recorder=recorder)
    in_building(check, "A", "B", recorder=recorder)


def test_any_lift_may_stand_for_other_lifts_when_a_key_is_used_again() -> None:
    async def check(made: Building) -> None:
        request = made.request(key="k1")
        begun = made.site.rides.begin(request)
        again = made.site.rides.begin(replace(request, lifts=("A",)))
        assert (again.is_new, again.ride.id) == (False, begun.ride.id)

    in_building(check, "A", "B")


def test_a_key_is_forgotten_with_its_ride_though_nobody_looks_for_it() -> None:
    async def check(made: Building) -> None:
        first = made.begin("A", key="k1")
        made.cancel(first)
        await elapse(ENDED_FOR_S - 10)
        assert not made.site.rides.begin(made.request("A", key="k1")).is_new
        await elapse(20)
        assert made.site.rides.begin(made.request("A", key="k1")).is_new

    in_building(check, "A")
