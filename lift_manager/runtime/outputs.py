"""The presses and holds of one lift between the rules and its driver: what leaves was committed, and is still current."""

from __future__ import annotations

import logging
from asyncio import Future
from collections.abc import Callable, Iterable
from functools import partial

from drivers.driver import LiftDriver
from drivers.model import Command, Outcome, OutputState, PressId, Result
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.inputs import (
    Action,
    Cancel,
    CommitFailed,
    Committed,
    Input,
    OutputChanged,
    Outputs,
    Press,
    PressEnded,
)
from lift_manager.lift.observation import Moment
from lift_manager.lift.outputs import outputs
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.session import Holder
from lift_manager.runtime.hold_beginnings import Holds
from lift_manager.runtime.inbox import Inbox
from lift_manager.runtime.journal import LiftJournal
from lift_manager.runtime.recorder import Recorder

_log = logging.getLogger(__name__)

NOT_SENT = "not sent: something else was requested instead"


class LiftOutputs:
    """Declares, presses and cancels. Presses and beginnings wait for the disk, and nothing else does."""

    def __init__(
        self, config: LiftConfig, driver: LiftDriver, recorder: Recorder, journal: LiftJournal, inbox: Inbox
    ) -> None:
        """Answers of the store, and outcomes of presses, go to the inbox."""
        self._config = config
        self._driver = driver
        self._recorder = recorder
        self._journal = journal
        self._inbox = inbox
        self._holds = Holds()
        self._waiting: dict[PressId, Press] = {}
        """Presses that are not with the driver yet."""
        self._sent: dict[PressId, Command] = {}
        """Presses that are with the driver, without an outcome."""
        self._commits = 0

    @property
    def shown(self) -> Outputs:
        """The state of every output as the rules know it."""
        return self._holds.shown(self._waiting_names)

    # -- what a step leads to

    def carry_out(self, record: LiftRecord, actions: Iterable[Action], moment: Moment, *, not_recorded: bool) -> None:
        """Send what is committed, declare what should be on, and write down what waits for that.

        After a commit that was `not_recorded` the rules have ended its presses already.
        """
        presses = self._take_actions(actions, not_recorded=not_recorded)
        for pending in record.presses:
            if pending.sequence <= record.committed and (press := self._waiting.get(pending.id)) is not None:
                self._sent[press.id] = press.command
                self._driver.press(press.id, press.command, press.leave_by)
                del self._waiting[press.id]  # only now: that the driver has it is no news, since it counts as requested
        # what is released by its own time, because the lift is not read, begins again only once it is renewed
        requested = {one: hold for one, hold in outputs(self._config, record).items() if hold.until > moment.now}
        before = self._holds.declared
        beginnings = self._holds.update(requested, self._waiting_names, may_begin=not record.disk_trouble)
        if self._holds.declared != before:
            self._driver.declare(self._holds.declared)
        rows = [(press.holder, press.command, False) for press in presses]
        rows += [(record.holder, one.command, one.again) for one in beginnings]
        if rows:
            self._write_down(rows, record.sequence, moment.now)

    def cancel_all(self) -> None:
        """Take back every press that has no outcome."""
        self._waiting.clear()
        for press in tuple(self._sent):
            self._driver.cancel(press)

    # -- what the driver reports

    def changed(self, name: str, state: OutputState) -> None:
        """Record the state of an output, and pass it on as an input if it differs for the rules."""
        pressed = self._waiting_names
        before = self._holds.shown_of(name, pressed)
        self._holds.states[name] = state
        if self._holds.shown_of(name, pressed) is not before:
            self._inbox.put(OutputChanged(self.shown))

    def written(self, name: str) -> None:
        """Record that an output was switched on."""
        self._holds.put_on(name)

    def ended(self, outcome: Outcome) -> None:
        """Record the outcome of a press."""
        if outcome.press in self._sent:
            del self._sent[outcome.press]
            self._inbox.put(PressEnded(outcome.press, outcome))

    # -- what waits for the disk

    @property
    def _waiting_names(self) -> frozenset[str]:
        return frozenset(press.command.name for press in self._waiting.values())

    def _take_actions(self, actions: Iterable[Action], *, not_recorded: bool) -> list[Press]:
        """Take presses and cancels in their order; return the presses that have to be written down."""
        presses = []
        for action in actions:
            match action:
                case Press():
                    self._waiting[action.id] = action
                    presses.append(action)
                case Cancel(press) if press not in self._waiting:
                    if not self._has_ended_by_itself(press):
                        self._driver.cancel(press)
                case Cancel(press):
                    gone = self._waiting.pop(press)
                    if not not_recorded:
                        outcome = Outcome(gone.command, Result.REJECTED, NOT_SENT, press=press)
                        self._inbox.put(PressEnded(press, outcome))
        return [press for press in presses if press.id in self._waiting]

    def _has_ended_by_itself(self, press: PressId) -> bool:
        """Whether no part of a press is left to be released: it is a pulse, and only its outcome is still to come."""
        command = self._sent.get(press)
        return command is not None and self._holds.states.get(command.name) is OutputState.AT_REST

    def _write_down(self, rows: Iterable[tuple[Holder | None, Command, bool]], sequence: int, now: float) -> None:
        self._commits += 1
        self._holds.handed_over(self._commits)
        written = [
            self._journal.press(holder, command, self._driver.frames(command), now, again=again)
            for holder, command, again in rows
        ]
        answer = [self._recorder.commit_now(row) for row in written][-1]  # rows are committed in their order
        if answer.done():
            self._answered(self._commits, sequence, self._inbox.put, answer)
        else:
            # taken where it arrives: another turn of a busy loop takes milliseconds, and a press waits
            answer.add_done_callback(partial(self._answered, self._commits, sequence, self._inbox.take_now))

    def _answered(
        self, commit: int, sequence: int, report: Callable[[Input], None], answer: Future[str | None]
    ) -> None:
        """Report the answer of the store as an input."""
        if answer.cancelled():
            reason: str | None = "the journal has ended"
        elif (bug := answer.exception()) is not None:
            _log.error("%s: a bug in the journal", self._config.name, exc_info=bug)
            reason = str(bug)
        else:
            reason = answer.result()
        if reason is None:
            self._holds.committed(commit)
            report(Committed(sequence))
            return
        for name in self._holds.not_committed(commit):
            _log.warning("%s: %s is not asserted: %s", self._config.name, name, reason)
        report(CommitFailed(reason))
