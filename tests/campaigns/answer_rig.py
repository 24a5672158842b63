"""A client under fuzzed answers: what it asks, the device that answers it, and what the judge says to what it took."""

from __future__ import annotations

import asyncio
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any, Protocol

from drivers.errors import ControllerException, Delivery, DriverError
from drivers.modbus.memory import MemoryWire
from drivers.modbus.settings import LinkSettings
from drivers.modbus.transactions import Permit
from drivers.modbus.wire import Wire
from register_maps import frames
from register_maps.frames import Request
from register_maps.words import Table
from tests.campaigns.answers import Script, Situation, data_length, right_answer, script
from tests.campaigns.judge_answers import Hearing, Payload, Question, Refusal

BUSY = 6
NOT_EXECUTED = frozenset({BUSY, 0x0A})
"""Refusals that say that nothing was carried out: server device busy, gateway path unavailable (V1.1b3, 7)."""
SURELY_WITHIN = 0.4
"""An answer that takes less than this part of the first time-out has to be taken. Chosen: half a second at first may become a
quarter, as the time-out follows the round trip."""
MOST_FINDINGS = 50
"""Kept of one batch: a callback that fails on every turn fills the memory otherwise."""
_REMEMBERED = 6


class Client(Protocol):
    """What is tested: `drivers.modbus.link.Link`, or one of the test's own with a planted mistake."""

    async def run(self) -> None: ...
    async def close(self) -> None: ...
    async def wait_up(self) -> int: ...
    async def read(self, request: Request) -> bytes: ...
    async def read_urgent(self, request: Request) -> bytes: ...
    async def write(self, request: Request, permit: Permit | None = None) -> None: ...


MakeClient = Callable[[Callable[[], Wire], LinkSettings, str], Client]
Fill = Callable[[bytes, Random], bytes]
"""The data that a device has for a read request."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that must not happen."""

    where: str
    """What replays it: "memory:SEED:BATCH"."""
    what: str
    history: tuple[str, ...] = ()
    """The last events of the connection, oldest first."""

    def __str__(self) -> str:
        return "\n".join((f"{self.where}: {self.what}", *(f"    {line}" for line in self.history)))


@dataclass(slots=True)
class Report:
    """What one batch came to."""

    cases: int = 0
    taken: int = 0
    """Answers that the client took, refusals included."""
    owed: int = 0
    """Answers that it had no reason not to take."""
    findings: list[Finding] = field(default_factory=list)

    def find(self, finding: Finding) -> None:
        """Keep a finding, unless there are plenty already."""
        if len(self.findings) < MOST_FINDINGS:
            self.findings.append(finding)

    def add(self, other: Report) -> None:
        self.cases += other.cases
        self.taken += other.taken
        self.owed += other.owed
        self.findings += other.findings


def noise(request: bytes, rng: Random) -> bytes:
    """Any data."""
    return rng.randbytes(data_length(request))


@dataclass(slots=True)
class Device:
    """The device at the end of one link, and the judge's ear on every connection to it."""

    rng: Random
    settings: LinkSettings
    fill: Fill = noise
    honest: float = 0.0
    """How often it is right without asking the mutations."""
    asked: int = 0
    """Requests it was sent."""
    newest: dict[bytes, tuple[Question, Hearing]] = field(default_factory=dict)
    """The newest request of each kind: by its frame without the transaction id."""
    earlier: deque[bytes] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))

    def hearing(self) -> Hearing:
        return Hearing(echoes_tid=self.settings.tid_echo)

    def heard(self, hearing: Hearing, frame: bytes, at: float) -> None:
        self.newest[frame[2:]] = (hearing.asked(frame, at), hearing)

    def answer(self, frame: bytes) -> Script:
        """Draw what comes of a request."""
        self.asked += 1
        right = right_answer(frame, self.fill(frame, self.rng))
        situation = Situation(frame, right, tuple(self.earlier), self.settings.timeout_s, self.rng)
        self.earlier.append(right)
        return ((0.0, right),) if self.honest and self.rng.random() < self.honest else script(situation)[1]

    def wire(self) -> MemoryWire:
        """A wire in memory to it."""
        hearing = self.hearing()

        def on_request(frame: bytes) -> tuple[()]:
            self.heard(hearing, frame, asyncio.get_running_loop().time())
            Player(self.answer(frame), deliver).start()
            return ()

        def deliver(data: bytes | None) -> bool:
            if not wire.is_open:
                return False
            if data is None:
                wire.drop()
            else:
                hearing.came(data, asyncio.get_running_loop().time())
                wire.deliver(data)
            return True

        wire = MemoryWire(on_request)
        return wire


