"""Plays schedules with the core of today, feeds the same inputs to `lift_manager.lift`, and compares what the two make of them.

python -m tests.campaigns.shadow --schedules 200 --seed 1
python -m tests.campaigns.shadow --replay 1234          (one schedule, with the inputs before the first difference)

A tool for the time in which both exist. Times of waiting for the disk are left out: here every step counts as committed.
"""
# ruff: noqa: SLF001  it looks into the core of today from outside, and goes with it

import argparse
import asyncio
import os
import subprocess
import sys
import time
from asyncio import Future
from collections import Counter, deque
from collections.abc import Callable, Coroutine, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, is_dataclass, replace
from datetime import datetime
from enum import Enum
from typing import Any

import pytest

from drivers.modbus.lift import ModbusLift
from drivers.model import Capabilities, Command, CommandKind, LiftReading, Outcome, OutputState, PressId
from lift_manager.core.lift import LiftTask
from lift_manager.core.outputs import LiftOutputs, Permit, always
from lift_manager.domain import asking, events, journal_rows, service, session_requests
from lift_manager.domain import state as states
from lift_manager.lab.world.world import World
from lift_manager.lift import audit, inputs, step
from lift_manager.lift import commands as lift_commands
from lift_manager.lift import events as lift_events
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Cause, Restriction, RestrictionKind
from lift_manager.lift.inhibits import blocked_by
from lift_manager.lift.inputs import Input, Press
from lift_manager.lift.observation import Moment
from lift_manager.lift.occupancy import Occupancy, RobotWord, SavedBoarding
from lift_manager.lift.outputs import outputs
from lift_manager.lift.record import DurableRecord, LiftRecord, Occupied, SavedSession
from lift_manager.lift.refusals import Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import EndReason, Holder
from lift_manager.lift.state import state
from lift_manager.lift.trust import Contradiction, Distrust, Trust
from register_maps.words import Side
from tests.campaigns.playing import LIFT, play
from tests.campaigns.schedules import Schedule, draw
from tests.campaigns.truth import maps, quiet
from tests.campaigns.visits import actors, with_visits
from tests.lift_manager.core.scripted import ScriptedDriver

AT_A_TIME = 10
INPUTS_SHOWN = 14
Json = Any


@dataclass(frozen=True)
class Difference:
    """Where the two cores part for the first time in a schedule."""

    kind: str
    at: float
    text: str
    before: tuple[str, ...] = ()
    """The inputs before it, the newest last."""


# -- one lift


