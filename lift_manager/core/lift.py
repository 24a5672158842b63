"""One task per lift: polls it, keeps its session, and decides what to press, hold and let go."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from drivers.driver import LiftDriver, Permit
from drivers.errors import DriverError
from drivers.model import Command, CommandKind, FloorName, LiftReading, Outcome
from lift_manager.core.bus import Bus
from lift_manager.domain import call as calls
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.events import Alarm, CommandEnded, Event, SessionEnded, SessionOpened, StateChanged
from lift_manager.domain.report import Seen, lift_state, same_but_for_time
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, barred, moving, robot_door, see
from lift_manager.domain.state import LiftState, RobotDoor
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode, Side

_log = logging.getLogger(__name__)

RECENT_FLOOR_S = 3.0
"""How long a client may act on a floor we reported: the workshop adapter polls every 0.5 s, publishes every 1 s and waits 1 s for
an answer (open-rmf 2.1), so its idea of the floor may be 2.5 s old."""

_ROBOT_MODE = Command(CommandKind.ROBOT_MODE)


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftOptions:
    """What the site says about one lift, as far as the manager needs it."""

    name: str
    floors: tuple[FloorName, ...]
    """Lowest first."""
    doors_at: Mapping[FloorName, tuple[Side, ...]]
    """Which doors serve each floor."""
    control: bool
    poll_s: float = 0.2
    lease_s: float = 300.0
    """On humble, requests stop once the lift is where they want it (open-rmf 1.4): the lease outlives RMF's 300 s localise step."""
    max_session_hold_s: float = 900.0


