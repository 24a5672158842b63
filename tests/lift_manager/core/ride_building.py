"""Rides in a building of lifts that do only what the test says."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

from drivers.model import Capabilities
from lift_manager.core.journal import ShortJournal
from lift_manager.core.lift import LiftTask
from lift_manager.core.manager import LiftManager
from lift_manager.core.memory import Memory
from lift_manager.core.options import LiftOptions
from lift_manager.core.recording import RecordingBus
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import Event, Occurrence, RideChanged
from lift_manager.domain.hours import RobotHours
from lift_manager.domain.ride import Ride, RideBegun, RideLimits, RideRequest
from lift_manager.domain.state import Holder
from lift_manager.runtime.bus import Bus
from register_maps.words import Door, Side
from tests.lift_manager.core.scripted import AT_L2, PLAIN, ScriptedDriver
from tests.support.proven import proven
from tests.support.ride_rig import clock
from tests.support.virtual_time import elapse, run_virtual

FLEET = Holder("ride", "fleet")
RMF = Holder("rmf", "tiny/robot1")
FLOORS = ("L1", "L2", "L3", "L4")


@dataclass
class Building:
    """Its manager, and its lifts by name."""

    manager: LiftManager
    drivers: Mapping[str, ScriptedDriver]
    told: list[Ride] = field(default_factory=list)
    heard: list[Occurrence] = field(default_factory=list)

    def wish(
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
            lifts=self.manager.lift_names() if lift == "any" else (lift,),
            any_lift=lift == "any",
            start=start,
            destination=destination,
            robot=robot,
            caller=FLEET,
            key=key,
            limits=limits or RideLimits(),
        )

    def begin(self, lift: str = "any", **more: object) -> Ride:
        answer = self.manager.begin_ride(self.wish(lift, **more))  # type: ignore[arg-type]  # keywords of wish
        assert isinstance(answer, RideBegun), answer
        return answer.ride

    def look(self, ride: Ride) -> Ride:
        found = self.manager.ride(ride.id)
        assert found is not None
        return found

    def ask(self, lift: str, holder: Holder = RMF, *, hold: bool = True) -> Accepted | Refused:
        state = self.manager.state(lift)
        assert state is not None
        return self.manager.request(Ask(lift, holder, "L1" if hold else state.floor or "L1", hold))

    async def car(self, lift: str, floor: str | None, door: Door = Door.CLOSED) -> None:
        """Let a lift say this, and time pass until the manager has heard it."""
        is_open = door is Door.OPEN
        flags = {"may_enter": is_open, "may_leave": is_open}
        driver = self.drivers[lift]
        driver.values = replace(driver.values, floor=floor, doors={Side.FRONT: door}, flags=flags)
        await elapse(1.5)


@asynccontextmanager
async def building(
    *lifts: str,
    floors: Mapping[str, tuple[str, ...]] | None = None,
    memory: Memory | None = None,
    journal: ShortJournal | None = None,
    hours: Mapping[str, RobotHours] | None = None,
    fire_release_delay_s: float = 0.0,
    able: Capabilities = PLAIN,
) -> AsyncIterator[Building]:
    """Lifts whose cars stand at L2 with their doors shut, and whose door signals are proven; its end is a `kill -9`."""
    memory = proven(lifts, able, memory)
    bus: Bus[Event] = RecordingBus(journal or ShortJournal())
    drivers = {lift: ScriptedDriver(able, AT_L2) for lift in lifts}
    tasks = []
    for lift in lifts:
        here = (floors or {}).get(lift, FLOORS)
        options = LiftOptions(
            name=lift,
            floors=here,
            doors_at=dict.fromkeys(here, able.doors),
            control=True,
            poll_s=0.2,
            between_sessions_s=0.0,
            fire_release_delay_s=fire_release_delay_s,
            robot_hours=(hours or {}).get(lift),
        )
        tasks.append(LiftTask(drivers[lift], options, bus, memory=memory, clock=clock))
    made = Building(LiftManager(tasks, bus, memory, clock=clock), drivers)

    def hear(occurrence: Occurrence) -> None:
        made.heard.append(occurrence)
        if isinstance(occurrence.event, RideChanged):
            made.told.append(occurrence.event.ride)

    with made.manager.tap(hear):
        running = [asyncio.ensure_future(work) for work in (made.manager.run(), *made.manager.drives())]
        await elapse(2)
        try:
            yield made
        finally:
            for work in running:
                work.cancel()
            ended = await asyncio.gather(*running, return_exceptions=True)
            failed = [error for error in ended if not isinstance(error, asyncio.CancelledError)]
            assert not failed, failed


def in_building(check: Callable[[Building], Awaitable[None]], *lifts: str, **settings: object) -> None:
    """Run a check in a building, on virtual time."""

    async def main() -> None:
        async with building(*lifts, **settings) as made:  # type: ignore[arg-type]  # keywords of building
            await check(made)

    run_virtual(main, limit_s=9000)