class Shadow:
    """One task of the core of today, and the record that is stepped beside it."""

    def __init__(
        self, task: LiftTask, report: Callable[[Difference], None], trace: deque[tuple[float, object]]
    ) -> None:
        self.task = task
        self.keeper = task._keeper
        self.outputs: LiftOutputs = task._outputs
        capabilities = self.outputs.capabilities
        self.config = config_of(task, capabilities)
        self.report = report
        self.trace = trace
        self.record: LiftRecord | None = None
        self.commands = {name: command_of(name) for name in sorted(capabilities.commands) if name != "heartbeat"}
        self.durable = durable_of(self.config.name, task.remembered())
        self.depth = self.steps = 0
        self.over = False
        self.ids: dict[Future[Outcome], PressId] = {}
        self.pressed: list[tuple[Command, Future[Outcome]]] = []
        self.wanted: dict[Command, bool] = {}
        """What the core of today wants held, and whether it may begin."""
        self.heard: list[object] = []
        self.stepped: list[step.Step] = []
        self.clock = task._people.clock
        self.clock_now: datetime | None = None
        """The time of day while an input is taken: the same for both."""
        task._people.clock = self.keeper.book._clock = self.frozen_clock
        task._bus._counters.append(self.hear)
        self.hook()

    def frozen_clock(self) -> datetime:
        return self.clock() if self.clock_now is None else self.clock_now

    def hear(self, _: str, item: object) -> None:
        """Take an event of the core of today that an input has brought about."""
        if self.depth:
            self.heard.append(item)

    # -- what goes in

    def hook(self) -> None:
        """Listen to everything that happens to the task."""
        task, keeper = self.task, self.keeper
        self.entry(keeper, "begin", lambda *_: None)
        self.entry(task, "_got", self.reading)
        self.entry(task, "_missed", lambda error: inputs.ReadFailed(str(error)))
        self.entry(keeper, "_ended", self.ended)
        self.entry(keeper, "act", lambda _: inputs.Tick())
        self.entry(task, "request", self.request)
        self.entry(task, "end_session", lambda holder, grace_s: inputs.EndSession(holder_of(holder), grace_s))
        self.entry(task, "hand_over", lambda by, to: inputs.HandOver(holder_of(by), holder_of(to), self.session_id()))
        self.entry(task, "acknowledge", inputs.Acknowledge)
        self.entry(task, "lock_out", self.lock_out)
        self.entry(task, "end_lockout", lambda by: inputs.Unrestrict(RestrictionKind.LOCKOUT, by))
        self.entry(task, "begin_drain", lambda by, reason: inputs.Restrict(RestrictionKind.DRAIN, by, reason))
        self.entry(task, "end_drain", lambda by: inputs.Unrestrict(RestrictionKind.DRAIN, by))
        self.entry(task, "force_release", self.force_release)
        self.entry(task, "announce_stop", inputs.AnnounceStop)
        self.entry(keeper, "stop", inputs.Stop)
        sessions = task.sessions
        self.entry(sessions, "open", self.open)
        self.entry(
            sessions,
            "renew",
            lambda session, holder, ttl_s: inputs.RenewSession(session, holder_of(holder), ttl_s),
        )
        self.entry(
            sessions,
            "close",
            lambda session, holder, robot: inputs.CloseSession(session, holder_of(holder), word_of(robot)),
        )
        self.entry(
            sessions,
            "hand_over",
            lambda session, by, to: inputs.HandOver(holder_of(by), holder_of(to), self.session_id(), session),
        )
        self.entry(sessions, "ask", self.command)
        self.entry(task.line, "join", lambda holder, _: inputs.JoinQueue(holder_of(holder)))
        self.entry(task.line, "leave", lambda holder: inputs.LeaveQueue(holder_of(holder)))
        self.entry(task, "state", lambda: None)
        self.hook_outputs()

    def hook_outputs(self) -> None:
        held: Any = self.outputs
        old_press, old_hold, old_release = held.press, held.hold, held.let_go
        old_keep, old_adopt = held.keep, held.adopt

        def press(command: Command, permit: Permit, begins: Permit = always) -> Future[Outcome]:
            asked = self.permit(command, permit, begins)
            future: Future[Outcome] = old_press(command, asked, begins)
            asked.future = future
            self.pressed.append((command, future))
            if command.name in held.capabilities.levels:
                self.wanted = {one: may for one, may in self.wanted.items() if one.name != command.name}
                self.wanted[command] = False
            return future

        def hold(command: Command, permit: Permit, *, begin: bool = True) -> None:
            if begin or command in self.wanted:
                self.wanted[command] = begin
            wanted = dict(self.wanted)
            old_hold(command, self.permit(command, permit), begin=begin)
            self.wanted = wanted  # where the map requires what the lift does not give, they let go by themselves

        def let_go(command: Command) -> None:
            self.wanted = {one: may for one, may in self.wanted.items() if one.name != command.name}
            old_release(command)

        def keep(command: Command) -> None:
            if command in self.wanted:
                self.wanted[command] = False
            old_keep(command)

        def adopt(command: Command, permit: Permit) -> None:
            self.wanted[command] = False
            old_adopt(command, self.permit(command, permit))

        held.press, held.hold, held.let_go, held.keep, held.adopt = press, hold, let_go, keep, adopt

    def permit(self, command: Command, permit: Permit, begins: Permit = always) -> "Asked":
        return Asked(self, command, permit, begins)

    def entry(self, owner: object, name: str, make: Callable[..., Input | None]) -> None:
        """Let the core of today do something first, and step the record by the same input."""
        old = getattr(owner, name)

        def wrapped(*args: Any, **kwargs: Any) -> Any:
            if self.depth or self.over or (self.record is None and name in ("state", "join", "leave")):
                return old(*args, **kwargs)
            self.depth += 1
            try:
                self.clock_now = self.clock()
                self.before()
                answer = old(*args, **kwargs)
                self.answer = answer
                self.after(name, make, args, kwargs, answer)
                return answer
            finally:
                self.depth -= 1
                self.clock_now = None

        setattr(owner, name, wrapped)

    def before(self) -> None:
        self.statuses = {name: self.status(command) for name, command in self.commands.items()}
        self.read_at = self.task._read_at
        self.trouble = self.task._log.trouble
        self.pressed, self.heard = [], []

    def after(self, name: str, make: Callable[..., Input | None], args: Any, kwargs: Any, answer: object) -> None:
        moment = self.moment(self.read_at)
        if self.record is None:
            started = step.start(self.config, self.durable, moment)
            self.record = started.record
            self.trace.append((moment.now, "start"))
            if name == "begin":
                self.compare(started, answer, name, self.moment(self.task._read_at))
                return
            self.stepped = [started]
        trouble = self.trouble
        self.record = replace(self.record, disk_trouble=trouble, committed=self.record.sequence)
        made = make(*args, **kwargs)
        if name in ("state", "begin") or made is None:
            noted = step.note_outputs(self.config, self.record, self.statuses, moment)
            self.record = noted if name == "state" else self.record
            if isinstance(answer, states.LiftState):
                self.compare_states(answer, moment)
            return
        self.trace.append((moment.now, made))
        self.steps += 1
        if isinstance(made, inputs.Reading):
            if not step.is_news(self.config, self.record, made.reading, read_at=moment.read_at, now=moment.now):
                self.trace.pop()
                return
        else:
            self.record = step.note_outputs(self.config, self.record, self.statuses, moment)
        done = step.step(self.config, self.record, made, moment)
        self.record = replace(done.record, committed=done.record.sequence)
        self.compare(done, answer, name, self.moment(self.task._read_at))

    # -- inputs

    def reading(self, reading: LiftReading) -> Input:
        return inputs.Reading(reading, self.statuses)

    def ended(self, future: Future[Outcome]) -> Input | None:
        if future.cancelled() or future not in self.ids:
            return None
        return inputs.PressEnded(self.ids[future], future.result())

    def request(self, ask: asking.Ask) -> Input:
        return inputs.LiftRequest(
            holder_of(ask.holder), ask.floor, ask.hold_door, word_of(ask.robot), ask.stays, self.session_id()
        )

    def lock_out(self, by: str, reason: str, *, at_once: bool = False) -> Input:
        return inputs.Restrict(RestrictionKind.LOCKOUT, by, reason, at_once)

    def force_release(self, by: str, reason: str, *, at_once: bool = False) -> Input:
        return inputs.ForceRelease(by, reason, at_once)

    def open(self, wish: session_requests.OpenSession) -> Input:
        return inputs.OpenSession(holder_of(wish.holder), wish.key, wish.ttl_s, self.session_id())

    def command(self, request: session_requests.SessionRequest) -> Input:
        made = lift_commands.CommandRequest(
            session=request.session,
            holder=holder_of(request.holder),
            kind=lift_commands.CommandType(request.do),
            floor=request.floor,
            hold_door=request.hold_door,
            side=request.side,
            key=request.key,
        )
        answer = self.answer
        return inputs.GiveCommand(made, answer.id if isinstance(answer, session_requests.Followed) else "")

    def session_id(self) -> str:
        """The id that the core of today has made for the session that goes on, or for the one that was over at once."""
        session = self.keeper.session
        if session is not None:
            return session.id
        sheets = self.keeper.book._over
        return next(reversed(sheets)) if sheets else ""

    def moment(self, read_at: float) -> Moment:
        return Moment(asyncio.get_running_loop().time(), self.task._people.clock(), read_at)

    def status(self, command: Command) -> OutputState:
        known = self.outputs._state(command.name)
        if known in (OutputState.AT_REST, OutputState.RELEASING) and self.outputs.given(command):
            return OutputState.REQUESTED  # it waits to be written down
        return OutputState.ON if known is OutputState.LOST else known  # what is lost is still wanted

    # -- what comes out

    def compare(self, done: step.Step, answer: object, name: str, moment: Moment) -> None:
        """Compare a step with what the core of today has done; the first difference ends the comparison of this process."""
        asked = name not in ("_got", "_missed", "_ended", "act", "begin", "announce_stop", "stop", "join", "leave")
        steps = [*self.stepped, done]
        made = [event for one in steps for event in one.events]
        actions = [action for one in steps for action in one.actions]
        self.stepped = []
        presses = [action for action in actions if isinstance(action, Press)]
        self.same("events", [told(one) for one in self.heard if told(one)], [told(one) for one in made])
        heard: list[Any] = self.heard
        old_rows = [row for row in map(journal_rows.row_of, heard) if row is not None]
        new_rows = [row for row in map(audit.row_of, made) if row is not None]
        recorded = [row for row in old_rows if str(row.kind) != "request"]  # some commands have no row of their own
        self.same(
            "rows", [row_words(row) for row in recorded], [row_words(row) for row in new_rows if row.kind != "request"]
        )
        if asked:
            self.same("reply", plain(answer), plain(done.reply))
        self.same("presses", [str(one) for one, _ in self.pressed], [str(one.command) for one in presses])
        for (_, future), press in zip(self.pressed, presses, strict=False):
            self.ids[future] = press.id
        if name != "stop":  # the outputs are told to release everything right after it
            self.compare_holds(moment)
        assert self.record is not None
        after = {name: self.status(command) for name, command in self.commands.items()}
        self.record = step.note_outputs(self.config, self.record, after, moment)
        self.compare_states(self.task.state(), moment)
        old = replace(durable_of(self.config.name, self.task.remembered()), session=None)
        # the core of today forgets the idempotency keys of commands and of sessions that are over
        new = replace(self.record.durable, session=None, commands=(), past_sessions=())
        self.same("durable", plain_durable(old, new), plain_durable(new, old))
        self.same(
            "saved session",
            plain_saved(durable_of(self.config.name, self.task.remembered()).session),
            plain_saved(self.record.durable.session),
        )

    def compare_holds(self, moment: Moment) -> None:
        assert self.record is not None
        declared = {str(command): hold for command, hold in outputs(self.config, self.record).items()}
        wanted = {
            str(command): begin
            for command, begin in self.wanted.items()
            if command.name in self.config.capabilities.commands
        }
        given = {str(command) for command in self.wanted if self.outputs.given(command)}
        old = {name: begin for name, begin in wanted.items() if name in declared or name in given}
        new = {name: hold.begin for name, hold in declared.items()}
        for name in [*old]:
            if name.startswith("robot_in_place"):
                old[name] = False  # from here on losing it is never another press
        self.same("holds", old, new)

    def compare_states(self, old: states.LiftState, moment: Moment) -> None:
        assert self.record is not None
        self.same("state", plain(old), plain(state(self.config, self.record, moment)))

    def same(self, kind: str, old: Json, new: Json) -> None:
        if old == new or self.over:
            return
        self.over = True
        if isinstance(old, dict) and isinstance(new, dict):
            keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
            kind = f"{kind}: {', '.join(keys[:3])}" if kind in ("state", "durable", "saved session") else kind
            old, new = {key: old.get(key) for key in keys}, {key: new.get(key) for key in keys}
        now = asyncio.get_running_loop().time()
        self.report(Difference(kind, now, f"old {old}\n        new {new}", shown(self.trace)))


