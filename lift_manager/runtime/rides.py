"""The rides of a site: steps them, and carries out what they ask for, as a client of lifts like any other.

One task processes all rides: on every event of a lift that has one, and once a second because time passes. Reports of robots and
requests of callers are replied to at once. Nothing is done from within an event: its publisher is in the middle of a step.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NoReturn

from lift_manager.lift import history
from lift_manager.lift.commands import CommandStatus, SessionInfo
from lift_manager.lift.events import Event as LiftEvent
from lift_manager.lift.inputs import GiveCommand, LiftRequest, OpenSession
from lift_manager.lift.observation import Moment
from lift_manager.lift.refusals import Accepted, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import Holder
from lift_manager.rides import rides as all_rides
from lift_manager.rides.choice import Choices, begin_ride, plan_ride
from lift_manager.rides.inputs import (
    BeginAgain,
    CancelRide,
    FoundOutside,
    Input,
    LiftAction,
    LiftReply,
    QueueChange,
    RideChanged,
    RobotReport,
    TakeLift,
    Tick,
    row_of,
)
from lift_manager.rides.observation import LiftView, RideObservation
from lift_manager.rides.record import RideRecord, published, restore
from lift_manager.rides.ride import Ride, RideBegun, RidePlan, RideRequest, RideWord
from lift_manager.rides.rides import Rides
from lift_manager.rides.step import TICK_S, Step, at_moment, step
from lift_manager.runtime.actor import LiftActor, new_id
from lift_manager.runtime.bus import Bus, Event, StateChanged
from lift_manager.runtime.errors import raised
from lift_manager.runtime.recorder import Clock, Recorder
from lift_manager.runtime.refusals import RefusalLog

_log = logging.getLogger(__name__)

_STEPS_IN_A_ROW = 8
"""Most steps of one ride in a row. Each has a reason of its own, and fewer are ever needed."""

_RIDES_IN_A_ROW = 10
"""How many rides are processed before others in the process have their turn. Chosen: some milliseconds."""

_ID_BYTES = 8


class SiteRides:
    """Every ride of a site. Replies come from memory; every refusal is raised as a `RequestRefused`."""

    def __init__(
        self,
        lifts: Mapping[str, LiftActor],
        bus: Bus[Event],
        recorder: Recorder,
        refusals: RefusalLog,
        clock: Clock,
    ) -> None:
        """The lifts share bus and recorder; nothing happens before `run` or the first request."""
        self._actors = lifts
        self._lifts = _Lifts(lifts)
        self._bus = bus
        self._recorder = recorder
        self._refusals = refusals
        self._clock = clock
        self._rides = Rides()
        self._choices: Choices | None = None
        """The choices of the present pass, until something changes them."""
        self._wake = asyncio.Event()
        self._news: set[str] = set()
        """Lifts with events that were not processed yet."""
        self._events: list[LiftEvent] = []
        self._is_restored = False
        self.is_stopping = False
        """No ride begins any more; those under way are saved, and continue at the next start."""

    async def run(self) -> None:
        """Process rides until cancelled."""
        self._restore()
        self._wake.set()
        while True:
            await self._wake.wait()
            with self._bus.tap(self._on_event):
                await self._go_on_until_over()

    # -- what callers request

    def plan(self, request: RideRequest) -> RidePlan:
        """Return the forecast of a ride now; nothing is begun, pressed or saved for it."""
        self._forget()
        found = plan_ride(self._fresh_choices(), request, self._moment, is_stopping=self.is_stopping)
        return self._refuse(_only_lift(request), found) if isinstance(found, Refused) else found

    def begin(self, request: RideRequest, *, is_remote: bool = False) -> RideBegun:
        """Begin a ride, or queue it; the same caller and idempotency key give the same ride.

        A remote caller does not report for its robot: nothing is requested of a lift before the robot does so itself.
        """
        self._forget()
        known = all_rides.repeated(self._rides, request)
        if isinstance(known, Refused):
            self._refuse(_only_lift(request), known)
        if known is not None:
            if not is_remote:
                self._step(known.id, BeginAgain())
            self._settle(known.id)
            return RideBegun(self._published(known.id), is_new=False)
        self._settle_maybe_aboard(request.holder)
        ride = secrets.token_hex(_ID_BYTES)
        begun = begin_ride(
            self._fresh_choices(), request, ride, self._moment, is_stopping=self.is_stopping, is_remote=is_remote
        )
        if isinstance(begun, Refused):
            self._refuse(_only_lift(request), begun)
        self._note(begun)
        self._wake.set()
        self._settle(ride)
        return RideBegun(self._published(ride), is_new=True)

    def ride(self, ride: str) -> Ride:
        """Return a ride as it is now, or one that ended recently. Faces also read it for their own purposes: nothing is counted."""
        self._forget()
        found = all_rides.find(self._rides, ride, None)
        if isinstance(found, Refused):
            raise raised(found)
        return self._published(ride)

    def all(self) -> tuple[Ride, ...]:
        """Return every ride under way, and those that ended recently; the oldest first."""
        self._forget()
        return tuple(
            self._published(one.id) for one in sorted(self._rides.by_id.values(), key=lambda one: one.begun_at)
        )

    def report(self, ride: str, word: RideWord, caller: Holder | None) -> Ride:
        """Take a robot's report; `caller` None is an operator, who may report for every robot."""
        record = self._find(ride, caller)
        if word is RideWord.LEFT:
            for heir in all_rides.heirs(self._rides, record):
                self._settle(heir.id)
                if self._rides.by_id[heir.id].maybe_aboard:
                    self.report(heir.id, word, caller)
                    return self._published(ride)
        self._settle_maybe_aboard(record.holder)
        self._settle(ride)
        done = self._step(ride, RobotReport(word))
        self._settle(ride)
        return self._published(ride) if done.reply is None else self._refuse(record.lift, done.reply)

    def cancel(self, ride: str, caller: Holder | None, reason: str) -> Ride:
        """Cancel a ride: a robot that may be inside is let out first. A repetition changes nothing.

        `caller` None is an operator or a remote caller, neither of whom reports for the robot.
        """
        self._find(ride, caller)
        self._settle(ride)
        self._step(ride, CancelRide(reason, by_operator=caller is None))
        self._settle(ride)
        return self._published(ride)

    # -- passes

    async def _go_on_until_over(self) -> None:
        """Run for as long as any ride matters; otherwise no state need be computed for anybody."""
        tick_at = _now()
        while True:
            self._wake.clear()
            is_tick = _now() >= tick_at
            if is_tick:
                tick_at = _now() + TICK_S
            await self._pass(is_tick=is_tick)
            if not self._rides.matter():
                return
            with suppress(TimeoutError):
                async with asyncio.timeout_at(tick_at):
                    await self._wake.wait()

    async def _pass(self, *, is_tick: bool) -> None:
        """Process the rides of lifts with news, and on a tick all rides; others have their turn in between."""
        news, self._news = self._news, set()
        events, self._events = self._events, []
        for event in events:
            for ride, happened in all_rides.concerned(self._rides, event):
                self._step(ride, happened)
        self._choices = None
        lifts = tuple(name for name in self._actors if is_tick or name in news)
        self._rides, freed = all_rides.freed(self._rides, self._lifts, lifts)
        if is_tick:
            due = tuple(one.id for one in self._rides.going_on())
        else:
            self._rides, due = all_rides.due(self._rides, self._lifts, lifts, freed, _now())
        for number, ride in enumerate(due):
            if number % _RIDES_IN_A_ROW == _RIDES_IN_A_ROW - 1:
                await asyncio.sleep(0)
            record = self._rides.by_id.get(ride)
            if record is None:
                continue
            if is_tick or freed.intersection(record.request.lifts):
                self._choose_again(record)
            self._settle(ride)
        self._forget()

    def _on_event(self, _: str, event: Event) -> None:
        """Record an event, and do nothing about it here."""
        if isinstance(event, RideChanged):
            return
        if not isinstance(event, StateChanged):
            self._events.append(event)
        self._news.add(event.lift)
        self._wake.set()

    # -- one ride

    def _settle(self, ride: str) -> None:
        """Step a ride until there is nothing to do for it."""
        for _ in range(_STEPS_IN_A_ROW):
            record = self._rides.by_id[ride]
            if record.is_over:
                return
            self._rides, changes = all_rides.place(self._rides, record, self._lifts, _now())
            self._change_queues(changes)
            done = self._step(ride, Tick())
            if not done.actions:
                return
            after = self._rides.by_id[ride]
            if after.is_flexible and any(_opens_session(action) for action in done.actions):
                self._choices = None  # it was refused
                self._choose_again(after)

    def _settle_maybe_aboard(self, holder: Holder) -> None:
        """Settle a holder's other rides before it reports anything: its report is newer than any of them."""
        for record in self._rides.of_holder_maybe_aboard(holder):
            self._settle(record.id)

    def _choose_again(self, record: RideRecord) -> None:
        """Move a waiting ride that may take any lift to another one, if it is better off there."""
        self._choices = (self._choices or self._fresh_choices()).go_on(self._rides, _now())
        lift = self._choices.better(record)
        if lift is not None:
            self._step(record.id, TakeLift(lift))
            self._choices = None

    def _step(self, ride: str, happened: Input) -> Step:
        """Step one ride, write down the result, and only then act on it."""
        before = self._rides.by_id[ride]
        seen_as = replace(before, lift=happened.lift) if isinstance(happened, TakeLift) else before
        done = step(before, happened, self._observe(seen_as), self._moment)
        self._note(done)
        for action in done.actions:
            if not isinstance(action, LiftAction):
                for other in all_rides.in_doubt(self._rides, done.record.lift, done.record.holder):
                    self._step(other.id, FoundOutside())
                continue
            reply = self._carry_out(action)
            self._step(ride, LiftReply(action.request, reply))
            if isinstance(reply, Refused):
                break
        if done.record.is_over and not before.is_over:
            # somebody may be next
            self._news.add(done.record.lift)
            self._wake.set()
        return done

    def _note(self, done: Step) -> None:
        self._rides, changes = all_rides.take(self._rides, done, self._lifts, self._moment)
        self._change_queues(changes)
        self._save(done.saves)
        for event in done.events:
            if isinstance(event, RideChanged):
                self._bus.publish(event, partial(self._write_down, event))
            else:
                self._actors[event.lift].publish(event)

    def _write_down(self, event: RideChanged, event_id: str) -> None:
        """Record and log a ride that is in another phase."""
        if (row := row_of(event)) is None:
            return
        self._recorder.note(replace(row, event=event_id))
        ride, why = event.ride, f": {event.ride.reason}" if event.ride.reason else ""
        extra = {"lift": event.lift, "event": event_id}
        holder = self._rides.by_id[ride.id].holder
        _log.info("%s: ride %s of %s is %s%s", event.lift, ride.id, holder, ride.phase, why, extra=extra)

    def _carry_out(self, action: LiftAction) -> SessionBegun | SessionInfo | CommandStatus | Accepted | Refused:
        """Request something of a lift; the ids that it may need are made here."""
        request = action.request
        if isinstance(request, OpenSession | GiveCommand | LiftRequest):
            request = replace(request, new_id=new_id())
        reply = self._actors[action.lift].handle(request)
        match reply:
            case SessionBegun() | SessionInfo() | CommandStatus() | Accepted():
                return reply
            case Refused():
                self._refusals.count(action.lift, reply.code)
                return reply
            case _:
                raise TypeError(f"{action.lift} replied {reply!r}")

    def _observe(self, record: RideRecord) -> RideObservation:
        session: SessionInfo | Refused | None = None
        if record.has_session:
            actor = self._actors[record.lift]
            actor.catch_up()  # the session is not to be older than the state beside it
            session = history.read_session(actor.config, actor.record, record.session, record.holder, actor.moment)
        return all_rides.observe(self._rides, self._lifts, record, session, self._moment)

    # -- inside

    @property
    def _moment(self) -> Moment:
        return Moment(_now(), self._clock())

    def _fresh_choices(self) -> Choices:
        return Choices(self._rides, self._lifts, _now())

    def _change_queues(self, changes: Sequence[QueueChange]) -> None:
        for change in changes:
            self._actors[change.lift].handle(change.input)

    def _save(self, lifts: Sequence[str]) -> None:
        for lift in lifts:
            self._actors[lift].save_rides(all_rides.saved(self._rides, lift, self._moment))

    def _restore(self) -> None:
        """Restore the rides of an earlier process, in their order; nothing is requested for them before their robots report."""
        if self._is_restored:
            return
        self._is_restored = True
        for actor in self._actors.values():
            actor.begin()  # before that it knows no session of a ride
        for lift, actor in self._actors.items():
            for saved in actor.saved_rides:
                record = restore(saved, lift, self._moment)
                self._rides = all_rides.put(self._rides, record)
                self._rides, changes = all_rides.place(self._rides, record, self._lifts, _now())
                self._change_queues(changes)

    def _forget(self) -> None:
        """Load the rides of an earlier process, and forget what ended long ago."""
        self._restore()
        self._rides, lifts = all_rides.forget(self._rides, _now())
        self._save(lifts)

    def _find(self, ride: str, caller: Holder | None) -> RideRecord:
        """Return a ride to a caller that may report for it."""
        self._forget()
        found = all_rides.find(self._rides, ride, caller)
        if isinstance(found, Refused):
            known = self._rides.by_id.get(ride)
            self._refuse("" if known is None else known.lift, found)
        return found

    def _published(self, ride: str) -> Ride:
        """Return a ride as it is at this moment: an event may not have been processed yet."""
        record = self._rides.by_id[ride]
        if not record.is_over:
            return at_moment(record, self._observe(record), self._moment)
        return published(record, _now())

    def _refuse(self, lift: str, refused: Refused) -> NoReturn:
        """Raise a refusal, and count it; `lift` is empty if the request was about none."""
        self._refusals.refuse(lift if lift in self._actors else "", refused)


class _Lifts(Mapping[str, LiftView]):
    """The lifts as rides see them, at the moment of each look."""

    def __init__(self, actors: Mapping[str, LiftActor]) -> None:
        self._actors = actors

    def __iter__(self) -> Iterator[str]:
        return iter(self._actors)

    def __len__(self) -> int:
        return len(self._actors)

    def __getitem__(self, lift: str) -> LiftView:
        actor = self._actors[lift]
        return LiftView(actor.config, actor.state(), actor.record.queue)


def _opens_session(action: object) -> bool:
    return isinstance(action, LiftAction) and isinstance(action.request, OpenSession)


def _only_lift(request: RideRequest) -> str:
    return request.lifts[0] if len(request.lifts) == 1 else ""


def _now() -> float:
    return asyncio.get_running_loop().time()
