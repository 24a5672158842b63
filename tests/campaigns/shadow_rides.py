"""Plays rides twice, with the ride engine of today and with one made of `lift_manager.rides`, and compares everything they do.

python -m tests.campaigns.shadow_rides --rides 100 --seed 1
python -m tests.campaigns.shadow_rides --replay 17
python -m tests.campaigns.shadow_rides --core-tests tests/lift_manager/core/test_ride_queue.py

Compared are, in order and with their times: what is requested of lifts and its replies, what is published, what is saved for a restart,
and every answer to robots and callers. Time is virtual, so that both engines see the same lifts for as long as they do the same.
A tool for the time in which both exist. `Engine` does what the runtime has to do (`lift_manager/rides/README.md`), over the core of today.
"""
# ruff: noqa: SLF001  it looks into the core of today from outside, and goes with it

import argparse
import asyncio
import logging
import random
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass, replace
from datetime import datetime
from enum import Enum
from itertools import product
from typing import Any

import pytest

from lift_manager.core import lift as core_lift
from lift_manager.core import manager as core_manager
from lift_manager.core.memory import ShortMemory
from lift_manager.core.rides.engine import RideEngine
from lift_manager.domain import asking, events, ride_record, session_requests
from lift_manager.domain import ride as today
from lift_manager.domain import service as old_service
from lift_manager.domain import state as states
from lift_manager.lift import events as lift_events
from lift_manager.lift import inputs
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType, SessionInfo, SessionOver
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import Moment, RobotDoor
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.queue import Queue
from lift_manager.lift.refusals import Accepted, Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.rides import rides as all_rides
from lift_manager.rides.choice import Choices, begin_ride, plan_ride
from lift_manager.rides.inputs import (
    BeginAgain,
    CancelRide,
    FoundOutside,
    Input,
    QueueChange,
    Replied,
    RideChanged,
    RobotReport,
    TakeLift,
    Tick,
    ToLift,
)
from lift_manager.rides.observation import Lifts, LiftView, RideObservation
from lift_manager.rides.record import Clearing, RideRecord, SavedRide, published, restore
from lift_manager.rides.ride import Phase, RideLimits, RideRefused, RideRequest, RideWord
from lift_manager.rides.rides import Rides
from lift_manager.rides.step import TICK_S, Step, at_moment, step
from register_maps.words import Door, Mode, Side
from tests.campaigns import ride_truth
from tests.lift_manager.core.ride_building import FLEET, Building, building
from tests.support import ride_rig
from tests.support.ride_faults import FAULTS, STEPS
from tests.support.ride_faults import play as play_fault
from tests.support.trip_sites import site_of
from tests.support.virtual_time import elapse, run_virtual

AT_ONCE = 8
AT_A_TIME = 10


# -- an engine over the pure rides, with the public methods of today's


