"""A door that the manager releases by itself has not read OPEN for `clear_s`: on a virtual site, for every face and limit."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Site
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.witness import STOP, FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.commands import CommandRequest, CommandType
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.rides.inputs import RideChanged
from lift_manager.rides.ride import Guidance, RideLimits, RideRequest
from lift_manager.runtime.bus import Occurrence, StateChanged
from register_maps.load import load
from simulator.state import Parameters
from tests.lift_manager.lab.test_world import Recorder, is_open_at, until
from tests.support.refusals import reply

CLEAR_S, RMF_CLEAR_S = 10.0, 30.0
LIMIT_S = 40.0
HOLD = "hold_door.front"
OF_ALL = {"lease_s": 900.0, "max_session_hold_s": 900.0, "max_session_s": 3600.0}


@dataclass
class Watched:
    """What a robot could read, and what became of the held door."""

    world: World
    open_at: float = -1.0
    """When OPEN was last read or published."""
    was_open: bool = False
    invited_at: float = -1.0
    """When a ride last said `enter` or `leave`."""
    held: bool = False
    released: list[tuple[float, float, float]] = field(default_factory=list)
    """When the held door was released by the manager; when OPEN, and an invitation, were last to be read before."""
    published: list[tuple[float, RobotDoor]] = field(default_factory=list)

    def look(self) -> None:
        now = asyncio.get_running_loop().time()
        self.see(now, self.world.site.state("lift"))
        for ride in self.world.site.rides.all():
            if ride.guidance in (Guidance.ENTER, Guidance.LEAVE):
                self.invited_at = now
        held = HOLD in self.world.lifts["lift"].truth.obeyed
        if self.held and not held:
            self.released.append((now, self.open_at, self.invited_at))
        self.held = held

    def see(self, now: float, state: LiftState) -> None:
        if state.robot_door is RobotDoor.OPEN:
            self.open_at = now

    def hear(self, occurrence: Occurrence) -> None:
        event = occurrence.event
        if isinstance(event, StateChanged):
            self.see(occurrence.at, event.state)
            self.published.append((occurrence.at, event.state.robot_door))
        elif isinstance(event, RideChanged) and event.ride.guidance in (Guidance.ENTER, Guidance.LEAVE):
            self.invited_at = occurrence.at

    async def until_released(self) -> tuple[float, float, float]:
        async with asyncio.timeout(5000):
            while not self.released:
                self.look()
                # every 50 ms where a door may be released soon; one that is released sooner has been open a moment before
                may_end = asyncio.get_running_loop().time() > LIMIT_S * 0.75
                await elapse(0.05 if may_end else 0.5)
        return self.released[0]


def site(**lift: object) -> LoadedSite:
    made = {
        "schema": 1,
        "name": "world",
        "controllers": {"plc": {"host": "memory", "port": 1, "map": "generic-registers"}},
        "lifts": {
            "lift": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2, "L3": 3}, "poll_s": 0.4}
            | OF_ALL
            | lift
        },
    }
    return LoadedSite(Site.model_validate(made), {"lift": load("generic-registers")}, Path("world"))


def in_world(check: Callable[[Watched], Awaitable[None]], **lift: object) -> None:
    async def main() -> None:
        world = World(site(**lift), (), settings={"lift": Parameters(speed=4.0)}, observe_every_s=5.0)
        watched = Watched(world)
        async with world.running():
            with world.site.tap(watched.hear):
                await elapse(2)
                await check(watched)

    run_virtual(main, limit_s=20_000)


@contextmanager
def repeated(say: Callable[[], object], every_s: float) -> Iterator[None]:
    async def forever() -> None:
        while True:
            say()
            await elapse(every_s)

    task = asyncio.ensure_future(forever())
    try:
        yield
    finally:
        task.cancel()


def workshop(watched: Watched) -> Callable[[], object]:
    request = FloorRequest("lift", Holder("workshop", "workshop"), "L2", hold_door=True)
    return lambda: watched.world.request(request)


def rmf(watched: Watched) -> Callable[[], object]:
    request = FloorRequest("lift", Holder("rmf", "fleet/r1"), "L2", hold_door=True, stays=True)
    return lambda: watched.world.request(request)


def session(watched: Watched) -> Callable[[], object]:
    site, holder = watched.world.site, Holder("api", "amr-7")
    session = site.open_session("lift", holder).session.id
    site.command("lift", CommandRequest(session=session, holder=holder, kind=CommandType.GO_TO, floor="L2"))
    return lambda: reply(lambda: site.renew_session("lift", session, holder, None))


def ride(watched: Watched) -> Callable[[], object]:
    limits = RideLimits(boarding_s=1800, alighting_s=1800)
    request = RideRequest(
        lifts=("lift",), any_lift=False, start="L2", destination="L3", caller=Holder("ride", "amr-7"), limits=limits
    )
    watched.world.site.rides.begin(request)
    return lambda: None


FACES = {"workshop": workshop, "rmf": rmf, "session": session, "ride": ride}


@pytest.mark.parametrize(
    ("face", "limit"),
    [
        *((face, limit) for face in FACES for limit in ("max_session_hold_s", "max_session_s")),
        ("workshop", "lease_s"),
        ("session", "lease_s"),
    ],
)
def test_a_door_is_released_only_after_it_has_invited_nobody_for_long_enough(face: str, limit: str) -> None:
    async def check(watched: Watched) -> None:
        goes_on = FACES[face](watched)
        goes_on()
        # a lease runs out because nobody renews it; the other limits end a hold however often its holder asks
        every_s = 1e6 if limit == "lease_s" else 1.0
        with repeated(goes_on, every_s):
            released_at, open_at, invited_at = await watched.until_released()
        clear_s = RMF_CLEAR_S if face == "rmf" else CLEAR_S
        assert open_at > 0
        # the door is looked at every 50 ms
        assert released_at - open_at >= clear_s - 0.06
        assert released_at - invited_at >= clear_s - 0.06
        # and it was not withdrawn sooner than it has to be
        assert released_at - open_at < clear_s + 0.6
        assert (released_at - invited_at < clear_s + 0.6) is (face == "ride")

    in_world(check, **{limit: LIMIT_S})


def test_a_ride_that_is_given_up_with_its_door_open_does_not_release_it_at_once() -> None:
    async def check(watched: Watched) -> None:
        limits = RideLimits(boarding_s=12, alighting_s=12)
        caller = Holder("ride", "amr-7")
        request = RideRequest(
            lifts=("lift",), any_lift=False, start="L2", destination="L3", caller=caller, limits=limits
        )
        watched.world.site.rides.begin(request)
        released_at, open_at, invited_at = await watched.until_released()
        # it said `enter`, then `leave` while nobody said whether the robot is inside
        assert invited_at > 0
        assert released_at - open_at >= CLEAR_S - 0.06
        assert released_at - invited_at >= CLEAR_S - 0.06

    in_world(check)


@pytest.mark.parametrize("locked_out", [False, True])
def test_a_manager_that_ends_withdraws_open_at_once_and_releases_the_door_three_seconds_later(
    *, locked_out: bool
) -> None:
    seen = Recorder()

    async def main() -> None:
        world = World(site(), (seen,))
        async with world.running():
            await elapse(2)
            world.request(FloorRequest("lift", Holder("workshop", "workshop"), "L2", hold_door=True))
            await until(world, is_open_at("L2"))
            await elapse(5)
            if locked_out:  # its ten seconds are more than a process that ends has left
                world.site.lock_out("lift", "the guard", "new ropes")
        assert world.released

    run_virtual(main)
    ((stopped_at, _),) = [(at, change) for at, change in seen.faults if change.fault == STOP]
    held_at = max(at for at, truth in seen.truths if HOLD in truth.commands)
    assert 2.9 <= held_at - stopped_at <= 3.2
    assert all(state.robot_door is not RobotDoor.OPEN for at, state in seen.states if at > stopped_at)
