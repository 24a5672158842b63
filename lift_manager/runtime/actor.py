"""Carries out what the rules decide for one lift: steps its record, publishes, declares, presses and writes down."""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
from dataclasses import replace
from datetime import UTC, datetime
from typing import NamedTuple

from drivers.driver import LiftDriver, Report
from drivers.errors import ControllerException, DriverError
from drivers.model import (
    Command,
    DriverFailed,
    LiftReading,
    Outcome,
    OutputChanged,
    PressId,
    Written,
)
from lift_manager.lift import inputs
from lift_manager.lift.commands import CommandStatus
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Event as LiftEvent
from lift_manager.lift.freshness import fresh_until
from lift_manager.lift.inhibits import blocked_by
from lift_manager.lift.inputs import (
    CommitFailed,
    Committed,
    GiveCommand,
    HandOver,
    Input,
    LiftRequest,
    ReadFailed,
    Reading,
    Request,
    Tick,
)
from lift_manager.lift.observation import Moment, Observation
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.state import LiftState, restrictions, same_but_for_time, state
from lift_manager.lift.step import (
    Reply,
    Step,
    is_repetition,
    next_change,
    note_outputs,
    start,
    step,
)
from lift_manager.rides.record import SavedRide
from lift_manager.runtime.bus import Bus, Event, StateChanged
from lift_manager.runtime.inbox import Inbox
from lift_manager.runtime.journal import LiftJournal
from lift_manager.runtime.outputs import LiftOutputs
from lift_manager.runtime.recorder import Clock, Recorder, SavedLift, wall_clock
from lift_manager.runtime.ticker import Pause

_log = logging.getLogger(__name__)


_ID_BYTES = 16
_NEVER = Moment(-math.inf, datetime.min.replace(tzinfo=UTC), -math.inf)


class _LastingState(NamedTuple):
    """A state, and what it was worked out from."""

    state: LiftState
    record: LiftRecord
    read_at: float
    until: float
    """From this loop time on, time alone may have changed it."""