class Engine:
    """Carries out what `lift_manager.rides` decides."""

    def __init__(self, core: Any, lines: Any, tap: Any, *, publish: Any, keep: Any, clock: Any) -> None:
        self._core, self._lines, self._tap = core, lines, tap
        self._publish, self._keep, self._clock = publish, keep, clock
        self._rides = Rides()
        self._lifts: Lifts = _Lifts(core, lines)
        self._wake = asyncio.Event()
        self._news: set[str] = set()
        self._events: list[Any] = []
        self._choices: Choices | None = None
        self._begun = self._taken_up = self._stopping = False

    # -- the loop

    async def run(self) -> None:
        self.take_up()
        self._begun = True
        self._wake.set()
        while True:
            await self._wake.wait()
            with self._tap(self._hear):
                await self._until_over()

    async def _until_over(self) -> None:
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
        news, self._news = self._news, set()
        heard, self._events = self._events, []
        for event in heard:
            for ride_id, happened in all_rides.concerned(self._rides, event):
                self._step(ride_id, happened)
        self._choices = None
        names = tuple(self._lifts)
        lifts = names if is_tick else tuple(name for name in names if name in news)
        self._rides, freed = all_rides.freed(self._rides, self._lifts, lifts)
        if is_tick:
            due = tuple(one.id for one in self._rides.going_on())
        else:
            self._rides, due = all_rides.due(self._rides, self._lifts, lifts, freed, _now())
        for number, ride_id in enumerate(due):
            if number % AT_A_TIME == AT_A_TIME - 1:
                await asyncio.sleep(0)
            record = self._rides.by_id.get(ride_id)
            if record is None or record.is_over:
                continue
            if self._begun and (is_tick or freed.intersection(record.request.lifts)):
                self._reconsider(record)
            self._settle(ride_id)
        self._recall()

    def _hear(self, occurrence: events.Occurrence) -> None:
        event = occurrence.event
        if isinstance(event, events.RideChanged):
            return
        if (made := event_of(event)) is not None:
            self._events.append(made)
        self._news.add(event.lift)
        self._wake.set()

    # -- steps

    def _moment(self) -> Moment:
        return Moment(_now(), self._clock())

    def _observe(self, record: RideRecord) -> RideObservation:
        session: SessionInfo | Refused | None = None
        if record.has_session:
            found = self._core.session(record.lift, record.session, old_holder(record.holder))
            session = refused_of(found) if isinstance(found, asking.Refused) else session_of(found)
        seen = all_rides.observe(self._rides, self._lifts, record, session, self._moment())
        self._lines(record.lift).length(_now())  # its silent callers leave
        return seen

    def _step(self, ride_id: str, happened: Input) -> Step:
        """Step one ride, write down what it comes to, and do it."""
        before = self._rides.by_id[ride_id]
        seen_as = replace(before, lift=happened.lift) if isinstance(happened, TakeLift) else before
        done = step(before, happened, self._observe(seen_as), self._moment())
        self._note(done)
        for action in done.actions:
            if not isinstance(action, ToLift):
                for other in all_rides.in_doubt(self._rides, done.record.lift, done.record.holder):
                    self._step(other.id, FoundOutside())
                continue
            reply = self._carry_out(action)
            self._step(ride_id, Replied(action.request, reply))
            if isinstance(reply, Refused):
                break
        if done.record.is_over and not before.is_over:
            self._news.add(done.record.lift)
            self._wake.set()
        return done

    def _note(self, done: Step) -> None:
        self._rides, changes = all_rides.take(self._rides, done, self._lifts, self._moment())
        self._change_queues(changes)
        self._save(done.saves[:1])
        for event in done.events:
            self._publish(old_event(event))
        self._save(done.saves[1:])  # so that the order is today's; to the runtime it is all one

    def _save(self, lifts: Sequence[str]) -> None:
        for lift in lifts:
            self._keep(lift, tuple(old_kept(one) for one in all_rides.saved(self._rides, lift, self._moment())))

    def _settle(self, ride_id: str) -> None:
        """Go on with a ride until there is nothing to do for it."""
        for _ in range(AT_ONCE):
            record = self._rides.by_id[ride_id]
            if record.is_over or not self._begun:
                return
            self._rides, changes = all_rides.place(self._rides, record, self._lifts, _now())
            self._change_queues(changes)
            done = self._step(ride_id, Tick())
            if not done.actions:
                return
            after = self._rides.by_id[ride_id]
            is_open = any(
                isinstance(one, ToLift) and isinstance(one.request, inputs.OpenSession) for one in done.actions
            )
            if is_open and after.is_flexible:
                self._choices = None
                self._reconsider(after)

    def _reconsider(self, record: RideRecord) -> None:
        before = self._choices or self._fresh_choices()
        self._choices = before.go_on(self._rides, _now())
        lift = self._choices.better(record)
        if lift is not None:
            self._step(record.id, TakeLift(lift))
            self._choices = None

    def _change_queues(self, changes: Sequence[QueueChange]) -> None:
        for change in changes:
            line = self._lines(change.lift)
            if isinstance(change.input, inputs.JoinQueue):
                line.join(old_holder(change.input.holder), _now())
            else:
                line.leave(old_holder(change.input.holder))

    def _carry_out(self, action: ToLift) -> Any:
        found = self._request(action)
        match found:
            case asking.Refused():
                return refused_of(found)
            case session_requests.SessionBegun():
                return SessionBegun(session_of(found.session), found.anew)
            case session_requests.SessionInfo():
                return session_of(found)
            case session_requests.Followed():
                return status_of(found)
            case _:
                return Accepted()

    def _request(self, action: ToLift) -> Any:
        lift, request, core = action.lift, action.request, self._core
        holder = old_holder(request.request.holder if isinstance(request, inputs.GiveCommand) else request.holder)
        match request:
            case inputs.OpenSession(key=key):
                return core.open_session(session_requests.OpenSession(lift, holder, key=key))
            case inputs.GiveCommand(given):
                return core.ask_within(
                    session_requests.SessionRequest(
                        lift=lift,
                        session=given.session,
                        holder=holder,
                        do=session_requests.Do(given.kind),
                        floor=given.floor,
                    )
                )
            case inputs.RenewSession(session):
                return core.renew_session(lift, session, holder, None)
            case inputs.CloseSession(session, robot=robot):
                return core.close_session(lift, session, holder, None if robot is None else asking.RobotWord(robot))
            case inputs.EndSession(grace_s=grace_s):
                return core.end_session(lift, holder, grace_s)
            case inputs.LiftRequest(floor=floor, hold_door=hold_door):
                return core.request(asking.Ask(lift, holder, floor, hold_door=hold_door, robot=asking.RobotWord.LEFT))

    # -- what callers request

    def take_up(self) -> None:
        if self._taken_up:
            return
        self._taken_up = True
        for lift in self._core.lift_names():
            remembered = self._core.remembered(lift)
            for one in remembered.rides if remembered is not None else ():
                record = restore(saved_of(one), lift, self._moment())
                self._rides = all_rides.put(self._rides, record)
                self._rides, changes = all_rides.place(self._rides, record, self._lifts, _now())
                self._change_queues(changes)
            self._news.add(lift)

    def stop(self) -> None:
        self._stopping = True

    def plan(self, wish: today.RideRequest) -> Any:
        found = plan_ride(self._fresh_choices(), request_of(wish), self._moment(), is_stopping=self._stopping)
        if isinstance(found, Refused | RideRefused):
            return old_refused(found)
        return today.RidePlan(found.lift, found.ahead, found.reason)

    def begin(self, wish: today.RideRequest) -> Any:
        self.take_up()
        request = request_of(wish)
        known = all_rides.repeated(self._rides, request)
        if isinstance(known, Refused):
            return old_refused(known)
        if known is not None:
            self._step(known.id, BeginAgain())
            self._settle(known.id)
            return today.RideBegun(self._shown(known.id), anew=False)
        self._catch_up(request.holder)
        ride_id = secrets.token_hex(8)
        begun = begin_ride(self._fresh_choices(), request, ride_id, self._moment(), is_stopping=self._stopping)
        if not isinstance(begun, Step):
            return old_refused(begun)
        self._note(begun)
        self._wake.set()
        self._settle(ride_id)
        return today.RideBegun(self._shown(ride_id), anew=True)

    def _fresh_choices(self) -> Choices:
        return Choices(self._rides, self._lifts, _now())

    def ride(self, ride_id: str) -> Any:
        self._recall()
        return None if ride_id not in self._rides.by_id else self._shown(ride_id)

    def lift_of(self, ride_id: str) -> str:
        self._recall()
        record = self._rides.by_id.get(ride_id)
        return "" if record is None else record.lift

    def rides(self) -> tuple[Any, ...]:
        self._recall()
        ordered = sorted(self._rides.by_id.values(), key=lambda one: one.begun_at)
        return tuple(self._shown(one.id) for one in ordered)

    def word(self, ride_id: str, word: today.RideWord, caller: states.Holder | None) -> Any:
        self._recall()
        record = all_rides.find(self._rides, ride_id, None if caller is None else holder_of(caller))
        if isinstance(record, RideRefused):
            return old_refused(record)
        if word is today.RideWord.LEFT:
            for heir in all_rides.heirs(self._rides, record):
                self._settle(heir.id)
                if self._rides.by_id[heir.id].maybe_aboard:
                    answer = self.word(heir.id, word, caller)
                    return answer if isinstance(answer, asking.Refused) else self._shown(ride_id)
        self._catch_up(record.holder)
        self._settle(ride_id)
        done = self._step(ride_id, RobotReport(RideWord(word)))
        self._settle(ride_id)
        return self._shown(ride_id) if done.reply is None else old_refused(done.reply)

    def cancel(self, ride_id: str, caller: states.Holder | None, reason: str) -> Any:
        self._recall()
        record = all_rides.find(self._rides, ride_id, None if caller is None else holder_of(caller))
        if isinstance(record, RideRefused):
            return old_refused(record)
        self._settle(ride_id)
        self._step(ride_id, CancelRide(reason, by_operator=caller is None))
        self._settle(ride_id)
        return self._shown(ride_id)

    def _catch_up(self, holder: Holder) -> None:
        for record in self._rides.of_holder_maybe_aboard(holder):
            self._settle(record.id)

    def _recall(self) -> None:
        self.take_up()
        self._rides, lifts = all_rides.forget(self._rides, _now())
        self._save(lifts)

    def _shown(self, ride_id: str) -> today.Ride:
        record = self._rides.by_id[ride_id]
        if self._begun and not record.is_over:
            return old_ride(at_moment(record, self._observe(record), self._moment()))
        return old_ride(published(record, _now()))


