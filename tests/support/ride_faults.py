"""Steps of a ride at which something happens, and what may happen."""

import math
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace

from lift_manager.lab.world.fault_names import fault_name
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.rides.ride import OVER, Guidance, Phase, Ride, RideLimits, RideWord
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import MemoryRecorder
from simulator import faults as device
from simulator.faults import Fault
from simulator.modes import Key
from tests.support.refusals import reply
from tests.support.ride_rig import LOOK_S, QUICK, MortalPlant, Rig, Robot, Spoilt, rig
from tests.support.trip_sites import Site, stops
from tests.support.virtual_time import elapse

RMF = Holder("rmf", "tiny/robot1")
OPERATOR = None


@dataclass
class Story:
    """One robot, one ride, and as many managers as it takes."""

    site: Site
    stack: AsyncExitStack
    limits: RideLimits = QUICK
    plant: MortalPlant = field(init=False)
    recorder: MemoryRecorder = field(default_factory=MemoryRecorder)
    robot: Robot = field(init=False)
    rig: Rig = field(init=False)
    alarms: list[str] = field(default_factory=list)
    lies: list[str] = field(default_factory=list)
    judged: int = 0
    clear_s: float = 0.0
    """How long before a release of ours its robot must not be invited any more."""

    async def begin(self) -> None:
        self.plant = MortalPlant(self.site)
        self.rig = await self.stack.enter_async_context(rig(self.plant, recorder=self.recorder))
        self.rig.clear_s = self.clear_s
        start, destination = stops(self.site)
        self.robot = Robot(self.rig.begin(start, destination, limits=self.limits).id)

    async def restart(self, down_s: float = 3.0) -> None:
        """Kill the manager, and start it again."""
        self._collect()
        await self.stack.aclose()
        await elapse(down_s)
        self.rig = await self.stack.enter_async_context(rig(self.plant, recorder=self.recorder))
        self.rig.clear_s = self.clear_s
        self.rig.made.aboard = self.robot.inside

    async def until(self, true: Callable[[Ride], bool], within_s: float = 240.0) -> None:
        """Let the robot go on until its ride is like this."""
        end = self.rig.now + within_s
        while not true(told := self.robot.act(self.rig)):
            assert self.rig.now < end, f"after {within_s:g} s still {told}"
            assert told.phase not in OVER, told
            await elapse(LOOK_S)

    async def go_on(self, seconds: float) -> None:
        end = self.rig.now + seconds
        while self.rig.now < end:
            self.robot.act(self.rig)
            await elapse(LOOK_S)

    async def end(self) -> Ride:
        """Let the robot go on until its ride is over, and whatever it has begun to do is done."""
        over = await self.robot.ride_out(self.rig)
        if self.robot.driving_since is not None:
            self.robot.inside, self.robot.driving_since = not self.robot.inside, None
        await elapse(1)
        self._collect()
        return over

    def _collect(self) -> None:
        self.alarms += self.rig.alarms
        self.lies += self.rig.lies
        self.judged += self.rig.judged


async def _called(story: Story) -> None:
    await story.until(lambda ride: ride.phase is Phase.CALLED)
    await story.go_on(1.5)


async def _at_the_door(story: Story) -> None:
    await story.until(lambda ride: ride.guidance is Guidance.ENTER)


async def _entering(story: Story) -> None:
    await _at_the_door(story)
    await story.go_on(2.0)


async def _just_inside(story: Story) -> None:
    story.robot.speaks = False
    await story.until(lambda _: story.robot.inside)
    story.robot.speaks = True


async def _riding(story: Story) -> None:
    await story.until(lambda ride: ride.phase is Phase.RIDING)
    while story.plant.truth(story.rig.now).level_at is not None:
        await story.go_on(LOOK_S)


async def _leaving(story: Story) -> None:
    await story.until(lambda ride: ride.guidance is Guidance.LEAVE)
    await story.go_on(2.0)


async def _just_outside(story: Story) -> None:
    await story.until(lambda ride: ride.phase is Phase.ALIGHTING)
    story.robot.speaks = False
    await story.until(lambda _: not story.robot.inside)
    story.robot.speaks = True


async def _clearing(story: Story) -> None:
    await _riding(story)
    story.rig.cancel(story.robot.ride)


STEPS: Mapping[str, Callable[[Story], Awaitable[None]]] = {
    "called": _called,
    "at the door": _at_the_door,
    "entering": _entering,
    "just inside": _just_inside,
    "riding": _riding,
    "leaving": _leaving,
    "just outside": _just_outside,
    "clearing": _clearing,
}


async def _dies(story: Story) -> None:
    story.plant.troubled = True
    story.plant.silent = True


async def _dies_and_returns(story: Story) -> None:
    story.plant.troubled = True
    story.plant.silent = True
    await story.go_on(12.0)
    story.plant.silent = False


async def _fire(story: Story) -> None:
    story.plant.troubled = True
    story.plant.people(replace(story.plant.face.inputs, fire=True))