class Asked:
    """A permit that is asked of both."""

    def __init__(self, shadow: Shadow, command: Command, permit: Permit, begins: Permit) -> None:
        self.shadow, self.command, self.old, self.begins = shadow, command, permit, begins
        self.future: Future[Outcome] | None = None

    def __call__(self) -> str | None:
        shadow = self.shadow
        why = self.old()
        press = None if self.future is None or self.future.done() else shadow.ids.get(self.future)
        record = shadow.record
        if record is None or shadow.over or shadow.depth or (self.future is not None and press is None):
            return why
        expected = (self.begins() if press is not None else None) or why
        moment = shadow.moment(shadow.task._read_at)
        asked = blocked_by(shadow.config, record, self.command, press, moment)
        if (expected is None) is not (asked is None) or (expected != asked and press is not None):
            shadow.same("permit", f"{self.command}: {expected}", f"{self.command}: {asked}")
        return why


# -- from the words of today to those of the new core


def command_of(name: str) -> Command:
    kind, _, side = name.partition(".")
    return Command(CommandKind(kind), side=Side(side) if side else None)


def config_of(task: LiftTask, capabilities: Capabilities) -> LiftConfig:
    options = task.options
    return LiftConfig(
        name=options.name,
        source=task._driver.source,
        floors=options.floors,
        doors_at=options.doors_at,
        control=options.control,
        capabilities=capabilities,
        lease_s=options.lease_s,
        max_session_s=options.max_session_s,
        takeover_after_s=options.takeover_after_s,
        max_session_hold_s=options.max_session_hold_s,
        clear_s=options.clear_s,
        rmf_clear_s=options.rmf_clear_s,
        infer_occupancy=options.infer_occupancy,
        board_min_s=options.board_min_s,
        robot_hours=options.robot_hours,
        between_sessions_s=options.between_sessions_s,
        fire_release_delay_s=options.fire_release_delay_s,
    )