class LiftTask:
    """One lift: its newest sight, its session, its call."""

    def __init__(self, driver: LiftDriver, options: LiftOptions, bus: Bus[Event]) -> None:
        self.options = options
        self._driver = driver
        self._able = driver.capabilities
        self._bus = bus
        self._sight: Sight | None = None
        self._fault = "no answer yet"
        self._session: Session | None = None
        self._call: Call | None = None
        self._permit: Permit = lambda: "there is no session"
        self._sessions_opened = 0
        self._keep_robot_mode = False
        """The session is over, but the car still moves: robot mode is not dropped under way."""
        self._fire_latched = False
        self._stopping = False
        self._left: dict[FloorName, float] = {}
        """When the car last left each floor while nobody held the lift."""
        self._shown: LiftState | None = None
        self._looked = asyncio.Event()

    async def first_look(self) -> None:
        """Return once the lift has been read for the first time."""
        await self._looked.wait()

    async def run(self) -> None:
        """Poll and drive the lift until cancelled. Its bad weather stays its own."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._driver.run())
            tasks.create_task(self._poll())
            tasks.create_task(self._watch_age())

    async def stop(self) -> None:
        """Refuse everything from now on, let everything go, and return once that is verified."""
        self._stopping = True
        self._end_session("the manager is stopping", _now())
        self._keep_robot_mode = False
        await self._driver.release_all()

    def state(self) -> LiftState:
        """Return what this lift publishes right now, from memory."""
        return lift_state(self._seen(), _now())

    def request(self, ask: Ask) -> Accepted | Refused:
        """Decide on a request at once. Acceptance is not arrival."""
        now = _now()
        answer = self._decide(ask, now)
        if isinstance(answer, Session):
            self._take(answer, now)
            return Accepted()
        return answer

    def _decide(self, ask: Ask, now: float) -> Session | Accepted | Refused:
        options, session = self.options, self._session
        if self._stopping:
            return Refused(Refusal.STOPPING, "the manager is stopping")
        if ask.floor not in options.floors:
            return Refused(
                Refusal.UNKNOWN_FLOOR,
                f"{options.name} has no floor {ask.floor!r}; its floors are {', '.join(options.floors)}",
            )
        mine = session is None or session.holder == ask.holder
        if mine and not ask.hold_door and self._is_release(ask.floor, now):
            self._end_session("released", now)
            return Accepted()
        if mine and (refused := self._refusal(now)) is not None:
            return refused
        return sessions.admit(session, ask, number=self._sessions_opened + 1, now=now)

    def _is_release(self, floor: FloorName, now: float) -> bool:
        """Whether `floor` is the one this lift reports, so that a request not to hold the door there lets go.

        An idle lift that people move is not called back to a floor that a slow client still believes in.
        """
        if floor == (
            self.state().floor or (self._sight.floor if self._sight is not None and not self._fresh(now) else None)
        ):
            return True
        return self._session is None and now - self._left.get(floor, -math.inf) <= RECENT_FLOOR_S

    def _refusal(self, now: float) -> Refused | None:
        """Return why nobody may command this lift now."""
        name, sight = self.options.name, self._sight
        if not self.options.control:
            return Refused(
                Refusal.MONITOR_ONLY, f"{name} is only watched: its site file does not say `access: control`"
            )
        if "go_to" not in self._able.commands:
            return Refused(Refusal.NOT_POSSIBLE, f"{name} cannot be called: its map {self._able.map_name} has no go_to")
        if sight is None or not self._fresh(now):
            return Refused(Refusal.OFFLINE, self._offline())
        if self._fire_latched:
            return Refused(
                Refusal.FIRE_LATCHED, f"{name} was in fire service; a person must check it and restart the manager"
            )
        why_not = barred(sight.values)
        return None if why_not is None else Refused(Refusal.MODE, f"{name} takes no robots now: {why_not}")

    def _offline(self) -> str:
        state = self.state()
        since = "never read yet" if state.age_s is None else f"last reading {state.age_s:.1f} s ago"
        return f"{state.lift} is offline, {since}: {state.reason}"

    def _take(self, session: Session, now: float) -> None:
        before = self._session
        self._session = session
        if before is None:
            self._sessions_opened = session.number
            self._left.clear()
            self._permit = self._make_permit(session.number)
            _log.info("%s: %s holds the lift, to %s", self.options.name, session.holder, session.floor)
            self._bus.publish(SessionOpened(self.options.name, session.holder, session.floor))
        if self._call is not None and self._call.floor != session.floor:
            self._driver.let_go(Command(CommandKind.GO_TO, self._call.floor))
        self._call = calls.want(self._call, session.floor, now)
        self._act(now)
        self._publish()

    def _make_permit(self, number: int) -> Permit:
        """Return the check that the link makes immediately before the bytes of a press leave."""

        def permit() -> str | None:
            if self._session is None or self._session.number != number:
                return "the session has ended"
            return self._why_not_now()

        return permit

    def _why_not_now(self) -> str | None:
        sight = self._sight
        if sight is None or not self._fresh(_now()):
            return "the last reading is too old"
        return "there was a fire" if self._fire_latched else barred(sight.values)

    async def _poll(self) -> None:
        loop, period = asyncio.get_running_loop(), self.options.poll_s
        due = loop.time()
        while True:
            try:
                reading = await self._driver.read()
            except DriverError as error:
                self._missed(error)
            else:
                self._got(reading)
            due += period
            late = loop.time() - due
            if late > 0:
                due += math.ceil(late / period) * period
            await asyncio.sleep(due - loop.time())

    def _got(self, reading: LiftReading) -> None:
        before = self._sight
        if before is None:
            self._looked.set()
        sight = self._sight = see(before, reading, self._able)
        settled = (
            before is not None
            and sight.values is before.values
            and sight.standing is before.standing
            and sight.agreed is before.agreed
        )
        if before is not None and before.floor is not None and before.floor != sight.floor and self._session is None:
            self._left[before.floor] = reading.at
        if self._fault:
            _log.info("%s: reading %s", self.options.name, self._driver.source)
            self._fault = ""
        elif settled and self._session is None and not self._keep_robot_mode:
            return
        self._act(_now())
        self._publish()

    def _missed(self, error: DriverError) -> None:
        if not self._fault:
            _log.warning("%s: %s", self.options.name, error)
        self._fault = str(error)
        self._act(_now())
        self._publish()

    def _act(self, now: float) -> None:
        """Bring wishes and sight together. Called after every reading, request and outcome."""
        sight = self._sight
        fresh = sight is not None and self._fresh(now)
        if sight is not None and fresh:
            self._obey_mode(sight, now)
        session = self._session
        if session is not None and now >= sessions.lease_ends_at(session, self.options.lease_s):
            self._end_session(f"the lease of {self.options.lease_s:g} s ran out", now)
        if sight is None or not fresh:
            return
        if self._session is None:
            self._settle(sight)
            return
        self._driver.hold(_ROBOT_MODE, self._why_not_now)
        self._serve(sight, now)

    def _obey_mode(self, sight: Sight, now: float) -> None:
        mode = sight.values.mode
        if mode is Mode.FIRE and not self._fire_latched:
            self._fire_latched = True
            self._keep_robot_mode = False
            self._driver.let_go(_ROBOT_MODE)
            self._alarm("fire: everything is let go, robots are refused until a person has checked the lift")
        if mode in ROBOT_FORBIDDEN_MODES and mode is not Mode.UNKNOWN:
            self._end_session(f"the mode is {mode}", now)

    def _serve(self, sight: Sight, now: float) -> None:
        """Advance the session that holds the lift."""
        session, call = self._session, self._call
        if session is None or call is None:
            return
        call = self._call = self._seen_call(call, sight, now)
        if call.phase is CallPhase.WANTED and not calls.granted(sight, self._able):
            self._await_grant(session, call, now)
            return
        if calls.may_press(call, sight):
            self._release_doors()
            self._press(session.floor, now)
        elif call.phase is CallPhase.ARRIVED:
            self._driver.let_go(Command(CommandKind.GO_TO, session.floor))
            self._stay(session, sight, now)
        else:
            self._release_doors()

    def _seen_call(self, call: Call, sight: Sight, now: float) -> Call:
        after = calls.seen(call, sight, self._able, now)
        if after.phase is not call.phase:
            _log.info("%s: call to %s %s %s", self.options.name, call.floor, after.phase, after.reason)
        return after

    def _await_grant(self, session: Session, call: Call, now: float) -> None:
        """Let the lease stand still while the lift has not granted robot mode, but not for ever."""
        self._session = replace(session, lease_from=now)
        if now - call.since > self._able.granted_within_s:
            self._end_session(
                f"{', '.join(sorted(self._able.call_requires))} was not granted within {self._able.granted_within_s:g} s",
                now,
            )

    def _press(self, floor: FloorName, now: float) -> None:
        if self._call is None:
            return
        self._call = calls.pressed(self._call, now)
        future = self._driver.press(Command(CommandKind.GO_TO, floor), self._permit)
        future.add_done_callback(self._ended)

    def _ended(self, future: asyncio.Future[Outcome]) -> None:
        if future.cancelled():
            return
        outcome, now = future.result(), _now()
        proof = f", seen by {outcome.proof}" if outcome.proof != "none" else ""
        _log.info("%s: %s %s%s %s", self.options.name, outcome.command, outcome.result, proof, outcome.reason)
        self._bus.publish(CommandEnded(self.options.name, outcome))
        if self._call is not None and self._call.floor == outcome.command.floor:
            self._call = calls.ended(self._call, outcome, now)
        self._act(now)
        self._publish()

    def _stay(self, session: Session, sight: Sight, now: float) -> None:
        """Hold the door at the session's floor, or end a session that wanted no more than to get there."""
        if not session.hold_door:
            self._end_session("arrived", now)
            return
        if robot_door(sight, self.options.doors_at[session.floor]) is RobotDoor.OPEN:
            session = sessions.stood_open(session, now)
        ends_at = sessions.hold_ends_at(session, self.options.max_session_hold_s)
        if ends_at is not None and now >= ends_at and not session.hold_spent:
            session = replace(session, hold_spent=True, holding_since=None)
            self._alarm(
                f"the door was held for {self.options.max_session_hold_s:g} s; it is let go, {session.holder} keeps the lift"
            )
        if session.hold_spent:
            self._release_doors()
        else:
            for side in self.options.doors_at[session.floor]:
                self._driver.hold(Command(CommandKind.HOLD_DOOR, side=side), self._permit)
            session = replace(session, holding_since=session.holding_since or now)
        self._session = session

    def _settle(self, sight: Sight) -> None:
        """Drop robot mode after a session, once the car stands still."""
        if self._keep_robot_mode:
            if moving(sight.values):
                self._driver.hold(_ROBOT_MODE, self._why_not_now)
                return
            self._keep_robot_mode = False
        self._driver.let_go(_ROBOT_MODE)

    def _end_session(self, reason: str, now: float) -> None:
        session = self._session
        if session is None:
            return
        self._session = self._call = None
        self._release_doors()
        self._driver.let_go(Command(CommandKind.GO_TO, session.floor))
        self._keep_robot_mode = not self._fire_latched and not self._stopping
        _log.info("%s: session of %s over: %s", self.options.name, session.holder, reason)
        self._bus.publish(SessionEnded(self.options.name, session.holder, reason))
        if self._sight is not None and self._fresh(now):
            self._settle(self._sight)
        self._publish()

    def _release_doors(self) -> None:
        for side in self._able.doors:
            self._driver.let_go(Command(CommandKind.HOLD_DOOR, side=side))

    def _fresh(self, now: float) -> bool:
        return self._sight is not None and now - self._sight.at <= self._able.max_age_s

    def _alarm(self, text: str) -> None:
        _log.warning("%s: %s", self.options.name, text)
        self._bus.publish(Alarm(self.options.name, text))

    def _seen(self) -> Seen:
        session = self._session
        doors = self.options.doors_at.get(session.floor, ()) if session is not None else ()
        held = session is None or all(
            self._driver.held(Command(CommandKind.HOLD_DOOR, side=side))
            for side in doors
            if f"hold_door.{side}" in self._able.commands
        )
        return Seen(
            lift=self.options.name,
            floors=self.options.floors,
            doors_at=self.options.doors_at,
            able=self._able,
            sight=self._sight,
            fault=self._fault,
            source=self._driver.source,
            session=session,
            arrived=self._call is not None and self._call.phase is CallPhase.ARRIVED,
            door_held=held,
        )

    async def _watch_age(self) -> None:
        """Publish the loss of a lift when its last reading has become too old, not when the next poll fails."""
        loop = asyncio.get_running_loop()
        while True:
            at = self._sight.at if self._sight is not None else loop.time()
            await asyncio.sleep(max(at + self._able.max_age_s - loop.time(), 0) + 0.001)
            if not self._fresh(loop.time()):
                self._act(loop.time())
                self._publish()
                await asyncio.sleep(self._able.max_age_s)

    def _publish(self) -> None:
        if not self._bus.heard:
            return
        state = self.state()
        if self._shown is None or not same_but_for_time(state, self._shown):
            self._shown = state
            self._bus.publish(StateChanged(self.options.name, state))


def _now() -> float:
    return asyncio.get_running_loop().time()
