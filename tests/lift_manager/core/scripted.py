"""A lift that does only what the test says: readings by hand, presses written down, virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace

from drivers.driver import Permit, always
from drivers.errors import DriverError, Sent
from drivers.model import Capabilities, Command, LiftReading, LiftValues, Outcome, Result, SignalValue
from lift_manager.core.bus import Bus, Subscription
from lift_manager.core.lift import LiftTask
from lift_manager.core.memory import Clock, Memory
from lift_manager.core.options import LiftOptions
from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.events import Alarm, Event
from lift_manager.domain.state import Holder, LiftState, RobotDoor
from register_maps.words import Door, Mode, Side
from tests.lift_manager.domain.test_call import ABLE
from tests.support.proven import proven
from tests.support.session_calls import SessionCalls
from tests.support.virtual_time import elapse, run_virtual

ROBOT = Holder("api", "fleet/robot1")
OTHER = Holder("api", "fleet/robot2")
FRONT = Side.FRONT

PERMITTING = replace(
    ABLE,
    commands=frozenset({"call", "go", "robot_in_place", "robot_left"}),
    signals=frozenset({"car_floor", "door.front", "may_enter", "may_leave"}),
    evidence="position_stable",
    until={"call": "robot_in_place", "go": "robot_left"},
    levels=frozenset({"call", "go"}),
    needs_occupancy=True,
)
"""Calls that stay on until the robot is in place or has left, pulses for both, and permissions (elevator-interfaces 1.1)."""
TWO_STOP = replace(
    ABLE,
    commands=frozenset({"call", "robot_in_place"}),
    signals=frozenset({"car_floor", "door.front"}),
    evidence="door_limit",
    until={"call": "robot_in_place"},
    levels=frozenset({"call", "robot_in_place"}),
    needs_occupancy=True,
)
"""Only a call and a level for a robot in place, which sends the car on; the open door is the floor (1.3)."""
PLAIN = replace(
    ABLE,
    commands=frozenset({"go_to", "hold_door.front"}),
    signals=frozenset({"car_floor", "door.front", "may_enter", "may_leave"}),
    evidence="position_stable",
    levels=frozenset({"hold_door.front"}),
)
"""One call for the empty and the occupied car, a door hold, and permissions."""


AT_L2 = LiftValues(floor="L2", mode=Mode.NORMAL, doors={FRONT: Door.CLOSED})
"""The car stands there with its door shut."""


class Silent(DriverError):
    """The scripted lift does not answer."""


@dataclass
class ScriptedDriver:
    """Writes down what reaches the lift; answers each press as told, and confirms where nothing is told."""

    capabilities: Capabilities
    values: LiftValues
    source: str = "by hand"
    silent: bool = False
    answers: dict[str, Result] = field(default_factory=dict)
    grants: bool = True
    """Whether the lift grants what its presses require."""
    takes_s: float = 0.0
    """What one poll takes."""
    unseen: bool = False
    """What is held or let go from here on is not seen to be so."""
    delay_s: float = 0.05
    """From the wish to the write, and again from there to the outcome."""
    log: list[str] = field(default_factory=list)
    """What reached the lift, in order: `press call L1`, `hold robot_in_place`, `let go call`."""
    on: set[str] = field(default_factory=set)
    renewed: dict[str, float] = field(default_factory=dict)
    """When each hold was last renewed."""
    permits: dict[str, Permit] = field(default_factory=dict)
    """The permit each command was last given with."""
    left_on: frozenset[str] = frozenset()
    """What was on when the process began: kept on where it is adopted."""
    adopted: set[str] = field(default_factory=set)
    begun: set[str] = field(default_factory=set)
    """What somebody has asked for in this process, beyond keeping what is on."""
    _flying: dict[str, asyncio.Future[Outcome]] = field(default_factory=dict)

    async def read(self) -> LiftReading:
        if self.silent:
            raise Silent("no answer", Sent.NO)
        at, values = asyncio.get_running_loop().time(), self.values
        if self.takes_s:
            await asyncio.sleep(self.takes_s)
        return LiftReading(at, 1, values)

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        value = self.values.floor
        return (SignalValue("car_floor", value, None, ("by hand",), None if self.silent else 0.0),)

    async def run(self) -> None:
        await asyncio.Event().wait()

    def press(self, command: Command, permit: Permit, begins: Permit = always) -> asyncio.Future[Outcome]:
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Outcome] = loop.create_future()
        self._end(command, Result.UNCONFIRMED, "replaced by a newer command")
        self._flying[command.name] = future
        self.permits[command.name] = permit
        self.on.add(command.name)
        loop.call_later(self.delay_s, self._write, command, lambda: begins() or permit(), future)
        return future

    def hold(self, command: Command, permit: Permit, *, begin: bool = True) -> None:
        if command.name not in self.capabilities.commands:
            return
        if not begin and command.name not in self.on:
            return
        if begin:
            self.begun.add(command.name)
        if command.name not in self.on and permit() is None:
            self.log.append(f"hold {command}")
            self.on.add(command.name)
        self.permits[command.name] = permit
        self.renewed[command.name] = asyncio.get_running_loop().time()

    def adopt(self, command: Command, permit: Permit) -> None:
        assert command.name in self.capabilities.commands, command
        self.adopted.add(command.name)
        self.permits[command.name] = permit
        if command.name in self.left_on:
            self.on.add(command.name)

    def keep(self, command: Command) -> None:
        self.begun.discard(command.name)

    def let_go(self, command: Command) -> None:
        if command.name in self.on:
            self.log.append(f"let go {command.name}")
            self.on.discard(command.name)
        self._end(command, Result.UNCONFIRMED, "let go before it was confirmed")

    def given(self, command: Command) -> bool:
        return command.name in self.on

    def held(self, command: Command) -> bool:
        return command.name in self.on and not self.unseen

    def at_rest(self, command: Command) -> bool:
        return command.name not in self.on and not self.unseen

    async def release_all(self) -> None:
        for name in tuple(self.on):
            self.log.append(f"let go {name}")
            self.on.discard(name)

    def _write(self, command: Command, permit: Permit, future: asyncio.Future[Outcome]) -> None:
        if future.done():
            return
        if (reason := permit()) is not None:
            self.on.discard(command.name)
            self._end(command, Result.REJECTED, reason)
            return
        if not self.grants:
            self.on.discard(command.name)
            self._end(command, Result.REJECTED, "not granted", not_granted=True)
            return
        self.log.append(f"press {command}")
        asyncio.get_running_loop().call_later(self.delay_s, self._answer, command, future)

    def _answer(self, command: Command, future: asyncio.Future[Outcome]) -> None:
        if future.done():
            return
        result = self.answers.get(command.name, Result.CONFIRMED)
        if command.name not in self.capabilities.levels or result is Result.REJECTED:
            self.on.discard(command.name)
        self._end(command, result, "" if result is Result.CONFIRMED else "as told")

    def _end(self, command: Command, result: Result, reason: str, *, not_granted: bool = False) -> None:
        future = self._flying.pop(command.name, None)
        if future is not None and not future.done():
            future.set_result(Outcome(command, result, reason, not_granted=not_granted))


@dataclass
class Bench(SessionCalls):
    """One lift task over a scripted driver."""

    driver: ScriptedDriver
    task: LiftTask
    heard: Subscription[Event]
    bus: Bus[Event]
    granted: dict[str, bool] = field(default_factory=dict)
    """Flags that the lift gives whatever car and door do."""

    @property
    def state(self) -> LiftState:
        return self.task.state()

    @property
    def presses(self) -> list[str]:
        return [line.removeprefix("press ") for line in self.driver.log if line.startswith("press ")]

    def ask(
        self, floor: str, robot: RobotWord | None = None, *, hold: bool = True, holder: Holder = ROBOT
    ) -> Accepted | Refused:
        return self.task.request(Ask("lift", holder, floor, hold, robot))

    def accept(self, floor: str, robot: RobotWord | None = None, *, hold: bool = True, holder: Holder = ROBOT) -> None:
        answer = self.ask(floor, robot, hold=hold, holder=holder)
        assert answer == Accepted(), answer

    def refuse(
        self, floor: str, robot: RobotWord | None = None, *, hold: bool = True, holder: Holder = ROBOT
    ) -> Refused:
        answer = self.ask(floor, robot, hold=hold, holder=holder)
        assert isinstance(answer, Refused), answer
        return answer

    async def car(self, floor: str | None, door: Door, *, enter: bool = False, leave: bool = False) -> None:
        """Let the lift say this, and time pass until the manager has heard it."""
        flags = {"may_enter": enter, "may_leave": leave} | self.granted
        self.driver.values = replace(self.driver.values, floor=floor, doors={FRONT: door}, flags=flags)
        await elapse(0.5)

    def grants_robot_mode(self) -> None:
        """Let the lift be in robot mode from here on."""
        self.granted = {"robot_mode_on": True}
        self.driver.values = replace(self.driver.values, flags=self.granted)

    async def mode(self, mode: Mode) -> None:
        self.driver.values = replace(self.driver.values, mode=mode)
        await elapse(0.5)

    async def called_to(self, floor: str) -> None:
        """Call the empty car and let it arrive, open and invite."""
        self.accept(floor)
        await elapse(0.5)
        await self.car(None, Door.CLOSED)
        await self.car(floor, Door.OPEN, enter=True)

    async def ridden_to(self, floor: str) -> None:
        """Let the occupied car arrive at a floor that was asked for, open and let the robot out."""
        await self.car(None, Door.CLOSED)
        await self.car(floor, Door.OPEN, leave=True)

    def robot_door(self) -> RobotDoor:
        """The door word that is published."""
        return self.task.state().robot_door

    async def alarms(self) -> list[str]:
        """Texts of the alarms so far."""
        texts: list[str] = []
        while True:
            try:
                async with asyncio.timeout(0):
                    event = await self.heard.next()
            except TimeoutError:
                return texts
            if isinstance(event, Alarm):
                texts.append(event.text)


async def boarded(made: Bench) -> None:
    """The robot is aboard, and the lift knows it and goes to L3."""
    await made.called_to("L1")
    made.accept("L3", RobotWord.IN_PLACE)
    await elapse(1)
    assert made.presses[-1] == "go L3"


async def abandoned(made: Bench) -> None:
    """Check that the lift was let go, was not told that the robot left, and that a person hears of it."""
    assert made.state.holder is None
    assert made.driver.on == set()
    assert "robot_left" not in made.presses
    assert [text for text in await made.alarms() if "aboard_abandoned" in text]


def on_bench(
    check: Callable[[Bench], Awaitable[None]],
    able: Capabilities = PERMITTING,
    *,
    infer: bool = False,
    lease_s: float = 300.0,
    max_session_hold_s: float = 900.0,
    doors_at: dict[str, tuple[Side, ...]] | None = None,
    between_sessions_s: float = 0.0,
    fire_release_delay_s: float = 0.0,
    max_session_s: float = 3600.0,
    clear_s: float = 10.0,
    takeover_after_s: float | None = None,
    poll_s: float = 0.1,
    memory: Memory | None = None,
    clock: Clock | None = None,
    found: LiftValues = AT_L2,
    left_on: frozenset[str] = frozenset(),
    floors: tuple[str, ...] = ("L1", "L2", "L3"),
    control: bool = True,
    at_once: Callable[["Bench"], object] | None = None,
    door_proven: bool = True,
) -> None:
    """Run a check on a fresh bench, on virtual time. Unless told otherwise, the car stands at L2 with its door shut.

    `left_on` are the outputs that a manager before this one left on; `at_once` happens before the first reading. Its door signal was
    proven by an earlier trip, unless `door_proven` is false.
    """

    async def main() -> None:
        driver = ScriptedDriver(able, found, left_on=left_on)
        bus: Bus[Event] = Bus()
        options = LiftOptions(
            name="lift",
            floors=floors,
            doors_at=doors_at or dict.fromkeys(floors, (FRONT,)),
            control=control,
            poll_s=poll_s,
            lease_s=lease_s,
            max_session_hold_s=max_session_hold_s,
            infer_occupancy=infer,
            between_sessions_s=between_sessions_s,
            fire_release_delay_s=fire_release_delay_s,
            max_session_s=max_session_s,
            clear_s=clear_s,
            takeover_after_s=takeover_after_s,
        )
        kept = proven(("lift",), able, memory) if door_proven else memory
        task = LiftTask(driver, options, bus, memory=kept, clock=clock)
        with bus.listen(10_000) as heard:
            running = [asyncio.ensure_future(work) for work in (task.drive(), task.run())]
            made = Bench(driver, task, heard, bus)
            if at_once is not None:
                at_once(made)
            await elapse(0.5)
            try:
                await check(made)
            finally:
                for work in running:
                    work.cancel()
                await asyncio.gather(*running, return_exceptions=True)

    run_virtual(main, limit_s=7200)