class Player:
    """Plays one script: each piece starts the pause before the next, so that none overtakes another."""

    __slots__ = ("_deliver", "_loop", "_next", "_pieces")

    def __init__(self, pieces: Script, deliver: Callable[[bytes | None], bool]) -> None:
        """`deliver` returns whether there is still somebody to deliver to."""
        self._pieces = pieces
        self._deliver = deliver
        self._next = 0
        self._loop = asyncio.get_running_loop()

    def start(self) -> None:
        if self._next < len(self._pieces):
            pause_s = self._pieces[self._next][0]
            if pause_s:
                self._loop.call_later(pause_s, self._play)
            else:
                self._loop.call_soon(self._play)

    def _play(self) -> None:
        data = self._pieces[self._next][1]
        self._next += 1
        if self._deliver(data):
            self.start()


class Asker:
    """Asks one client one thing after another, at times two at once, and lets the judge compare."""

    def __init__(self, where: str, client: Client, device: Device, report: Report, rng: Random) -> None:
        self._where = where
        self._client = client
        self._device = device
        self._report = report
        self._rng = rng
        self._requests = requests(rng)

    async def ask_until(self, cases: int) -> None:
        """Go on until the device has answered so often."""
        rng = self._rng
        first = self._requests[0]
        while self._device.asked < cases:
            await self._client.wait_up()
            if rng.random() < 0.6:  # a poll asks the same again and again, and so does whoever confirms a press
                first = rng.choice(self._requests)
            chance = rng.random()
            if chance < 0.9:
                await self._ask(first)
            elif chance < 0.97:
                second = rng.choice([request for request in self._requests if request.body != first.body])
                await asyncio.gather(self._ask(first), self._ask(second))
            else:
                await self._give_up(first)

    async def _give_up(self, request: Request) -> None:
        """A caller that does not wait: its answer must not fall to the next one."""
        task = asyncio.ensure_future(self._ask(request))
        if self._rng.random() < 0.5:
            await asyncio.wait([task], timeout=self._device.settings.timeout_s / 60)
        else:
            await asyncio.wait([task], timeout=0)
        task.cancel()
        await asyncio.wait([task])

    async def _ask(self, request: Request) -> None:
        self._device.newest.pop(request.body, None)
        told: bytes | DriverError
        try:
            if request.is_write:
                await self._client.write(request)
                told = b""
            elif self._rng.random() < 0.2:
                told = await self._client.read_urgent(request)
            else:
                told = await self._client.read(request)
        except DriverError as error:
            told = error
        except Exception:  # noqa: BLE001 - an error that no caller expects is what is looked for
            self._find(f"{request}: raised\n{traceback.format_exc()}", None)
            return
        self._judge(request, told)

    def _judge(self, request: Request, told: bytes | DriverError) -> None:
        question, hearing = self._device.newest.get(request.body, (None, None))
        self._report.taken += not isinstance(told, DriverError) or isinstance(told, ControllerException)
        if question is not None and question.must_take(SURELY_WITHIN * self._device.settings.timeout_s):
            self._report.owed += 1
        objection = objection_to(question, told, self._device.settings.timeout_s)
        if objection:
            self._find(f"{request}: {objection}", hearing)

    def _find(self, what: str, hearing: Hearing | None) -> None:
        self._report.find(Finding(self._where, what, history(hearing)))


