"""One lift behind Modbus links: a map and its links become readings, commands and outcomes."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Mapping

from drivers.driver import Permit
from drivers.errors import (
    ConnectionLost,
    ControllerException,
    DriverError,
    HeartbeatStopped,
    PointsRefused,
    PressRefused,
    Sent,
    UnitOffline,
)
from drivers.modbus import diagnosis
from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.confirm import Expectation, proof
from drivers.modbus.endings import ended
from drivers.modbus.lines import Line, Lines
from drivers.modbus.link import Link
from drivers.modbus.plan import plan_reads, polled
from drivers.modbus.presses import Press, Presses
from drivers.modbus.reading import lift_values
from drivers.modbus.recipe import Outputs
from drivers.modbus.steps import NEED_PERMIT, Phase, Step, StepKind
from drivers.modbus.writer import Writer
from drivers.model import Command, LiftReading, LiftValues, Outcome, Proof, Result
from register_maps.codec import Block, Codec
from register_maps.frames import Request

_log = logging.getLogger(__name__)

_HEARTBEAT = frozenset({"alive"})


class ModbusLift:
    """The LiftDriver of one lift on a Modbus link.

    Wishes are noted at once; `run` writes them. Raises ValueError when the site's floors do not fit the map's coding.
    """

    def __init__(
        self, codec: Codec, link: Link, settings: LiftSettings, endpoints: Mapping[str, Line] | None = None
    ) -> None:
        """Plan the poll and prepare every request once; `endpoints` are the map's further devices."""
        self._codec = codec
        self._lines = Lines(Line(link, settings.unit_id), endpoints or {})
        self._name = link.name
        self._settings = settings
        self._commands = dict(codec.commands) if settings.control else {}
        self._names = {code: name for name, code in settings.floors.items()}
        self._blocks = plan_reads(
            polled(codec),
            codec.served,
            max_registers=settings.max_registers_per_read,
            max_bits=settings.max_bits_per_read,
        )
        self._requests = tuple((self._lines.link(b.endpoint), self._lines.request(b)) for b in self._blocks)
        self._reader = codec.reader(self._blocks)
        self._values: LiftValues | None = None
        self._epoch = 0
        self._alive_at = -math.inf
        alive = codec.map.signals.get("alive")
        self._alive_within_s = alive.must_change_within_s if alive is not None else None
        watchdog = codec.map.signals.get("watchdog_time")
        self._watchdog_unit_s = (watchdog.unit_s if watchdog is not None else None) or 1.0
        car_floor = codec.map.signals.get("car_floor")
        self._floor_under_way = car_floor is None or car_floor.known_while is None
        self._told: set[tuple[str, int]] = set()
        """Values outside their table that were reported: once each."""
        self._refused: dict[Block, str] = {}
        """What a controller refused to say, once it was found out."""
        self._outputs = Outputs(self._commands, codec.written)
        self._writer = Writer(codec, self._commands, self._lines, settings)
        self._presses = Presses(tuple(settings.floors))
        self._permits: dict[str, Permit] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wakes = {
            endpoint: asyncio.Event() for endpoint in sorted({c.endpoint for c in codec.commands.values()} | {""})
        }
        self._rested = asyncio.Event()
        self.capabilities = capabilities(codec, self._blocks, settings)

    @property
    def source(self) -> str:
        """Where it is, for messages."""
        return self._name

    async def read(self) -> LiftReading:
        """Poll once. Raises DriverError."""
        lines, loop = self._lines, self._loop
        if loop is None:
            # kept: Python 3.11 asks the kernel for the process id whenever it is asked for its loop
            loop = self._loop = asyncio.get_running_loop()
        at, epoch = loop.time(), lines.epoch
        if len(self._requests) == 1:
            link, request = self._requests[0]
            try:
                payloads: tuple[bytes, ...] = (await link.read(request),)
            except ControllerException as error:
                raise await self._explained(error, request) from error
        else:
            payloads = await self._read_blocks()
        if lines.epoch != epoch:
            raise ConnectionLost(self._name, "poll", "the connection was replaced in the middle of it")
        if epoch != self._epoch:
            await self._take_over(epoch)
        changed = self._reader.feed(payloads)
        values = self._values
        if changed or values is None:
            values = self._changed(changed or frozenset(), at)
        if self._alive_within_s is not None and at - self._alive_at > self._alive_within_s:
            raise HeartbeatStopped(self._name, at - self._alive_at, self._alive_within_s)
        if self._presses.waiting:
            self._presses.look(values, at)
        return LiftReading(at, epoch, values)

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled; no device waits for another."""
        async with asyncio.TaskGroup() as workers:
            for endpoint in self._wakes:
                workers.create_task(self._work(endpoint))

    async def _work(self, endpoint: str) -> None:
        loop = asyncio.get_running_loop()
        while True:
            step = self._outputs.next(loop.time(), endpoint)
            if step is not None:
                await self._carry_out(step)
                continue
            if self._outputs.at_rest:
                self._rested.set()
            await self._sleep_until(self._outputs.wake_at(endpoint), self._wakes[endpoint])

    def press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        """Give a command once."""
        if command.name not in self._outputs:
            return self._presses.refuse(command, permit, f"{self._settings.name} has no command {command.name}")
        press = self._presses.begin(command, permit)
        self._permits[command.name] = permit
        code = self._settings.floors[command.floor] if command.floor is not None else 1
        self._outputs.press(command.name, code, asyncio.get_running_loop().time())
        self._stir()
        return press.future

    def hold(self, command: Command, permit: Permit) -> None:
        """Keep a held command on, or renew it."""
        if command.name not in self._outputs:
            return
        if self._missing(command.name):
            # what the map requires was taken away: the hold goes, whatever its limit
            self.let_go(command)
            return
        self._permits[command.name] = permit
        resting = self._outputs.phase(command.name) is Phase.REST
        self._outputs.hold(command.name, asyncio.get_running_loop().time())
        if resting:
            self._stir()

    def let_go(self, command: Command) -> None:
        """Release a hold or a press that is still on."""
        if command.name in self._outputs and self._outputs.phase(command.name) is not Phase.REST:
            self._outputs.let_go(command.name)
            self._presses.end(command.name, Result.UNCONFIRMED, "let go before it was confirmed")
            self._stir()

    def given(self, command: Command) -> bool:
        """Whether it is wanted and not let go."""
        phase = self._outputs.phase(command.name) if command.name in self._outputs else Phase.REST
        return phase in (Phase.DUE, Phase.LEAVING, Phase.ON)

    def held(self, command: Command) -> bool:
        """Whether this hold is on and verified, by read-back or, where the map asks for it, by its effect."""
        if self._values is None or command.name not in self._outputs:
            return False
        if self._outputs.phase(command.name) is not Phase.ON:
            return False
        expected = Expectation(command, self._writer.confirm(command.name).any_of, None, ())
        return proof(expected, self._values, read_back=self._outputs.verified(command.name)) is not Proof.NONE

    async def release_all(self) -> None:
        """Let everything go and return once it is verified."""
        self._presses.end_all("everything was let go")
        self._outputs.let_all_go()
        if not self._outputs.at_rest:
            self._rested.clear()
            self._stir()
            await self._rested.wait()

    async def _read_blocks(self) -> tuple[bytes, ...]:
        payloads: list[bytes] = []
        for link, request in self._requests:
            try:
                payloads.append(await link.read(request))
            except ControllerException as error:
                raise await self._explained(error, request) from error
        return tuple(payloads)

    async def _explained(self, error: ControllerException, request: Request) -> ControllerException:
        """Name the signals that an exception answer is about; of what is not served, find out which of them."""
        if isinstance(error, UnitOffline):
            return error
        block = next(b for b, (_, asked) in zip(self._blocks, self._requests, strict=True) if asked is request)
        if error.code == diagnosis.ILLEGAL_ADDRESS and block not in self._refused:

            async def ask(one: Block) -> None:
                await self._lines.link(one.endpoint).read(self._lines.request(one))

            self._refused[block] = await diagnosis.what_is_refused(self._codec, block, ask)
        if error.code == diagnosis.ILLEGAL_ADDRESS:
            return PointsRefused(error, self._refused[block])
        return PointsRefused(error, f"this block holds {diagnosis.whose(self._codec, block)}")

    def _changed(self, changed: frozenset[str], at: float) -> LiftValues:
        if self._values is None or "alive" in changed:
            self._alive_at = at
        if self._values is None or changed != _HEARTBEAT:
            self._values = lift_values(
                self._reader.values,
                self._reader.unlisted,
                self._names,
                watchdog_unit_s=self._watchdog_unit_s,
                floor_under_way=self._floor_under_way,
            )
            self._report_unlisted(self._values)
            for name in ended(self._commands, self._values):
                self._outputs.let_go(name)
                self._stir()
        return self._values

    def _report_unlisted(self, values: LiftValues) -> None:
        for signal, raw in values.unknown.items():
            if (signal, raw) not in self._told:
                self._told.add((signal, raw))
                where = ", ".join(self._codec.map.signals[signal].addresses)
                message = "%s: %s (%s) reads %d, which the map and the site do not list; it counts as unknown"
                _log.warning(message, self._settings.name, signal, where, raw)

    async def _take_over(self, epoch: int) -> None:
        """Look at our own outputs over a new connection before anything is believed or written."""
        if self._commands:
            cells = await self._lines.cells(self._writer.all_read_blocks)
            self._outputs.reconnected(cells, asyncio.get_running_loop().time())
            self._stir()
        self._epoch = epoch
        self._refused.clear()

    async def _carry_out(self, step: Step) -> None:
        loop = asyncio.get_running_loop()
        press = self._presses.of(step.name) if step.kind is StepKind.PRESS else None
        permit = self._permit(step, press)
        maybe_sent = False
        try:
            async for request in self._writer.write(step, self._outputs.cells(step), permit):
                maybe_sent = True
                if press is not None:
                    press.frames.append(_hex(request))
            self._outputs.written(step, loop.time())
            if press is not None and not press.future.done():
                self._presses.await_proof(press, self._writer.confirm(step.name), self._values)
            if (holds := await self._writer.look(step)) is not None:
                self._outputs.looked(step, holds=holds, now=loop.time())
                if press is not None:
                    press.read_back = holds
        except PressRefused as refused:
            # a hold that may not be refreshed stays on until it is let go or falls by its limit
            self._outputs.failed(step, maybe_sent=maybe_sent, now=loop.time())
            if press is not None:
                result = Result.UNCONFIRMED if maybe_sent else Result.REJECTED
                self._presses.finish(press, result, refused.reason)
        except DriverError as error:
            sent = maybe_sent or error.sent is not Sent.NO
            rejected = isinstance(error, ControllerException)
            self._outputs.failed(step, maybe_sent=sent, now=loop.time(), rejected=rejected)
            if press is not None and press.expected is None:
                result = Result.UNCONFIRMED if error.sent is Sent.UNKNOWN else Result.REJECTED
                self._presses.finish(press, result, f"{self._writer.printed(step.name)}: {error}")
            _log.debug("%s: %s of %s failed: %s", self._settings.name, step.kind, step.name, error)

    def _permit(self, step: Step, press: Press | None) -> Permit | None:
        """Return what is asked immediately before a step leaves; None for what lets go, which nobody can refuse.

        A write that carries the pressed value of a neighbour asks for that one as well. A release cannot wait for it: what
        may not be pressed now is let go with it.
        """
        if step.kind not in NEED_PERMIT:
            neighbours = self._outputs.neighbours(step)
            if step.kind is StepKind.BEAT and neighbours:
                return lambda: self._first_refusal(neighbours)
            for name in neighbours:
                if (reason := self._refusal(name)) is not None:
                    self._outputs.let_go(name)
                    self._presses.end(name, Result.UNCONFIRMED, f"let go together with {step.name}: {reason}")
            return None

        def allowed() -> str | None:
            if not self._outputs.still_wanted(step):
                return "nobody wants it any more"
            if press is not None and self._missing(step.name):
                press.not_granted = True
            return self._refusal(step.name) or self._first_refusal(self._outputs.neighbours(step))

        return allowed

    def _refusal(self, name: str) -> str | None:
        """Say why an output may not be written as pressed now."""
        if self._lines.epoch != self._epoch:
            return "the connection is new and has not been read yet"
        if missing := self._missing(name):
            return f"{name} needs {', '.join(missing)}"
        return self._permits[name]()

    def _first_refusal(self, names: tuple[str, ...]) -> str | None:
        reasons = ((name, self._refusal(name)) for name in names)
        return next((f"{name} would be pressed with it: {reason}" for name, reason in reasons if reason), None)

    def _missing(self, name: str) -> list[str]:
        flags = self._values.flags if self._values is not None else {}
        return [flag for flag in self._commands[name].spec.requires if not flags.get(flag, False)]

    def _stir(self) -> None:
        for wake in self._wakes.values():
            wake.set()

    @staticmethod
    async def _sleep_until(when: float, wake: asyncio.Event) -> None:
        wake.clear()
        if math.isinf(when):
            await wake.wait()
            return
        try:
            async with asyncio.timeout_at(when):
                await wake.wait()
        except TimeoutError:
            return


def _hex(request: Request) -> str:
    """Unit, function and data of a request: what a person compares with a manual."""
    return request.body[4:].hex()
