"""Carries out what the rules decide for one lift: polls it, steps its record, publishes, declares, presses and writes down."""

from __future__ import annotations

import asyncio
import logging
import math
from asyncio import Future
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial

from drivers.driver import LiftDriver, Report
from drivers.errors import ControllerException, DriverError
from drivers.model import (
    Command,
    DriverFailed,
    FloorName,
    LiftReading,
    Outcome,
    OutputChanged,
    PressId,
    Result,
    Written,
)
from lift_manager.lift import doors, inputs
from lift_manager.lift.commands import CommandStatus
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.inhibits import blocked_by, fresh
from lift_manager.lift.inputs import (
    Action,
    AnnounceStop,
    Cancel,
    CommitFailed,
    Committed,
    GiveCommand,
    HandOver,
    Input,
    LiftRequest,
    Press,
    PressEnded,
    ReadFailed,
    Reading,
    Request,
    Stop,
    Tick,
)
from lift_manager.lift.observation import Moment
from lift_manager.lift.outputs import outputs
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, same_but_for_time, state
from lift_manager.lift.step import Reply, Step, is_news, note_outputs, start, step
from lift_manager.runtime.bus import Bus, Event, StateChanged
from lift_manager.runtime.holds import Holds
from lift_manager.runtime.journal import LiftJournal
from lift_manager.runtime.recorder import Clock, Recorder, wall_clock
from lift_manager.runtime.ticker import Ticker

_log = logging.getLogger(__name__)

WAKES_LATE_S = 0.001
"""A timer may fire a hair before its time, and would find nothing due."""

_NO_CLOCK = datetime.min.replace(tzinfo=UTC)
"""The time of day costs more than everything else that a reading without news needs, and nothing depends on it there."""

NOT_SENT = "not sent: something else was wanted instead"


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftSettings:
    """What the site says about one lift beside its rules (`LiftConfig`)."""

    poll_s: float = 0.2
    first_poll_s: float = 0.0
    """Delay of the first poll, so that the lifts of a site do not poll in one burst."""
    rmf_name: str = ""
    """In RMF's building map; empty where it is the same there."""
    rmf_floors: Mapping[FloorName, str] = field(default_factory=dict)
    """Those that RMF's building map names otherwise."""


