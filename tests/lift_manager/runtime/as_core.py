"""Runs tests of the core of today, and campaigns, on the runtime: a lift that looks like `core.lift.LiftTask` over a `LiftActor`.

python -m tests.lift_manager.runtime.as_core tests/lift_manager/core/test_fire.py ...   (arguments of pytest)
python -m tests.lift_manager.runtime.as_core -m tests.campaigns.truth --schedules 100   (a module and its arguments)

A tool for the time in which both exist: it goes with the core.
"""

# ruff: noqa: SLF001  it looks into the core of today from outside, and goes with it

import asyncio
import importlib
import runpy
import sys
from asyncio import Future
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any
from weakref import WeakKeyDictionary

import pytest

from drivers.driver import LiftDriver
from lift_manager.core.journal import ShortJournal
from lift_manager.core.memory import Memory, ShortMemory
from lift_manager.core.options import LiftOptions
from lift_manager.domain import asking, boarding, contradictions, events, service, session, session_requests
from lift_manager.domain import state as states
from lift_manager.domain.description import LiftDescription, LiftSignals
from lift_manager.domain.journal import Row
from lift_manager.lift import (
    commands,
    history,
    inputs,
    observation,
    occupancy,
    queue,
    record,
    refusals,
    requests,
    trust,
)
from lift_manager.lift import events as lift_events
from lift_manager.lift import session as lift_session
from lift_manager.lift import state as lift_states
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.record import DurableRecord
from lift_manager.runtime.actor import LiftActor, LiftSettings
from lift_manager.runtime.bus import Bus, StateChanged
from lift_manager.runtime.life import is_clearing, release
from lift_manager.runtime.poll import LiftPoll
from lift_manager.runtime.recorder import Clock
from lift_manager.runtime.ticker import Ticker

SAME: dict[type, type] = {
    lift_session.Holder: states.Holder,
    lift_session.EndReason: service.EndReason,
    lift_session.Advice: service.Advice,
    observation.RobotDoor: states.RobotDoor,
    lift_states.Quality: states.Quality,
    lift_states.Restrictions: states.Restrictions,
    lift_states.LiftState: states.LiftState,
    occupancy.Occupancy: boarding.Who,
    occupancy.RobotWord: asking.RobotWord,
    occupancy.SavedBoarding: boarding.KeptBoarding,
    refusals.Refusal: asking.Refusal,
    refusals.Refused: asking.Refused,
    refusals.Blocking: asking.Blocking,
    refusals.Accepted: asking.Accepted,
    commands.CommandType: session_requests.Do,
    commands.CommandState: session_requests.Status,
    commands.CommandStatus: session_requests.Followed,
    commands.SessionInfo: session_requests.SessionInfo,
    commands.SessionOver: session_requests.SessionOver,
    requests.SessionBegun: session_requests.SessionBegun,
    record.Occupied: service.Occupied,
    record.SavedSession: session.KeptSession,
    trust.Trust: contradictions.Trust,
    trust.Distrust: contradictions.Distrust,
    trust.Contradiction: contradictions.Contradiction,
    lift_events.Cause: service.Cause,
    lift_events.SessionOpened: events.SessionOpened,
    lift_events.SessionRestored: events.SessionRestored,
    lift_events.SessionEnded: events.SessionEnded,
    lift_events.HandedOver: events.HandedOver,
    lift_events.Advised: events.Advised,
    lift_events.CommandEnded: events.CommandEnded,
    lift_events.Alarm: events.Alarm,
    StateChanged: events.StateChanged,
}
BACK = {old: new for new, old in SAME.items()}
RENAMED = {
    "occupancy": "who",
    "in_place_taken": "in_place_told",
    "kind": "do",
    "state": "status",
    "requested_at": "asked_at",
    "is_new": "anew",
    "saved_at": "kept_at",
    "opened_at_target": "stood_open",
    "ends_at": "closes_at",
    "ends_for": "closing",
}
PLAIN = frozenset({StateChanged, trust.Distrust, events.StateChanged, contradictions.Distrust})
"""Classes whose fields have the same names."""
KEPT: WeakKeyDictionary[Any, dict[str, tuple[service.Remembered, DurableRecord]]] = WeakKeyDictionary()
"""What each memory was given, as both: idempotency keys are in the new record alone."""