class _Lifts(Mapping[str, LiftView]):
    """The lifts of the core of today, looked at when they are needed."""

    def __init__(self, core: Any, lines: Any) -> None:
        self._core, self._lines = core, lines

    def __iter__(self) -> Iterator[str]:
        return iter(self._core.lift_names())

    def __len__(self) -> int:
        return len(self._core.lift_names())

    def __getitem__(self, lift: str) -> LiftView:
        described, state, line = self._core.describe(lift), self._core.state(lift), self._lines(lift)
        if described is None:
            raise KeyError(lift)
        config = LiftConfig(
            name=lift,
            source="",
            floors=described.floors,
            doors_at=described.doors_at,
            control=described.control,
            capabilities=described.able,
            clear_s=described.clear_s,
        )
        places = {one: holder_of(one) if isinstance(one, states.Holder) else one for one in line._line}
        asked_at = {places[one]: at for one, at in line._heard_at.items()}
        return LiftView(config, state_of(state), Queue(tuple(places.values()), asked_at, line._left))


def _now() -> float:
    return asyncio.get_running_loop().time()


# -- today's values and ours


def made_of(kind: Any, old: Any, **other: Any) -> Any:
    """Return a value of a kind with the fields that another one has too."""
    same = {
        one.name: getattr(old, one.name) for one in fields(kind) if one.name not in other and hasattr(old, one.name)
    }
    return kind(**same, **other)


