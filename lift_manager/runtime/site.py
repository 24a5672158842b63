"""All lifts of one site behind one facade: every face uses this and nothing below it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from drivers.model import Command, CommandInfo, CommandKind, CommandStep, PlannedWrite
from lift_manager.lift import history
from lift_manager.lift.commands import CommandRequest, CommandState, CommandStatus, SessionInfo
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import (
    Acknowledged,
    Alarm,
    CommandFollowed,
    ForceReleased,
    Restriction,
    RestrictionEnded,
    RestrictionKind,
)
from lift_manager.lift.freshness import age_s
from lift_manager.lift.inhibits import unknown_floor
from lift_manager.lift.inputs import (
    Acknowledge,
    CloseSession,
    EndSession,
    ForceRelease,
    GiveCommand,
    HandOver,
    Input,
    LiftRequest,
    OpenSession,
    RenewSession,
    Restrict,
    Unrestrict,
)
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.quiet import under_way
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.refusals import Accepted, Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.rmf_view import RmfRules
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftSignals, LiftState
from lift_manager.runtime.actor import LiftActor, new_id
from lift_manager.runtime.bus import Bus, Event, Occurrence, StateChanged, Subscription
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import Clock, Recorder, wall_clock
from lift_manager.runtime.refusals import FaceRefusal, RefusalLog
from lift_manager.runtime.rides import SiteRides
from register_maps.words import Side

RECORDED_WITHIN_S = 0.5
"""How long the reply to a change waits for the disk. Chosen: a client waits a second."""

Kind = TypeVar("Kind")


class Site:
    """Many lifts. Replies come from memory: nothing waits for a controller, and nothing but `recorded` for the disk.

    Every refusal is raised as a `RequestRefused`.
    """

    def __init__(
        self,
        actors: Iterable[LiftActor],
        bus: Bus[Event],
        recorder: Recorder,
        *,
        rmf: RmfRules | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Put lifts together that share bus, recorder and clock."""
        self._lifts = {actor.config.name: actor for actor in actors}
        self._bus = bus
        self._recorder = recorder
        self.refusals = RefusalLog(recorder)
        self.rides = SiteRides(self._lifts, bus, recorder, self.refusals, clock or wall_clock())
        self.stopping = False
        """It is stopping: nobody holds a lift any more, and sessions are kept for the next start."""
        self.rmf = rmf or RmfRules()
        """What the site file sets for Open-RMF."""

    # -- what is known

    def lift_names(self) -> tuple[str, ...]:
        """Return every lift in the order of the site file, whether or not it can be reached."""
        return tuple(self._lifts)

    def state(self, lift: str) -> LiftState:
        """Return what a lift publishes right now."""
        return self._lift(lift).state()

    def lasting_state(self, lift: str) -> LiftState:
        """Return the same for a face that shows no seconds of a live lift: the same object until anything else of it changes."""
        return self._lift(lift).lasting_state()

    def age_s(self, lift: str) -> float | None:
        """Return the age of the last whole reading of a lift; None when there never was one."""
        actor = self._lift(lift)
        return age_s(actor.record, actor.moment)

    def config(self, lift: str) -> LiftConfig:
        """Return what site file and map define for a lift."""
        return self._lift(lift).config

    def signals(self, lift: str) -> LiftSignals:
        """Return every signal as it was read last."""
        actor = self._lift(lift)
        signals = actor.driver.signals(asyncio.get_running_loop().time())
        return LiftSignals(lift, self.age_s(lift), actor.config.capabilities.max_age_s, signals)

    def map_commands(self, lift: str) -> tuple[CommandInfo, ...]:
        """Return every command of a lift's map, and what its output does now."""
        return self._lift(lift).driver.commands()

    def planned_writes(self, lift: str, steps: Iterable[str]) -> tuple[PlannedWrite, ...]:
        """Return what these steps would write from rest, each as `press go_to L2` or `release hold_door.front`. Nothing is sent."""
        actor = self._lift(lift)
        parsed = [_parse_step(step) for step in steps]
        known = {command.name: command for command in actor.driver.commands()}
        for step in parsed:
            if (refused := _step_refused(actor.config, known, step)) is not None:
                self.refusals.refuse(lift, refused)
        return actor.driver.plan([step for step in parsed if step is not None])

    def durable(self, lift: str) -> DurableRecord:
        """Return what of a lift outlives the manager: decisions of people, and what they have to see to."""
        return self._lift(lift).record.durable

    def under_way(self, lift: str) -> str:
        """Return what is under way on a lift, for people; empty if there is nothing. Rides are in `rides`."""
        actor = self._lift(lift)
        actor.catch_up()
        return under_way(actor.config, actor.record, actor.moment)

    async def recorded(self, lift: str, within_s: float = RECORDED_WITHIN_S) -> bool:
        """Wait until the newest record of a lift is on the disk; False where that took longer."""
        written = self._recorder.written(lift)
        if written is None:
            return True
        done, _ = await asyncio.wait([written], timeout=within_s)
        return bool(done)

    def begin_stopping(self) -> None:
        """Begin no more rides, and inform faces: nobody holds a lift any more, and sessions are kept for the next start."""
        self.stopping = self.rides.is_stopping = True

    @property
    def unwritten(self) -> frozenset[str]:
        """Why nothing can be recorded; then nothing is pressed on any lift."""
        return frozenset({"journal", "state"}) if self._recorder.trouble else frozenset()

    # -- callers that know no sessions

    def request(
        self,
        lift: str,
        holder: Holder,
        floor: str,
        *,
        hold_door: bool,
        robot: RobotWord | None = None,
        stays: bool = False,
    ) -> Accepted:
        """Take a request that names a floor. All rules are behind this, the release for a closed door included."""
        if lift not in self._lifts:
            self.refusals.turned_away(FaceRefusal(Refusal.UNKNOWN_LIFT, "there is no such lift", lift, str(holder)))
        return self._take(lift, LiftRequest(holder, floor, hold_door, robot, stays, new_id()), Accepted)

    def end_session(self, lift: str, holder: Holder, grace_s: float) -> Accepted:
        """End the session of this holder, the car where it is; within the grace a request of the same holder continues it."""
        return self._take(lift, EndSession(holder, grace_s), Accepted)

    def hand_over(self, lift: str, holder: Holder, to: Holder) -> Accepted:
        """Hand the session of this holder to another caller; the car and its door stay as they are."""
        return self._take(lift, HandOver(holder, to, new_id()), Accepted)

    # -- sessions that their holders open and close

    def open_session(self, lift: str, holder: Holder, *, key: str = "", ttl_s: float | None = None) -> SessionBegun:
        """Take the lift for a caller; nothing is called by it."""
        return self._take(lift, OpenSession(holder, key, ttl_s, new_id()), SessionBegun)

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo:
        """Return a session by its id, also one that is over for a short time; `holder` None reads those of all holders."""
        actor = self._lift(lift)
        actor.begin()
        return self._raised(
            lift, history.read_session(actor.config, actor.record, session, holder, actor.moment), SessionInfo
        )

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo:
        """Begin its lease again; a session from before a restart continues."""
        return self._take(lift, RenewSession(session, holder, ttl_s), SessionInfo)

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo:
        """End it, the car where it is; one that is over already is returned as it is."""
        return self._take(lift, CloseSession(session, holder, robot), SessionInfo)

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo:
        """Hand it to another caller. It gets a new id: the old one ends."""
        return self._take(lift, HandOver(holder, to, new_id(), session), SessionInfo)

    def command(self, lift: str, request: CommandRequest) -> CommandStatus:
        """Take a command of a session's holder; `command_status` returns its outcome."""
        return self._take(lift, GiveCommand(request, new_id()), CommandStatus)

    def command_status(self, lift: str, session: str, holder: Holder | None, command: str) -> CommandStatus:
        """Return a command within a session by its id, as it is now."""
        actor = self._lift(lift)
        found = history.read_command(actor.config, actor.record, session, holder, command, actor.moment)
        return self._raised(lift, found, CommandStatus)

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, command: str, within_s: float
    ) -> CommandStatus:
        """Return the same, once it is no longer pending or `within_s` has passed."""
        ended = asyncio.Event()

        def receive(_: str, event: Event) -> None:
            if isinstance(event, CommandFollowed) and event.status.id == command:
                ended.set()

        with self._bus.overhear(receive):
            status = self.command_status(lift, session, holder, command)
            if status.state is CommandState.PENDING:
                try:
                    async with asyncio.timeout(within_s):
                        await ended.wait()
                except TimeoutError:
                    pass
                status = self.command_status(lift, session, holder, command)
        return status

    # -- people

    def acknowledge(self, lift: str, by: str) -> Acknowledged:
        """Record that a person has checked the lift after a fire, or found no robot in its car."""
        return self._decide(lift, by, "acknowledge", Acknowledge(by), Acknowledged)

    def lock_out(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> Restriction:
        """Keep robots off a lift until a person ends that.

        OPEN is withdrawn at once. The door is released `clear_s` later while a robot may be in it, unless `at_once`; everything
        else is released now.
        """
        action = Restrict(RestrictionKind.LOCKOUT, by, reason, at_once)
        return self._decide(lift, by, "lockout", action, Restriction)

    def end_lockout(self, lift: str, by: str) -> RestrictionEnded:
        """End a lockout."""
        return self._decide(lift, by, "lockout_end", Unrestrict(RestrictionKind.LOCKOUT, by), RestrictionEnded)

    def begin_drain(self, lift: str, by: str, reason: str) -> Restriction:
        """Begin no new session on a lift; the present one continues to its end."""
        return self._decide(lift, by, "drain", Restrict(RestrictionKind.DRAIN, by, reason), Restriction)

    def end_drain(self, lift: str, by: str) -> RestrictionEnded:
        """End a drain."""
        return self._decide(lift, by, "drain_end", Unrestrict(RestrictionKind.DRAIN, by), RestrictionEnded)

    def force_release(self, lift: str, by: str, reason: str, *, at_once: bool = False) -> ForceReleased:
        """Take a lift from its holder; everything is released as at the end of any session, when `lock_out` does."""
        return self._decide(lift, by, "release", ForceRelease(by, reason, at_once), ForceReleased)

    def turned_away(self, who: FaceRefusal) -> None:
        """Write down a request that a face refused by itself."""
        self.refusals.count(who.lift if who.lift in self._lifts else "", who.code)
        self.refusals.turned_away(who)

    def logged_in(self, key: str, address: str, *, ended: bool = False) -> None:
        """Write down that a browser logged in with this key, or out."""
        self.refusals.login(key, address, ended=ended)

    # -- what happens

    @property
    def boot(self) -> str:
        """The beginning of the ids of this process's events."""
        return self._bus.boot

    @property
    def newest(self) -> int:
        """The number of the newest event; 0 before the first. `numbering` makes it that of a decision."""
        return self._bus.newest

    def freshen(self, lift: str | None = None) -> None:
        """Publish every change of a state that is not published yet, of this lift or of all lifts."""
        for name in self._lifts if lift is None else (lift,):
            self._lift(name).freshen()

    @contextmanager
    def numbering(self, lift: str) -> Iterator[None]:
        """Give what is decided within the context a later number than every state before it.

        Whether or not anybody listens. Afterwards `newest` is that of the resulting state.
        """
        self.freshen(lift)
        yield
        self.freshen(lift)

    @contextmanager
    def tap(self, receive: Callable[[Occurrence], None]) -> Iterator[None]:
        """Call `receive` with every event for as long as the context lasts, at once and in order.

        It must not raise, wait, or request anything: it is called in the middle of a step.
        """
        loop = asyncio.get_running_loop()
        with self._bus.tap(lambda event_id, event: receive(Occurrence(event_id, loop.time(), event))):
            yield

    @contextmanager
    def overhear(self, receive: Callable[[Occurrence], None]) -> Iterator[None]:
        """As `tap`, but only for what is published anyway: no state is computed for it."""
        loop = asyncio.get_running_loop()
        with self._bus.overhear(lambda event_id, event: receive(Occurrence(event_id, loop.time(), event))):
            yield

    @contextmanager
    def listen(self) -> Iterator[Subscription[Event]]:
        """Listen to events; the state of every lift comes first."""
        with self._bus.listen() as subscription:
            for name, actor in self._lifts.items():
                subscription.put(StateChanged(name, actor.state()))
            yield subscription

    def report_disk(self, trouble: str) -> None:
        """Alert people that nothing can be recorded, or report that it can again; the store has a row of its own for it."""
        for lift in self._lifts:
            self._bus.publish(Alarm(lift, trouble or "journal: rows are written again; robots are taken as before"))

    # -- inside

    def _lift(self, lift: str) -> LiftActor:
        if (actor := self._lifts.get(lift)) is None:
            shown = json.dumps(lift, ensure_ascii=not lift.isprintable())
            text = f"no lift {shown}; the lifts are {', '.join(self._lifts)}"
            self.refusals.refuse("", Refused(Refusal.UNKNOWN_LIFT, text))
        return actor

    def _take(self, lift: str, happened: Input, kind: type[Kind]) -> Kind:
        return self._raised(lift, self._lift(lift).handle(happened), kind)

    def _decide(self, lift: str, by: str, action: str, happened: Input, kind: type[Kind]) -> Kind:
        """Take a person's decision; a refused one is written down here, because no lift has a row of it."""
        try:
            return self._take(lift, happened, kind)
        except RequestRefused as refused:
            self.refusals.person_refused(lift, by, action, code=refused.code, message=refused.message)
            raise

    def _raised(self, lift: str, reply: object, kind: type[Kind]) -> Kind:
        """Return a reply; raise a refusal, and count it."""
        if isinstance(reply, Refused):
            self.refusals.refuse(lift, reply)
        if not isinstance(reply, kind):
            raise TypeError(f"{lift} replied {reply!r}")
        return reply


def _parse_step(text: str) -> CommandStep | None:
    """Return a step by its words; None for no such step."""
    verb, _, rest = text.partition(" ")
    name, _, floor = rest.partition(" ")
    kind, _, side = name.partition(".")
    if verb not in ("press", "release") or kind not in set(CommandKind) or side not in {"", *Side}:
        return None
    command = Command(CommandKind(kind), floor or None, Side(side) if side else None)
    return CommandStep(command, is_release=verb == "release")


def _step_refused(config: LiftConfig, known: Mapping[str, CommandInfo], step: CommandStep | None) -> Refused | None:
    commands = ", ".join(known)
    if step is None or (info := known.get(step.command.name)) is None:
        named = "a step" if step is None else step.command.name
        text = f"{config.name} has no {named} like that; write `press` or `release` and one of {commands}"
        return Refused(Refusal.NOT_POSSIBLE, text)
    if info.takes_floor:
        return unknown_floor(config, step.command.floor or "")
    if step.command.floor is not None:
        return Refused(Refusal.NOT_POSSIBLE, f"{config.name}: {info.name} takes no floor")
    return None