class LiftActor:
    """One lift: its driver, its newest record, and the order in which things happen to it. The `DriverOwner` of its driver."""

    # every poll touches it: see benchmarks/README.md
    __slots__ = (
        "_bus",
        "_clock",
        "_has_begun",
        "_is_taking",
        "_known",
        "_lasting",
        "_published",
        "_published_of",
        "_read_at",
        "_recorder",
        "_steady_until",
        "_stepped_at",
        "config",
        "driver",
        "inbox",
        "journal",
        "outputs",
        "pause",
        "record",
        "saved_rides",
    )

    def __init__(
        self,
        driver: LiftDriver,
        config: LiftConfig,
        bus: Bus[Event],
        recorder: Recorder,
        *,
        clock: Clock | None = None,
    ) -> None:
        """Attach to the driver; nothing happens before `begin` or the first input. The lifts of a site share bus and recorder."""
        self.config = config
        self.driver = driver
        saved = recorder.recall(config.name) or SavedLift()
        self.record = LiftRecord(durable=saved.record)
        """The newest record; only inputs change it."""
        self.saved_rides = saved.rides
        """The rides that are saved with it."""
        self.journal = LiftJournal(config.name, driver.source, recorder)
        self.inbox = Inbox(self._take)
        self.pause = Pause()
        """Between two polls."""
        self.outputs = LiftOutputs(config, driver, recorder, self.journal, self.inbox)
        self._bus = bus
        self._recorder = recorder
        self._clock = clock or wall_clock()
        self._read_at = -math.inf
        """Monotonic seconds; no signal of the lift is older than this."""
        self._known: Observation | None = None
        """The observation of the newest record, and until when readings may repeat it without being news."""
        self._steady_until = -math.inf
        self._stepped_at = _NEVER
        """When the step was that made this record."""
        self._has_begun = self._is_taking = False
        self._published: LiftState | None = None
        """The state of its newest event."""
        self._published_of: LiftRecord | None = None
        """The record whose state was compared with it last."""
        self._lasting: _LastingState | None = None
        driver.attach(self)

    def begin(self) -> None:
        """Continue with what an earlier process left, before the lift is read; once."""
        if not self._has_begun:
            self._has_begun = True
            moment = self.moment
            self.journal.found(self.record.durable, restrictions(self.config, self.record, moment), moment)
            self._carry_out(start(self.config, self.record.durable, moment), moment)
            self.inbox.take_all()

    # -- inputs

    def handle(self, happened: Input) -> Reply | None:
        """Take what was reported and then this input; return the reply to its caller.

        What follows from it happens soon. Not re-entrant.
        """
        self.begin()
        self.inbox.take_all()
        self._take_trouble()
        if isinstance(happened, Request) and self._bus.received:
            self.freshen()  # listeners get the state before the decision
        return self._take(happened)

    def take_reading(self, reading: LiftReading, now: float) -> None:
        """Take a poll that was answered by `now`."""
        if not self.take_repetition(reading, now):
            self.handle(Reading(reading, {}))

    def take_repetition(self, reading: LiftReading, now: float) -> bool:
        """Take a poll without news, which costs almost nothing. Returns False, and takes nothing, if there is news."""
        is_repeated = is_repetition(
            self.config, self._known, reading, steady_until=self._steady_until, read_at=self._read_at, now=now
        )
        if not is_repeated or self.inbox:
            return False
        self._read_at = reading.at
        return True

    def take_failure(self, error: DriverError) -> None:
        """Take a poll that failed."""
        self.journal.link(str(error), _now(), answers=isinstance(error, ControllerException))
        self.handle(ReadFailed(str(error)))

    def report(self, item: Report) -> None:
        """Record what the driver reports; the rules learn of it soon."""
        match item:
            case OutputChanged(name, output):
                self.outputs.changed(name, output)
            case Outcome():
                self.outputs.ended(item)
            case Written(name, what):
                if what == "press":
                    self.outputs.written(name)
                    self.pause.end_by(_now() + self.config.poll_ridden_s)  # it is read whether the lift took it
                saved = self.record.durable.session  # a release at the end still belongs to the session that is kept
                self.journal.wrote(None if saved is None else saved.holder, item)
            case DriverFailed(reason):
                _log.error("%s: a bug in its driver, so everything is released: %s", self.config.name, reason)

    def blocked_by(self, command: Command, press: PressId | None) -> str | None:
        """Return what forbids this command now."""
        return blocked_by(self.config, self.record, command, press, self.moment)

    # -- what is known

    @property
    def moment(self) -> Moment:
        """Now."""
        return Moment(_now(), self._clock(), self._read_at)

    def catch_up(self) -> None:
        """Take what was reported already, unless this is in the middle of that."""
        if not self._is_taking:
            self.inbox.take_all()

    def state(self) -> LiftState:
        """Return what this lift publishes right now, from memory."""
        self.catch_up()
        return state(self.config, self.record, self.moment)

    def lasting_state(self) -> LiftState:
        """Return the same, but while the lift is live its seconds may be those of an earlier moment.

        It is the same object until a step, a reading or time can have changed it: computing it costs more than a short reply.
        """
        self.catch_up()
        known = self._lasting
        if known is None or known.record is not self.record or known.read_at != self._read_at or _now() >= known.until:
            until = min(self.inbox.wake_at, fresh_until(self.config.capabilities, self._read_at))
            known = self._lasting = _LastingState(self.state(), self.record, self._read_at, until)
        return known.state

    def freshen(self) -> None:
        """Publish a change of the state that was not published yet, whether or not anybody listens."""
        if self._published_of is not self.record or _now() >= self.inbox.wake_at:
            self._publish_state(self.moment)

    def publish(self, event: LiftEvent) -> None:
        """Publish an event of this lift, once its row and its line in the log are there."""
        self._bus.publish(event, lambda event_id: self.journal.event(event, event_id))

    def save_rides(self, rides: tuple[SavedRide, ...]) -> None:
        """Save these rides with the record from now on."""
        self.saved_rides = rides
        self._save()

    # -- one input after the other

    def _take(self, happened: Input) -> Reply | None:
        if self._is_taking:
            raise RuntimeError(f"{self.config.name}: {happened} came from within another input")
        self._is_taking = True
        try:
            if not isinstance(happened, Tick | Reading | ReadFailed) and _now() >= self.inbox.wake_at:
                # what is over by now is over for this input too, though the timer was not called yet
                self._step(Tick())
            return self._step(happened)
        finally:
            self._is_taking = False

    def _step(self, happened: Input) -> Reply | None:
        if isinstance(happened, Tick) and (due := self._next_change()) > _now():
            self.inbox.wake(due)  # the readings since the last step were no news, and the newest is not too old yet
            return None
        moment, record, known = self.moment, self.record, self.outputs.shown
        match happened:
            case Reading(reading):
                happened = Reading(reading, known)
                self._read_at = reading.at
            case inputs.OutputChanged(then):
                known = then  # an output that fell and came back in between has fallen all the same
            case GiveCommand() if not self.journal.admits(happened, moment.now, known=_knows(self.config, happened)):
                happened = replace(happened, is_recorded=False)
        if known != record.outputs:
            record = note_outputs(self.config, record, known, moment)
        done = step(self.config, record, happened, moment)
        if isinstance(happened, Request) and _is_recorded(happened, done.reply):
            refused = done.reply if isinstance(done.reply, Refused) else None
            self.journal.request(happened, refused, moment.now, known=_knows(self.config, happened))
        elif isinstance(happened, Reading):
            self.journal.link(done.record.fault, moment.now, answers=True)
            self.journal.mode(happened.reading.values.mode, moment.now)
        if moment.read_at != self._read_at:
            moment = Moment(moment.now, moment.clock, self._read_at)
        self._carry_out(done, moment, happened)
        return done.reply

    def _carry_out(self, done: Step, moment: Moment, happened: Input | None = None) -> None:
        """Assign the record, publish, and then declare, press and write down what follows from it."""
        before, self.record, self._stepped_at = self.record, done.record, moment
        self._known, self._steady_until = done.record.observation, done.steady_until
        self.journal.call(before.call, done.record.call)
        for event in done.events:
            self.publish(event)
        is_commit_alone = isinstance(happened, Committed) and not before.disk_trouble
        if self._bus.received and not is_commit_alone:  # it changes nothing of the state, and a press waits for it
            self._publish_state(moment)
        if done.record.durable is not before.durable:
            self._save()
        self.outputs.carry_out(done.record, done.actions, moment, not_recorded=isinstance(happened, CommitFailed))
        self.inbox.wake(done.wake_at)

    def _save(self) -> None:
        self._recorder.keep(self.config.name, SavedLift(self.record.durable, self.saved_rides))

    def _next_change(self) -> float:
        """Return the first time since the last step at which something changes, by the newest reading."""
        return next_change(self.config, self.record, replace(self._stepped_at, read_at=self._read_at))

    def _take_trouble(self) -> None:
        """Inform the rules whether anything can be recorded."""
        trouble = self._recorder.trouble
        if trouble and not self.record.disk_trouble:
            self._take(CommitFailed(trouble))
        elif self.record.disk_trouble and not trouble:
            self._take(Committed(self.record.committed))

    def _publish_state(self, moment: Moment) -> None:
        """Publish a state as an event of its own, if it differs from that of the newest event."""
        now, self._published_of = state(self.config, self.record, moment), self.record
        if self._published is None or not same_but_for_time(now, self._published):
            self._published = now
            self._bus.publish(StateChanged(self.config.name, now))


def _knows(config: LiftConfig, request: Request) -> bool:
    """Whether a request names no floor, or one that the lift has."""
    match request:
        case LiftRequest(floor=floor):
            return floor in config.floors
        case GiveCommand(inner):
            return inner.floor is None or inner.floor in config.floors
        case _:
            return True


def _is_recorded(request: Request, reply: Reply | None) -> bool:
    """Whether a request has rows in the journal: not a repetition by idempotency key, nor a hand-over by a face without sessions."""
    match reply:
        case SessionBegun(is_new=False) | Refused(code=Refusal.KEY_REUSED):
            return False
        case CommandStatus() if isinstance(request, GiveCommand):
            return reply.id == request.new_id
    return not isinstance(request, HandOver) or request.session is not None


def new_id() -> str:
    """Return an id of a session or a command that cannot be guessed."""
    return secrets.token_urlsafe(_ID_BYTES)


def _now() -> float:
    return asyncio.get_running_loop().time()
