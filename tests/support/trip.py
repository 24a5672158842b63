"""A whole robot trip: the real driver and actor, on virtual time, over anything that answers Modbus/TCP frames.

Every state that is published on the way is compared with what the lift really did when it was read.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from drivers.modbus.capabilities import LiftSettings
from drivers.modbus.lift import ModbusLift
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.memory import MemoryWire, Reply
from drivers.modbus.units import Unit
from drivers.model import Outcome, Result
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm, CommandEnded
from lift_manager.lift.inputs import LiftRequest
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Accepted
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.runtime.actor import LiftActor, new_id
from lift_manager.runtime.bus import Bus, Event, StateChanged, Subscription
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.recorder import MemoryRecorder, Recorder
from tests.support.mortal import MortalRecorder
from tests.support.proven import proven
from tests.support.trip_sites import Site
from tests.support.virtual_time import cancel_all, elapse, run_virtual

ANSWER_S = 0.004
START_S = 2.5
"""From the start to the first word of a test: more than two polls of the slowest map."""
POLL_TAKES_S = 0.1
"""From the first request of a poll to its last, and less than from poll to poll."""
LOOK_S = 0.2
"""Between two looks at the published state."""
ROBOT = Holder("rmf", "fleet/robot1")


@dataclass(frozen=True, slots=True)
class Truth:
    """What a lift really does, whatever its registers say. Floors are indices, the lowest is 0."""

    near: int | None
    """In whose door zone the car is, moving or not."""
    level_at: int | None
    """Where the car stands level."""
    open_at: int | None
    """Where it stands level with its door fully open."""
    may_enter: bool
    may_leave: bool
    asked: frozenset[str] = frozenset()
    """Commands that its outputs hold."""


class Plant(Protocol):
    """A lift at the far end of the wires."""

    def answer(self, device: str, frame: bytes, now: float) -> bytes | None:
        """Answer one request to one of its devices; the controller's name is empty."""
        ...

    def truth(self, now: float) -> Truth:
        """Tell what it really does."""
        ...


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request and its answer."""

    at: float
    device: str
    request: bytes
    answer: bytes
    truth: Truth

    @property
    def is_write(self) -> bool:
        return self.request[7] > 4


@dataclass
class Trip:
    """One robot on one lift."""

    site: Site
    plant: Plant
    actor: LiftActor
    recorder: Recorder
    driver: ModbusLift
    exchanges: list[Exchange]
    in_words: bool
    """Whether the robot says when it is in place and when it has left."""
    bus: Bus[Event] = field(default_factory=Bus)
    aboard: bool = False
    wrong: list[str] = field(default_factory=list)
    """Everything published that was not so."""
    outcomes: list[Outcome] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)
    published: int = 0
    opened: int = 0
    """Published states that invite a robot."""

    @property
    def state(self) -> LiftState:
        return self.actor.state()

    @property
    def invites(self) -> bool:
        """Whether a robot that looks now would drive."""
        return self.state.robot_door is RobotDoor.OPEN

    def ask(self, floor: str, word: RobotWord | None = None, *, hold: bool = True) -> None:
        """Ask, and be accepted."""
        request = LiftRequest(ROBOT, floor, hold, word if self.in_words else None, new_id=new_id())
        answer = self.actor.handle(request)
        assert answer == Accepted(), answer

    async def until(self, true: Callable[[LiftState], bool], *, asking: str = "", within_s: float = 60.0) -> None:
        """Wait for a state, and repeat the request for a floor every second meanwhile, as robots do."""
        loop = asyncio.get_running_loop()
        start, asked = loop.time(), loop.time()
        while not true(self.state):
            assert loop.time() < start + within_s, f"{self.site.name}: after {within_s:g} s still {self.state}"
            if asking and loop.time() >= asked + 1:
                asked = loop.time()
                self.ask(asking)
            await elapse(LOOK_S)

    async def invited_to(self, floor: str) -> None:
        """Wait for the invitation to drive at a floor, and check that it lasts while the robot drives for 6 s."""
        commands = self.site.codec.map.commands
        spent = {name for name in commands if name.startswith("go_to") and commands[name].until in (None, "arrived")}
        await self.until(lambda state: (state.robot_door, state.floor) == (RobotDoor.OPEN, floor), asking=floor)
        for _ in range(6):
            await elapse(1)
            assert (self.state.robot_door, self.state.floor) == (RobotDoor.OPEN, floor)
            assert self.state.standing
            assert self.exchanges[-1].truth.asked.isdisjoint(spent), "a call that ends on arrival is let go there"
            self.ask(floor)

    async def make(self, *, pickup: str, destination: str) -> None:
        """Call, enter, ride, leave, release."""
        self.ask(pickup)
        assert not self.invites
        assert self.state.holder == ROBOT
        await self.invited_to(pickup)
        self.aboard = True
        self.ask(destination, RobotWord.IN_PLACE)
        assert not self.invites
        assert self.state.destination == destination
        await self.invited_to(destination)
        self.ask(destination, RobotWord.LEFT, hold=False)
        self.aboard = False
        released = self.state
        assert released.holder is None
        await self.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        await elapse(12)
        quiet = self.state
        assert (quiet.quality, quiet.robot_door) == (Quality.LIVE, RobotDoor.CLOSED)
        self.check()

    def check(self) -> None:
        """Fail with whatever was published wrongly, was not confirmed, or alarmed somebody."""
        failed = [outcome for outcome in self.outcomes if outcome.result is not Result.CONFIRMED]
        found = [*self.wrong[:10], *self.alarms, *map(str, failed)]
        assert not found, "\n".join([self.site.name, *found])

    def judge(self, state: LiftState) -> None:
        """Compare one published state with what the lift did when it was read."""
        self.published += 1
        if state.quality is not Quality.LIVE or state.age_s is None:
            self.wrong.append(f"offline: {state.reason}")
            return
        now = asyncio.get_running_loop().time()
        truths = self._truths(now - state.age_s, now - state.age_s + POLL_TAKES_S)
        index = list(self.site.floors).index(state.floor) if state.floor is not None else None
        said = f"at {now:.2f} s {state.robot_door} at {state.floor}, on the way to {state.destination}: {truths}"
        arrived = state.holder is not None and state.floor == state.destination
        if (arrived or state.standing) and not self._stands(index, now - state.age_s):
            self.wrong.append(f"not there: {said}")
        if state.robot_door is RobotDoor.OPEN:
            self.opened += 1
            if not any(self._invites(truth, state, index) for truth in truths):
                self.wrong.append(f"not open: {said}")
            holds = {name for name in self.site.codec.commands if name.startswith("hold_door.")}
            if state.holder is not None and not holds <= self.exchanges[-1].truth.asked:
                self.wrong.append(f"not held: {said}")

    def _invites(self, truth: Truth, state: LiftState, index: int | None) -> bool:
        permitted = {"may_enter": truth.may_enter, "may_leave": truth.may_leave}
        permitted = {name: given for name, given in permitted.items() if name in self.site.codec.signals}
        if state.holder is not None and permitted:
            permitted = {name: permitted[name] for name in ("may_leave" if self.aboard else "may_enter",)}
        mine = state.holder is None or state.floor == state.destination
        return index is not None and truth.open_at == index and mine and (not permitted or any(permitted.values()))

    def _stands(self, index: int | None, read_at: float) -> bool:
        """Whether the car stood at a floor by the evidence of its map: of time, that it may still creep towards it."""
        stable_s = self.site.codec.map.at_floor_evidence.for_s
        if stable_s is None:
            return index in {truth.level_at for truth in self._truths(read_at, read_at + POLL_TAKES_S)}
        since = self._truths(read_at - stable_s + min(stable_s, POLL_TAKES_S), read_at + POLL_TAKES_S)
        return all(truth.near == index for truth in since)

    def _truths(self, since: float, until: float) -> list[Truth]:
        """Return what the lift did as each request that read something in this time reached it."""
        found = []
        for exchange in reversed(self.exchanges):
            if exchange.at < since - 1e-9:
                break
            if not exchange.is_write and exchange.at < until:
                found.append(exchange.truth)
        return found

    async def watch(self, heard: Subscription[Event]) -> None:
        """Judge every state that is published."""
        while True:
            match await heard.next():
                case StateChanged(state=state):
                    self.judge(state)
                case CommandEnded(outcome=outcome):
                    self.outcomes.append(outcome)
                case Alarm(text=text):
                    self.alarms.append(text)
                case _:
                    pass

    async def look(self) -> None:
        """Judge what anybody who asks is told."""
        while True:
            await elapse(LOOK_S)
            self.judge(self.state)


@asynccontextmanager
async def trip(
    site: Site,
    plant: Plant,
    *,
    in_words: bool = True,
    poll_s: float = 0.2,
    recorder: Recorder | None = None,
    start_s: float = START_S,
    door_proven: bool = False,
) -> AsyncIterator[Trip]:
    """One lift of a site whose devices are those of a plant, polled for `start_s`; `door_proven` by a trip before this one.

    Its end is a `kill -9`; the next one with the same plant and `recorder` is the manager after a restart.
    """
    source = site.codec.map
    exchanges: list[Exchange] = []

    def answer(device: str, frame: bytes) -> list[Reply]:
        now = asyncio.get_running_loop().time()
        said = plant.answer(device, frame, now)
        if said is None:
            return []
        exchanges.append(Exchange(now, device, frame, said, plant.truth(now)))
        return [(ANSWER_S, said)]

    settings = LinkSettings(
        timeout_s=source.link.timeout_s, min_gap_s=source.link.min_gap_s, reconnect_min_s=source.link.reconnect_min_s
    )
    lines = {
        name: Unit(Link(partial(MemoryWire, partial(answer, name)), settings, name=name or "plc"), source.unit_of(name))
        for name in ("", *source.endpoints)
    }
    links = [line.link for line in lines.values()]
    own = lines.pop("")
    lift_settings = LiftSettings(
        name="lift", floors=site.floors, unit_id=own.unit_id, control=True, max_age_s=source.link.max_age_s
    )
    driver = ModbusLift(site.codec, own.link, lift_settings, lines)
    bus: Bus[Event] = Bus()
    config = LiftConfig(
        name="lift",
        source=driver.source,
        floors=tuple(site.floors),
        doors_at=dict.fromkeys(site.floors, driver.capabilities.doors),
        control=True,
        capabilities=driver.capabilities,
        poll_s=max(poll_s, source.link.min_poll_s),
        infer_occupancy=not in_words,
        between_sessions_s=0,
    )
    saved = proven(("lift",), driver.capabilities, recorder) if door_proven else recorder or MemoryRecorder()
    own_recorder = MortalRecorder(saved)
    actor = LiftActor(driver, config, bus, own_recorder)
    made = Trip(site, plant, actor, own_recorder, driver, exchanges, in_words, bus)
    polls = LiftPoll(actor)
    running = [asyncio.ensure_future(work) for work in (*(link.run() for link in links), driver.run(), polls.run())]
    await elapse(start_s)
    with bus.listen() as heard:
        running += [asyncio.ensure_future(work) for work in (made.watch(heard), made.look())]
        try:
            yield made
        finally:
            own_recorder.killed = True
            await cancel_all(running)
            assert heard.lost == 0


def on_trip(
    check: Callable[[Trip], Awaitable[None]],
    site: Site,
    plant: Plant,
    *,
    in_words: bool = True,
    door_proven: bool = False,
) -> Trip:
    """Run a check on virtual time and return the trip, with all that was said on it."""

    async def main() -> Trip:
        async with trip(site, plant, in_words=in_words, door_proven=door_proven, poll_s=0.4) as made:
            await check(made)
            return made

    return run_virtual(main, limit_s=600)
