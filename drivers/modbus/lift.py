"""One lift behind Modbus links: a map and its links become readings, commands and outcomes."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Mapping
from contextlib import suppress

from drivers.driver import Permit
from drivers.errors import (
    BUSY,
    ConnectionLost,
    ControllerException,
    DriverError,
    PointsRefused,
    PressRefused,
    Sent,
    UnitOffline,
)
from drivers.modbus.capabilities import LiftSettings, capabilities
from drivers.modbus.confirm import Expectation, proof
from drivers.modbus.diagnosis import Diagnosis
from drivers.modbus.endings import ended
from drivers.modbus.foreign import Watch
from drivers.modbus.heartbeat import SIGNAL, Heartbeat
from drivers.modbus.lines import Line, Lines
from drivers.modbus.link import Link
from drivers.modbus.permission import Permissions
from drivers.modbus.plan import plan_reads, polled
from drivers.modbus.presses import Press, Presses
from drivers.modbus.reading import lift_values
from drivers.modbus.recipe import Outputs
from drivers.modbus.steps import CHANGE, Phase, Step, StepKind
from drivers.modbus.writer import Writer
from drivers.model import Command, LiftReading, LiftValues, Outcome, Proof, Result
from register_maps.codec import Cell, Codec

_log = logging.getLogger(__name__)

_ONLY_ALIVE = frozenset({SIGNAL})
_EARLY_S = 1e-6
"""A timer may be called just before its time; what is due so soon is due now, or its worker would turn until then."""
_LET_GO_WITHIN_S = 4.0
"""How long a bug waits for outputs to be let go of before it ends the program: as long as an orderly end does."""


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
        self._requests = tuple((b, self._lines.link(b.endpoint), self._lines.request(b)) for b in self._blocks)
        self._reader = codec.reader(self._blocks)
        self._values: LiftValues | None = None
        self._epoch = 0
        self._epochs: dict[str, int] = {}
        self._bug: Exception | None = None
        self._bug_at = math.inf
        self._heartbeat = Heartbeat(codec, link.name)
        watchdog = codec.map.signals.get("watchdog_time")
        self._watchdog_unit_s = (watchdog.unit_s if watchdog is not None else None) or 1.0
        car_floor = codec.map.signals.get("car_floor")
        self._floor_under_way = car_floor is None or car_floor.known_while is None
        self._diagnosis = Diagnosis(codec, self._lines, settings.name)
        self._outputs = Outputs(self._commands, codec.written)
        self._writer = Writer(codec, self._commands, self._lines, settings)
        self._presses = Presses(tuple(settings.floors))
        self._permissions = Permissions(
            codec,
            self._outputs,
            self._presses,
            self._lines,
            self._heartbeat,
            values=lambda: self._values,
            is_unread=self._is_unread,
        )
        self._watch = Watch(
            codec,
            self._outputs,
            self._lines,
            settings,
            is_unread=self._is_unread,
            tripped=self._is_tripped,
            clear=self._clear,
        )
        self._notices = self._watch.notices
        self._complained: set[str] = set()
        """Holds whose refusal was reported: once until they are on again."""
        self._check_floors()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wakes = {
            endpoint: asyncio.Event() for endpoint in sorted({c.endpoint for c in codec.commands.values()} | {""})
        }
        self._rested = asyncio.Event()
        self.capabilities = capabilities(codec, self._blocks, settings)

    def _check_floors(self) -> None:
        """Raise ValueError for a floor of the site that some call of the map cannot express."""
        for command in self._commands.values():
            for code in self._settings.floors.values() if command.is_call else ():
                command.encode(code)

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
            block, link, request = self._requests[0]
            try:
                payloads: tuple[bytes, ...] = (await link.read(request),)
            except ControllerException as error:
                raise await self._diagnosis.explained(error, block) from error
        else:
            payloads = await self._read_blocks()
        if lines.epoch != epoch:
            raise ConnectionLost(self._name, "poll", "the connection was replaced in the middle of it")
        is_new = epoch != self._epoch
        if is_new:
            await self._take_over(epoch)
        changed = self._reader.feed(payloads)
        values = self._values
        if changed or values is None:
            values = self._changed(changed or frozenset(), at)
        if is_new:
            self._heartbeat.connected(self._epochs, at)
        if at > self._heartbeat.live_until:
            raise self._heartbeat.error(at)
        if self._presses.waiting:
            self._presses.look(values, at)
        return LiftReading(at, epoch, values, self._watch.take_notices() if self._notices else ())

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled; no device waits for another.

        A bug raises only once everything is let go of, or after a few seconds in which that was not possible.
        """
        async with asyncio.TaskGroup() as workers:
            for endpoint in self._wakes:
                workers.create_task(self._work(endpoint))
            if self._watch.has_work:
                workers.create_task(self._look_for_others())

    async def _work(self, endpoint: str) -> None:
        loop = asyncio.get_running_loop()
        while True:
            step = self._outputs.next(loop.time() + _EARLY_S, endpoint)
            if step is not None and self._permissions.waits(step):
                self._outputs.failed(step, maybe_sent=False, now=loop.time())
                continue
            if step is not None:
                try:
                    await self._carry_out(step)
                except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
                    self._outputs.failed(step, maybe_sent=True, now=loop.time())
                    self._let_go_because_of(bug, f"{step.kind} of {step.name}")
                continue
            if self._outputs.at_rest:
                self._rested.set()
            if self._bug is not None and (self._outputs.at_rest or loop.time() >= self._bug_at + _LET_GO_WITHIN_S):
                raise self._bug
            wake_at = min(self._outputs.wake_at(endpoint), self._bug_at + _LET_GO_WITHIN_S)
            await _sleep_until(wake_at, self._wakes[endpoint])

    async def _look_for_others(self) -> None:
        try:
            await self._watch.run()
        except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
            self._let_go_because_of(bug, "the look at our outputs")

    def _let_go_because_of(self, bug: Exception, what: str) -> None:
        _log.error("%s: a bug in %s; everything is let go", self._settings.name, what, exc_info=bug)
        if self._bug is None:
            self._bug, self._bug_at = bug, asyncio.get_running_loop().time()
        self._presses.end_all("everything was let go because of a bug")
        self._outputs.let_all_go()
        self._stir()

    def press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        """Give a command once."""
        if command.name not in self._outputs:
            return self._presses.refuse(command, permit, f"{self._settings.name} has no command {command.name}")
        if self._bug is not None:
            return self._presses.refuse(command, permit, "the driver of this lift has failed")
        press = self._presses.begin(command, permit)
        self._permissions.note(command.name, permit)
        code = self._settings.floors[command.floor] if command.floor is not None else 1
        self._outputs.press(command.name, code, asyncio.get_running_loop().time())
        self._end_dropped()
        self._stir()
        return press.future

    def hold(self, command: Command, permit: Permit) -> None:
        """Keep a held command on, or renew it."""
        if command.name not in self._outputs or self._bug is not None:
            return
        if self._permissions.missing(command.name):
            # what the map requires was taken away: the hold goes, whatever its limit
            self.let_go(command)
            return
        self._permissions.note(command.name, permit)
        resting = self._outputs.phase(command.name) is Phase.REST
        self._outputs.hold(command.name, asyncio.get_running_loop().time())
        if resting:
            self._end_dropped()
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
        any_of = self._writer.confirm(command.name).any_of
        if "readback" in any_of and not self._outputs.verified(command.name):
            return False  # a door that is open by itself does not make up for a hold that is not there
        expected = Expectation(command, any_of, None, ())
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
        for block, link, request in self._requests:
            try:
                payloads.append(await link.read(request))
            except ControllerException as error:
                raise await self._diagnosis.explained(error, block) from error
        return tuple(payloads)

    def _changed(self, changed: frozenset[str], at: float) -> LiftValues:
        if SIGNAL in changed:
            self._heartbeat.beat(at)
        if self._values is None or changed != _ONLY_ALIVE:
            self._values = lift_values(
                self._reader.values,
                self._reader.unlisted,
                self._names,
                watchdog_unit_s=self._watchdog_unit_s,
                floor_under_way=self._floor_under_way,
            )
            self._diagnosis.report_unlisted(self._values)
            for name in ended(self._commands, self._values, self._codec.signals):
                self._outputs.let_go(name)
                self._end_dropped()
                self._stir()
        return self._values

    async def _take_over(self, epoch: int) -> None:
        """Look at our own outputs over a new connection before anything is believed or written."""
        epochs = self._lines.epochs
        changed = {endpoint for endpoint, number in epochs.items() if number != self._epochs.get(endpoint)}
        cells: dict[Cell, int] = {}
        for block, names in self._writer.read_blocks(changed).items():
            try:
                cells |= await self._lines.cells([block])
            except UnitOffline:
                raise
            except ControllerException as error:
                raise PointsRefused(error, f"it does not say what our outputs hold: {names}") from error
        if self._commands:
            self._outputs.reconnected(cells, asyncio.get_running_loop().time(), changed)
            self._stir()
        self._epoch, self._epochs = epoch, epochs
        self._diagnosis.forget()

    async def _carry_out(self, step: Step) -> None:
        loop = asyncio.get_running_loop()
        asks = step.kind in (StepKind.PRESS, StepKind.RESET)
        press = self._presses.of(step.name) if asks else None
        permit = self._permissions.of(step, press)
        maybe_sent = False
        cells = self._outputs.covered(step) if step.kind in CHANGE else ()
        self._watch.writing(cells)
        try:
            async for request in self._writer.write(step, self._outputs.cells(step), permit):
                maybe_sent = True
                if press is not None and step.kind is StepKind.PRESS:
                    press.sent(request)
            self._outputs.written(step, loop.time())
            self._complained.discard(step.name)
            if press is not None and step.kind is StepKind.PRESS and not press.future.done():
                self._presses.await_proof(press, self._writer.confirm(step.name), self._values)
            if not self._outputs.looked_at_later(step, loop.time()):
                await self._look_back(step, press)
        except PressRefused as refused:
            # a hold that may not be refreshed stays on until it is let go or falls by its limit
            self._outputs.failed(step, maybe_sent=maybe_sent, now=loop.time())
            if press is not None:
                result = Result.UNCONFIRMED if maybe_sent else Result.REJECTED
                self._presses.finish(press, result, refused.reason)
        except DriverError as error:
            rejected = isinstance(error, ControllerException) and error.code != BUSY
            sent = maybe_sent or not (error.sent is Sent.NO or _not_executed(error))
            self._outputs.failed(step, maybe_sent=sent, now=loop.time(), rejected=rejected)
            if press is not None and press.expected is None:
                result = Result.UNCONFIRMED if error.sent is Sent.UNKNOWN else Result.REJECTED
                self._presses.finish(press, result, f"{self._writer.printed(step.name)}: {error}")
            self._complain(step, error, aloud=rejected and press is None and step.name not in self._complained)
        finally:
            self._watch.writing(cells)
            self._end_dropped()

    async def _look_back(self, step: Step, press: Press | None) -> None:
        """Look whether what a step wrote has come about, where anybody asks for it."""
        if (holds := await self._writer.look(step)) is not None:
            self._outputs.looked(step, holds=holds, now=asyncio.get_running_loop().time(), excused=self._is_tripped())
            self._watch.tell_fights()
            if press is not None:
                press.read_back = holds

    def _complain(self, step: Step, error: DriverError, *, aloud: bool) -> None:
        """Report a write that failed; one that a controller refuses and nobody waits for, once for everybody to hear."""
        if aloud:
            self._complained.add(step.name)
        what = self._writer.printed(step.name)
        message = "%s: %s of %s failed: %s"
        _log.log(logging.WARNING if aloud else logging.DEBUG, message, self._settings.name, step.kind, what, error)

    def _end_dropped(self) -> None:
        """End the presses that will not be written any more."""
        for name in self._presses.unwritten:
            if not self._outputs.pending(name):
                reason = "not sent: something else was wanted instead, or it could not be sent in time"
                self._presses.end(name, Result.REJECTED, reason)

    def _is_unread(self) -> bool:
        """Whether a connection is new, and nothing was read over it yet."""
        return self._lines.epoch != self._epoch

    def _clear(self, name: str) -> None:
        """Let go of what somebody else has pressed."""
        self._outputs.clear(name, asyncio.get_running_loop().time())
        self._stir()

    def _is_tripped(self) -> bool:
        """Whether the lift says that a watchdog has let our outputs go."""
        return self._values is not None and self._values.flags.get("watchdog_tripped", False)

    def _stir(self) -> None:
        for wake in self._wakes.values():
            wake.set()


async def _sleep_until(when: float, wake: asyncio.Event) -> None:
    wake.clear()
    with suppress(TimeoutError):
        async with asyncio.timeout_at(None if math.isinf(when) else when):
            await wake.wait()


def _not_executed(error: DriverError) -> bool:
    """Whether the controller said that it did not understand, and so did nothing (exceptions 01, 02 and 03)."""
    return isinstance(error, ControllerException) and error.code in (1, 2, 3)