def old(value: Any) -> Any:
    """Return a value of the new core as today's core has it."""
    match value:
        case Enum():
            return SAME[type(value)](value.value) if type(value) in SAME else value
        case lift_events.Acknowledged():
            return service.Acknowledged(value.by, value.at, tuple(old(one) for one in value.causes))
        case lift_events.ForceReleased():
            holder = old(value.holder)
            return service.ForceReleased(
                value.by, value.at, value.reason, holder, value.maybe_aboard, clear_s=value.clear_s
            )
        case lift_events.Restriction():
            kind = service.Lockout if value.kind is RestrictionKind.LOCKOUT else service.Drain
            return kind(value.by, value.reason, value.since)
        case lift_events.RestrictionEnded():
            is_lockout = value.restriction.kind is RestrictionKind.LOCKOUT
            ended: Any = service.LockoutEnded if is_lockout else service.DrainEnded
            return ended(value.by, value.at, old(value.restriction))
        case tuple():
            return tuple(old(one) for one in value)
        case _ if type(value) in SAME:
            names = {} if type(value) in PLAIN else RENAMED
            return SAME[type(value)](
                **{names.get(one.name, one.name): old(getattr(value, one.name)) for one in fields(value)}
            )
        case _:
            return value


def new(value: Any) -> Any:
    """Return a value of today's core as the new core has it."""
    if isinstance(value, Enum):
        return BACK[type(value)](value.value) if type(value) in BACK else value
    if isinstance(value, tuple):
        return tuple(new(one) for one in value)
    if type(value) in BACK and is_dataclass(value):
        target: Any = BACK[type(value)]
        names = {} if type(value) in PLAIN else RENAMED
        return target(**{one.name: new(getattr(value, names.get(one.name, one.name))) for one in fields(target)})
    return value


def old_event(event: Any) -> Any:
    match event:
        case lift_events.SessionOpened() | lift_events.SessionRestored():
            made = old(event)
            return replace(made, floor=made.floor or "")
        case lift_events.RestrictionBegun(lift, one):
            is_lockout = one.kind is RestrictionKind.LOCKOUT
            return events.LockedOut(lift, old(one)) if is_lockout else events.DrainBegun(lift, old(one))
        case lift_events.RestrictionEnded(lift, _, _, one):
            is_lockout = one.kind is RestrictionKind.LOCKOUT
            return events.LockoutOver(lift, old(event)) if is_lockout else events.DrainOver(lift, old(event))
        case lift_events.Acknowledged():
            return events.PersonAcknowledged(event.lift, old(event))
        case lift_events.ForceReleased():
            return events.ReleasedByPerson(event.lift, old(event))
        case lift_events.CommandFollowed(lift, status, _):
            return events.RequestFollowed(lift, old(status))
        case _:
            return old(event)


def remembered(record_: DurableRecord, rides: Any) -> service.Remembered:
    lockout, drain = record_.restriction(RestrictionKind.LOCKOUT), record_.restriction(RestrictionKind.DRAIN)
    return service.Remembered(
        fire_since=record_.fire_since,
        lockout=old(lockout),
        drain=old(drain),
        occupied=old(record_.occupied),
        left_untold=record_.robot_left_owed_since,
        robot_mode_until=record_.robot_mode_until,
        acknowledged=old(record_.acknowledged),
        session=old(record_.session),
        rides=rides,
        trust=old(record_.trust),
    )


def durable(lift: str, kept: service.Remembered) -> DurableRecord:
    restrictions = tuple(
        lift_events.Restriction(kind, one.by, one.reason, one.since)
        for kind, one in ((RestrictionKind.LOCKOUT, kept.lockout), (RestrictionKind.DRAIN, kept.drain))
        if one is not None
    )
    said = kept.acknowledged
    return DurableRecord(
        fire_since=kept.fire_since,
        restrictions=restrictions,
        occupied=new(kept.occupied),
        robot_left_owed_since=kept.left_untold,
        robot_mode_until=kept.robot_mode_until,
        acknowledged=None if said is None else lift_events.Acknowledged(lift, said.by, said.at, new(said.what)),
        session=new(kept.session),
        trust=new(kept.trust),
    )


class OldBus:
    """The bus of today, for events of the new core."""

    def __init__(self, bus: Any) -> None:
        self.bus = bus

    @property
    def heard(self) -> bool:
        return bool(self.bus.heard)

    def publish(self, item: Any) -> str:
        return str(self.bus.hand_out(old_event(item)))


