"""Keeps the session of one lift: who commands it, and what is pressed, held and let go for them."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

from drivers.model import Command, CommandKind, FloorName, Outcome, Result
from lift_manager.core.admission import Admission
from lift_manager.core.announce import Announcer
from lift_manager.core.around import Around
from lift_manager.core.calling import CallButton
from lift_manager.core.countdown import Countdown
from lift_manager.core.emergency import Emergency
from lift_manager.core.ending import before_the_end, last_word
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.core.outputs import LiftOutputs, Permit
from lift_manager.core.people import PeopleFirst
from lift_manager.core.robot_mode import RobotMode
from lift_manager.core.serving import Serving
from lift_manager.core.session_book import SessionBook
from lift_manager.core.session_info import Facts, ended_info, info_of
from lift_manager.core.session_memory import SessionMemory
from lift_manager.core.tenure import Tenure
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Ask, Refusal, Refused
from lift_manager.domain.boarding import Who
from lift_manager.domain.contradictions import Commanded
from lift_manager.domain.events import Event
from lift_manager.domain.service import ITS_OWN_WORD, STOPPING_TEXT, Advice, EndReason, advise
from lift_manager.domain.session import KeptSession, Session
from lift_manager.domain.session_requests import SessionInfo, SessionOver
from lift_manager.domain.sight import Sight, disbelieved, moving
from lift_manager.domain.state import Holder, Restrictions
from lift_manager.runtime.bus import Bus
from register_maps.vocabulary import CALLS
from register_maps.words import Door

STOPPING = Refused(Refusal.STOPPING, "the manager is stopping")


class SessionKeeper:
    """At most one session, its call and its holds. Nothing here waits."""

    def __init__(
        self,
        outputs: LiftOutputs,
        options: LiftOptions,
        bus: Bus[Event],
        people: PeopleFirst,
        around: Around,
    ) -> None:
        self.session: Session | None = None
        self.people = people
        self._options = options
        self._outputs = outputs
        self._able = outputs.capabilities
        self.say = Announcer(options.name, bus, control=options.control)
        self.sight = around.sight
        self.changed = around.changed
        self._last_sight = around.last_sight
        self._trouble = around.trouble
        self.admission = Admission(options, self._able, people, lambda: around.sight(_now()))
        self._button = CallButton(outputs, options, self._press)
        self.handshake = Handshake(outputs, options, self._button, self._press, permit=self._why_no_word)
        self.serving = Serving(
            outputs, options, self._button, self.handshake, self.say, press=self._press, used=self._used
        )
        self.tenure = Tenure(options, self.say, arrive_within_s=self._able.arrive_within_s)
        self.book = SessionBook(options.name, self.say, people.clock)
        self._emergency = Emergency(options, people, self.say)
        self._memory = SessionMemory(options, people)
        self.stopping = False
        self._begun = False
        self._permit: Permit = lambda: "there is no session"
        self.opened = 0
        self._used_by = 0
        """The newest session for which anything was pressed or held."""
        self._robot_mode = RobotMode(outputs)
        self._countdown = Countdown(self._count_down)
        self._released_open = False
        """A session has ended with its door open, and the door has not been seen to close since."""
        if (occupied := people.remembered.occupied) is not None:
            self.handshake.take_up(occupied.holder, aboard=occupied.aboard)
        if people.remembered.left_untold is not None:
            self.handshake.owe_left()

    @property
    def busy(self) -> bool:
        """Whether every reading matters, changed or not."""
        return self.session is not None or self._robot_mode.kept or self.handshake.untold

    @property
    def arrived(self) -> bool:
        """Whether the session's call is fulfilled."""
        return self.serving.call.arrived

    @property
    def aboard(self) -> bool | None:
        """Whether the session's robot is in the car; None where nobody knows."""
        return self.handshake.aboard if self.session is not None else None

    @property
    def stood_open_at(self) -> FloorName | None:
        """The session's floor, once the door has stood open there."""
        return self.session.floor if self.session is not None and self.session.stood_open else None

    @property
    def door_held(self) -> bool:
        """Whether our hold of every door at the session's floor is on and verified, where the map has one."""
        return self.session is not None and self.serving.door_held(self.session, self._last_sight())

    @property
    def releases_at(self) -> float | None:
        """When the door is released by the manager itself, as far as it knows; None without a session."""
        session = self.session
        return None if session is None else sessions.releases_at(session, self._options.limits(session.holder))

    @property
    def invites_until(self) -> float:
        """From when on an open door invites nobody, because it is released soon."""
        session = self.session
        if session is None:
            return -math.inf if self._released_open else math.inf
        return -math.inf if self.stopping else sessions.invites_until(session, self._options.limits(session.holder))

    @property
    def may_be_crossed(self) -> bool:
        """Whether a robot may be on its way through the door that is held for the session, or about to be.

        A hold whose refresh was not answered no longer counts as held, and one that a restart found on may be at a floor that is not
        known yet: a robot may be in its door all the same.
        """
        return (self.arrived or self.serving.keeps_found_hold) and self.serving.door_given

    @property
    def letting_go(self) -> bool:
        """Whether there is a fire in which not everything is let go yet."""
        return self._emergency.release_at is not None

    @property
    def waits(self) -> str:
        """What the session waits for before anything is pressed; empty when it does not."""
        if self.session is None:
            return ""
        trouble = "" if self.serving.call.pressed else self._trouble()
        stuck = f"the disk: {trouble}" if trouble else ""
        resting = self.people.resting_text if self.people.resting(_now()) else ""
        sight = self._last_sight()
        doubt = disbelieved(sight, self.session.floor) if sight is not None else ""
        return stuck or resting or self.serving.awaits or self.handshake.awaits or doubt

    @property
    def commanded(self) -> Commanded:
        """What of the session is on the lift."""
        pressed = self.serving.call.pressed or self.serving.doors.given
        return Commanded(self.serving.call.now, pressed=pressed, stood_open=self.stood_open_at is not None)

    def restrictions(self) -> Restrictions:
        """Return what keeps robots off, and what the session waits for."""
        return self.people.restrictions(self.waits)

    def info(self, session: Session, now: float) -> SessionInfo:
        """Return the session that goes on as its holder sees it."""
        kept_open = self.serving.keeps_open(session, self._last_sight())
        facts = Facts(self.book.opened_at, self.arrived, kept_open, self.handshake.who, self.waits)
        return info_of(session, self._options, facts, now)

    def begin(self) -> None:
        """Take up the session of before this start, if there is one. To be called before the lift is read for the first time.

        Nothing is pressed by it: what is found on is kept on, and what is found off waits until the holder asks again, for
        somebody may have let go of it meanwhile, and a holder that still needs it is heard within seconds.
        """
        if self._begun or self.stopping:
            return
        self._begun = True
        kept, now, number = self._memory.kept, _now(), self.opened + 1
        taken_up = self._memory.take_up(kept, number, now) if kept is not None else None
        if kept is None or not isinstance(taken_up, Session):
            until = self._memory.robot_mode_until(now, self._able.arrive_within_s)
            self._robot_mode.adopt_rest(self.admission.why_no_robot_mode, until)
            self.note(now)
            if kept is not None and isinstance(taken_up, tuple):
                self._restored_over(kept, *taken_up, now)
                self.say.doubt(kept.holder, *taken_up, self.handshake.occupied_by(None))
                self.say.ended(kept.holder, *taken_up, self._advice())
            return
        if self.people.remembered.trust.map_hash != self._able.map_hash:
            # with another map an open door has shown nothing
            taken_up = replace(taken_up, stood_open=False)
        self.session = taken_up
        self.book.begun(taken_up, kept.opened_at)
        self.opened = self._used_by = number
        self._permit = self.admission.permit(number, lambda: self.session)
        self.serving.restore(taken_up, kept, self._permit, now)
        self._robot_mode.adopt(self.admission.why_no_press)
        self.say.restored(taken_up, pressed=kept.pressed)
        self.note(now)

    def tell(self, text: str) -> None:
        """Tell people, and whoever holds the lift, of something that the driver has noticed."""
        self.say.alarm(text, self.session.holder if self.session is not None else None)

    @property
    def clearing(self) -> bool:
        """Whether the door of a session that is `closing` is held for a robot in it; not on a lift that cannot be read."""
        now, session = _now(), self.session
        closing = session is not None and session.closing is not None
        return closing and now < (self.releases_at or now) and self.sight(now) is not None

    def announce_stop(self, clear_s: float) -> None:
        """Refuse everything from now on, and withdraw OPEN; a door that a robot may be in is held for `clear_s` more."""
        now, session = _now(), self.session
        self.note(now)
        self.stopping = True
        if session is None:
            return
        if session.closing is not None and session.over_at is not None:
            # a person has ended it: the process does not live as long as its robot was given
            left_s = min(clear_s, session.over_at - now) if self.may_be_crossed else 0.0
            self._close_soon(session, *session.closing, left_s, now)
        elif self.may_be_crossed and not session.ending:
            self._close_soon(session, EndReason.STOPPING, STOPPING_TEXT, clear_s, now)

    def stop(self) -> None:
        """Refuse everything from now on, and let the session rest until the next start."""
        if not self.stopping:
            self.note(_now())
            self.stopping = True
        if self.session is not None and self.session.ending and self.session.closing is None:
            self.end(EndReason.RELEASED, "released", _now())
        self.end(EndReason.STOPPING, STOPPING_TEXT, _now())
        self._robot_mode.drop()

    def _restored_over(self, kept: KeptSession, reason: EndReason, text: str, now: float) -> None:
        """Remember a session from before a restart that is over by now: its holder may ask what became of it."""
        session = sessions.restored(kept, number=self.opened, at=self.people.clock(), now=now)
        self.book.begun(session, kept.opened_at)
        self._book_over(
            session, self.info(session, now), SessionOver(reason, text, self._advice(), self.people.clock())
        )

    def take(self, session: Session, now: float, *, anew: bool = True) -> None:
        """Go on with a session that was admitted; `anew` where its call is wanted, or wanted again."""
        before = self.session
        again = anew and session.hold_door and session.hold_spent
        self.session = session = (
            sessions.hold_again(session, self._options.between_sessions_s, now) if again else session
        )
        if before is None:
            self.opened = session.number
            self._permit = self.admission.permit(session.number, lambda: self.session)
            self.book.begun(session, self.people.clock())
            self.say.opened(session)
        if anew:
            self.serving.wants(session, now, holds_again=again and not session.hold_spent)
        self.note(now)
        self.act(now)
        self.changed()

    def _why_no_word(self) -> str | None:
        """Return why the lift may not be told that a robot left; that the session is over is no reason."""
        return "the manager is stopping" if self.stopping else self.admission.why_no_press()

    def act(self, now: float) -> None:
        """Bring wishes and sight together. Called after every reading, request and outcome."""
        self._act(now)
        self.look(now)
        if (releases_at := self.releases_at) is not None:
            self._countdown.set(self.invites_until, releases_at)

    def _count_down(self) -> None:
        self.act(_now())
        self.changed()

    def look(self, now: float) -> None:
        """See what has become of the requests within the session."""
        if self.session is not None and self.book.waiting:
            self.book.look(self.serving.view(self.session, self._last_sight(), self.waits, now), now)

    def _act(self, now: float) -> None:
        self._end_what_is_over(now)
        sight, last = self.sight(now), self._last_sight()
        if last is not None:
            # letting go needs no fresh reading: a poll may take longer than a reading counts
            self._obey_mode(last, now)
        if self._emergency.release_at is not None:
            if now >= self._emergency.release_at:
                self._robot_mode.drop()
                self.handshake.let_go()
                self._emergency.release_at = None
                self.end(EndReason.FIRE, "there is a fire", now)
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
            may_begin = self.session.may_begin
            closing = self.session.closing is not None
            permit = self.admission.why_no_robot_mode if closing else self.admission.why_no_press
            self._robot_mode.hold(permit, begin=may_begin)
            if closing:
                self._robot_mode.stay()
            self.handshake.act(self._permit, now, begin=may_begin)
            served = self.serving.advance(self.session, sight, self._permit, now)
            if isinstance(served, Session):
                self.session = served
                self.serving.close(self._permit_to_close, now)
            else:
                self.end(*served, now)
        else:
            self.session = self.serving.unread(self.session, now)
        self.note(now)

    def _end_what_is_over(self, now: float) -> None:
        """End a session that was announced to end, and distrust an open door no longer once it was seen to close."""
        if (session := self.session) is not None and session.over_at is not None and now >= session.over_at:
            self._end_now(*(session.closing or (EndReason.RELEASED, "released")), now)
        if (sight := self.sight(now)) is not None and Door.OPEN not in sight.values.doors.values():
            self._released_open = False

    def note(self, now: float, *, pressed: bool = False) -> None:
        """Write down what a restart must know. An orderly end writes down nothing more: the session rests until then."""
        session, word = self.session, last_word(self.session, self._options)
        self._memory.note_rest(self.handshake.left_behind(session, word))
        if self._begun and not self.stopping:
            ends_at = None if session is None else session.over_at
            mode_until = self._robot_mode.kept_until if ends_at is None else self._robot_mode.kept_after(ends_at)
            self._memory.note_mode(mode_until, now)
            pressed = pressed or self.serving.call.pressed
            self._memory.note(self.session, self.handshake.kept(), pressed=pressed, now=now)

    def _rest(self, sight: Sight | None, now: float) -> None:
        """Finish what the last session left to do. A session that waits for people to have their turn loses no time by it."""
        if sight is not None:
            self.handshake.seen(sight, None, now)
        self.handshake.act(None, now)
        self._settle(now)
        if self.session is not None:
            self.session = replace(self.session, lease_from=now)
        self.serving.call.wait(now)

    def _permit_to_close(self) -> str | None:
        return self._permit() or self.serving.why_no_close(self.session, self.sight(_now()))

    def _obey_mode(self, sight: Sight, now: float) -> None:
        holder = self.session.holder if self.session is not None else None
        if (why := self._emergency.seen(sight, holder, self._advice, now)) is not None:
            self.handshake.let_go()
            self.end(EndReason.MODE, why, now)

    def _expire(self, sight: Sight | None, now: float) -> None:
        if (session := self.session) is not None:
            rides = (sight is None or moving(sight)) and self.handshake.occupied_by(session) is not None
            if (over := self.tenure.expired(session, now, rides=rides)) is not None:
                self.end(*over, now)

    def _advice(self) -> Advice:
        """Return what the session's robot does best."""
        sight = self.sight(_now())
        may_be_aboard = self.handshake.occupied_by(self.session) is not None
        return advise(sight.doors if sight is not None else None, may_be_aboard=may_be_aboard)

    def _press(self, command: Command, permit: Permit) -> asyncio.Future[Outcome]:
        if command.kind is not CommandKind.ROBOT_LEFT:
            self._used()
        # what is pressed was pressed if a restart comes between: its row, and with it the press, waits for this
        self.note(_now(), pressed=command.kind in CALLS)
        future = self._outputs.press(command, permit, before_the_end(command.kind, lambda: self.session))
        future.add_done_callback(self._ended)
        return future

    def _used(self, session: Session | None = None) -> None:
        """Something is pressed or held for the session, which is then like this."""
        if session is not None:
            self.session = session
            self.note(_now())
        if self.session is not None:
            self._used_by = self.session.number

    def _ended(self, future: asyncio.Future[Outcome]) -> None:
        if future.cancelled():
            return
        outcome, now = future.result(), _now()
        self.say.outcome(outcome, self.session.holder if self.session is not None else None)
        # one that its holder's end came before has not failed
        kept_back = self.session is not None and self.session.ending and outcome.result is Result.REJECTED
        self.serving.call.ended(future, replace(outcome, not_granted=outcome.not_granted or kept_back), now)
        self.serving.closing.ended(future, outcome)
        if (text := self.handshake.ended(future, outcome, now)) is not None:
            self.say.alarm(text)
        self.act(now)
        self.changed()

    def _settle(self, now: float) -> None:
        """Drop robot mode after a session, once the car stands still."""
        sight, last = self.sight(now), self._last_sight()
        # a lift that cannot be read may be told later; one that may not be told at all is not waited for
        reporting = self.handshake.reporting and (sight is None or self._why_no_word() is None)
        text = self._robot_mode.settle(sight, last, self.admission.why_no_robot_mode, reporting=reporting, now=now)
        if text is not None:
            self.say.alarm(text)

    def release(self, ask: Ask, now: float) -> None:
        """End the session at its holder's word, or hear what it still has to say of one that is over."""
        if self.session is None:
            self.handshake.end_again(ask, now)
            self.note(now)
        self.end(EndReason.RELEASED, "released", now, release=ask)

    def end_soon(self, session: Session, grace_s: float, now: float) -> None:
        """Take its holder's word that the session is over. Until the grace is over what is on stays on, should it think again."""
        self.session = sessions.ending(session, grace_s, now)
        self.act(now)
        self.changed()

    def end_for_a_person(self, reason: EndReason, text: str, now: float, *, at_once: bool) -> float:
        """End the session at a person's request; return after how many seconds.

        OPEN is withdrawn now. While a robot may be in the doorway the door is released only `clear_s` later, unless `at_once`.
        """
        session, clear_s = self.session, 0.0
        if session is None or at_once or not self.may_be_crossed or (session.ending and session.closing is None):
            self._end_now(reason, text, now)
        else:
            # a second word does not shorten what a robot in the doorway was given, nor does it begin it again
            over_at = math.inf if session.over_at is None else session.over_at
            clear_s = max(0.0, min(self._options.limits(session.holder).clear_s, over_at - now))
            self._close_soon(session, reason, text, clear_s, now)
        self.act(now)
        self.changed()
        return clear_s

    def _close_soon(self, session: Session, reason: EndReason, text: str, clear_s: float, now: float) -> None:
        self.session = sessions.closing(session, reason, text, now + clear_s)
        self._countdown.set(now + clear_s)
        self.changed()

    def _end_now(self, reason: EndReason, text: str, now: float) -> None:
        self.end(reason, text, now)
        if reason is EndReason.LOCKOUT:
            self.handshake.let_go()

    def held_by(self, holder: Holder | None, now: float) -> Session | Refused:
        """Return the session if it is this holder's, or whosever where none is named."""
        if self.stopping:
            return STOPPING
        return self.tenure.held_by(self.session, holder, now, in_car=self.handshake.occupied_by(None))

    def contest(
        self, session: Session, asker: Holder, now: float, refusal: Refused | None, *, queued: bool
    ) -> Refused | None:
        """End the session where it has to make way for another caller; `refusal` is what else speaks against that one.

        For one who would be `queued` behind others it does not end.
        """
        over = self.tenure.contest(session, asker, now, self.handshake, refusal)
        if over is None or isinstance(over, Refused):
            return over
        if not queued:
            self.end(*over, now)
        return None

    def end(self, reason: EndReason, text: str, now: float, *, release: Ask | None = None) -> None:
        """End the session, if there is one. The car is not moved by it; `release` is its holder's word."""
        session = self.session
        if session is None:
            return
        holder, advice = session.holder, self._advice()
        release = release or last_word(session, self._options)
        was = self.info(session, now)
        self._released_open |= self.may_be_crossed
        self.session = self._emergency.release_at = None
        self.serving.end()
        self.handshake.end(session, release, now, arrived=reason is EndReason.ARRIVED)
        self.note(now)
        self.say.doubt(holder, reason, text, self.handshake.occupied_by(None))
        used = session.number == self._used_by
        if used:
            self.people.session_ended(now)
        if self.people.fire_latched or self.stopping:
            self._robot_mode.drop()
        elif used:
            self._robot_mode.session_ended(now)
        self._book_over(session, was, SessionOver(reason, text, advice, self.people.clock()))
        self.say.ended(holder, reason, text, advice)
        self._settle(now)
        self.note(now)
        self.changed()

    def _book_over(self, session: Session, was: SessionInfo, over: SessionOver) -> None:
        if over.reason in ITS_OWN_WORD:
            over = replace(over, advice=None)
        robot = was.robot
        if self.handshake.occupied_by(None) is None and robot in (Who.MAY_BOARD, Who.ABOARD):
            robot = Who.LEFT
        self.book.over(ended_info(was, robot, over), over.text, _now())


def _now() -> float:
    return asyncio.get_running_loop().time()