def objection_to(question: Question | None, told: bytes | DriverError, timeout_s: float) -> str | None:
    """What is wrong with what a caller was told, after everything that the connection brought."""
    if question is None:
        if isinstance(told, DriverError) and told.sent is Delivery.NO:
            return None
        return f"nothing was sent, and the caller was told {told!r}"
    answer = question.answer
    if isinstance(told, bytes):
        return None if answer == Payload(told) else f"took {told.hex(' ')!r}, where the judge allows {answer}"
    if isinstance(told, ControllerException):
        return None if answer == Refusal(told.code) else f"took {told}, where the judge allows {answer}"
    if told.sent is Delivery.NO and answer not in {Refusal(code) for code in NOT_EXECUTED}:
        return f"said {told!r}, not sent, of a request that left"
    if question.must_take(SURELY_WITHIN * timeout_s) and answer != Refusal(BUSY):
        return f"did not take {answer}, which came alone and in time: {told!r}"
    return None


def unhandled_in_loop(report: Report, where: str) -> None:
    """Make a finding of every exception in a callback, and of every task that nobody waited for."""

    def found(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        lines = traceback.format_exception(error) if isinstance(error, BaseException) else [repr(error)]
        report.find(Finding(where, f"unhandled in the loop: {context['message']}\n{''.join(lines)}"))

    asyncio.get_running_loop().set_exception_handler(found)


async def together(
    asking: Sequence[asyncio.Task[None]], running: Sequence[asyncio.Task[None]], report: Report, where: str
) -> None:
    """Wait for all who ask; whoever runs and ends before them, and whoever raises, is a finding."""
    everybody = asyncio.ensure_future(asyncio.wait(asking, return_when=asyncio.FIRST_EXCEPTION))
    try:
        everything: list[asyncio.Future[Any]] = [everybody, *running]
        await asyncio.wait(everything, return_when=asyncio.FIRST_COMPLETED)
        for task in (*running, *asking):
            if task.done() and (task in running or task.exception() is not None):
                error = task.exception()
                lines = "" if error is None else "".join(traceback.format_exception(error))
                report.find(Finding(where, f"{task.get_coro()} ended\n{lines}"))
    finally:
        everybody.cancel()
        await asyncio.wait([everybody])
        for task in asking:
            task.cancel()
        await asyncio.wait(asking)


def history(hearing: Hearing | None) -> tuple[str, ...]:
    """The last events of a connection in words."""
    if hearing is None:
        return ()
    return tuple(f"{at:.4f} s {what:5} {data.hex(' ')}" for at, what, data in hearing.events)


def requests(rng: Random) -> tuple[Request, ...]:
    """Requests of every function, no two alike; counts at the limits of the specification among them."""
    made: list[Request] = []
    for table, limit in ((Table.COIL, 2000), (Table.DISCRETE, 2000), (Table.HOLDING, 125), (Table.INPUT, 125)):
        counts = (1, 1, 2, 8, 9, 16, limit)
        made += [frames.read(table, rng.randrange(65536 - count), count, _unit(rng)) for count in counts]
    for _ in range(4):
        address = rng.randrange(65000)
        made += [
            frames.write_coil(address, rng.random() < 0.5, _unit(rng)),
            frames.write_register(address, rng.randrange(65536), _unit(rng)),
            frames.write_coils(address, [rng.random() < 0.5 for _ in range(rng.randrange(1, 20))], _unit(rng)),
            frames.write_registers(address, [rng.randrange(65536) for _ in range(rng.randrange(1, 20))], _unit(rng)),
            frames.mask_write(address, rng.randrange(65536), rng.randrange(65536), _unit(rng)),
        ]
    return tuple({request.body: request for request in made}.values())


def _unit(rng: Random) -> int:
    return rng.choice((1, 1, 1, 0, 17, 255))