def holder_of(old: states.Holder) -> Holder:
    return Holder(old.face, old.name)


def holder_or_none(old: states.Holder | None) -> Holder | None:
    return None if old is None else holder_of(old)


def old_holder(new: Holder) -> states.Holder:
    return states.Holder(new.face, new.name)


def state_of(old: states.LiftState) -> LiftState:
    restrictions = made_of(Restrictions, old.restrictions, maybe_aboard=holder_or_none(old.restrictions.maybe_aboard))
    made: LiftState = made_of(
        LiftState,
        old,
        quality=Quality(old.quality),
        robot_door=RobotDoor(old.robot_door),
        holder=holder_or_none(old.holder),
        restrictions=restrictions,
    )
    return made


def advice_of(old: old_service.Advice | None) -> Advice | None:
    return None if old is None else Advice(old)


def session_of(old: session_requests.SessionInfo) -> SessionInfo:
    over = old.over
    made: SessionInfo = made_of(
        SessionInfo,
        old,
        holder=holder_of(old.holder),
        robot=Occupancy(old.robot),
        over=None if over is None else SessionOver(EndReason(over.reason), over.text, advice_of(over.advice), over.at),
    )
    return made


def status_of(old: session_requests.Followed) -> CommandStatus:
    return CommandStatus(
        id=old.id,
        lift=old.lift,
        holder=holder_of(old.holder),
        kind=CommandType(old.do),
        floor=old.floor,
        state=CommandState(old.status),
        reason=old.reason,
        proof=old.proof,
        requested_at=old.asked_at,
        ended_at=old.ended_at,
    )


def refused_of(old: asking.Refused) -> Refused:
    return Refused(Refusal(old.code), old.message)


def old_refused(new: Refused | RideRefused) -> asking.Refused:
    return asking.Refused(asking.Refusal(new.code), new.message)


def event_of(old: events.Event) -> lift_events.Event | None:
    match old:
        case events.Advised(lift, holder, advice, text):
            return lift_events.Advised(lift, holder_of(holder), Advice(advice), text)
        case events.RequestFollowed(lift, followed):
            return lift_events.CommandFollowed(lift, status_of(followed), is_recorded=True)
        case events.PersonAcknowledged(lift, said):
            causes = tuple(lift_events.Cause(one) for one in said.what)
            return lift_events.Acknowledged(lift, said.by, said.at, causes)
        case _:
            return None


def old_event(new: Any) -> events.Event:
    if isinstance(new, RideChanged):
        before = None if new.before is None else today.Phase(new.before)
        return events.RideChanged(new.lift, old_ride(new.ride), before)
    return events.Alarm(new.lift, new.text, old_holder(new.holder))


