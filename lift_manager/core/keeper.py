"""Keeps the session of one lift: who commands it, and what is pressed, held and let go for them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import replace

from drivers.driver import LiftDriver, Permit
from drivers.model import Command, CommandKind, FloorName, Outcome
from lift_manager.core.bus import Bus
from lift_manager.core.calling import CallButton
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.domain import call as calls
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.events import Alarm, CommandEnded, Event, SessionEnded, SessionOpened
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, barred, moving, on_fire
from register_maps.vocabulary import CALLS
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode, Side

_log = logging.getLogger(__name__)

_ROBOT_MODE = Command(CommandKind.ROBOT_MODE)
_CALLS = frozenset(CALLS) - {CommandKind.GO}
"""Commands that bring the empty car."""


class SessionKeeper:
    """At most one session, its call and its holds. Nothing here waits."""

    def __init__(
        self,
        driver: LiftDriver,
        options: LiftOptions,
        bus: Bus[Event],
        *,
        sight: Callable[[float], Sight | None],
        last_sight: Callable[[], Sight | None],
        changed: Callable[[], None],
    ) -> None:
        """`sight` gives what is known at a time unless it is too old by then, `last_sight` however old it is.

        `changed` hears when there is news to publish.
        """
        self.session: Session | None = None
        self._options = options
        self._driver = driver
        self._able = driver.capabilities
        self._bus = bus
        self._sight = sight
        self._last_sight = last_sight
        self._changed = changed
        self._button = CallButton(driver, options, self._press)
        self._handshake = Handshake(driver, options, self._button, self._press, permit=self._why_no_word)
        self._call: Call | None = None
        self._pressed: asyncio.Future[Outcome] | None = None
        """The newest press of the call."""
        self._permit: Permit = lambda: "there is no session"
        self._sessions_opened = 0
        self._keep_robot_mode_until: float | None = None
        """The session is over, but the car still moves: robot mode is not dropped under way."""
        self._fire_latched = False
        self._stopping = False

    @property
    def busy(self) -> bool:
        """Whether every reading matters, changed or not."""
        return self.session is not None or self._keep_robot_mode_until is not None or self._handshake.reporting

    @property
    def arrived(self) -> bool:
        """Whether the session's call is fulfilled."""
        return self._call is not None and self._call.phase is CallPhase.ARRIVED

    @property
    def aboard(self) -> bool | None:
        """Whether the session's robot is in the car; None where nobody knows."""
        return self._handshake.aboard if self.session is not None else None

    @property
    def stood_open_at(self) -> FloorName | None:
        """The session's floor, once the door has stood open there."""
        return self.session.floor if self.session is not None and self.session.stood_open else None

    @property
    def door_held(self) -> bool:
        """Whether our hold of every door at the session's floor is on and verified, where the map has one."""
        if self.session is None:
            return False
        holds = [self._hold_door(side) for side in self._options.doors_at[self.session.floor]]
        return all(self._driver.held(hold) for hold in holds if hold.name in self._able.commands)

    def request(self, ask: Ask, *, is_release: bool, offline: str) -> Accepted | Refused:
        """Decide on a request and act on it. `offline` says why, should the lift be offline."""
        now = _now()
        answer = self._decide(ask, now, is_release=is_release, offline=offline)
        if not isinstance(answer, Session):
            return answer
        refused = self._handshake.hear(ask, self.session, self._sight(now), arrived=self.arrived, now=now)
        if refused is not None:
            return refused
        self._take(answer, now)
        return Accepted()

    def stop(self) -> None:
        """Refuse everything from now on, and end the session."""
        self._stopping = True
        self._end_session("the manager is stopping", _now())
        self._keep_robot_mode_until = None

    def _decide(self, ask: Ask, now: float, *, is_release: bool, offline: str) -> Session | Accepted | Refused:
        options, session = self._options, self.session
        if self._stopping:
            return Refused(Refusal.STOPPING, "the manager is stopping")
        if ask.floor not in options.floors:
            return Refused(
                Refusal.UNKNOWN_FLOOR,
                f"{options.name} has no floor {ask.floor!r}; its floors are {', '.join(options.floors)}",
            )
        mine = session is None or session.holder == ask.holder
        if mine and is_release:
            self._release(ask, now)
            return Accepted()
        if mine and (refused := self._refusal(now, offline)) is not None:
            return refused
        return sessions.admit(session, ask, number=self._sessions_opened + 1, now=now)

    def _refusal(self, now: float, offline: str) -> Refused | None:
        """Return why nobody may command this lift now."""
        name, sight = self._options.name, self._sight(now)
        if not self._options.control:
            return Refused(
                Refusal.MONITOR_ONLY, f"{name} is only watched: its site file does not say `access: control`"
            )
        if not self._able.commands.intersection(_CALLS):
            text = f"{name} cannot be called: its map {self._able.map_name} has neither go_to nor call"
            return Refused(Refusal.NOT_POSSIBLE, text)
        if sight is None:
            return Refused(Refusal.OFFLINE, offline)
        if self._fire_latched:
            return Refused(
                Refusal.FIRE_LATCHED, f"{name} was in fire service; a person must check it and restart the manager"
            )
        why_not = barred(sight.values, self._able)
        return None if why_not is None else Refused(Refusal.MODE, f"{name} takes no robots now: {why_not}")

    def _take(self, session: Session, now: float) -> None:
        before = self.session
        self.session = session
        if before is None:
            self._sessions_opened = session.number
            self._permit = self._make_permit(session.number)
            _log.info("%s: %s holds the lift, to %s", self._options.name, session.holder, session.floor)
            self._bus.publish(SessionOpened(self._options.name, session.holder, session.floor))
        moves_on = self._call is not None and self._call.floor != session.floor
        if moves_on and self._handshake.ready:
            self._button.let_go()
        holds_door = self._button.holds_door(session.floor, aboard=self._handshake.aboard is True)
        if moves_on or not (session.hold_spent and holds_door):
            self._call = calls.want(self._call, session.floor, now)
        self.act(now)
        self._changed()

    def _make_permit(self, number: int) -> Permit:
        """Return the check that the link makes immediately before the bytes of a press leave."""

        def permit() -> str | None:
            if self.session is None or self.session.number != number:
                return "the session has ended"
            return self._why_not_now()

        return permit

    def _why_not_now(self) -> str | None:
        sight = self._sight(_now())
        if sight is None:
            return "the last reading is too old"
        return "there was a fire" if self._fire_latched else barred(sight.values, self._able)

    def _why_no_word(self) -> str | None:
        """Return why the lift may not be told that a robot left; that the session is over is no reason."""
        return "the manager is stopping" if self._stopping else self._why_not_now()

    def act(self, now: float) -> None:
        """Bring wishes and sight together. Called after every reading, request and outcome."""
        sight = self._sight(now)
        if sight is not None:
            self._obey_mode(sight, now)
        session = self.session
        if session is not None and now >= sessions.lease_ends_at(session, self._options.lease_s):
            self._end_session(f"the lease of {self._options.lease_s:g} s ran out", now)
        if self.session is None:
            if sight is not None:
                self._handshake.seen(sight, None, now)
            self._handshake.act(None, now)
            self._settle(now)
            return
        if sight is None:
            return
        self._driver.hold(_ROBOT_MODE, self._why_not_now)
        self._handshake.act(self._permit, now)
        self._serve(sight, now)

    def _obey_mode(self, sight: Sight, now: float) -> None:
        mode = sight.values.mode
        if on_fire(sight.values) and not self._fire_latched:
            self._fire_latched = True
            self._keep_robot_mode_until = None
            self._driver.let_go(_ROBOT_MODE)
            self._handshake.let_go()
            self._alarm("fire: everything is let go, robots are refused until a person has checked the lift")
        if mode in ROBOT_FORBIDDEN_MODES and mode is not Mode.UNKNOWN:
            self._end_session(f"the mode is {mode}", now)

    def _serve(self, sight: Sight, now: float) -> None:
        """Advance the session that holds the lift."""
        session, call = self.session, self._call
        if session is None or call is None:
            return
        call = self._call = self._seen_call(call, sight, now)
        self._handshake.seen(sight, session, now)
        command = self._handshake.next_command(call.floor)
        missing = calls.missing(sight, self._able, command) if call.phase is CallPhase.WANTED else None
        if missing:
            self._release_doors()
            self._await_grant(session, call, f"{', '.join(sorted(missing))} for {command}", now)
            return
        if call.phase is CallPhase.WANTED and not self._handshake.ready:
            self._await_word(session, sight, now)
        elif calls.may_press(call, sight, self._able, now):
            self._release_doors()
            self._press_call(call, now)
        elif call.phase is CallPhase.ARRIVED:
            self._button.let_go_at("arrived")
            self._stay(session, sight, now)
        else:
            self._release_doors()
            if call.phase is CallPhase.FAILED and self._button.until:
                self._button.let_go()

    def _await_word(self, session: Session, sight: Sight, now: float) -> None:
        """Stay open for a robot aboard until the lift has been told of it; a robot on its way out needs nothing more."""
        if self._handshake.aboard and sight.floor is not None and sight.standing:
            self._hold_open(session, sight, sight.floor, now)
        else:
            self._release_doors()

    def _seen_call(self, call: Call, sight: Sight, now: float) -> Call:
        after = calls.seen(call, sight, self._able, now)
        if after.phase is CallPhase.CONFIRMED and self._button.forgotten:
            after = calls.failed(after, "the controller no longer holds the call", now)
        if after.phase is not call.phase:
            _log.info("%s: call to %s %s %s", self._options.name, call.floor, after.phase, after.reason)
        return after

    def _await_grant(self, session: Session, call: Call, what: str, now: float) -> None:
        """Let the lease stand still while the lift has not granted what is needed, such as robot mode, but not for ever."""
        self.session = replace(session, lease_from=now)
        if now - call.since > self._able.granted_within_s:
            self._end_session(f"{what} was not granted within {self._able.granted_within_s:g} s", now)

    def _press_call(self, call: Call, now: float) -> None:
        pressed = self._button.press(call.floor, self._permit, aboard=self._handshake.aboard is True)
        if pressed is None:
            # where no call moves the occupied car, the word that a robot is in place has sent it on
            self._call = calls.unpressed(call, now)
        else:
            self._call, self._pressed = calls.pressed(call, now), pressed

    def _press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        future = self._driver.press(command, permit)
        future.add_done_callback(self._ended)
        return future

    def _ended(self, future: asyncio.Future[Outcome]) -> None:
        if future.cancelled():
            return
        outcome, now = future.result(), _now()
        proof = f", seen by {outcome.proof}" if outcome.proof != "none" else ""
        _log.info("%s: %s %s%s %s", self._options.name, outcome.command, outcome.result, proof, outcome.reason)
        self._bus.publish(CommandEnded(self._options.name, outcome))
        if self._call is not None and future is self._pressed:
            self._call = calls.ended(self._call, outcome, now)
        if (text := self._handshake.ended(future, outcome, now)) is not None:
            self._alarm(text)
        self.act(now)
        self._changed()

    def _stay(self, session: Session, sight: Sight, now: float) -> None:
        """Hold the door at the session's floor, or end a session that wanted no more than to get there.

        A robot aboard keeps its session: it has still to get out.
        """
        if not session.hold_door and self._handshake.aboard is not True:
            self._end_session("arrived", now)
            return
        if self._handshake.door_is_open(sight, session.floor):
            session = sessions.stood_open(session, now)
        self.session = session
        if session.hold_door:
            self._hold_open(session, sight, session.floor, now)

    def _hold_open(self, session: Session, sight: Sight, floor: FloorName, now: float) -> None:
        """Hold the doors that serve a floor, and the call that keeps them open, for as long as the site allows."""
        ends_at = sessions.hold_ends_at(session, self._options.max_session_hold_s)
        if ends_at is not None and now >= ends_at and not session.hold_spent:
            session = replace(session, hold_spent=True, holding_since=None)
            self._alarm(
                f"the door was held for {self._options.max_session_hold_s:g} s; it is let go, {session.holder} keeps the lift"
            )
        if session.hold_spent or barred(sight.values, self._able) is not None:
            self._release_doors()
            self._button.let_go_of_door()
        else:
            self._button.keep_on(self._permit)
            for side in self._options.doors_at[floor]:
                self._driver.hold(self._hold_door(side), self._permit)
            session = replace(session, holding_since=now if session.holding_since is None else session.holding_since)
        self.session = session

    def _settle(self, now: float) -> None:
        """Drop robot mode after a session, once the car stands still; a car that never does keeps it for a bounded time.

        While the lift cannot be read, what it said last decides, and the hold is not renewed.
        """
        until, last = self._keep_robot_mode_until, self._last_sight()
        under_way = last is not None and moving(last) and last.values.flags.get("robot_mode_on", False)
        if until is not None and now < until and (under_way or self._handshake.reporting):
            if self._sight(now) is not None:
                self._driver.hold(_ROBOT_MODE, self._why_not_now)
            return
        if until is not None and under_way:
            self._alarm(
                f"nobody has seen the car come to rest for {self._able.arrive_within_s:g} s; robot mode is dropped"
            )
        self._keep_robot_mode_until = None
        self._driver.let_go(_ROBOT_MODE)

    def _release(self, ask: Ask, now: float) -> None:
        """End the session at its holder's word."""
        if self.session is None:
            self._handshake.end_again(ask, now)
        self._end_session("released", now, release=ask)

    def _end_session(self, reason: str, now: float, *, release: Ask | None = None) -> None:
        session = self.session
        if session is None:
            return
        self.session = self._call = None
        self._release_doors()
        if self._handshake.end(session, release, now):
            self._alarm(
                f"aboard_abandoned: the session of {session.holder} is over with its robot aboard ({reason});"
                " everything is let go, and the lift is not told that the robot left"
            )
        keeps = not self._fire_latched and not self._stopping
        self._keep_robot_mode_until = now + self._able.arrive_within_s if keeps else None
        _log.info("%s: session of %s over: %s", self._options.name, session.holder, reason)
        self._bus.publish(SessionEnded(self._options.name, session.holder, reason))
        self._settle(now)
        self._changed()

    def _release_doors(self) -> None:
        for side in self._able.doors:
            self._driver.let_go(self._hold_door(side))

    def _alarm(self, text: str) -> None:
        _log.warning("%s: %s", self._options.name, text)
        self._bus.publish(Alarm(self._options.name, text))

    @staticmethod
    def _hold_door(side: Side) -> Command:
        return Command(CommandKind.HOLD_DOOR, side=side)


def _now() -> float:
    return asyncio.get_running_loop().time()