class LiftActor:
    """One lift: its driver, its newest record, and the order in which things happen to it. The `Above` of its driver."""

    def __init__(  # noqa: PLR0913  what it works with
        self,
        driver: LiftDriver,
        config: LiftConfig,
        bus: Bus[Event],
        recorder: Recorder,
        *,
        settings: LiftSettings | None = None,
        ticker: Ticker | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Attach to the driver; nothing happens before `run` or the first input. The lifts of a site share bus, recorder and ticker."""
        self.config = config
        self.settings = settings or LiftSettings()
        self.record = LiftRecord(durable=recorder.recall(config.name))
        """The newest one; only inputs change it."""
        self.polls = 0
        """Polls that have ended, well or not: it rises for as long as our own loop advances."""
        self.looked = asyncio.Event()
        """The lift has been read."""
        self.driver = driver
        self._bus = bus
        self._recorder = recorder
        self._ticker = ticker or Ticker()
        self._clock = clock or wall_clock()
        self._journal = LiftJournal(config.name, driver.source, recorder)
        self._read_at = -math.inf
        """Monotonic seconds; nothing that the lift said is older than this."""
        self._holds = Holds()
        self._waiting: dict[PressId, Press] = {}
        """Presses that are not on the disk."""
        self._pressed: set[PressId] = set()
        """Presses that are with the driver, without an outcome."""
        self._inbox: deque[Input] = deque()
        """What driver and store have reported."""
        self._commits = 0
        self._has_begun = self._is_taking = False
        self._soon: asyncio.Handle | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._wake_at = math.inf
        self._shown: LiftState | None = None
        """As published last."""
        self._bug: Future[None] | None = None
        driver.attach(self)

    # -- life

    async def run(self) -> None:
        """Go on with the session of before this start, and poll the lift until cancelled. A failed poll affects no other lift."""
        self.begin()
        self._bug = asyncio.get_running_loop().create_future()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._poll())
            tasks.create_task(_raised(self._bug))

    async def drive(self) -> None:
        """Carry out presses, holds and releases until cancelled; releasing needs this and the link, and nothing else."""
        await self.driver.run()

    def begin(self) -> None:
        """Go on with what an earlier process left, before the lift is read; once."""
        if not self._has_begun:
            self._has_begun = True
            moment = self.moment
            self._carry_out(start(self.config, self.record.durable, moment), moment)
            self._take_reports()

    def announce_stop(self) -> bool:
        """Refuse everything from now on and withdraw OPEN; return whether a door is still held for a robot in it."""
        if not self.record.is_stopping:
            self.handle(AnnounceStop())
        moment = self.moment
        return doors.is_clearing(self.config, self.record, fresh(self.config, self.record, moment), moment.now)

    async def stop(self) -> None:
        """Release everything, and return once that is verified; bound it with a timeout."""
        self.handle(Stop())
        for press in tuple(self._pressed):
            self.driver.cancel(press)
        try:
            await self.driver.released()
        finally:
            self.sum_up(end=True)

    # -- what happens

    def handle(self, happened: Input) -> Reply | None:
        """Take one input and everything that it brings about; return the reply to whoever made it. Not re-entrant."""
        self.begin()
        self._take_reports()
        self._take_trouble()
        if isinstance(happened, Request):
            self.freshen()  # what is decided has a later number than every state before it
        reply = self._take(happened)
        self._take_reports()
        return reply

    def report(self, item: Report) -> None:
        """Take note of what the driver reports; it is in the middle of its work, so the rules learn of it later."""
        match item:
            case OutputChanged(name, output):
                self._holds.states[name] = output
                if not (self._inbox and isinstance(self._inbox[-1], inputs.OutputChanged)):
                    self._inbox.append(inputs.OutputChanged({}))
            case Outcome(press=press):
                if press in self._pressed:
                    self._pressed.discard(press)
                    self._inbox.append(PressEnded(press, item))
            case Written(name, what):
                if what == "press":
                    self._holds.put_on(name)
                self._journal.wrote(self._holder, item)
            case DriverFailed(reason):
                _log.error("%s: a bug in its driver, everything is released: %s", self.config.name, reason)
        self._take_reports_soon()

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Return what forbids this command now."""
        return blocked_by(self.config, self.record, command, press, self.moment)

    # -- what is known

    @property
    def moment(self) -> Moment:
        """Now."""
        return Moment(_now(), self._clock(), self._read_at)

    def state(self) -> LiftState:
        """Return what this lift publishes right now, from memory."""
        return state(self.config, self.record, self.moment)

    def freshen(self) -> None:
        """Publish a change that was not published yet, whether or not anybody listens."""
        self._publish_state(self.moment)

    def sum_up(self, *, end: bool = False) -> None:
        """Write down what was only counted for a minute, or at the end all of it."""
        self._journal.tell(_now(), end=end)

    # -- polls

    async def _poll(self) -> None:
        loop, period = asyncio.get_running_loop(), self.settings.poll_s
        await asyncio.sleep(self.settings.first_poll_s)
        due = loop.time()
        while True:
            try:
                reading = await self.driver.read()
            except DriverError as error:
                self.handle(ReadFailed(str(error)))
                self._journal.link(str(error), _now(), answers=isinstance(error, ControllerException))
            else:
                self._got(reading)
            self.polls += 1
            due += period
            late = loop.time() - due
            if late > 0:
                # an overloaded poller skips polls; queued ones would only bring older and older news
                due += math.ceil(late / period) * period
            await self._ticker.sleep_until(due)

    def _got(self, reading: LiftReading) -> None:
        """Take a reading; one without news costs next to nothing."""
        moment = Moment(_now(), _NO_CLOCK, self._read_at)
        if not self._inbox and not is_news(self.config, self.record, reading, moment):
            self._read_at = reading.at
            return
        self.handle(Reading(reading, {}))
        self._journal.link(self.record.fault, moment.now, answers=True)
        self._journal.mode(reading.values.mode, moment.now)
        self.looked.set()

    # -- one input after the other

    def _take(self, happened: Input) -> Reply | None:
        if self._is_taking:
            raise RuntimeError(f"{self.config.name}: {happened} came from within another input")
        self._is_taking = True
        try:
            return self._stepped(happened)
        finally:
            self._is_taking = False

    def _stepped(self, happened: Input) -> Reply | None:
        moment, record = self.moment, self.record
        known = self._holds.shown([press.command.name for press in self._waiting.values()])
        match happened:
            case Reading(reading):
                happened = Reading(reading, known)
                self._read_at = reading.at
            case inputs.OutputChanged():
                happened = inputs.OutputChanged(known)
            case GiveCommand() if not self._journal.admits(happened, moment.now, known=self._knows(happened)):
                happened = replace(happened, is_recorded=False)
        if known != record.outputs:
            record = note_outputs(self.config, record, known, moment)
        done = step(self.config, record, happened, moment)
        if isinstance(happened, Request) and _is_recorded(happened, done.reply):
            refused = done.reply if isinstance(done.reply, Refused) else None
            self._journal.request(happened, refused, moment.now, known=self._knows(happened))
        self._carry_out(done, replace(moment, read_at=self._read_at), not_recorded=isinstance(happened, CommitFailed))
        return done.reply

    def _carry_out(self, done: Step, moment: Moment, *, not_recorded: bool = False) -> None:
        """Assign the record, publish, declare, and have written down what has to be."""
        before, self.record = self.record, done.record
        for event in done.events:
            self._journal.event(event, self._bus.publish(event))
        if self._bus.heard:
            self._publish_state(moment)
        if done.record.durable is not before.durable:
            self._recorder.keep(self.config.name, done.record.durable)
        presses = self._take_actions(done.actions, not_recorded=not_recorded)
        self._send_committed()
        self._declare(presses, moment)
        self._wake(done.wake_at)

    def _take_actions(self, actions: Iterable[Action], *, not_recorded: bool) -> list[Press]:
        presses = []
        for action in actions:
            match action:
                case Press():
                    self._waiting[action.id] = action
                    presses.append(action)
                case Cancel(press) if press in self._pressed:
                    self.driver.cancel(press)
                case Cancel(press):
                    gone = self._waiting.pop(press, None)
                    if gone is not None and not not_recorded:
                        outcome = Outcome(gone.command, Result.REJECTED, NOT_SENT, press=press)
                        self._inbox.append(PressEnded(press, outcome))
        return [press for press in presses if press.id in self._waiting]

    def _send_committed(self) -> None:
        """Give the driver every press that is on the disk and still current."""
        for pending in self.record.presses:
            if pending.sequence <= self.record.committed and pending.id in self._waiting:
                press = self._waiting.pop(pending.id)
                self._pressed.add(press.id)
                self.driver.press(press.id, press.command, press.leave_by)

    def _declare(self, presses: Iterable[Press], moment: Moment) -> None:
        """Declare the holds, and have the presses and the beginnings of this step written down."""
        wanted = outputs(self.config, self.record, moment)
        waiting = {press.command.name for press in self._waiting.values()}
        before = self._holds.declared
        beginnings = self._holds.update(wanted, waiting, may_begin=not self.record.disk_trouble)
        if self._holds.declared != before:
            self.driver.declare(self._holds.declared)
        rows = [(press.holder, press.command, False) for press in presses]
        rows += [(self._holder, one.command, one.again) for one in beginnings]
        if not rows:
            return
        self._commits += 1
        self._holds.handed_over(self._commits)
        written = [
            self._journal.press(holder, command, self.driver.frames(command), moment.now, again=again)
            for holder, command, again in rows
        ]
        answer = [self._recorder.before(row) for row in written][-1]  # rows are committed in their order
        done = partial(self._take_answer, self._commits, self.record.sequence)
        if answer.done():
            done(answer)
        else:
            answer.add_done_callback(done)

    def _take_answer(self, commit: int, sequence: int, answer: Future[str | None]) -> None:
        """Take the answer of the store as an input."""
        if answer.cancelled():
            reason: str | None = "the journal has ended"
        elif (bug := answer.exception()) is not None:
            _log.error("%s: a bug in the journal", self.config.name, exc_info=bug)
            reason = str(bug)
        else:
            reason = answer.result()
        if reason is None:
            self._holds.committed(commit)
            self._inbox.append(Committed(sequence))
        else:
            for name in self._holds.not_committed(commit):
                _log.warning("%s: %s is not asserted: %s", self.config.name, name, reason)
            self._inbox.append(CommitFailed(reason))
        self._take_reports_soon()

    def _take_reports(self) -> None:
        while self._inbox:
            self._take(self._inbox.popleft())

    def _take_reports_soon(self) -> None:
        if self._soon is None:
            self._soon = asyncio.get_running_loop().call_soon(self._guarded, None)

    def _take_trouble(self) -> None:
        """Let the rules know whether anything can be written down."""
        trouble = self._recorder.trouble
        if trouble and not self.record.disk_trouble:
            self._take(CommitFailed(trouble))
        elif self.record.disk_trouble and not trouble:
            self._take(Committed(self.record.committed))

    def _wake(self, at: float) -> None:
        """Step the record at this time, whatever comes or does not come before."""
        if at == self._wake_at:
            return
        self._wake_at = at
        if self._timer is not None:
            self._timer.cancel()
        if at < math.inf:
            self._timer = asyncio.get_running_loop().call_at(at + WAKES_LATE_S, self._guarded, Tick())

    def _guarded(self, happened: Input | None) -> None:
        """Take reports, or an input, from a callback of the loop: a bug ends `run`, as one in a task does."""
        if happened is None:
            self._soon = None
        else:
            self._wake_at = math.inf
        try:
            if happened is None:
                self._take_reports()
            else:
                self.handle(happened)
        except Exception as bug:
            if self._bug is None or self._bug.done():
                raise
            self._bug.set_exception(bug)

    # -- small things

    @property
    def _holder(self) -> Holder | None:
        session = self.record.session
        return None if session is None else session.holder

    def _publish_state(self, moment: Moment) -> None:
        """Give a state an event of its own, if it is another one than that of the newest."""
        now = state(self.config, self.record, moment)
        if self._shown is None or not same_but_for_time(now, self._shown):
            self._shown = now
            self._bus.publish(StateChanged(self.config.name, now))

    def _knows(self, request: Request) -> bool:
        """Whether a request names no floor, or one that the lift has."""
        match request:
            case LiftRequest(floor=floor):
                return floor in self.config.floors
            case GiveCommand(inner):
                return inner.floor is None or inner.floor in self.config.floors
            case _:
                return True


def _is_recorded(request: Request, reply: Reply | None) -> bool:
    """Whether a request has rows in the journal: not what an idempotency key repeats, nor what a face without sessions hands over."""
    match reply:
        case SessionBegun(is_new=False) | Refused(code=Refusal.KEY_REUSED):
            return False
        case CommandStatus() if isinstance(request, GiveCommand):
            return reply.id == request.new_id
    return not isinstance(request, HandOver) or request.session is not None


async def _raised(bug: Future[None]) -> None:
    """Raise a bug that a callback has met."""
    await bug


def _now() -> float:
    return asyncio.get_running_loop().time()