def old_ride(new: Any) -> today.Ride:
    made: today.Ride = made_of(
        today.Ride,
        new,
        caller=old_holder(new.caller),
        phase=today.Phase(new.phase),
        guidance=today.Guidance(new.guidance),
        advice=None if new.advice is None else old_service.Advice(new.advice),
    )
    return made


def request_of(old: today.RideRequest) -> RideRequest:
    limits = made_of(RideLimits, old.limits)
    made: RideRequest = made_of(RideRequest, old, caller=holder_of(old.caller), limits=limits)
    return made


def saved_of(old: ride_record.KeptRide) -> SavedRide:
    clearing = None if old.clearing is None else Clearing(Phase(old.clearing.ending), old.clearing.cause)
    made: SavedRide = made_of(
        SavedRide,
        old,
        request=request_of(old.wish),
        phase=Phase(old.phase),
        saved_at=old.kept_at,
        advice=advice_of(old.advice),
        has_entered=old.entered,
        could_exit_at=old.could_leave_at,
        clearing=clearing,
    )
    return made


def old_kept(new: SavedRide) -> ride_record.KeptRide:
    one = new.request
    limits = made_of(today.RideLimits, one.limits)
    wish = made_of(today.RideRequest, one, caller=old_holder(one.caller), limits=limits)
    clearing = new.clearing
    made: ride_record.KeptRide = made_of(
        ride_record.KeptRide,
        new,
        wish=wish,
        phase=today.Phase(new.phase),
        kept_at=new.saved_at,
        advice=None if new.advice is None else old_service.Advice(new.advice),
        entered=new.has_entered,
        could_leave_at=new.could_exit_at,
        clearing=None if clearing is None else ride_record.Clearing(today.Phase(clearing.ending), clearing.cause),
    )
    return made


# -- what an engine does, line by line


MUTATES = ("open_session", "ask_within", "renew_session", "close_session", "end_session", "request")
ANSWERS = ("plan", "begin", "ride", "rides", "word", "cancel")
SHORT = today.RideLimits(queued_s=20.0, called_s=20.0, boarding_s=20.0, riding_s=20.0, alighting_s=20.0)
_IDS = re.compile(r"\b[0-9a-f]{16}\b|(?<=')[\w-]{22}(?=')")