def holder_of(old: states.Holder) -> Holder:
    return Holder(old.face, old.name)


def word_of(old: asking.RobotWord | None) -> RobotWord | None:
    return None if old is None else RobotWord(old)


def durable_of(lift: str, old: service.Remembered) -> DurableRecord:
    restrictions = []
    if old.lockout is not None:
        one = old.lockout
        restrictions.append(Restriction(RestrictionKind.LOCKOUT, one.by, one.reason, one.since))
    if old.drain is not None:
        other = old.drain
        restrictions.append(Restriction(RestrictionKind.DRAIN, other.by, other.reason, other.since))
    occupied = old.occupied
    said = old.acknowledged
    trust = old.trust
    distrust = tuple(Distrust(Contradiction(one.kind), one.text, one.since, one.trips) for one in trust.distrust)
    return DurableRecord(
        fire_since=old.fire_since,
        restrictions=tuple(restrictions),
        occupied=None if occupied is None else Occupied(holder_of(occupied.holder), occupied.aboard, occupied.since),
        robot_left_owed_since=old.left_untold,
        robot_mode_until=old.robot_mode_until,
        acknowledged=None
        if said is None
        else lift_events.Acknowledged(lift, said.by, said.at, tuple(Cause(cause) for cause in said.what)),
        session=saved_of(old),
        trust=Trust(trust.map_hash, trust.door_proven, distrust),
    )


