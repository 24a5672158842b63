"""A lift that does only what the test says: readings by hand, presses written down, virtual time."""

import asyncio
import math
from asyncio import Future
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

from drivers.driver import DriverOwner, NoOwner, OnAnswer
from drivers.errors import Delivery, DriverError
from drivers.model import (
    Capabilities,
    Command,
    CommandInfo,
    CommandStep,
    Hold,
    LiftReading,
    LiftValues,
    Outcome,
    OutputChanged,
    OutputState,
    PlannedWrite,
    PressId,
    Result,
    SignalValue,
    Written,
)
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from lift_manager.runtime.actor import LiftActor
from lift_manager.runtime.bus import Bus, Event, Subscription
from lift_manager.runtime.life import SiteLife
from lift_manager.runtime.recorder import Clock, MemoryRecorder, Recorder, SavedLift
from lift_manager.runtime.site import Site
from register_maps.words import Door, Mode, Side
from tests.lift_manager.lift.test_call import ABLE
from tests.support.proven import proven
from tests.support.session_calls import SessionCalls
from tests.support.virtual_time import cancel_all, elapse, run_virtual

ROBOT = Holder("api", "fleet/robot1")
OTHER = Holder("api", "fleet/robot2")
FRONT = Side.FRONT

PERMITTING = replace(
    ABLE,
    commands=frozenset({"call", "go", "robot_in_place", "robot_left"}),
    signals=frozenset({"car_floor", "door.front", "may_enter", "may_leave"}),
    evidence="position_stable",
    until={"call": "robot_in_place", "go": "robot_left"},
    held_commands=frozenset({"call", "go"}),
    needs_occupancy=True,
)
"""Calls that stay on until the robot is in place or has left, pulses for both, and permissions (elevator-interfaces 1.1)."""
TWO_STOP = replace(
    ABLE,
    commands=frozenset({"call", "robot_in_place"}),
    signals=frozenset({"car_floor", "door.front"}),
    evidence="door_limit",
    until={"call": "robot_in_place"},
    held_commands=frozenset({"call", "robot_in_place"}),
    needs_occupancy=True,
)
"""Only a call and a level for a robot in place, which sends the car on; the open door is the floor (1.3)."""
PLAIN = replace(
    ABLE,
    commands=frozenset({"go_to", "hold_door.front"}),
    signals=frozenset({"car_floor", "door.front", "may_enter", "may_leave"}),
    evidence="position_stable",
    held_commands=frozenset({"hold_door.front"}),
)
"""One call for the empty and the occupied car, a door hold, and permissions."""