class Log:
    """The lines of one play, with the ids of rides, sessions and commands numbered."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._ids: dict[str, str] = {}

    def add(self, what: str, value: object) -> None:
        at = f"{_now():.3f}"
        text = _IDS.sub(lambda found: self._number(found[0]), f"{what} {plain(value)}")
        self.lines.append(f"{at} {text}")

    def _number(self, found: str) -> str:
        return self._ids.setdefault(found, f"#{len(self._ids)}")


class LoggedCore:
    """The core, with every request to it in the log."""

    def __init__(self, core: Any, log: Log) -> None:
        self._core, self._log = core, log

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._core, name)
        if name not in MUTATES:
            return found

        def logged(*given: Any, **named: Any) -> Any:
            reply = found(*given, **named)
            self._log.add(f"{name} {plain(given)} {plain(named)}", reply)
            return reply

        return logged


class LoggedEngine:
    """An engine, with every answer of it in the log."""

    def __init__(self, make: Callable[..., Any], log: Log, core: Any, *given: Any, **named: Any) -> None:
        old_publish, old_keep = named["publish"], named["keep"]

        def publish(event: Any) -> Any:
            log.add("publish", event)
            return old_publish(event)

        def keep(lift: str, kept: Any) -> None:
            log.add(f"keep {lift}", kept)
            old_keep(lift, kept)

        self._engine = make(LoggedCore(core, log), *given, **named | {"publish": publish, "keep": keep})
        self._log = log

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._engine, name)
        if name not in ANSWERS:
            return found

        def logged(*given: Any) -> Any:
            answer = found(*given)
            self._log.add(f"{name} {plain(given)}", answer)
            return answer

        return logged


def plain(value: Any) -> str:
    """Return a value in words, in which no time is more exact than a millisecond."""
    match value:
        case Enum():
            return str(value.value)
        case float():
            return f"{value:.3f}"
        case datetime():
            return value.isoformat(timespec="milliseconds")
        case tuple() | list():
            return f"[{', '.join(plain(one) for one in value)}]"
        case dict():
            return f"{{{', '.join(f'{key}: {plain(one)}' for key, one in value.items())}}}"
        case _ if is_dataclass(value):
            known = ", ".join(f"{one.name}={plain(getattr(value, one.name))}" for one in fields(value))
            return f"{type(value).__name__}({known})"
        case _:
            return repr(value)


@contextmanager
def with_engine(make: Callable[..., Any], log: Log) -> Iterator[None]:
    """Let every manager and every rig be made with an engine whose doings are logged, and every clock go with virtual time."""

    def made(*given: Any, **named: Any) -> LoggedEngine:
        return LoggedEngine(make, log, *given, **named)

    others = {"RideEngine": made, "wall_clock": lambda: ride_rig.clock}
    modules: tuple[Any, ...] = (core_manager, core_lift, ride_rig)
    usual = [(module, name, getattr(module, name)) for module in modules for name in others if hasattr(module, name)]
    for module, name, _ in usual:
        setattr(module, name, others[name])
    try:
        yield
    finally:
        for module, name, value in usual:
            setattr(module, name, value)


def difference(one: Sequence[str], other: Sequence[str]) -> str:
    """Return where two logs part for the first time, with the lines before; empty where they do not."""
    for number in range(max(len(one), len(other))):
        first = one[number] if number < len(one) else "nothing more"
        second = other[number] if number < len(other) else "nothing more"
        if first != second:
            before = "".join(f"      {line[:600]}\n" for line in one[max(0, number - 3) : number])
            return f"line {number}\n{before}  today {first[:3000]}\n  new   {second[:3000]}"
    return ""


def compare(main: Callable[[], Any]) -> tuple[int, str]:
    """Play the same twice; return the number of lines and the first difference."""
    logs = []
    for make in (RideEngine, Engine):
        log = Log()
        with with_engine(make, log):
            try:
                run_virtual(main, limit_s=ride_truth.LIMIT_S)
            except AssertionError as finding:
                log.lines.append(f"FAILED {finding}")
        logs.append(log.lines)
    return len(logs[0]), difference(*logs)


def main_of(seed: int) -> Callable[[], Any]:
    return lambda: ride_truth.play(ride_truth.draw(seed))


# -- many robots among three lifts


async def crowd(seed: int) -> None:
    """Play minutes of robots, callers and people that do anything at any time, through two restarts."""
    dice, memory = random.Random(seed), ShortMemory()
    known: list[str] = []
    for _ in range(3):
        async with building("A", "B", "C", memory=memory) as made:
            known = [one.id for one in made.manager.rides()]
            for _ in range(60):
                await _anything(dice, made, known)
                await elapse(dice.choice((0.0, 0.1, 0.5, 1.3, 4.0, 12.0)))


async def _anything(dice: random.Random, made: Building, known: list[str]) -> None:
    manager, lift = made.manager, dice.choice("ABC")
    chance = dice.random()
    ride_id = dice.choice(known) if known else "none"
    caller = dice.choice((FLEET, FLEET, FLEET, None))
    if chance < 0.2:
        wish = made.wish(
            dice.choice(("any", "any", lift)),
            *dice.sample(("L1", "L2", "L3"), 2),
            robot=dice.choice(("amr-1", "amr-1", "amr-2", "amr-3", "")),
            key=dice.choice(("", "", "k1", "k2")),
            limits=dice.choice((None, SHORT)),
        )
        if dice.random() < 0.2:
            manager.plan_ride(wish)
        begun = manager.begin_ride(wish)
        if not isinstance(begun, asking.Refused):
            known.append(begun.ride.id)
    elif chance < 0.45:
        manager.ride_word(ride_id, dice.choice(tuple(today.RideWord)), caller)
    elif chance < 0.52:
        manager.cancel_ride(ride_id, caller, "no order")
    elif chance < 0.82:
        _move_cars(dice, made)
    elif chance < 0.86:
        driver = made.drivers[lift]
        driver.silent = not driver.silent
    else:
        _people(dice, made, lift)
    for ride_id in known:
        manager.ride(ride_id)


def _move_cars(dice: random.Random, made: Building) -> None:
    """Let cars be where their rides want them as often as not."""
    for lift, driver in made.drivers.items():
        state = made.manager.state(lift)
        wanted = None if state is None else state.destination
        floor = dice.choice((wanted, wanted, "L1", "L2", "L3", None))
        is_open = floor is not None and dice.random() < 0.6
        flags = {"may_enter": is_open, "may_leave": is_open}
        doors = {Side.FRONT: Door.OPEN if is_open else Door.CLOSED}
        mode = dice.choice((Mode.NORMAL,) * 19 + (Mode.INSPECTION, Mode.FIRE))
        driver.values = replace(driver.values, floor=floor, doors=doors, flags=flags, mode=mode)


def _people(dice: random.Random, made: Building, lift: str) -> None:
    manager = made.manager
    match dice.randrange(7):
        case 0:
            manager.force_release(lift, "Ana", "needed", at_once=dice.random() < 0.5)
        case 1 | 2:
            manager.acknowledge(lift, "Ana")
        case 3:
            manager.lock_out(lift, "Ana", "oil")
        case 4:
            manager.end_lockout(lift, "Ana")
        case 5:
            made.ask(lift)
        case _:
            made.ask(lift, hold=False)


class OnTests:
    """Lets tests of today run with an engine, and keeps what it did in each: a plugin of pytest."""

    def __init__(self, make: Callable[..., Any]) -> None:
        self.logs: dict[str, Log] = {}
        self.failed: list[str] = []
        self._make = make

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: Any) -> Any:
        """Run one test."""
        self.logs[item.nodeid] = Log()
        with with_engine(self._make, self.logs[item.nodeid]):
            return (yield)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep what failed."""
        if report.failed:
            self.failed.append(report.nodeid)


