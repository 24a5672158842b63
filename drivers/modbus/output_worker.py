"""Carries out what is due, device by device, and tells the outputs and presses how it went."""

from __future__ import annotations

import asyncio
import logging
import math
from contextlib import suppress

from drivers.errors import BUSY, ControllerException, Delivery, DriverError, PressRefused
from drivers.modbus.exchange import Permit
from drivers.modbus.foreign_writes import ForeignWriteCheck
from drivers.modbus.output import match
from drivers.modbus.permission import Permissions
from drivers.modbus.presses import NOT_SENT, Press, Presses
from drivers.modbus.recipe import Outputs
from drivers.modbus.reports import DriverReports
from drivers.modbus.steps import CHANGE, Phase, Step, StepKind
from drivers.modbus.writer import Writer
from drivers.model import Result

_log = logging.getLogger(__name__)

_EARLY_S = 1e-6
"""A timer may be called just before its time; what is due so soon is due now, or its worker would turn until then."""
_LET_GO_WITHIN_S = 4.0
"""How long a bug waits for outputs to be let go of before it ends the program: as long as an orderly end does."""


class OutputWorker:
    """The workers of one lift: one per device, so that no device waits for another."""

    def __init__(
        self,
        lift: str,
        outputs: Outputs,
        writer: Writer,
        presses: Presses,
        permissions: Permissions,
        watch: ForeignWriteCheck,
        up: DriverReports,
    ) -> None:
        self._lift = lift
        self._up = up
        self._outputs = outputs
        self._writer = writer
        self._presses = presses
        self._permissions = permissions
        self._watch = watch
        self._bug: Exception | None = None
        self._bug_at = math.inf
        self._complained: set[str] = set()
        """Holds whose refusal was reported: once until they are on again."""
        self._wakes = {endpoint: asyncio.Event() for endpoint in outputs.endpoints}
        self._rested = asyncio.Event()

    @property
    def has_failed(self) -> bool:
        """Whether a bug was met, and everything is let go because of it."""
        return self._bug is not None

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled.

        A bug raises only once everything is let go of, or after a few seconds in which that was not possible.
        """
        async with asyncio.TaskGroup() as workers:
            for endpoint in self._wakes:
                workers.create_task(self._work(endpoint))
            if self._watch.has_work:
                workers.create_task(self._look_for_others())

    def stir(self) -> None:
        """Something may be due."""
        for wake in self._wakes.values():
            wake.set()

    async def rest(self) -> None:
        """Return once every output is at rest."""
        if not self._outputs.at_rest:
            self._rested.clear()
            self.stir()
            await self._rested.wait()

    def end_dropped(self) -> None:
        """End the presses that will not be written any more."""
        for name in self._presses.unwritten:
            if not self._outputs.pending(name):
                self._presses.end(name, Result.REJECTED, NOT_SENT)

    async def _work(self, endpoint: str) -> None:
        loop = asyncio.get_running_loop()
        while True:
            step = None if self._writer.is_fenced else self._outputs.next(loop.time() + _EARLY_S, endpoint)
            self.end_dropped()
            self._up.report_states()
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
            due_at = math.inf if self._writer.is_fenced else self._outputs.wake_at(endpoint)
            wake_at = min(due_at, self._bug_at + _LET_GO_WITHIN_S)
            await _sleep_until(wake_at, self._wakes[endpoint])

    async def _look_for_others(self) -> None:
        try:
            await self._watch.run(self.stir)
        except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
            self._let_go_because_of(bug, "the look at our outputs")

    def _let_go_because_of(self, bug: Exception, what: str) -> None:
        _log.error("%s: a bug in %s; everything is let go", self._lift, what, exc_info=bug)
        if self._bug is None:
            self._bug, self._bug_at = bug, asyncio.get_running_loop().time()
        reason = "everything was let go because of a bug"
        self._presses.end_all(reason)
        self._outputs.let_all_go()
        self._up.report_failure(f"{reason} in {what}: {bug!r}")
        self.stir()

    async def _carry_out(self, step: Step) -> None:
        loop = asyncio.get_running_loop()
        asks = step.kind in (StepKind.PRESS, StepKind.RESET)
        press = self._presses.of(step.name) if asks else None
        permit = self._permissions.of(step, press)
        maybe_sent = False
        cells = self._outputs.covered(step) if step.kind in CHANGE else ()
        self._watch.writing(cells)
        try:
            looked = await self._look_first(step, permit)
            if looked is False:
                return
            async for request in self._writer.write(step, self._outputs.cells(step), permit):
                maybe_sent = True
                if press is not None and step.kind is StepKind.PRESS:
                    press.sent(request)
            self._outputs.written(step, loop.time())
            self._up.report_states()
            self._complained.discard(step.name)
            if press is not None and step.kind is StepKind.PRESS and not press.ended:
                self._presses.await_proof(press, self._up.confirm(step.name), self._up.values)
            if looked is None and not self._outputs.looked_at_later(step, loop.time()):
                await self._look_back(step, press)
        except PressRefused as refused:
            # a hold that may not be refreshed stays on until it is let go or falls by its limit
            self._outputs.failed(step, maybe_sent=maybe_sent, now=loop.time())
            if press is not None:
                result = Result.UNCONFIRMED if maybe_sent else Result.REJECTED
                self._presses.finish(press, result, refused.reason)
        except DriverError as error:
            rejected = isinstance(error, ControllerException) and error.code != BUSY
            sent = maybe_sent or not (error.sent is Delivery.NO or _not_executed(error))
            arrived = isinstance(error, ControllerException)
            self._outputs.failed(step, maybe_sent=sent, now=loop.time(), rejected=rejected, arrived=arrived)
            if press is not None and press.expected is None:
                result = Result.UNCONFIRMED if error.sent is Delivery.UNKNOWN else Result.REJECTED
                self._presses.finish(press, result, f"{self._writer.printed(step.name)}: {error}")
            self._complain(step, error, aloud=rejected and press is None and step.name not in self._complained)
        finally:
            self._watch.writing(cells)
            self.end_dropped()

    async def _look_first(self, step: Step, permit: Permit | None) -> bool | None:
        """Look whether a hold is still on before it is refreshed. Returns False where it is not, and nothing is to be written.

        None says that the write is to be looked at afterwards. A look that the controller refuses keeps no hold from its refresh.
        """
        output = self._outputs.output(step.name) if step.kind is StepKind.REFRESH else None
        if output is None or not output.is_looked_at_first or (permit is not None and permit() is not None):
            return None
        if not self._watch.compares(step.name):
            return None
        try:
            cells = await self._writer.cells(step.name)
        except ControllerException:
            return None
        if output.phase is not Phase.ON:
            return False
        was_held, now = output.verified, asyncio.get_running_loop().time()
        excused = self._permissions.is_tripped()
        holds = match(output.codec, cells, output.code)
        stays = output.found(holds=holds, now=now, excused=excused)
        if not stays and was_held and not excused:
            self._watch.found_off(step.name, cells)
        if not stays:
            return False
        return True if holds and output.verified and not output.codec.shared else None

    async def _look_back(self, step: Step, press: Press | None) -> None:
        """Look whether what a step wrote has come about, where anybody asks for it."""
        if (holds := await self._writer.look(step)) is not None:
            now, excused = asyncio.get_running_loop().time(), self._permissions.is_tripped()
            self._outputs.looked(step, holds=holds, now=now, excused=excused)
            self._watch.tell_fights()
            if press is not None:
                press.read_back = holds

    def _complain(self, step: Step, error: DriverError, *, aloud: bool) -> None:
        """Report a write that failed; one that a controller refuses and nobody waits for, once for everybody to hear."""
        if aloud:
            self._complained.add(step.name)
        what = self._writer.printed(step.name)
        message = "%s: %s of %s failed: %s"
        _log.log(logging.WARNING if aloud else logging.DEBUG, message, self._lift, step.kind, what, error)


async def _sleep_until(when: float, wake: asyncio.Event) -> None:
    wake.clear()
    with suppress(TimeoutError):
        async with asyncio.timeout_at(None if math.isinf(when) else when):
            await wake.wait()


def _not_executed(error: DriverError) -> bool:
    """Whether the controller said that it did not understand, and so did nothing (exceptions 01, 02 and 03)."""
    return isinstance(error, ControllerException) and error.code in (1, 2, 3)