class OldRecorder:
    """Memory and journal of today as one recorder."""

    def __init__(self, memory: Memory, journal: Any) -> None:
        self.memory, self.journal = memory, journal

    @property
    def trouble(self) -> str:
        return self.journal.trouble or self.memory.trouble

    def recall(self, lift: str) -> DurableRecord:
        now = self.memory.recall(lift)
        before, record_ = KEPT.get(self.memory, {}).get(lift, (None, None))
        if record_ is not None and before is not None and replace(now, rides=()) == replace(before, rides=()):
            return record_
        return durable(lift, now)

    def keep(self, lift: str, record_: DurableRecord) -> None:
        kept = remembered(record_, self.memory.recall(lift).rides)
        KEPT.setdefault(self.memory, {})[lift] = kept, record_
        if kept != self.memory.recall(lift):
            self.memory.keep(lift, kept)

    def note(self, row: Row) -> None:
        self.journal.note(row)

    def before(self, row: Row) -> Future[str | None]:
        answer: Future[str | None] = self.journal.before(row)
        return answer

    def written(self, lift: str) -> Future[None] | None:
        return self.memory.written(lift)


class Line:
    """The queue of a lift as rides use it."""

    def __init__(self, actor: LiftActor) -> None:
        self.actor = actor

    @property
    def left(self) -> int:
        return self.actor.record.queue.departures

    def join(self, holder: states.Holder, now: float) -> None:
        self.actor.handle(inputs.JoinQueue(new(holder)))

    def leave(self, holder: states.Holder) -> None:
        self.actor.handle(inputs.LeaveQueue(new(holder)))

    def first(self, now: float) -> Any:
        places = queue.waiting(self.actor.record.queue, now)
        return old(places[0]) if places else None

    def ahead(self, holder: states.Holder, now: float) -> int:
        return queue.ahead_of(self.actor.record.queue, new(holder), now)

    def length(self, now: float) -> int:
        return len(queue.waiting(self.actor.record.queue, now))

    def why_not_yet(self, holder: states.Holder, now: float) -> Any:
        return old(queue.why_not_yet(self.actor.config.name, self.actor.record.queue, new(holder), now))


class Sessions:
    """Sessions of a lift as faces of today use them."""

    def __init__(self, actor: LiftActor, bus: Any) -> None:
        self.actor, self.bus = actor, bus

    def open(self, wish: session_requests.OpenSession) -> Any:
        return self.take(inputs.OpenSession(new(wish.holder), wish.key, wish.ttl_s, session.new_id()))

    def read(self, session_id: str, holder: states.Holder | None) -> Any:
        self.actor.begin()
        actor = self.actor
        return old(history.read_session(actor.config, actor.record, session_id, new(holder), actor.moment))

    def renew(self, session_id: str, holder: states.Holder, ttl_s: float | None) -> Any:
        return self.take(inputs.RenewSession(session_id, new(holder), ttl_s))

    def close(self, session_id: str, holder: states.Holder, robot: asking.RobotWord | None) -> Any:
        return self.take(inputs.CloseSession(session_id, new(holder), new(robot)))

    def hand_over(self, session_id: str, holder: states.Holder, to: states.Holder) -> Any:
        return self.take(inputs.HandOver(new(holder), new(to), session.new_id(), session_id))

    def ask(self, asked: session_requests.SessionRequest) -> Any:
        made = commands.CommandRequest(
            session=asked.session,
            holder=new(asked.holder),
            kind=new(asked.do),
            floor=asked.floor,
            hold_door=asked.hold_door,
            side=asked.side,
            key=asked.key,
        )
        return self.take(inputs.GiveCommand(made, session.new_id()))

    def followed(self, session_id: str, holder: states.Holder | None, number: str) -> Any:
        actor = self.actor
        return old(history.read_command(actor.config, actor.record, session_id, new(holder), number, actor.moment))

    async def until_ended(self, session_id: str, holder: states.Holder | None, number: str, within_s: float) -> Any:
        news = asyncio.Event()
        with self.bus.overhear(lambda *_: news.set()):
            try:
                async with asyncio.timeout(within_s):
                    while getattr(found := self.followed(session_id, holder, number), "status", "") == "pending":
                        news.clear()
                        await news.wait()
                    return found
            except TimeoutError:
                return self.followed(session_id, holder, number)

    def take(self, happened: inputs.Input) -> Any:
        return old(self.actor.handle(happened))