def core_tests(paths: Sequence[str]) -> int:
    """Run tests of today with both engines; return how many differ or fail with the new one."""
    plugins = [OnTests(RideEngine), OnTests(Engine)]
    for plugin in plugins:
        args = ["-q", "-p", "no:cacheprovider", "-p", "no:randomly", "--assert=plain", "--timeout=900", "--tb=short"]
        args += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        pytest.main([*args, *paths], plugins=[plugin])
    old, new = plugins
    differing = {name: found for name in old.logs if (found := difference(old.logs[name].lines, new.logs[name].lines))}
    for name, found in differing.items():
        sys.stdout.write(f"DIFFERS {name}: {found}\n")
    lines = sum(len(log.lines) for log in old.logs.values())
    sys.stdout.write(
        f"{len(old.logs)} tests, {lines} lines; {len(differing)} differ; failed with the new engine: {new.failed}\n"
    )
    return len(differing) + len(new.failed)


def main() -> int:
    """Play and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rides", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="of the first ride; the others follow")
    parser.add_argument("--crowds", type=int, default=0, help="so many plays of many robots among three lifts instead")
    parser.add_argument("--replay", type=int, metavar="SEED")
    parser.add_argument("--table", action="store_true", help="every fault at every step, each on one map")
    parser.add_argument(
        "--core-tests", nargs="+", metavar="PATH", help="run these tests of today with both engines instead"
    )
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if given.core_tests:
        return 1 if core_tests(given.core_tests) else 0
    began = time.monotonic()
    plays: list[tuple[str, Callable[[], Any]]]
    if given.table:
        maps = ride_truth.MAPS
        cases = enumerate(product(STEPS, FAULTS))
        plays = [(f"{s}, {f}", _case(maps[n % len(maps)], s, f)) for n, (s, f) in cases]
    elif given.crowds:
        seeds = range(given.seed, given.seed + given.crowds)
        plays = [(f"crowd {seed}", _crowd(seed)) for seed in seeds]
    else:
        seeds = (
            range(given.seed, given.seed + given.rides)
            if given.replay is None
            else range(given.replay, given.replay + 1)
        )
        plays = [(str(ride_truth.draw(seed)), main_of(seed)) for seed in seeds]
    total, differing = 0, 0
    for name, play in plays:
        lines, found = compare(play)
        total += lines
        if found:
            differing += 1
            sys.stdout.write(f"DIFFERS {name}: {found}\n")
        sys.stderr.write(f"{name}: {lines} lines, {'they differ' if found else 'the same'}\n")
    sys.stdout.write(f"{len(plays)} rides in {time.monotonic() - began:.0f} s, {total} lines, {differing} differ\n")
    return 1 if differing else 0


def _crowd(seed: int) -> Callable[[], Any]:
    return lambda: crowd(seed)


def _case(name: str, at_step: str, fault: str) -> Callable[[], Any]:
    return lambda: play_fault(site_of(name), at_step, fault)


if __name__ == "__main__":
    sys.exit(main())