async def _out_of_service(story: Story) -> None:
    story.plant.troubled = True
    story.plant.people(replace(story.plant.face.inputs, key=Key.OUT_OF_SERVICE))


async def _lockout(story: Story) -> None:
    answer = reply(lambda: story.rig.site.lock_out("lift", "Ana", "oil"))
    # a second lockout may come while the door of the first is still held for a robot in it
    assert not isinstance(answer, RequestRefused) or answer.code is Refusal.LOCKED_OUT, answer


async def _force_release(story: Story) -> None:
    reply(lambda: story.rig.site.force_release("lift", "Ana", "needed", at_once=True))
    story.rig.invited_at = -math.inf  # a person who wants it at once has seen that nobody is in the door


async def _restart(story: Story) -> None:
    story.plant.troubled = True
    await story.restart()


async def _long_restart(story: Story) -> None:
    story.plant.troubled = True
    await story.restart(down_s=45.0)


async def _restart_and_heard(story: Story) -> None:
    story.plant.troubled = True
    await story.restart()
    answer = reply(lambda: story.rig.say(story.robot.ride, RideWord.HERE))
    # the ride may be over: its robot may have been silent for too long before
    assert not isinstance(answer, RequestRefused) or answer.message.startswith("the ride is over"), answer


async def _cancel(story: Story) -> None:
    story.rig.cancel(story.robot.ride)


async def _operator_cancels(story: Story) -> None:
    story.rig.cancel(story.robot.ride, OPERATOR)


async def _other_asks(story: Story) -> None:
    floor = next(iter(story.site.floors))
    for _ in range(5):
        reply(lambda: story.rig.site.request("lift", RMF, floor, hold_door=True))
        await story.go_on(1.0)


FAULTS: Mapping[str, Callable[[Story], Awaitable[None]]] = {
    "dies": _dies,
    "dies and returns": _dies_and_returns,
    "fire": _fire,
    "out of service": _out_of_service,
    "lockout": _lockout,
    "force-release": _force_release,
    "restart": _restart,
    "long restart": _long_restart,
    "restart, and its robot is heard": _restart_and_heard,
    "cancel": _cancel,
    "operator cancels": _operator_cancels,
    "rmf asks": _other_asks,
}


CLEAR_S = 10.0
"""From the withdrawal of OPEN to the release of the door: what a site has that says nothing else."""
LASTS_S = 8.0
"""How long a fault of the wire or the registers lasts. Chosen: longer than a robot takes through the door."""


def _wire(spoilt: Spoilt) -> Callable[[Story], Awaitable[None]]:
    async def spoil(story: Story) -> None:
        story.plant.troubled, story.plant.spoils = True, spoilt
        await story.go_on(LASTS_S)
        story.plant.spoils = None

    return spoil


def _device(fault: Fault) -> Callable[[Story], Awaitable[None]]:
    async def fail(story: Story) -> None:
        story.plant.troubled = True
        story.plant.begin(fault)
        await story.go_on(LASTS_S)
        story.plant.end(fault)

    return fail


FURTHER: Mapping[str, Callable[[Story], Awaitable[None]]] = {
    **{str(spoilt): _wire(spoilt) for spoilt in Spoilt},
    **{
        fault_name(fault): _device(fault)
        for fault in (
            device.LostPress(),
            device.IgnoredWrites(),
            device.IgnoredWrites(stored=True),
            device.FloorAhead(),
            device.FrozenHeartbeat(),
            device.StuckDoor(),
            device.ReopeningDoor(),
            device.CallsCancelled(),
            device.RobotModeWithdrawn(),
            device.Overload(),
        )
    },
}
"""Faults of the wire, of the registers and of the machine, of those that no map shows wrongly."""


async def play(site: Site, step: str, fault: str) -> tuple[Story, Ride]:
    """Bring a ride to a step, let a fault happen, and let the robot go on to the end."""
    async with AsyncExitStack() as stack:
        story = Story(site, stack)
        await story.begin()
        await STEPS[step](story)
        await FAULTS[fault](story)
        over = await story.end()
        judge_end(story, over)
        return story, over


def judge_end(story: Story, over: Ride) -> None:
    """Check what a ride says in the end against where its robot is."""
    assert not story.lies, "\n".join(story.lies[:5])
    state = story.rig.made.state
    if story.robot.inside:
        assert over.phase is Phase.GAVE_UP, over
        assert over.maybe_aboard, over
        assert over.advice is not None, over
        assert state.restrictions.maybe_aboard == Holder("ride", "fleet/amr-7"), state
        assert any("ride:fleet/amr-7" in text for text in story.alarms), story.alarms
    if over.phase is not Phase.DONE:
        assert over.reason, over
    if not over.maybe_aboard:
        assert not story.robot.inside, over
    # a session that has ended, by a person too, keeps its lift until the open door was withdrawn for long enough
    is_released_soon = state.releases_in_s is not None and state.releases_in_s <= CLEAR_S
    assert state.holder is None or state.holder.face != "ride" or state.ending or is_released_soon, state