AT_REST = OutputState.AT_REST
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
    """From the press to the write, and again from there to the outcome."""
    log: list[str] = field(default_factory=list)
    """What reached the lift, in order: `press call L1`, `hold robot_in_place`, `let go call`."""
    read_at: list[float] = field(default_factory=list)
    """When it was read."""
    on: set[str] = field(default_factory=set)
    """What is on, or on its way; a test may take something away, as a controller does."""
    renewed: dict[str, float] = field(default_factory=dict)
    """When what is on was last declared for longer."""
    left_on: frozenset[str] = frozenset()
    """What was on when the process began: kept on where it is adopted."""
    adopted: set[str] = field(default_factory=set)
    begun: set[str] = field(default_factory=set)
    """What is declared with a beginning, beyond keeping what is on."""
    above: DriverOwner = field(default_factory=NoOwner)
    _declared: dict[str, tuple[Command, Hold]] = field(default_factory=dict)
    _used: dict[str, int] = field(default_factory=dict)
    """The newest `begin` of each hold that is used up."""
    _states: dict[str, OutputState] = field(default_factory=dict)
    _newest: dict[str, PressId] = field(default_factory=dict)
    _flying: dict[str, tuple[PressId, Command]] = field(default_factory=dict)
    """Presses without an outcome."""
    _unwritten: set[str] = field(default_factory=set)
    """Those of them that were not written."""
    _was_read: bool = False
    _fence_at: float = math.inf
    _released: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        self.capabilities = replace(
            self.capabilities,
            max_hold_s=dict.fromkeys(self.capabilities.commands, 1e6) | dict(self.capabilities.max_hold_s),
        )

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)
        if name == "unseen" and hasattr(self, "_released"):
            self._report_states()

    def attach(self, above: DriverOwner) -> None:
        self.above = above

    async def read(self) -> LiftReading:
        at, values = asyncio.get_running_loop().time(), self.values
        if not self.silent:
            self.read_at.append(at)
        if self.takes_s:
            await asyncio.sleep(self.takes_s)
        if self.silent:
            raise Silent("no answer", Delivery.NO)
        self._was_read = True
        for name, (_, hold) in self._declared.items():
            if hold.until <= at and name not in self._unwritten:
                self._let_go(name)
        self._report_states()
        return LiftReading(at, 1, values, outputs=self._states)

    def begin_read(self, on_answer: OnAnswer) -> bool:
        return False

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        value = self.values.floor
        return (SignalValue("car_floor", value, None, ("by hand",), None if self.silent else 0.0),)

    async def run(self) -> None:
        await asyncio.Event().wait()

    def declare(self, holds: Mapping[Command, Hold]) -> None:
        now = asyncio.get_running_loop().time()
        known = {command.name: (command, hold) for command, hold in holds.items()}
        assert known.keys() <= self.capabilities.commands, known
        before, self._declared = self._declared, known
        if self._is_fenced:
            return
        for name in sorted((self.capabilities.held_commands | before.keys() | known.keys()) - self._unwritten):
            if name not in known:
                self._used.pop(name, None)
                self._let_go(name)
                continue
            command, hold = known[name]
            (self.begun.add if hold.begin else self.begun.discard)(name)
            if not self._was_read and not hold.begin and name not in self.on:
                self.adopted.add(name)
                if name in self.left_on:
                    self.on.add(name)
            elif name in self.on:
                if name in before and hold.until > before[name][1].until:
                    self.renewed[name] = now
            elif hold.begin > self._used.get(name, 0):
                self._put_on(command, hold, now)
        self._report_states()

    def press(self, press: PressId, command: Command, leave_by: float) -> None:
        self._end(command.name, Result.UNCONFIRMED, "replaced by a newer command")
        self._newest[command.name], self._flying[command.name] = press, (press, command)
        self.on.add(command.name)
        self._unwritten.add(command.name)
        asyncio.get_running_loop().call_later(self.delay_s, self._write, press, command, leave_by)
        self._report_states()

    def cancel(self, press: PressId) -> None:
        for name, newest in self._newest.items():
            if newest == press and (name in self._unwritten or name not in self._declared):
                self._let_go(name)
        for name in [name for name, (one, _) in self._flying.items() if one == press]:
            self._end(name, Result.UNCONFIRMED, "let go before it was confirmed")
        self._report_states()

    def frames(self, command: Command) -> tuple[str, ...]:
        return ()

    def commands(self) -> tuple[CommandInfo, ...]:
        return ()

    def plan(self, steps: Sequence[CommandStep]) -> tuple[PlannedWrite, ...]:
        return ()

    def fence(self, until: float) -> None:
        self._fence_at = until
        self.declare(dict(self._declared.values()))

    async def released(self) -> None:
        while self.on:
            self._released.clear()
            await self._released.wait()

    @property
    def _is_fenced(self) -> bool:
        return asyncio.get_running_loop().time() >= self._fence_at

    def _put_on(self, command: Command, hold: Hold, now: float) -> None:
        if self.above.blocked_by(command, None) is None:
            self.log.append(f"hold {command}")
            self.on.add(command.name)
            self.renewed[command.name] = now
            self._used[command.name] = hold.begin
            self.above.report(Written(command.name, "press", ()))

    def _let_go(self, name: str) -> None:
        if name in self.on:
            self.log.append(f"let go {name}")
            self.on.discard(name)
        self._unwritten.discard(name)
        self._end(name, Result.UNCONFIRMED, "let go before it was confirmed")

    def _write(self, press: PressId, command: Command, leave_by: float) -> None:
        name = command.name
        if self._flying.get(name, (None, None))[0] != press:
            return
        refusal = self.above.blocked_by(command, press)
        if asyncio.get_running_loop().time() > leave_by or self._is_fenced:
            refusal = "too late"
        if refusal is not None or not self.grants:
            self.on.discard(name)
            self._end(name, Result.REJECTED, refusal or "not granted", not_granted=refusal is None)
            return
        self._unwritten.discard(name)
        self.log.append(f"press {command}")
        self.above.report(Written(name, "press", ()))
        self._report_states()
        asyncio.get_running_loop().call_later(self.delay_s, self._answer, press, command)

    def _answer(self, press: PressId, command: Command) -> None:
        name = command.name
        if self._flying.get(name, (None, None))[0] != press:
            return
        result = self.answers.get(name, Result.CONFIRMED)
        if name not in self.capabilities.held_commands or result is Result.REJECTED:
            self.on.discard(name)
        self._end(name, result, "" if result is Result.CONFIRMED else "as told")

    def _end(self, name: str, result: Result, reason: str, *, not_granted: bool = False) -> None:
        self._unwritten.discard(name)
        press, command = self._flying.pop(name, (0, None))
        if command is not None:
            self._report_states()
            self.above.report(Outcome(command, result, reason, grant_missing=not_granted, press=press))

    def _state(self, name: str) -> OutputState:
        if name in self._unwritten or (name in self._declared and name in self.adopted and not self._was_read):
            return OutputState.REQUESTED
        if name in self.on:
            return OutputState.ON if self.unseen else OutputState.HELD
        declared = self._declared.get(name)
        if declared is not None and 0 < declared[1].begin <= self._used.get(name, 0):
            return OutputState.LOST
        return OutputState.RELEASING if self.unseen else OutputState.AT_REST

    def _report_states(self) -> None:
        states = {name: self._state(name) for name in sorted(self.capabilities.commands)}
        changed = {name: state for name, state in states.items() if state is not self._states.get(name, AT_REST)}
        if changed or not self._states:
            self._states = states
        for name, state in changed.items():
            self.above.report(OutputChanged(name, state))
        if not self.on:
            self._released.set()