class LiftTask:
    """A lift as today's manager has it."""

    def __init__(
        self,
        driver: LiftDriver,
        options: LiftOptions,
        bus: Bus[Any],
        ticker: Ticker | None = None,
        *,
        memory: Memory | None = None,
        log: Any = None,
        clock: Clock | None = None,
    ) -> None:
        memory = memory or ShortMemory()
        self.options = options
        self.memory = memory
        self._driver = driver
        journal = log._journal if log is not None else ShortJournal()
        config = LiftConfig(
            source=driver.source,
            capabilities=driver.capabilities,
            **{
                one.name: getattr(options, one.name)
                for one in fields(LiftConfig)
                if one.name not in ("source", "capabilities")
            },
        )
        settings = LiftSettings(poll_s=options.poll_s, first_poll_s=options.first_poll_s)
        recorder: Any = OldRecorder(memory, journal)
        new_bus: Any = OldBus(bus)
        self.actor = LiftActor(driver, config, new_bus, recorder, settings=settings, clock=clock)
        self.poll = LiftPoll(self.actor, ticker)
        self.line = Line(self.actor)
        self.sessions = Sessions(self.actor, bus)

    @property
    def polls(self) -> int:
        return self.poll.polls

    async def first_look(self) -> None:
        await self.poll.looked.wait()

    async def run(self) -> None:
        await self.poll.run()

    async def drive(self) -> None:
        await self._driver.run()

    def announce_stop(self) -> None:
        self.actor.handle(inputs.AnnounceStop())

    @property
    def clearing(self) -> bool:
        return is_clearing(self.actor)

    async def stop(self) -> None:
        await release(self.actor)

    def tell(self, *, end: bool = False) -> None:
        self.actor.journal.tell(asyncio.get_running_loop().time(), end=end)

    def freshen(self) -> None:
        self.actor.freshen()

    def state(self) -> states.LiftState:
        made: states.LiftState = old(self.actor.state())
        return made

    def describe(self) -> LiftDescription:
        options = self.options
        return LiftDescription(
            lift=options.name,
            floors=options.floors,
            doors_at=options.doors_at,
            control=options.control,
            able=self._driver.capabilities,
            poll_s=options.poll_s,
            lease_s=options.lease_s,
            max_session_s=options.max_session_s,
            max_session_hold_s=options.max_session_hold_s,
            clear_s=options.clear_s,
            robot_hours="" if options.robot_hours is None else str(options.robot_hours),
            rmf_name=options.rmf_name,
            rmf_floors=options.rmf_floors,
        )

    def signals(self) -> LiftSignals:
        now = asyncio.get_running_loop().time()
        age_s = self.actor.state().age_s
        return LiftSignals(self.options.name, age_s, self._driver.capabilities.max_age_s, self._driver.signals(now))

    def request(self, ask: asking.Ask) -> Any:
        made = inputs.LiftRequest(
            new(ask.holder), ask.floor, ask.hold_door, new(ask.robot), ask.stays, new_id=session.new_id()
        )
        return self.take(made)

    def acknowledge(self, by: str) -> Any:
        return self.take(inputs.Acknowledge(by))

    def lock_out(self, by: str, reason: str, *, at_once: bool = False) -> Any:
        return self.take(inputs.Restrict(RestrictionKind.LOCKOUT, by, reason, at_once))

    def end_lockout(self, by: str) -> Any:
        return self.take(inputs.Unrestrict(RestrictionKind.LOCKOUT, by))

    def begin_drain(self, by: str, reason: str) -> Any:
        return self.take(inputs.Restrict(RestrictionKind.DRAIN, by, reason))

    def end_drain(self, by: str) -> Any:
        return self.take(inputs.Unrestrict(RestrictionKind.DRAIN, by))

    def force_release(self, by: str, reason: str, *, at_once: bool = False) -> Any:
        return self.take(inputs.ForceRelease(by, reason, at_once))

    def end_session(self, holder: states.Holder, grace_s: float) -> Any:
        return self.take(inputs.EndSession(new(holder), grace_s))

    def hand_over(self, holder: states.Holder, to: states.Holder) -> Any:
        return self.take(inputs.HandOver(new(holder), new(to), session.new_id()))

    def remembered(self) -> service.Remembered:
        return remembered(self.actor.record.durable, self.memory.recall(self.options.name).rides)

    def note_rides(self, rides: Any) -> None:
        name = self.options.name
        kept = replace(self.memory.recall(name), rides=rides)
        if kept != self.memory.recall(name):
            self.memory.keep(name, kept)

    def take(self, happened: inputs.Input) -> Any:
        return old(self.actor.handle(happened))


def install() -> None:
    """Have everything that is imported from here on use the runtime."""
    importlib.import_module("lift_manager.core.lift")
    for name, loaded in tuple(sys.modules.items()):
        if name.startswith(("lift_manager", "tests")) and hasattr(loaded, "LiftTask"):
            setattr(loaded, "LiftTask", LiftTask)  # noqa: B010  whatever the module is


install()

if __name__ == "__main__":
    if sys.argv[1:2] == ["-m"]:
        sys.argv = sys.argv[2:]
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
        raise SystemExit(0)
    from tests.lift_manager.runtime import as_core

    raise SystemExit(
        pytest.main(
            ["-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning", *sys.argv[1:]],
            plugins=[as_core],
        )
    )