def saved_of(old: service.Remembered) -> SavedSession | None:
    kept = old.session
    if kept is None:
        return None
    boarding = kept.boarding
    return SavedSession(
        holder=holder_of(kept.holder),
        floor=kept.floor,
        hold_door=kept.hold_door,
        opened_at=kept.opened_at,
        lease_from=kept.lease_from,
        holding_since=kept.holding_since,
        saved_at=kept.kept_at,
        opened_at_target=kept.stood_open,
        hold_spent=kept.hold_spent,
        pressed=kept.pressed,
        boarding=SavedBoarding(
            Occupancy(boarding.who), boarding.sent_on, boarding.may_leave_at, boarding.in_place_told
        ),
        id=kept.id,
        stays=kept.stays,
        lease_s=kept.lease_s,
        key=kept.key,
        key_ttl_s=kept.key_ttl_s,
        ends_at=kept.closes_at,
        ends_for=None if kept.closing is None else (EndReason(kept.closing[0].value), kept.closing[1]),
    )


# -- values that can be compared

_SAME_FIELDS = {"do": "kind", "status": "state", "asked_at": "requested_at", "anew": "is_new"}


def plain(value: object) -> Json:  # noqa: C901, PLR0911, PLR0912 - one line for each kind of value
    """Return a value of either core as plain data."""
    match value:
        case None | bool() | int():
            return value
        case service.Lockout():
            return {"lockout": [value.by, value.reason, str(value.since)]}
        case service.Drain():
            return {"drain": [value.by, value.reason, str(value.since)]}
        case Restriction():
            return {str(value.kind): [value.by, value.reason, str(value.since)]}
        case service.LockoutEnded():
            return {"ended": [value.by, str(value.at), plain(value.lockout)]}
        case service.DrainEnded():
            return {"ended": [value.by, str(value.at), plain(value.drain)]}
        case lift_events.RestrictionEnded():
            return {"ended": [value.by, str(value.at), plain(value.restriction)]}
        case service.Acknowledged():
            return {"acknowledged": [value.by, str(value.at), [str(one) for one in value.what]]}
        case lift_events.Acknowledged():
            return {"acknowledged": [value.by, str(value.at), [str(one) for one in value.causes]]}
        case service.ForceReleased() | lift_events.ForceReleased():
            shown = plain_fields(value)
            shown.pop("lift", None)
            return shown
        case SessionBegun() | session_requests.SessionBegun():
            return {
                "session": plain(value.session),
                "new": value.is_new if isinstance(value, SessionBegun) else value.anew,
            }
        case asking.Refused() | Refused():
            return {"code": str(value.code), "message": value.message, "blocking": plain(value.blocking)}
        case float():
            return round(value, 3)
        case Enum():
            return str(value.value)
        case datetime():
            return value.isoformat(timespec="milliseconds")
        case dict():
            return {str(key): plain(one) for key, one in value.items()}
        case tuple() | list():
            return [plain(one) for one in value]
        case states.Holder() | Holder():
            return str(value)
        case _ if is_dataclass(value):
            return plain_fields(value)
        case _:
            return str(value)


