"""Keeps the session of one lift: who commands it, and what is pressed, held and let go for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

from drivers.driver import LiftDriver, Permit
from drivers.model import Command, CommandKind, FloorName, Outcome
from lift_manager.core.admission import Admission
from lift_manager.core.announce import Announcer
from lift_manager.core.bus import Bus
from lift_manager.core.calling import CallButton
from lift_manager.core.doors import DoorHolds
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.core.people import PeopleFirst
from lift_manager.core.robot_mode import RobotMode
from lift_manager.core.session_call import SessionCall
from lift_manager.domain import call as calls
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.events import Event
from lift_manager.domain.service import Acknowledged, Advice, EndReason, Lockout, advise
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, barred, on_fire
from lift_manager.domain.state import Restrictions
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode


class SessionKeeper:
    """At most one session, its call and its holds. Nothing here waits."""

    def __init__(
        self,
        driver: LiftDriver,
        options: LiftOptions,
        bus: Bus[Event],
        people: PeopleFirst,
        *,
        sight: Callable[[float], Sight | None],
        last_sight: Callable[[], Sight | None],
        changed: Callable[[], None],
    ) -> None:
        """`sight` gives what is known at a time unless it is too old by then, `last_sight` however old it is.

        `changed` hears when there is news to publish.
        """
        self.session: Session | None = None
        self.people = people
        self._options = options
        self._driver = driver
        self._able = driver.capabilities
        self._say = Announcer(options.name, bus)
        self._sight = sight
        self._last_sight = last_sight
        self._changed = changed
        self._admission = Admission(options, self._able, people, lambda: sight(_now()))
        self._button = CallButton(driver, options, self._press)
        self._handshake = Handshake(driver, options, self._button, self._press, permit=self._why_no_word)
        self._call = SessionCall(options.name, self._able, self._button)
        self._permit: Permit = lambda: "there is no session"
        self._sessions_opened = 0
        self._used_by = 0
        """The newest session for which anything was pressed or held."""
        self._doors = DoorHolds(driver, options)
        self._robot_mode = RobotMode(driver)
        self._fire_release_at: float | None = None
        """The robot has been told of the fire; then everything is let go."""
        self._awaits = ""
        """What the lift has not granted yet."""
        self._stopping = False
        if (occupied := people.remembered.occupied) is not None:
            self._handshake.take_up(occupied.holder, aboard=occupied.aboard)

    @property
    def busy(self) -> bool:
        """Whether every reading matters, changed or not."""
        return self.session is not None or self._robot_mode.kept or self._handshake.reporting

    @property
    def arrived(self) -> bool:
        """Whether the session's call is fulfilled."""
        return self._call.arrived

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
        return self.session is not None and self._doors.held(self.session.floor)

    @property
    def restrictions(self) -> Restrictions:
        """What keeps robots off, and what the session waits for."""
        resting = self.session is not None and self.people.resting(_now())
        return self.people.restrictions(self.people.resting_text if resting else self._awaits)

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

    def tell(self, text: str) -> None:
        """Tell people, and whoever holds the lift, of something that the driver has noticed."""
        self._say.alarm(text, self.session.holder if self.session is not None else None)

    def stop(self) -> None:
        """Refuse everything from now on, and end the session."""
        self._stopping = True
        self._end_session(EndReason.STOPPING, "the manager is stopping", _now())
        self._robot_mode.drop()

    def lock_out(self, by: str, reason: str) -> Lockout | Refused:
        """Keep robots off until a person says otherwise, and let everything go at once."""
        answer = self.people.lock_out(by, reason)
        if isinstance(answer, Lockout):
            now = _now()
            self._end_session(EndReason.LOCKOUT, f"locked out by {by}: {reason}", now)
            self._handshake.let_go()
            self.act(now)
            self._changed()
        return answer

    def acknowledge(self, by: str, *, offline: str) -> Acknowledged | Refused:
        """Take it that a person has checked the lift. `offline` says why, should it be offline."""
        too_early = self._admission.too_early(offline=offline, letting_go=self._fire_release_at is not None)
        if too_early is not None:
            return too_early
        left = self.session is None and self._handshake.occupied_by(None) is not None
        answer = self.people.acknowledge(by, occupied=left)
        if left and isinstance(answer, Acknowledged):
            self._handshake.found_empty(_now())
            self.act(_now())
        self._changed()
        return answer

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
        occupied = self._handshake.occupied_by(session)
        goes_on = session is not None or (occupied is not None and occupied[0] == ask.holder)
        if mine and (refused := self._admission.refusal(offline=offline, goes_on=goes_on)) is not None:
            return refused
        return sessions.admit(session, ask, number=self._sessions_opened + 1, now=now)

    def _take(self, session: Session, now: float) -> None:
        before = self.session
        self.session = session
        if before is None:
            self._sessions_opened = session.number
            self._permit = self._make_permit(session.number)
            self._say.opened(session)
        moves_on = self._call.elsewhere(session.floor)
        if moves_on and self._handshake.ready:
            self._button.let_go()
        holds_door = self._button.holds_door(session.floor, aboard=self._handshake.aboard is True)
        if moves_on or not (session.hold_spent and holds_door):
            self._call.want(session.floor, now)
        self.act(now)
        self._changed()

    def _make_permit(self, number: int) -> Permit:
        """Return the check that the link makes immediately before the bytes of a press leave."""

        def permit() -> str | None:
            if self.session is None or self.session.number != number:
                return "the session has ended"
            return self._admission.why_no_press()

        return permit

    def _why_no_word(self) -> str | None:
        """Return why the lift may not be told that a robot left; that the session is over is no reason."""
        return "the manager is stopping" if self._stopping else self._admission.why_no_press()

    def act(self, now: float) -> None:
        """Bring wishes and sight together. Called after every reading, request and outcome."""
        sight, last = self._sight(now), self._last_sight()
        if last is not None:
            # letting go needs no fresh reading: a poll may take longer than a reading counts
            self._obey_mode(last, now)
        if self._fire_release_at is not None:
            if now >= self._fire_release_at:
                self._end_in_fire(now)
            return
        session = self.session
        if session is not None and now >= sessions.lease_ends_at(session, self._options.lease_s):
            self._end_session(EndReason.LEASE, f"the lease of {self._options.lease_s:g} s ran out", now)
        if self._robot_mode.kept:
            # a lift that is still in robot mode is none for people
            self.people.session_ended(now)
        if self.session is None or self.people.resting(now):
            self._rest(sight, now)
        elif sight is not None:
            if self._robot_mode.known:
                self._used_by = self.session.number
            self._robot_mode.hold(self._admission.why_no_press)
            self._handshake.act(self._permit, now)
            self._serve(sight, now)
        self.people.note_occupied(self._handshake.occupied_by(self.session))

    def _rest(self, sight: Sight | None, now: float) -> None:
        """Finish what the last session left to do. A session that waits for people to have their turn loses no time by it."""
        if sight is not None:
            self._handshake.seen(sight, None, now)
        self._handshake.act(None, now)
        self._settle(now)
        if self.session is not None:
            self.session = replace(self.session, lease_from=now)
        self._call.wait(now)

    def _obey_mode(self, sight: Sight, now: float) -> None:
        mode, session = sight.values.mode, self.session
        if on_fire(sight.values) and not self.people.fire_latched:
            self.people.latch_fire()
            self._fire_release_at = now
            if session is not None and mode is Mode.FIRE:
                self._fire_release_at += self._options.fire_release_delay_s
            self._say.fire(session.holder if session is not None else None, self._advice())
        if mode in ROBOT_FORBIDDEN_MODES and mode is not Mode.UNKNOWN:
            if self._fire_release_at is None:
                self._handshake.let_go()
                self._end_session(EndReason.MODE, f"the mode is {mode}", now)
            elif mode is not Mode.FIRE:
                self._fire_release_at = now

    def _end_in_fire(self, now: float) -> None:
        self._fire_release_at = None
        self._robot_mode.drop()
        self._handshake.let_go()
        self._end_session(EndReason.FIRE, "there is a fire", now)

    def _advice(self) -> Advice:
        """Return what the session's robot does best."""
        sight = self._sight(_now())
        may_be_aboard = self._handshake.occupied_by(self.session) is not None
        return advise(sight.values.doors if sight is not None else None, may_be_aboard=may_be_aboard)

    def _serve(self, sight: Sight, now: float) -> None:
        """Advance the session that holds the lift."""
        session, call = self.session, self._call.now
        if session is None or call is None:
            return
        self._awaits = ""
        call = self._call.seen(call, sight, now)
        self._handshake.seen(sight, session, now)
        command = self._handshake.next_command(call.floor)
        missing = calls.missing(sight, self._able, command) if call.phase is CallPhase.WANTED else None
        if missing:
            self._doors.let_go()
            self._await_grant(session, call, f"{', '.join(sorted(missing))} for {command}", now)
            return
        if call.phase is CallPhase.WANTED and not self._handshake.ready:
            self._await_word(session, sight, now)
        elif calls.may_press(call, sight, self._able, now):
            self._doors.let_go()
            self._call.press(call, self._permit, aboard=self._handshake.aboard is True, now=now)
        elif call.phase is CallPhase.ARRIVED:
            self._button.let_go_at("arrived")
            self._stay(session, sight, now)
        else:
            self._doors.let_go()
            if call.phase is CallPhase.FAILED and self._button.until:
                self._button.let_go()

    def _await_word(self, session: Session, sight: Sight, now: float) -> None:
        """Stay open for a robot aboard until the lift has been told of it; a robot on its way out needs nothing more."""
        if self._handshake.aboard and sight.floor is not None and sight.standing:
            self._hold_open(session, sight, sight.floor, now)
        else:
            self._doors.let_go()

    def _await_grant(self, session: Session, call: Call, what: str, now: float) -> None:
        """Let the lease stand still while the lift has not granted what is needed, such as robot mode, but not for ever."""
        self.session = replace(session, lease_from=now)
        self._awaits = f"{what}, which the lift has not granted yet"
        if now - call.since > self._able.granted_within_s:
            text = f"{what} was not granted within {self._able.granted_within_s:g} s"
            self._end_session(EndReason.NOT_GRANTED, text, now)

    def _press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        if self.session is not None and command.kind is not CommandKind.ROBOT_LEFT:
            self._used_by = self.session.number
        future = self._driver.press(command, permit)
        future.add_done_callback(self._ended)
        return future

    def _ended(self, future: asyncio.Future[Outcome]) -> None:
        if future.cancelled():
            return
        outcome, now = future.result(), _now()
        self._say.outcome(outcome)
        self._call.ended(future, outcome, now)
        if (text := self._handshake.ended(future, outcome, now)) is not None:
            self._say.alarm(text)
        self.act(now)
        self._changed()

    def _stay(self, session: Session, sight: Sight, now: float) -> None:
        """Hold the door at the session's floor, or end a session that wanted no more than to get there.

        A robot aboard keeps its session: it has still to get out.
        """
        if not session.hold_door and self._handshake.aboard is not True:
            self._end_session(EndReason.ARRIVED, "arrived", now)
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
            self._say.hold_spent(session.holder, self._options.max_session_hold_s)
        if session.hold_spent or barred(sight.values, self._able) is not None:
            self._doors.let_go()
            self._button.let_go_of_door()
        else:
            self._used_by = session.number
            self._button.keep_on(self._permit)
            self._doors.hold(floor, self._permit)
            session = replace(session, holding_since=now if session.holding_since is None else session.holding_since)
        self.session = session

    def _settle(self, now: float) -> None:
        """Drop robot mode after a session, once the car stands still."""
        sight, last = self._sight(now), self._last_sight()
        # a lift that cannot be read may be told later; one that may not be told at all is not waited for
        reporting = self._handshake.reporting and (sight is None or self._why_no_word() is None)
        text = self._robot_mode.settle(sight, last, self._admission.why_no_robot_mode, reporting=reporting, now=now)
        if text is not None:
            self._say.alarm(text)

    def _release(self, ask: Ask, now: float) -> None:
        """End the session at its holder's word."""
        if self.session is None:
            self._handshake.end_again(ask, now)
            self.people.note_occupied(self._handshake.occupied_by(None))
        self._end_session(EndReason.RELEASED, "released", now, release=ask)

    def _end_session(self, reason: EndReason, text: str, now: float, *, release: Ask | None = None) -> None:
        session = self.session
        if session is None:
            return
        holder, advice = session.holder, self._advice()
        self.session = self._fire_release_at = None
        self._call.forget()
        self._awaits = ""
        self._doors.let_go()
        abandoned = self._handshake.end(session, release, now, arrived=reason is EndReason.ARRIVED)
        in_car = self._handshake.occupied_by(None)
        self.people.note_occupied(in_car)
        self._say.doubt(holder, reason, text, abandoned=abandoned, in_car=in_car is not None)
        used = session.number == self._used_by
        if used:
            self.people.session_ended(now)
        if self.people.fire_latched or self._stopping:
            self._robot_mode.drop()
        elif used:
            self._robot_mode.session_ended(now)
        self._say.ended(holder, reason, text, advice)
        self._settle(now)
        self._changed()


def _now() -> float:
    return asyncio.get_running_loop().time()
