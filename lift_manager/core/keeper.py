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
from lift_manager.core.emergency import Emergency
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.core.people import PeopleFirst
from lift_manager.core.robot_mode import RobotMode
from lift_manager.core.serving import Serving
from lift_manager.core.session_memory import SessionMemory
from lift_manager.core.tenure import Tenure
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused
from lift_manager.domain.events import Event
from lift_manager.domain.service import STOPPING_TEXT, Acknowledged, Advice, EndReason, ForceReleased, Lockout, advise
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, moving
from lift_manager.domain.state import Holder, Restrictions
from register_maps.vocabulary import CALLS

_STOPPING = Refused(Refusal.STOPPING, "the manager is stopping")


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
        self._serving = Serving(driver, options, self._button, self._handshake, self._say, used=self._used)
        self._tenure = Tenure(options, self._say, arrive_within_s=self._able.arrive_within_s)
        self._emergency = Emergency(options, people, self._say)
        self._memory = SessionMemory(options, people)
        self._begun = self._stopping = False
        self._permit: Permit = lambda: "there is no session"
        self._sessions_opened = 0
        self._used_by = 0
        """The newest session for which anything was pressed or held."""
        self._robot_mode = RobotMode(driver)
        if (occupied := people.remembered.occupied) is not None:
            self._handshake.take_up(occupied.holder, aboard=occupied.aboard)
        if people.remembered.left_untold is not None:
            self._handshake.owe_left()

    @property
    def busy(self) -> bool:
        """Whether every reading matters, changed or not."""
        return self.session is not None or self._robot_mode.kept or self._handshake.untold

    @property
    def arrived(self) -> bool:
        """Whether the session's call is fulfilled."""
        return self._serving.call.arrived

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
        return self.session is not None and self._serving.door_held(self.session)

    def restrictions(self, trouble: str) -> Restrictions:
        """Return what keeps robots off, and what the session waits for; `trouble` is why nothing may be pressed."""
        if self.session is None:
            return self.people.restrictions("")
        stuck = "" if self._serving.call.pressed else trouble
        resting = self.people.resting_text if self.people.resting(_now()) else ""
        return self.people.restrictions(stuck or resting or self._serving.awaits or self._handshake.awaits)

    def begin(self) -> None:
        """Take up the session of before this start, if there is one. To be called before the lift is read for the first time.

        Nothing is pressed by it: what is found on is kept on, and what is found off waits until the holder asks again, for
        somebody may have let go of it meanwhile, and a holder that still needs it is heard within seconds.
        """
        if self._begun or self._stopping:
            return
        self._begun = True
        kept, now, number = self._memory.kept, _now(), self._sessions_opened + 1
        taken_up = self._memory.take_up(kept, number, now) if kept is not None else None
        if kept is None or not isinstance(taken_up, Session):
            until = self._memory.robot_mode_until(now, self._able.arrive_within_s)
            self._robot_mode.adopt_rest(self._admission.why_no_robot_mode, until)
            self._note(now)
            if kept is not None and isinstance(taken_up, tuple):
                self._say.doubt(kept.holder, *taken_up, self._handshake.occupied_by(None))
                self._say.ended(kept.holder, *taken_up, self._advice())
            return
        self.session = taken_up
        self._sessions_opened = self._used_by = number
        self._permit = self._admission.permit(number, lambda: self.session)
        self._serving.restore(taken_up, kept, self._permit, now)
        self._robot_mode.adopt(self._admission.why_no_press)
        self._say.restored(taken_up, pressed=kept.pressed)
        self._note(now)

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
        """Refuse everything from now on, and let the session rest until the next start."""
        self._note(_now())
        self._stopping = True
        self._end_session(EndReason.STOPPING, STOPPING_TEXT, _now())
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

    def force_release(self, by: str, reason: str) -> ForceReleased | Refused:
        """End the session at a person's word. Whatever may be in the car stays there, and so does what is known of it."""
        now = _now()
        if isinstance(held := self._held_by(None, now), Refused):
            return held
        self._end_session(EndReason.FORCED, f"released by {by}: {reason}", now)
        in_car = self._handshake.occupied_by(None) is not None
        released = ForceReleased(by, self.people.clock(), reason, held.holder, in_car)
        self._say.released(released)
        self.act(now)
        self._changed()
        return released

    def hand_over(self, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session to another caller at its holder's word, with what is known of the robot; nothing else changes."""
        now = _now()
        if isinstance(held := self._held_by(holder, now), Refused):
            return held
        self.session = sessions.handed_over(held, to, now)
        if to != holder:
            self._say.handed_over(holder, to)
        self.act(now)
        self._changed()
        return Accepted()

    def _held_by(self, holder: Holder | None, now: float) -> Session | Refused:
        if self._stopping:
            return _STOPPING
        return self._tenure.held_by(self.session, holder, now, in_car=self._handshake.occupied_by(None))

    def acknowledge(self, by: str, *, offline: str) -> Acknowledged | Refused:
        """Take it that a person has checked the lift. `offline` says why, should it be offline."""
        too_early = self._admission.too_early(offline=offline, letting_go=self._emergency.release_at is not None)
        if too_early is not None:
            return too_early
        held = self.session.holder if self.session is not None else None
        left = self._handshake.to_see_to(self.session, fire=self.people.fire_latched)
        answer = self.people.acknowledge(by, occupied=left is not None, held=held)
        if left is not None and isinstance(answer, Acknowledged):
            left(_now())
            self.act(_now())
        self._changed()
        return answer

    def _decide(self, ask: Ask, now: float, *, is_release: bool, offline: str) -> Session | Accepted | Refused:
        if self._stopping:
            return _STOPPING
        if (unknown := self._admission.unknown_floor(ask.floor)) is not None:
            return unknown
        if self.session is not None and self.session.holder == ask.holder:
            self.session = replace(self.session, heard_at=now)
        elif self.session is not None and ask.hold_door and not is_release:
            refusal = self._admission.refusal(offline=offline, goes_on=False)
            over = self._tenure.contest(self.session, ask, now, self._handshake, refusal)
            if isinstance(over, Refused):
                return over
            if over is not None:
                self._end_session(*over, now)
        session = self.session
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
            self._permit = self._admission.permit(session.number, lambda: self.session)
            self._say.opened(session)
        self._serving.wants(session, now)
        self._note(now)
        self.act(now)
        self._changed()

    def _why_no_word(self) -> str | None:
        """Return why the lift may not be told that a robot left; that the session is over is no reason."""
        return "the manager is stopping" if self._stopping else self._admission.why_no_press()

    def act(self, now: float) -> None:
        """Bring wishes and sight together. Called after every reading, request and outcome."""
        sight, last = self._sight(now), self._last_sight()
        if last is not None:
            # letting go needs no fresh reading: a poll may take longer than a reading counts
            self._obey_mode(last, now)
        if self._emergency.release_at is not None:
            if now >= self._emergency.release_at:
                self._robot_mode.drop()
                self._handshake.let_go()
                self._emergency.release_at = None
                self._end_session(EndReason.FIRE, "there is a fire", now)
            return
        self._expire(sight, now)
        if self._robot_mode.kept:
            # a lift that is still in robot mode is none for people
            self.people.session_ended(now)
        if self.session is None or self.people.resting(now):
            self._rest(sight, now)
        elif sight is not None:
            if self._robot_mode.known:
                self._used()
            may_begin = not self.session.restored
            self._robot_mode.hold(self._admission.why_no_press, begin=may_begin)
            self._handshake.act(self._permit, now, begin=may_begin)
            served = self._serving.advance(self.session, sight, self._permit, now)
            if isinstance(served, Session):
                self.session = served
            else:
                self._end_session(*served, now)
        self._note(now)

    def _note(self, now: float, *, pressed: bool = False) -> None:
        """Write down what a restart must know. An orderly end writes down nothing more: the session rests until then."""
        self._memory.note_rest(self._handshake, self.session)
        if self._begun and not self._stopping:
            self._memory.note_mode(self._robot_mode.kept_until, now)
            pressed = pressed or self._serving.call.pressed
            self._memory.note(self.session, self._handshake.kept(), pressed=pressed, now=now)

    def _rest(self, sight: Sight | None, now: float) -> None:
        """Finish what the last session left to do. A session that waits for people to have their turn loses no time by it."""
        if sight is not None:
            self._handshake.seen(sight, None, now)
        self._handshake.act(None, now)
        self._settle(now)
        if self.session is not None:
            self.session = replace(self.session, lease_from=now)
        self._serving.call.wait(now)

    def _obey_mode(self, sight: Sight, now: float) -> None:
        holder = self.session.holder if self.session is not None else None
        if (why := self._emergency.seen(sight, holder, self._advice, now)) is not None:
            self._handshake.let_go()
            self._end_session(EndReason.MODE, why, now)

    def _expire(self, sight: Sight | None, now: float) -> None:
        if (session := self.session) is not None:
            rides = (sight is None or moving(sight)) and self._handshake.occupied_by(session) is not None
            if (over := self._tenure.expired(session, now, rides=rides)) is not None:
                self._end_session(*over, now)

    def _advice(self) -> Advice:
        """Return what the session's robot does best."""
        sight = self._sight(_now())
        may_be_aboard = self._handshake.occupied_by(self.session) is not None
        return advise(sight.values.doors if sight is not None else None, may_be_aboard=may_be_aboard)

    def _press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        if command.kind is not CommandKind.ROBOT_LEFT:
            self._used()
        # what is pressed was pressed if a restart comes between: its row, and with it the press, waits for this
        self._note(_now(), pressed=command.kind in CALLS)
        future = self._driver.press(command, permit)
        future.add_done_callback(self._ended)
        return future

    def _used(self, session: Session | None = None) -> None:
        """Something is pressed or held for the session, which is then like this."""
        if session is not None:
            self.session = session
            self._note(_now())
        if self.session is not None:
            self._used_by = self.session.number

    def _ended(self, future: asyncio.Future[Outcome]) -> None:
        if future.cancelled():
            return
        outcome, now = future.result(), _now()
        self._say.outcome(outcome, self.session.holder if self.session is not None else None)
        self._serving.call.ended(future, outcome, now)
        if (text := self._handshake.ended(future, outcome, now)) is not None:
            self._say.alarm(text)
        self.act(now)
        self._changed()

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
            self._note(now)
        self._end_session(EndReason.RELEASED, "released", now, release=ask)

    def _end_session(self, reason: EndReason, text: str, now: float, *, release: Ask | None = None) -> None:
        session = self.session
        if session is None:
            return
        holder, advice = session.holder, self._advice()
        self.session = self._emergency.release_at = None
        self._serving.end()
        self._handshake.end(session, release, now, arrived=reason is EndReason.ARRIVED)
        self._note(now)
        self._say.doubt(holder, reason, text, self._handshake.occupied_by(None))
        used = session.number == self._used_by
        if used:
            self.people.session_ended(now)
        if self.people.fire_latched or self._stopping:
            self._robot_mode.drop()
        elif used:
            self._robot_mode.session_ended(now)
        self._say.ended(holder, reason, text, advice)
        self._settle(now)
        self._note(now)
        self._changed()


def _now() -> float:
    return asyncio.get_running_loop().time()