def plain_fields(value: Any) -> dict[str, Json]:
    return {_SAME_FIELDS.get(one.name, one.name): plain(getattr(value, one.name)) for one in fields(value)}


def row_words(row: Any) -> Json:
    return [str(row.kind), row.text, row.lift, row.caller, plain(dict(row.data))]


def plain_durable(durable: DurableRecord, other: DurableRecord) -> Json:
    """Return what outlives the manager, without what differs from `other` by design.

    A robot that was in the car, out of it and perhaps in it again within one step has been there all the time. Until when robot
    mode is kept follows the monotonic clock, should the two drift apart. What a fire changes is written at once, and not one
    reading later.
    """
    shown = plain_fields(durable)
    if durable.occupied is not None and other.occupied is not None:
        shown["occupied"] = [str(durable.occupied.holder), durable.occupied.aboard]
    shown["robot_mode_until"] = durable.robot_mode_until is None
    if durable.fire_since is not None:
        shown["robot_mode_until"] = shown["occupied"] = None
    return shown


def plain_saved(saved: SavedSession | None) -> Json:
    """Return a saved session without its clocks: what is derived from them is compared by what it does."""
    if saved is None:
        return {}
    shown = plain_fields(saved)
    shown.pop("saved_at")
    for name in ("opened_at", "lease_from", "holding_since"):
        at = getattr(saved, name)
        shown[name] = None if at is None else round(at.timestamp(), 1)
    return shown


