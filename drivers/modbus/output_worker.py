"""Carries out the steps that are due, device by device, and records the results."""

from __future__ import annotations

import asyncio
import logging
import math
from functools import partial

from drivers.errors import BUSY, ControllerException, Delivery, DriverError, PressRefused
from drivers.flag import Flag
from drivers.modbus.foreign_writes import ForeignWriteCheck
from drivers.modbus.output import matches
from drivers.modbus.outputs import Outputs
from drivers.modbus.permission import Permissions
from drivers.modbus.presses import NOT_SENT, Press, Presses
from drivers.modbus.reports import DriverReports
from drivers.modbus.steps import CHANGING_KINDS, Phase, Step, StepKind
from drivers.modbus.transactions import Permit
from drivers.modbus.writer import Writer
from drivers.model import Result
from register_maps.frames import Request

_log = logging.getLogger(__name__)

_EARLY_S = 1e-6
"""A timer may fire just before its time; a step due so soon is due now, or its worker would spin until then."""
_RELEASE_WITHIN_S = 4.0
"""How long outputs may take to be released after a bug before the program ends: as long as in an orderly shutdown."""


class OutputWorker:
    """The workers of one lift: one per device, so that no device waits for another."""

    def __init__(
        self,
        lift: str,
        outputs: Outputs,
        writer: Writer,
        presses: Presses,
        permissions: Permissions,
        foreign_writes: ForeignWriteCheck,
        reports: DriverReports,
    ) -> None:
        self._lift = lift
        self._reports = reports
        self._outputs = outputs
        self._writer = writer
        self._presses = presses
        self._permissions = permissions
        self._foreign_writes = foreign_writes
        self._bug: Exception | None = None
        self._bug_at = math.inf
        self._logged: dict[str, None] = {}
        """Outputs whose failure was logged, once until they are on again."""
        self._wakes = {endpoint: Flag() for endpoint in outputs.endpoints}
        self._rested: asyncio.Event | None = None
        """Somebody waits until every output is at rest."""

    @property
    def has_failed(self) -> bool:
        """Whether a bug was met, so that everything is released."""
        return self._bug is not None

    async def run(self) -> None:
        """Carry out presses, holds and releases until cancelled.

        After a bug it raises once everything is released, or after a few seconds.
        """
        async with asyncio.TaskGroup() as workers:
            for endpoint in self._wakes:
                workers.create_task(self._work(endpoint))
            if self._foreign_writes.has_work:
                await self._watch_foreign_writes()  # not in a task of its own, which would take a KB for each lift

    def wake(self) -> None:
        """Look for due steps now."""
        for wake in self._wakes.values():
            wake.set()

    async def wait_until_at_rest(self) -> None:
        """Return once every output is at rest."""
        if not self._outputs.all_at_rest:
            self._rested = self._rested or asyncio.Event()
            self.wake()
            await self._rested.wait()

    def end_dropped_presses(self) -> None:
        """End the presses that will no longer be written."""
        for name in self._presses.unwritten:
            if not self._outputs.is_pending(name):
                self._presses.end(name, Result.REJECTED, NOT_SENT)

    async def _work(self, endpoint: str) -> None:
        loop = asyncio.get_running_loop()
        while True:
            step = None if self._writer.is_fenced else self._outputs.next_step(loop.time() + _EARLY_S, endpoint)
            self.end_dropped_presses()
            self._reports.report_states()
            if step is not None and self._permissions.must_wait(step):
                self._outputs.record_failure(step, maybe_sent=False, now=loop.time())
                continue
            if step is not None:
                try:
                    await self._carry_out(step)
                except Exception as bug:  # noqa: BLE001  raised again once nothing is held any more
                    self._outputs.record_failure(step, maybe_sent=True, now=loop.time())
                    self._release_after_bug(bug, f"{step.kind} of {step.name}")
                continue
            if self._rested is not None and self._outputs.all_at_rest:
                self._rested.set()
                self._rested = None
            if self._bug is not None and (self._outputs.all_at_rest or loop.time() >= self._bug_at + _RELEASE_WITHIN_S):
                raise self._bug
            due_at = math.inf if self._writer.is_fenced else self._outputs.wake_at(endpoint)
            wake_at = min(due_at, self._bug_at + _RELEASE_WITHIN_S)
            await _sleep_until(wake_at, self._wakes[endpoint])

    async def _watch_foreign_writes(self) -> None:
        try:
            await self._foreign_writes.run(self.wake)
        except Exception as bug:  # noqa: BLE001  it is raised again once nothing is held any more
            self._release_after_bug(bug, "the check for foreign writes")

    def _release_after_bug(self, bug: Exception, what: str) -> None:
        _log.error("%s: a bug in %s; everything is released", self._lift, what, exc_info=bug)
        if self._bug is None:
            self._bug, self._bug_at = bug, asyncio.get_running_loop().time()
        reason = "everything was released because of a bug"
        self._presses.end_all(reason)
        self._outputs.release_all()
        self._reports.report_failure(f"{reason} in {what}: {bug!r}")
        self.wake()

    async def _carry_out(self, step: Step) -> None:
        loop = asyncio.get_running_loop()
        starts_press = step.kind in (StepKind.PRESS, StepKind.RESET)
        press = self._presses.get(step.name) if starts_press else None
        permit = self._permissions.permit_for(step, press)
        answered: list[Request] = []
        on_answer = partial(_note_answer, answered, press if step.kind is StepKind.PRESS else None)
        cells = self._outputs.covered_cells(step) if step.kind in CHANGING_KINDS else ()
        self._foreign_writes.count_write(cells)
        try:
            looked = await self._look_first(step, permit)
            if looked is False:
                return
            await self._writer.write(step, self._outputs.cells(step), permit, on_answer)
            self._outputs.record_write(step, loop.time())
            self._reports.report_states()
            self._logged.pop(step.name, None)
            if press is not None and step.kind is StepKind.PRESS and not press.ended:
                self._presses.await_proof(press, self._reports.confirmation(step.name), self._reports.values)
            if looked is None and not self._outputs.defer_verification(step, loop.time()):
                await self._look_back(step, press)
        except PressRefused as refused:
            # a hold that may not be refreshed stays on until it is released or expires
            self._outputs.record_failure(step, maybe_sent=bool(answered), now=loop.time())
            if press is not None:
                result = Result.UNCONFIRMED if answered else Result.REJECTED
                self._presses.finish(press, result, refused.reason)
        except DriverError as error:
            rejected = isinstance(error, ControllerException) and error.code != BUSY
            sent = bool(answered) or not (error.sent is Delivery.NO or _was_not_executed(error))
            arrived = isinstance(error, ControllerException)
            self._outputs.record_failure(step, maybe_sent=sent, now=loop.time(), rejected=rejected, arrived=arrived)
            if press is not None and press.expected is None:
                result = Result.UNCONFIRMED if error.sent is Delivery.UNKNOWN else Result.REJECTED
                self._presses.finish(press, result, f"{self._writer.printed(step.name)}: {error}")
            self._log_failure(step, error, is_warning=rejected and press is None and step.name not in self._logged)
        finally:
            self._foreign_writes.count_write(cells)
            self.end_dropped_presses()

    async def _look_first(self, step: Step, permit: Permit | None) -> bool | None:
        """Read a hold back before it is refreshed. Returns False if it is off: then nothing is to be written.

        None: read it back after the write instead. A read that the controller refuses does not prevent the refresh.
        """
        output = self._outputs.output(step.name) if step.kind is StepKind.REFRESH else None
        if output is None or not output.is_looked_at_first or (permit is not None and permit() is not None):
            return None
        if not self._foreign_writes.compares(step.name):
            return None
        try:
            cells = await self._writer.cells(step.name)
        except ControllerException:
            return None
        if output.phase is not Phase.ON:
            return False
        was_held, now = output.verified, asyncio.get_running_loop().time()
        excused = self._permissions.is_watchdog_tripped()
        holds = matches(output.codec, cells, output.code)
        stays = output.check_before_refresh(holds=holds, now=now, excused=excused)
        if not stays and was_held and not excused:
            self._foreign_writes.report_found_off(step.name, cells)
        if not stays:
            return False
        return True if holds and output.verified and not output.codec.is_shared else None

    async def _look_back(self, step: Step, press: Press | None) -> None:
        """Read back what a step wrote, if that is used for anything."""
        if (holds := await self._writer.read_back(step)) is not None:
            now, excused = asyncio.get_running_loop().time(), self._permissions.is_watchdog_tripped()
            self._outputs.record_look(step, holds=holds, now=now, excused=excused)
            self._foreign_writes.report_fights()
            if press is not None:
                press.read_back = holds

    def _log_failure(self, step: Step, error: DriverError, *, is_warning: bool) -> None:
        """Log a write that failed; as a warning, once, if the controller refuses it and no press reports it."""
        if is_warning:
            self._logged[step.name] = None
        what = self._writer.printed(step.name)
        message = "%s: %s of %s failed: %s"
        _log.log(logging.WARNING if is_warning else logging.DEBUG, message, self._lift, step.kind, what, error)


def _note_answer(answered: list[Request], press: Press | None, request: Request) -> None:
    answered.append(request)
    if press is not None:
        press.add_frame(request)


async def _sleep_until(when: float, wake: Flag) -> None:
    wake.clear()
    timer = None if math.isinf(when) else asyncio.get_running_loop().call_at(when, wake.set)
    try:
        await wake.wait()
    finally:
        if timer is not None:
            timer.cancel()


def _was_not_executed(error: DriverError) -> bool:
    """Whether the controller answered that it did not understand, and so did nothing (exceptions 01, 02 and 03)."""
    return isinstance(error, ControllerException) and error.code in (1, 2, 3)