class SlowRecorder(MemoryRecorder):
    """Puts on its disk what the test lets it."""

    def __init__(self) -> None:
        super().__init__()
        self.waiting: list[Future[str | None]] = []
        self.unwritten: list[Future[None]] = []

    def commit_now(self, row: Row) -> Future[str | None]:
        self.note(row)
        self.waiting.append(asyncio.get_running_loop().create_future())
        return self.waiting[-1]

    def written(self, lift: str) -> Future[None] | None:
        self.unwritten.append(asyncio.get_running_loop().create_future())
        return self.unwritten[-1]

    async def commit(self, failure: str | None = None) -> None:
        """Answer everything that waits."""
        for answer in self.waiting:
            answer.set_result(failure)
        self.waiting.clear()
        await elapse(0.2)


class CountingRecorder(MemoryRecorder):
    """Counts what it is to keep."""

    kept = 0

    def keep(self, lift: str, saved: SavedLift) -> None:
        self.kept += 1
        super().keep(lift, saved)


@dataclass
class Bench(SessionCalls):
    """One running lift over a scripted driver."""

    driver: ScriptedDriver
    actor: LiftActor
    site: Site
    life: SiteLife
    recorder: Recorder
    heard: Subscription[Event]
    bus: Bus[Event]
    granted: dict[str, bool] = field(default_factory=dict)
    """Flags that the lift gives whatever car and door do."""
    caller: Holder = ROBOT

    @property
    def rows(self) -> list[Row]:
        """The rows of a recorder in memory."""
        assert isinstance(self.recorder, MemoryRecorder)
        return self.recorder.rows

    @property
    def press_rows(self) -> list[str]:
        """Texts of the rows that presses wait for."""
        return [row.text for row in self.rows if row.kind is RowKind.PRESS]

    @property
    def presses(self) -> list[str]:
        return [line.removeprefix("press ") for line in self.driver.log if line.startswith("press ")]

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
        return self.state.robot_door

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
    poll_s: float = 0.4,
    poll_ridden_s: float = math.inf,
    recorder: Recorder | None = None,
    clock: Clock | None = None,
    found: LiftValues = AT_L2,
    left_on: frozenset[str] = frozenset(),
    floors: tuple[str, ...] = ("L1", "L2", "L3"),
    control: bool = True,
    at_once: Callable[["Bench"], object] | None = None,
    door_proven: bool = True,
    listens: bool = True,
) -> None:
    """Run a check on a fresh bench, on virtual time. Unless told otherwise, the car stands at L2 with its door shut.

    `left_on` are the outputs that a manager before this one left on; `at_once` happens before the first reading. Its door signal was
    proven by an earlier trip, unless `door_proven` is false. Unless it `listens`, nobody hears its events.
    """

    async def main() -> None:
        driver = ScriptedDriver(able, found, left_on=left_on)
        bus: Bus[Event] = Bus()
        config = LiftConfig(
            name="lift",
            source=driver.source,
            floors=floors,
            doors_at=doors_at or dict.fromkeys(floors, (FRONT,)),
            control=control,
            capabilities=driver.capabilities,
            poll_s=poll_s,
            poll_ridden_s=poll_ridden_s,
            lease_s=lease_s,
            max_session_hold_s=max_session_hold_s,
            infer_occupancy=infer,
            between_sessions_s=between_sessions_s,
            fire_release_delay_s=fire_release_delay_s,
            max_session_s=max_session_s,
            clear_s=clear_s,
            takeover_after_s=takeover_after_s,
        )
        kept = proven(("lift",), able, recorder) if door_proven else recorder or MemoryRecorder()
        actor = LiftActor(driver, config, bus, kept, clock=clock)
        site = Site([actor], bus, kept, clock=clock)
        life = SiteLife(site, [actor])
        with ExitStack() as listening:
            heard = listening.enter_context(bus.listen(10_000))
            if not listens:
                listening.close()
            running = [asyncio.create_task(work) for work in (*life.drives(), life.run())]
            made = Bench(driver, actor, site, life, kept, heard, bus)
            if at_once is not None:
                at_once(made)
            await elapse(0.5)
            try:
                await check(made)
            finally:
                await cancel_all(running)

    run_virtual(main, limit_s=7200)