def told(event: object) -> Json:  # noqa: C901, PLR0911, PLR0912 - one line for each kind of event
    """Return what an event tells; None for those that one core alone has."""
    match event:
        case events.StateChanged() | events.RideChanged():
            return None
        case events.LockedOut(_, lockout):
            return ["begun", plain(lockout)]
        case events.DrainBegun(_, drain):
            return ["begun", plain(drain)]
        case lift_events.RestrictionBegun(_, restriction):
            return ["begun", plain(restriction)]
        case events.LockoutOver(_, ended) | events.DrainOver(_, ended):
            return plain(ended)
        case events.PersonAcknowledged(_, said):
            return plain(said)
        case events.ReleasedByPerson(_, released):
            return plain(released)
        case lift_events.RestrictionEnded() | lift_events.Acknowledged() | lift_events.ForceReleased():
            return plain(event)
        case events.RequestFollowed(_, followed):
            return ["command", plain(followed)]
        case lift_events.CommandFollowed(_, status, _):
            return ["command", plain(status)]
        case events.SessionOpened() | lift_events.SessionOpened():
            return ["opened", plain(event.holder), event.floor or ""]
        case events.SessionRestored() | lift_events.SessionRestored():
            return ["restored", plain(event.holder), event.floor or "", event.text]
        case _ if is_dataclass(event):
            return [type(event).__name__, plain_fields(event)]
        case _:
            return None


# -- schedules


def shown(trace: Iterable[tuple[float, object]]) -> tuple[str, ...]:
    """Return inputs in words; of a reading what matters most."""
    return tuple(f"{at:.3f} {_shown(one)}" for at, one in trace)


def _shown(one: object) -> str:
    if not isinstance(one, inputs.Reading):
        return str(one)
    values = one.reading.values
    doors = {str(side): str(door) for side, door in values.doors.items()}
    flags = [name for name, on in values.flags.items() if on]
    on = {name: str(status) for name, status in one.outputs.items() if status is not OutputState.AT_REST}
    calls = f"{values.call_accepted} {sorted(values.calls)} {values.destination}"
    return f"Reading {values.floor} {doors} {values.motion} {values.mode} {flags} calls {calls}; {on}"


@dataclass
class Shadowed:
    """What became of one schedule."""

    seed: int
    map: str
    differences: list[Difference] = field(default_factory=list)
    steps: int = 0


def shadow(schedule: Schedule, *, visited: bool = False) -> Shadowed:
    """Play a schedule with both cores."""
    done = Shadowed(schedule.seed, schedule.map)
    trace: deque[tuple[float, object]] = deque(maxlen=INPUTS_SHOWN)

    shadows: list[Shadow] = []

    def attach(world: World) -> None:
        both = Shadow(world.manager._lifts[LIFT], done.differences.append, trace)
        shadows.append(both)

    def more(world: World) -> Iterable[Coroutine[Any, Any, None]]:
        attach(world)
        old_restart = world.restart

        async def restart() -> None:
            await old_restart()
            attach(world)

        world.restart = restart  # type: ignore[method-assign]  # a new manager is shadowed before it does anything
        return actors(world, schedule.seed, lambda *_: None) if visited else []

    played = play(schedule, more=more)
    for finding in played.findings:
        if finding.rule == "crash":
            done.differences.append(Difference("crash", finding.at, finding.text, shown(trace)))
    done.steps = sum(both.steps for both in shadows)
    return done


def run(seeds: Sequence[int]) -> list[Shadowed]:
    """Play some schedules; every fourth with visitors who come through the doors of the program."""
    with quiet():
        return [shadow(*_drawn(seed)[:1], visited=_drawn(seed)[1]) for seed in seeds]


def _drawn(seed: int) -> tuple[Schedule, bool]:
    schedule, visited = draw(seed, maps()), seed % 4 == 0
    return (with_visits(schedule) if visited else schedule), visited


