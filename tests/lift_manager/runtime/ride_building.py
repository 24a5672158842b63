"""Rides in a building of lifts that do only what the test says."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

from drivers.model import Capabilities, LiftValues
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.hours import RobotHours
from lift_manager.lift.refusals import Accepted
from lift_manager.lift.session import Holder
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Ride, RideLimits, RideRequest, RideWord
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event, Occurrence
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import Recorder
from lift_manager.runtime.site import Site
from register_maps.words import Door, Side
from tests.lift_manager.runtime.scripted import AT_L2, PLAIN, ScriptedDriver
from tests.support.mortal import MortalRecorder
from tests.support.proven import proven
from tests.support.refusals import refusal, reply
from tests.support.ride_rig import clock
from tests.support.virtual_time import cancel_all, elapse, run_virtual

FLEET = Holder("ride", "fleet")
RMF = Holder("rmf", "tiny/robot1")
FLOORS = ("L1", "L2", "L3", "L4")


@dataclass
class Building:
    """Its site, and its lifts by name."""

    site: Site
    life: SiteLife
    bus: Bus[Event]
    drivers: Mapping[str, ScriptedDriver]
    changes: list[Ride] = field(default_factory=list)
    """Rides as they were published."""
    heard: list[Occurrence] = field(default_factory=list)

    def request(
        self,
        lift: str = "any",
        start: str = "L1",
        destination: str = "L3",
        *,
        robot: str = "amr-1",
        key: str = "",
        limits: RideLimits | None = None,
    ) -> RideRequest:
        return RideRequest(
            lifts=self.site.lift_names() if lift == "any" else (lift,),
            any_lift=lift == "any",
            start=start,
            destination=destination,
            robot=robot,
            caller=FLEET,
            key=key,
            limits=limits or RideLimits(),
        )

    def begin(self, lift: str = "any", **more: object) -> Ride:
        return self.site.rides.begin(self.request(lift, **more)).ride  # type: ignore[arg-type]  # keywords of request

    def refuse(self, request: RideRequest) -> RequestRefused:
        """Begin a ride that is refused."""
        return refusal(lambda: self.site.rides.begin(request))

    def look(self, ride: Ride) -> Ride:
        return self.site.rides.ride(ride.id)

    def report(self, ride: Ride, word: RideWord) -> Ride:
        """Let the robot of a ride report something that is taken."""
        return self.site.rides.report(ride.id, word, FLEET)

    def cancel(self, ride: Ride) -> Ride:
        return self.site.rides.cancel(ride.id, FLEET, "no order")

    def maybe_aboard(self, lift: str = "A") -> Holder | None:
        """Whose robot may be in the car of a lift."""
        return self.site.state(lift).restrictions.maybe_aboard

    def ask(self, lift: str, holder: Holder = RMF, *, hold: bool = True) -> Accepted | RequestRefused:
        """Make a request for a lift that is no ride's, taken or not."""
        floor = "L1" if hold else self.site.state(lift).floor or "L1"
        return reply(lambda: self.site.request(lift, holder, floor, hold_door=hold))

    async def car(self, lift: str, floor: str | None, door: Door = Door.CLOSED) -> None:
        """Let a lift say this, and time pass until the manager has heard it."""
        is_open = door is Door.OPEN
        flags = {"may_enter": is_open, "may_leave": is_open}
        driver = self.drivers[lift]
        driver.values = replace(driver.values, floor=floor, doors={Side.FRONT: door}, flags=flags)
        await elapse(1.5)

    async def taken_away(self, lift: str = "A") -> None:
        """A person takes a lift from its holder."""
        self.site.force_release(lift, "Ana", "needed", at_once=True)
        await elapse(1)


@asynccontextmanager
async def building(
    *lifts: str,
    floors: Mapping[str, tuple[str, ...]] | None = None,
    recorder: Recorder | None = None,
    hours: Mapping[str, RobotHours] | None = None,
    fire_release_delay_s: float = 0.0,
    able: Capabilities = PLAIN,
    found: LiftValues = AT_L2,
    left_on: frozenset[str] = frozenset(),
    runs: bool = True,
) -> AsyncIterator[Building]:
    """Lifts whose cars stand at L2 with their doors shut, and whose door signals are proven; its end is a `kill -9`.

    `left_on` are the outputs that the building before this one left on. Unless it `runs`, nothing was read yet.
    """
    own_recorder = MortalRecorder(proven(lifts, able, recorder))
    bus: Bus[Event] = Bus()
    drivers = {lift: ScriptedDriver(able, found, left_on=left_on) for lift in lifts}
    actors = []
    for lift, driver in drivers.items():
        here = (floors or {}).get(lift, FLOORS)
        config = LiftConfig(
            name=lift,
            source=driver.source,
            floors=here,
            doors_at=dict.fromkeys(here, able.doors),
            control=True,
            capabilities=driver.capabilities,
            poll_s=0.2,
            between_sessions_s=0.0,
            fire_release_delay_s=fire_release_delay_s,
            robot_hours=(hours or {}).get(lift),
        )
        actors.append(LiftActor(driver, config, bus, own_recorder, clock=clock))
    site = Site(actors, bus, own_recorder, clock=clock)
    made = Building(site, SiteLife(site, actors), bus, drivers)

    def hear(occurrence: Occurrence) -> None:
        made.heard.append(occurrence)
        if isinstance(occurrence.event, RideChanged):
            made.changes.append(occurrence.event.ride)

    with site.overhear(hear):
        works = (made.life.run(), *made.life.drives()) if runs else ()
        running = [asyncio.ensure_future(work) for work in works]
        await elapse(2 if runs else 0)
        try:
            yield made
        finally:
            own_recorder.killed = True
            await cancel_all(running)


def in_building(check: Callable[[Building], Awaitable[None]], *lifts: str, **settings: object) -> None:
    """Run a check in a building, on virtual time."""

    async def main() -> None:
        async with building(*lifts, **settings) as made:  # type: ignore[arg-type]  # keywords of building
            await check(made)

    run_virtual(main, limit_s=9000)
