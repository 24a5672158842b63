"""Who commands a driver in tests: permits by hand, holds declared one by one, futures for outcomes. Nothing waits for a disk."""

import asyncio
import math
from collections.abc import Callable

from drivers.driver import LiftDriver, Report
from drivers.model import (
    Capabilities,
    Command,
    DriverFailed,
    Hold,
    LiftReading,
    Outcome,
    OutputChanged,
    OutputState,
    PressId,
    SignalValue,
    Written,
)
from tests.drivers.by_hand import LogByHand

Permit = Callable[[], str | None]
WANTED = (OutputState.REQUESTED, OutputState.ON, OutputState.HELD, OutputState.LOST)
LEAVE_WITHIN_S = 10.0


class Caller:
    """The `DriverOwner` of one driver. A hold that is lost is put on again at once, as long as it is declared."""

    def __init__(self, driver: LiftDriver, log: LogByHand | None = None) -> None:
        self.driver = driver
        self.log = log or LogByHand()
        self.states: dict[str, OutputState] = {}
        self.failures: list[str] = []
        self.asked: list[tuple[Command, PressId | None]] = []
        """What the driver asked before something left."""
        self.declared: dict[str, tuple[Command, Hold]] = {}
        self._permits: dict[str, Permit] = {}
        self._begins: dict[PressId, Permit] = {}
        self._outcomes: dict[PressId, asyncio.Future[Outcome]] = {}
        self._newest: dict[str, PressId] = {}
        self._adopted: set[str] = set()
        self._unwritten: set[str] = set()
        """Holds that have their row, and were not written since."""
        self._number = 0
        driver.attach(self)

    @property
    def capabilities(self) -> Capabilities:
        return self.driver.capabilities

    @property
    def source(self) -> str:
        return self.driver.source

    async def run(self) -> None:
        await self.driver.run()

    async def read(self) -> LiftReading:
        return await self.driver.read()

    def signals(self, now: float) -> tuple[SignalValue, ...]:
        return self.driver.signals(now)

    # what is asked of the driver

    def press(self, command: Command, permit: Permit, begins: Permit | None = None) -> asyncio.Future[Outcome]:
        number = self._next_number()
        outcome = self._outcomes[number] = asyncio.get_running_loop().create_future()
        self._permits[command.name] = permit
        if begins is not None:
            self._begins[number] = begins
        self._newest[command.name] = number
        _ = self.log.before(command, self.driver.frames(command))
        now = asyncio.get_running_loop().time()
        self.driver.press(number, command, now + LEAVE_WITHIN_S)
        if command.name in self.capabilities.held_commands and not outcome.done():
            self._declare(command, 0, now)
        return outcome

    def hold(self, command: Command, permit: Permit, *, begin: bool = True) -> None:
        name, now = command.name, asyncio.get_running_loop().time()
        self._permits[name] = permit
        state, declared = self.states.get(name), self.declared.get(name)
        number = 0 if declared is None else declared[1].begin
        if state in WANTED:
            if not begin and state is OutputState.REQUESTED:
                number = 0
            self._declare(command, number or (self._next_number() if begin else 0), now)
            self._put_on_again(name)
        elif begin and name in self.capabilities.commands:
            if self._has_row(command):
                self._declare(command, self._next_number(), now)
        else:
            self._undeclare(name)

    def keep(self, command: Command) -> None:
        if (declared := self.declared.get(command.name)) is not None:
            self.declared[command.name] = command, Hold(0, declared[1].until)
            self._tell()

    def adopt(self, command: Command, permit: Permit) -> None:
        self._permits[command.name] = permit
        self._adopted.add(command.name)
        self._declare(command, 0, asyncio.get_running_loop().time())

    def let_go(self, command: Command) -> None:
        self._undeclare(command.name)
        if command.name in self._newest and not self.at_rest(command):
            self.driver.cancel(self._newest[command.name])

    async def release_all(self) -> None:
        self.declared.clear()
        self._tell()
        for press in self._newest.values():
            self.driver.cancel(press)
        await self.driver.released()

    def given(self, command: Command) -> bool:
        return self.states.get(command.name) in WANTED

    def held(self, command: Command) -> bool:
        return self.states.get(command.name) is OutputState.HELD

    def at_rest(self, command: Command) -> bool:
        return self.states.get(command.name, OutputState.AT_REST) is OutputState.AT_REST

    # what the driver asks and reports

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        self.asked.append((command, press))
        begins = None if press is None else self._begins.get(press)
        if begins is not None and (refusal := begins()) is not None:
            return refusal
        permit = self._permits.get(command.name)
        return "nobody asked for it" if permit is None else permit()

    def report(self, item: Report) -> None:
        match item:
            case OutputChanged(name, state):
                was, self.states[name] = self.states.get(name), state
                if was is OutputState.REQUESTED and name in self._adopted:
                    self._adopted.discard(name)
                    asyncio.get_running_loop().call_soon(self._renew, name, asyncio.get_running_loop().time())
                if state is OutputState.LOST:
                    asyncio.get_running_loop().call_soon(self._put_on_again, name)
            case Written(name, what):
                if what == "press":
                    self._unwritten.discard(name)
                self.log.wrote(item)
            case Outcome():
                if (outcome := self._outcomes.pop(item.press, None)) is not None and not outcome.done():
                    outcome.set_result(item)
            case DriverFailed(reason):
                self.failures.append(reason)
                self.declared.clear()

    def _next_number(self) -> int:
        self._number += 1
        return self._number

    def _put_on_again(self, name: str) -> None:
        if name in self.declared and self.states[name] is OutputState.LOST:
            command, hold = self.declared[name]
            if self._has_row(command, again=True):
                self.declared[name] = command, Hold(self._next_number(), hold.until)
                self._tell()

    def _renew(self, name: str, at: float) -> None:
        if name in self.declared and self.states[name] in (OutputState.ON, OutputState.HELD):
            self._declare(self.declared[name][0], self.declared[name][1].begin, at)

    def _has_row(self, command: Command, *, again: bool = False) -> bool:
        if command.name not in self._unwritten:
            if self.log.before(command, self.driver.frames(command), again=again).result() is not None:
                return False
            self._unwritten.add(command.name)
        return True

    def _declare(self, command: Command, begin: int, at: float) -> None:
        until = at + self.capabilities.max_hold_s.get(command.name, math.inf)
        self.declared[command.name] = command, Hold(begin, until)
        self._tell()

    def _undeclare(self, name: str) -> None:
        self._unwritten.discard(name)
        if self.declared.pop(name, None) is not None:
            self._tell()

    def _tell(self) -> None:
        self.driver.declare(dict(self.declared.values()))