def report(done: Sequence[Shadowed], took_s: float) -> list[str]:
    differing = [one for one in done if one.differences]
    steps = sum(one.steps for one in done)
    lines = [f"{len(done)} schedules, {steps} steps in {took_s:.0f} s, {len(differing)} schedules differ"]
    kinds = Counter(one.differences[0].kind for one in differing)
    for kind, count in kinds.most_common():
        first = next(one for one in differing if one.differences[0].kind == kind)
        seeds = [one.seed for one in differing if one.differences[0].kind == kind]
        found = first.differences[0]
        lines += [f"{count:4d}  {kind}: seeds {seeds[:12]}", f"      seed {first.seed}, {first.map}, {found.at:.3f} s"]
        lines += [f"        {found.text}", *(f"          {line}" for line in found.before)]
    return lines


class OnCoreTests:
    """Shadows every lift of the tests of the core of today: a plugin of pytest."""

    def __init__(self) -> None:
        self.found: list[Difference] = []
        self.differing: list[tuple[str, Difference]] = []
        self.steps = 0
        self.shadows: list[Shadow] = []
        made = LiftTask.__init__
        plugin = self

        def init(task: LiftTask, *args: Any, **kwargs: Any) -> None:
            made(task, *args, **kwargs)
            if isinstance(task._driver, ModbusLift | ScriptedDriver):
                plugin.shadows.append(Shadow(task, plugin.found.append, deque(maxlen=INPUTS_SHOWN)))

        LiftTask.__init__ = init  # type: ignore[assignment,method-assign]  # every task of these tests is made like this

    def pytest_runtest_teardown(self, item: Any) -> None:
        """Keep what was found in one test."""
        self.steps += sum(one.steps for one in self.shadows)
        if self.found:
            found = self.found[0]
            self.differing.append((item.nodeid, found))
            head = [item.nodeid, f"      {found.kind} at {found.at:.3f} s", f"        {found.text}"]
            sys.stderr.write("\n".join([*head, *(f"          {line}" for line in found.before), ""]))
        self.found.clear()
        self.shadows.clear()


def core_tests(paths: Sequence[str]) -> int:
    """Run tests of the core of today with every lift shadowed."""
    plugin = OnCoreTests()
    pytest.main(
        [
            "-q",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:randomly",
            "-s",
            "--assert=plain",
            "--timeout=300",
            "--tb=line",
            "-W",
            "ignore::pytest.PytestAssertRewriteWarning",
            *paths,
        ],
        plugins=[plugin],
    )
    sys.stdout.write(f"{plugin.steps} steps, {len(plugin.differing)} tests differ\n")
    return 1 if plugin.differing else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schedules", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1, help="of the first schedule; the others follow")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--replay", type=int, metavar="SEED")
    parser.add_argument(
        "--core-tests", nargs="*", metavar="PATH", help="shadow these tests of the core of today instead"
    )
    given = parser.parse_args()
    if given.core_tests is not None:
        return core_tests(given.core_tests or ["tests/lift_manager/core"])
    if os.environ.get("PYTHONHASHSEED") != "0":
        command = [sys.executable, "-m", "tests.campaigns.shadow", *sys.argv[1:]]
        return subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "0"}, check=False).returncode
    began = time.monotonic()
    if given.replay is not None:
        done = run([given.replay])
    else:
        seeds = range(given.seed, given.seed + given.schedules)
        chunks = [seeds[start : start + AT_A_TIME] for start in range(0, len(seeds), AT_A_TIME)]
        with ProcessPoolExecutor(given.processes) as pool:
            done = []
            for chunk in pool.map(run, chunks):
                done += chunk
                sys.stderr.write(f"{len(done)} schedules, {sum(bool(one.differences) for one in done)} differ\n")
    sys.stdout.write("\n".join([*report(done, time.monotonic() - began), ""]))
    return 1 if any(one.differences for one in done) else 0


if __name__ == "__main__":
    raise SystemExit(main())
