"""The outputs of one lift as sessions use them: declared to the driver as holds, and pressed once that is written down.

The driver knows of no journal. A press, and the beginning of a hold, waits here for its row; nothing else waits: releases,
renewals and what is on go on whatever the disk does.
"""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import Future
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from drivers.driver import LiftDriver, Report
from drivers.model import (
    Capabilities,
    Command,
    DriverFailed,
    Hold,
    Outcome,
    OutputChanged,
    OutputState,
    PressId,
    Result,
    Written,
)

_log = logging.getLogger(__name__)

ROW_WITHIN_S = 3.0
"""So long a press waits for its row. Chosen: a disk that takes longer is stuck, and a robot's client asks again anyhow; with
`LEAVE_WITHIN_S` it bounds how old a press can be when it leaves."""

LEAVE_WITHIN_S = 10.0
"""How long a press may wait to be written, beyond the pauses of its map. Chosen: a caller that waited longer asks again, and
nobody expects a button to be pressed for somebody who asked long ago."""

ROW_REFUSED_PAUSE_S = 2.0
"""Pause before a hold whose row was refused asks for one again. Chosen: as for a failed call."""

REPLACED = "replaced by a newer command"
NOT_SENT = "not sent: something else was wanted instead, or it could not be sent in time"
TAKEN_BACK = "let go before it was confirmed"

Permit = Callable[[], str | None]
"""Asked immediately before the bytes of a press leave, and before that as often as anybody wants to know; a text refuses it."""

_WANTED = frozenset({OutputState.REQUESTED, OutputState.ON, OutputState.HELD, OutputState.LOST})
_ON = frozenset({OutputState.ON, OutputState.HELD})


def always() -> str | None:
    """Refuse nothing."""
    return None


class WriteLog(Protocol):
    """Writes down what is told to one lift. Never raises, and only `before` has an answer to wait for."""

    def before(self, command: Command, frames: tuple[str, ...], *, again: bool = False) -> Future[str | None]:
        """Note that this is about to be pressed; tell when that is written down: None, or why it may not be pressed.

        `again` says that it is a hold that was found off, and is put on again for the same request.
        `frames` are the writes it will be, as far as they are known before words that others write too are read.
        """
        ...

    def wrote(self, written: Written) -> None:
        """Note what reached the wire, or may have. Of what is written again and again only changes are noted."""
        ...


@dataclass(slots=True, eq=False)
class _Press:
    """One press."""

    id: PressId
    future: Future[Outcome]
    begins: Permit
    """Asked beside the permit of its command until it was written."""


@dataclass(slots=True, eq=False)
class _PendingWrite:
    """A press, or the beginning of a hold, that waits for its row."""

    command: Command
    permit: Permit
    at: float
    """When it was asked for last."""
    press: _Press | None = None
    """None for a hold."""
    again: bool = False
    """A hold that was found off."""
    timer: asyncio.TimerHandle | None = None


