"""A second controller and its naive lift as the far end of a trip."""

from dataclasses import dataclass, field

from tests.support.second_controllers.cast import CAST
from tests.support.second_controllers.device import Device
from tests.support.second_controllers.lift import Lift, NaiveLift
from tests.support.second_controllers.thingweb import DemoCar
from tests.support.trip import Truth
from tests.support.trip_sites import Site


@dataclass
class SecondPlant:
    """The devices of one lift of the cast."""

    site: Site
    lift: Lift
    devices: dict[str, Device] = field(init=False)

    def __post_init__(self) -> None:
        self.devices = CAST[self.site.name].devices(self.lift)

    def answer(self, device: str, frame: bytes, now: float) -> bytes | None:
        return self.devices[device].answer(frame, now)

    def truth(self, now: float) -> Truth:
        self.devices[""].run_to(now)
        shows = self.lift.shows
        near = shows.floor if shows.at_floor else None
        asked = frozenset(self.devices[""].asked())
        return Truth(near, near if shows.level else None, shows.open_at, shows.may_enter, shows.may_leave, asked)


def naive_lift(site: Site) -> Lift:
    """Make the lift behind the second controller of a site."""
    if site.name == "thingweb-elevator":
        return DemoCar()
    part = CAST[site.name]
    return NaiveLift(len(site.floors), robot_mode=part.by_key, in_place_sends_on=part.in_place_sends_on)