class LiftOutputs:
    """What is declared and pressed for the sessions of one lift. The `Above` of its driver."""

    def __init__(self, lift: str, driver: LiftDriver, log: WriteLog) -> None:
        """Attach to the driver; `log` has the row of everything that is put on."""
        self.capabilities: Capabilities = driver.capabilities
        self.flags: Mapping[str, bool] = {}
        """Flags that the lift gave last."""
        self._lift = lift
        self._driver = driver
        self._write_log = log
        self._holds: dict[str, tuple[Command, Hold]] = {}
        """What is declared, by name."""
        self._permits: dict[str, Permit] = {}
        self._presses: dict[PressId, _Press] = {}
        """Those without an outcome."""
        self._newest: dict[str, PressId] = {}
        """The press that put an output on, or will."""
        self._number = 0
        """Counts presses and beginnings."""
        self._states: dict[str, OutputState] = {}
        self._adopted: set[str] = set()
        """Declared before the first reading, and not looked at yet."""
        self._pending: dict[str, _PendingWrite] = {}
        self._not_before: dict[str, float] = {}
        """When holds whose row was refused may ask again."""
        self._unwritten: set[str] = set()
        """Holds that have their row, and were not written since."""
        self._has_failed = False
        driver.attach(self)

    # what sessions ask for

    def press(self, command: Command, permit: Permit, begins: Permit = always) -> Future[Outcome]:
        """Give a command once; it waits until it is written down.

        `begins` is asked with the permit until it was written: what is on then may stay.
        """
        name = command.name
        press = _Press(self._next_number(), asyncio.get_running_loop().create_future(), begins)
        if name not in self.capabilities.commands or self._has_failed:
            failed = (
                f"{self._lift} has no command {name}" if not self._has_failed else "the driver of this lift has failed"
            )
            _end(press, command, Result.REJECTED, failed)
            return press.future
        self._drop(name, Result.UNCONFIRMED, REPLACED)
        self._ask(_PendingWrite(command, permit, _now(), press))
        return press.future

    def hold(self, command: Command, permit: Permit, *, begin: bool = True) -> None:
        """Keep a hold on, or renew it, for `max_hold_s` from now. From rest it waits until it is written down.

        Where it may not `begin`, only what is on is renewed.
        """
        name, now = command.name, _now()
        if name not in self.capabilities.commands or self._has_failed:
            return
        if name not in self._adopted and self._missing(name):
            # what the map requires was taken away: there is nothing to write down
            self.let_go(command)
            return
        if (state := self._state(name)) in _WANTED:
            self._permits[name] = permit
            declared = self._holds.get(name)
            number = 0 if declared is None else declared[1].begin
            if not begin and state is OutputState.REQUESTED:
                number = 0  # it was not put on yet
            self._declare(command, number or (self._next_number() if begin else 0), now)
            if self._state(name) is OutputState.LOST:
                self._put_on_again(name)
        elif not begin:
            self._drop(name, Result.REJECTED, NOT_SENT)
            self._undeclare(name)
        elif (waiting := self._pending.get(name)) is not None:
            waiting.permit, waiting.at = permit, now
        elif self._may_ask(name, now):
            self._ask(_PendingWrite(command, permit, now))

    def keep(self, command: Command) -> None:
        """Leave a hold on though nobody asks for it any more, and renew it no more; what waits to be put on is dropped."""
        name = command.name
        self._drop(name, Result.REJECTED, NOT_SENT)
        if (declared := self._holds.get(name)) is not None:
            self._holds[name] = declared[0], Hold(0, declared[1].until)
            self._tell()

    def adopt(self, command: Command, permit: Permit) -> None:
        """Keep what was on for this session before the process began, if the first look at the lift finds it on."""
        self._permits[command.name] = permit
        self._adopted.add(command.name)
        self._declare(command, 0, _now())

    def let_go(self, command: Command) -> None:
        """Release a hold or a press that is still on."""
        name = command.name
        self._drop(name, Result.UNCONFIRMED, TAKEN_BACK)
        self._undeclare(name)
        if (press := self._newest.get(name)) is not None and self._state(name) is not OutputState.AT_REST:
            self._driver.cancel(press)

    def given(self, command: Command) -> bool:
        """Whether it is wanted and not let go; what waits to be written down or was adopted is wanted."""
        return command.name in self._pending or self._state(command.name) in _WANTED

    def held(self, command: Command) -> bool:
        """Whether this hold is on and verified."""
        return self._state(command.name) is OutputState.HELD

    def at_rest(self, command: Command) -> bool:
        """Whether nothing of it is on or wanted, and that is verified."""
        return command.name not in self._pending and self._state(command.name) is OutputState.AT_REST

    async def release_all(self) -> None:
        """Let everything go and return once that is verified."""
        self._drop_all("everything was let go")
        self._tell()
        for press in self._newest.values():
            self._driver.cancel(press)
        await self._driver.released()

    # what the driver asks and reports

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Return what forbids this command now."""
        if press is not None:
            if (given := self._presses.get(press)) is None:
                return "nobody wants it any more"
            if (refusal := given.begins()) is not None:
                return refusal
        permit = self._permits.get(command.name)
        return "nobody wants it" if permit is None else permit()

    def report(self, item: Report) -> None:
        """Take note of something; what presses because of it follows later."""
        match item:
            case OutputChanged(name, state):
                self._changed(name, state)
            case Written(name, what):
                if what == "press":
                    self._unwritten.discard(name)
                self._write_log.wrote(item)
            case Outcome():
                if (press := self._presses.pop(item.press, None)) is not None and not press.future.done():
                    press.future.set_result(item)
            case DriverFailed():
                self._has_failed = True
                self._drop_all("everything was let go because of a bug")

    def _changed(self, name: str, state: OutputState) -> None:
        was = self._state(name)
        self._states[name] = state
        if name in self._adopted and was is OutputState.REQUESTED:
            self._adopted.discard(name)
            if state in _ON and name in self._holds:
                # it is limited from the first look on
                asyncio.get_running_loop().call_soon(self._renew, name, _now())
        if state is OutputState.LOST:
            asyncio.get_running_loop().call_soon(self._put_on_again, name)

    # declaring

    def _state(self, name: str) -> OutputState:
        return self._states.get(name, OutputState.AT_REST)

    def _missing(self, name: str) -> bool:
        return not all(self.flags.get(flag, False) for flag in self.capabilities.requires.get(name, ()))

    def _next_number(self) -> int:
        self._number += 1
        return self._number

    def _declare(self, command: Command, begin: int, at: float) -> None:
        until = at + self.capabilities.max_hold_s.get(command.name, math.inf)
        self._holds[command.name] = command, Hold(begin, until)
        self._tell()

    def _undeclare(self, name: str) -> None:
        self._adopted.discard(name)
        if self._holds.pop(name, None) is not None:
            self._tell()

    def _renew(self, name: str, at: float) -> None:
        if (declared := self._holds.get(name)) is not None:
            self._declare(declared[0], declared[1].begin, at)

    def _tell(self) -> None:
        self._driver.declare(dict(self._holds.values()))

    def _put_on_again(self, name: str) -> None:
        """Have it written down that a hold is put on again after it was found off."""
        declared, now = self._holds.get(name), _now()
        if declared is None or self._state(name) is not OutputState.LOST or self._has_failed:
            return
        if name not in self._pending and self._may_ask(name, now):
            self._ask_for_row(_PendingWrite(declared[0], always, now, again=True))

    # waiting for rows

    def _ask(self, write: _PendingWrite) -> None:
        """Have it written down, and drop what it excludes: what is asked for last is what is wanted, however rows come."""
        for other in self.capabilities.excludes.get(write.command.name, ()):
            self._drop(other, Result.REJECTED, NOT_SENT)
        self._ask_for_row(write)

    def _ask_for_row(self, write: _PendingWrite) -> None:
        name = write.command.name
        if write.press is None and name in self._unwritten:
            self._enter(write)
            return
        row = self._write_log.before(write.command, self._driver.frames(write.command), again=write.again)
        if row.done():
            self._answered(write, row)
            return
        self._pending[name] = write
        write.timer = asyncio.get_running_loop().call_later(ROW_WITHIN_S, self._too_late, write)
        row.add_done_callback(partial(self._row_done, write))

    def _row_done(self, write: _PendingWrite, row: Future[str | None]) -> None:
        if self._pending.get(write.command.name) is write:
            self._forget(write.command.name)
            self._answered(write, row)

    def _too_late(self, write: _PendingWrite) -> None:
        self._forget(write.command.name)
        self._refuse(write, f"not sent: it could not be written down within {ROW_WITHIN_S:g} s; see to the disk")

    def _answered(self, write: _PendingWrite, row: Future[str | None]) -> None:
        if row.cancelled():
            reason: str | None = "not sent: it was not written down, because the journal has ended"
        elif (bug := row.exception()) is not None:
            _log.error("%s: a bug in the journal; %s is not pressed", self._lift, write.command, exc_info=bug)
            reason = f"not sent: it was not written down: {bug}"
        else:
            reason = row.result()
        if reason is not None:
            self._refuse(write, reason)
            return
        if write.press is None:
            self._unwritten.add(write.command.name)
        self._not_before.pop(write.command.name, None)
        self._enter(write)

    def _refuse(self, write: _PendingWrite, reason: str) -> None:
        name = write.command.name
        if write.press is not None:
            _end(write.press, write.command, Result.REJECTED, reason)
            return
        if name not in self._not_before:
            _log.warning("%s: %s is not asserted: %s", self._lift, write.command, reason)
        self._not_before[name] = _now() + ROW_REFUSED_PAUSE_S

    def _may_ask(self, name: str, now: float) -> bool:
        return now >= self._not_before.get(name, -math.inf)

    def _enter(self, write: _PendingWrite) -> None:
        """It is written down: from here on the driver sees to it."""
        name, press = write.command.name, write.press
        if write.again:
            if (declared := self._holds.get(name)) is not None:
                self._holds[name] = declared[0], Hold(self._next_number(), declared[1].until)
                self._tell()
            return
        self._permits[name] = write.permit
        if press is None:
            self._declare(write.command, self._next_number(), write.at)
            return
        self._presses[press.id] = press
        self._newest[name] = press.id
        now = _now()
        self._driver.press(press.id, write.command, now + LEAVE_WITHIN_S)
        if name in self.capabilities.levels and press.id in self._presses:
            self._declare(write.command, 0, now)

    def _forget(self, name: str) -> _PendingWrite | None:
        self._unwritten.discard(name)
        write = self._pending.pop(name, None)
        if write is not None and write.timer is not None:
            write.timer.cancel()
        return write

    def _drop(self, name: str, result: Result, reason: str) -> None:
        """Forget what waits to be written down."""
        write = self._forget(name)
        if write is not None and write.press is not None:
            _end(write.press, write.command, result, reason)

    def _drop_all(self, reason: str) -> None:
        """Want nothing any more."""
        for name in self.capabilities.commands:
            self._drop(name, Result.UNCONFIRMED, reason)
        self._holds.clear()
        self._adopted.clear()


def _end(press: _Press, command: Command, result: Result, reason: str) -> None:
    if not press.future.done():
        press.future.set_result(Outcome(command, result, reason, press=press.id))


def _now() -> float:
    return asyncio.get_running_loop().time()
