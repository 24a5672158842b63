"""Sessions that their holder opens, uses and closes: every answer is from memory and at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.model import FloorName
from lift_manager.core.handing_over import hand_over
from lift_manager.core.keeper import STOPPING, SessionKeeper
from lift_manager.core.options import LiftOptions
from lift_manager.core.session_book import reused
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Ask, Refusal, Refused, RobotWord
from lift_manager.domain.boarding import Who
from lift_manager.domain.following import Pending
from lift_manager.domain.session import Session
from lift_manager.domain.session_requests import (
    WORDS,
    Do,
    Followed,
    OpenSession,
    SessionBegun,
    SessionInfo,
    SessionRequest,
)
from lift_manager.domain.state import Holder

_NO_SESSION = (
    "{lift} has no session of that id for you; one that was over an hour ago, or before a restart, is forgotten"
)

_RELEASES = frozenset({Do.LET_GO_DOOR, Do.ROBOT_LEFT})
"""What the holder of a session that ends soon may still ask for."""


class SessionDesk:
    """The sessions of one lift, as the face of their holder uses them."""

    def __init__(self, keeper: SessionKeeper, options: LiftOptions, line: WaitingLine) -> None:
        self._keeper = keeper
        self._options = options
        self._line = line
        self._doing: Mapping[Do, Callable[[Session, SessionRequest, str, float], Refused | None]] = {
            Do.GO_TO: self._go_to,
            Do.HOLD_DOOR: self._hold_door,
            Do.LET_GO_DOOR: self._let_go_door,
            Do.CLOSE_DOOR: self._close_door,
            Do.ROBOT_IN_PLACE: self._robot_word,
            Do.ROBOT_LEFT: self._robot_word,
        }

    def known_by_key(self, wish: OpenSession) -> SessionInfo | Refused | None:
        """Return the session that a caller has opened with this key before; refuse another wish with it."""
        keeper, now = self._keeper, _now()
        session = keeper.session
        if not wish.key:
            return None
        if session is not None and (session.holder, session.key) == (wish.holder, wish.key):
            keeper.session = session = replace(session, heard_at=now)
            return reused(wish, session.key_ttl_s) or keeper.info(session, now)
        return keeper.book.past_by_key(wish, now)

    def open(self, wish: OpenSession, offline: str) -> SessionBegun | Refused:
        """Take the lift for a caller. `offline` says why, should the lift be offline."""
        keeper, now = self._keeper, _now()
        answer = self._why_not_open(wish, offline, now)
        if answer is not None:
            self._line.refused(wish.holder, answer, now)
            return answer
        self._line.leave(wish.holder)
        number = keeper.opened + 1
        session = sessions.opened(wish.holder, number=number, lease_s=wish.ttl_s, key=wish.key, now=now)
        session = replace(session, lease_s=self._options.lease_for(wish.ttl_s))
        keeper.take(session, now)
        # what it takes up may have ended it by now
        info = keeper.info(session, now) if keeper.session is not None else keeper.book.past(session.id, now)
        return SessionBegun(info or keeper.info(session, now), anew=True)

    def read(self, session: str, holder: Holder | None) -> SessionInfo | Refused:
        """Return a session by its id; `holder` None reads whosesoever it is."""
        now = _now()
        found = self._found(session, holder, now)
        return self._keeper.info(found, now) if isinstance(found, Session) else found

    def renew(self, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        """Begin the lease anew; `ttl_s` None leaves its length. The call of a session from before a restart goes on."""
        keeper, now = self._keeper, _now()
        found = self._live(session, holder, now)
        if isinstance(found, Refused):
            return found
        lease_s = found.lease_s if ttl_s is None else self._options.lease_for(ttl_s)
        keeper.take(replace(sessions.renewed(found, now), lease_s=lease_s), now, anew=found.restored)
        return self.read(session, holder)

    def close(self, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        """End a session, or hear what the robot of one that is over has still to say."""
        keeper, now = self._keeper, _now()
        found = self._found(session, holder, now)
        if isinstance(found, Refused):
            return found
        release = Ask(self._options.name, holder, found.floor or self._options.floors[0], hold_door=False, robot=robot)
        if isinstance(found, Session):
            keeper.release(release, now)
        elif keeper.session is None and robot is RobotWord.LEFT:
            keeper.release(release, now)
            keeper.act(now)
            keeper.changed()
        return self.read(session, holder)

    def hand_over(self, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        """Give a session to another caller; the answer has its new id."""
        keeper, now = self._keeper, _now()
        found = self._live(session, holder, now)
        if isinstance(found, Refused):
            return found
        return keeper.info(hand_over(keeper, found, to, now), now)

    def known_request(self, request: SessionRequest) -> Followed | Refused | None:
        """Return the request that the holder has made with this key before; refuse another wish with it."""
        now = _now()
        if isinstance(self._found(request.session, request.holder, now), Refused):
            return None
        return self._keeper.book.by_key(request, now)

    def ask(self, request: SessionRequest, offline: str, *, noted: bool) -> Followed | Refused:
        """Decide on a request and act on it; `noted` says that the journal has it."""
        keeper, now = self._keeper, _now()
        found = self._live(request.session, request.holder, now)
        if isinstance(found, Refused):
            return found
        keeper.session = found = replace(found, heard_at=now)
        keeper.look(now)
        given = request.do is Do.LET_GO_DOOR and keeper.serving.view(found, None, "", now).door_given
        over = None if request.do in _RELEASES else sessions.over_soon(found, now)
        refused = over or self._doing[request.do](found, request, offline, now)
        if refused is not None:
            return refused
        floor = request.floor if request.do is Do.GO_TO else found.floor
        number = keeper.book.take(request, Pending(request.do, floor, pressed=given), noted=noted)
        keeper.act(now)
        keeper.changed()
        return self.followed(request.session, request.holder, number)

    def followed(self, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        """Return a request as it is now."""
        found = self._request(session, holder, number)
        return found if isinstance(found, Refused) else found[0]

    async def until_ended(
        self, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        """Return a request once it has ended, or as it is after so long."""
        found = self._request(session, holder, number)
        if isinstance(found, Refused):
            return found
        try:
            async with asyncio.timeout(within_s):
                await found[1].wait()
        except TimeoutError:
            pass
        return self.followed(session, holder, number)

    # -- whose it is

    def _found(self, session: str, holder: Holder | None, now: float) -> Session | SessionInfo | Refused:
        keeper, live = self._keeper, self._keeper.session
        if live is not None and live.id == session and holder in (None, live.holder):
            return live
        past = keeper.book.past(session, now)
        if past is not None and holder in (None, past.holder):
            in_car = keeper.handshake.occupied_by(live)
            doubt = in_car is not None and in_car[0] == past.holder
            cleared = past.robot in (Who.MAY_BOARD, Who.ABOARD) and not doubt
            return replace(past, robot=Who.LEFT) if cleared else past
        return Refused(Refusal.NO_SUCH_SESSION, _NO_SESSION.format(lift=self._options.name))

    def _live(self, session: str, holder: Holder, now: float) -> Session | Refused:
        found = self._found(session, holder, now)
        if isinstance(found, SessionInfo):
            why = found.over.text if found.over is not None else "over"
            return Refused(Refusal.SESSION_OVER, f"the session on {self._options.name} is over: {why}")
        if isinstance(found, Session) and self._keeper.stopping:
            return STOPPING
        return found

    def _request(self, session: str, holder: Holder | None, number: str) -> tuple[Followed, asyncio.Event] | Refused:
        now = _now()
        if isinstance(refused := self._found(session, holder, now), Refused):
            return refused
        found = self._keeper.book.find(session, number, now)
        if found is None:
            text = "the session has no request of that id; of many, and of those before a restart, it is forgotten"
            return Refused(Refusal.NO_SUCH_COMMAND, text)
        return found

    # -- what is done

    def _why_not_open(self, wish: OpenSession, offline: str, now: float) -> Refused | None:
        keeper = self._keeper
        if keeper.stopping:
            return STOPPING
        goes_on = keeper.handshake.goes_on(wish.holder)
        refused = keeper.admission.refusal(offline=offline, goes_on=goes_on)
        queued = None if goes_on else self._line.why_not_yet(wish.holder, now)
        if (session := keeper.session) is not None:
            contested = None
            if session.holder != wish.holder:
                contested = keeper.contest(session, wish.holder, now, refused, queued=queued is not None)
            if contested is not None or keeper.session is not None:
                return contested or sessions.held(session, now)
        return refused or queued or keeper.handshake.why_kept(wish.holder)

    def _go_to(self, session: Session, request: SessionRequest, offline: str, now: float) -> Refused | None:
        floor = request.floor or ""
        if (unknown := self._keeper.admission.unknown_floor(floor)) is not None:
            return unknown
        return self._wanted(session, floor, Do.GO_TO, offline, now, hold_door=request.hold_door)

    def _hold_door(self, session: Session, request: SessionRequest, offline: str, now: float) -> Refused | None:
        name = self._options.name
        if session.floor is None:
            return self._not_now("it was asked for no floor yet: ask for one with go_to, and hold_door with it")
        turn_s = self._options.between_sessions_s
        if session.hold_spent and not sessions.may_hold_again(session, turn_s, now):
            limit_s = self._options.max_session_hold_s
            return self._not_now(
                f"the door was held at {session.floor} for {limit_s:g} s, as long as the site allows; it is held again once it"
                f" has been shut for {turn_s:g} s"
            )
        if (why := self._keeper.serving.why_no_hold(session.floor)) is not None:
            return Refused(Refusal.NOT_POSSIBLE, f"{name}: {why}")
        return self._wanted(session, session.floor, Do.HOLD_DOOR, offline, now, hold_door=True)

    def _let_go_door(self, session: Session, request: SessionRequest, offline: str, now: float) -> Refused | None:
        # a release: nothing speaks against it, and nothing is called by it
        self._let_go(session, Do.LET_GO_DOOR, now)
        return None

    def _close_door(self, session: Session, request: SessionRequest, offline: str, now: float) -> Refused | None:
        keeper, name, floor = self._keeper, self._options.name, session.floor
        here = self._options.doors_at[floor] if floor is not None else ()
        sides = here if request.side is None else (request.side,)
        closing = keeper.serving.closing
        if not closing.known or (missing := closing.missing(sides)):
            which = "close_door" if not closing.known else f"close_door.{missing[0]}"
            return Refused(Refusal.NOT_POSSIBLE, f"{name} has no {which}: its map has no such button")
        if floor is not None and request.side not in (None, *here):
            return Refused(Refusal.NOT_POSSIBLE, f"{name} has no {request.side} door at {floor}")
        if (refused := keeper.admission.refusal(offline=offline, goes_on=True)) is not None:
            return refused
        if (why_not := keeper.serving.why_no_close(replace(session, hold_door=False), keeper.sight(now))) is not None:
            return self._not_now(why_not)
        self._let_go(session, Do.CLOSE_DOOR, now)
        closing.want(sides, now)
        return None

    def _robot_word(self, session: Session, request: SessionRequest, offline: str, now: float) -> Refused | None:
        keeper, sight, word = self._keeper, self._keeper.sight(now), WORDS[request.do]
        refused = keeper.admission.refusal(offline=offline, goes_on=True)
        # that it left is no wish: nothing but what it says itself speaks against it
        if refused is not None and word is RobotWord.IN_PLACE:
            return refused
        here = sight.floor if sight is not None else None
        floor = session.floor or here or self._options.floors[0]
        ask = Ask(self._options.name, session.holder, floor, session.hold_door, word)
        if (refused := keeper.handshake.hear(ask, session, sight, arrived=keeper.arrived, now=now)) is not None:
            return refused
        self._displace(session, request.do)
        keeper.take(sessions.renewed(session, now), now, anew=session.restored)
        return None

    def _wanted(
        self, session: Session, floor: FloorName, do: Do, offline: str, now: float, *, hold_door: bool
    ) -> Refused | None:
        """Take a wish for a floor as one of a face without sessions is taken."""
        keeper = self._keeper
        if (refused := keeper.admission.refusal(offline=offline, goes_on=True)) is not None:
            return refused
        ask = Ask(self._options.name, session.holder, floor, hold_door)
        refused = keeper.handshake.hear(ask, session, keeper.sight(now), arrived=keeper.arrived, now=now)
        if refused is None:
            after = sessions.wanting(session, floor, hold_door=hold_door, now=now)
            self._displace(after, do)
            keeper.take(after, now)
        return refused

    def _displace(self, session: Session, do: Do) -> None:
        self._keeper.book.displace(do, session.floor, hold_door=session.hold_door)

    def _let_go(self, session: Session, do: Do, now: float) -> None:
        after = replace(sessions.renewed(session, now), hold_door=False, holding_since=None)
        self._displace(after, do)
        self._keeper.session = after
        self._keeper.serving.let_go_of_door()
        self._keeper.note(now)

    def _not_now(self, why: str) -> Refused:
        return Refused(Refusal.NOT_NOW, f"{self._options.name}: {why}")


def _now() -> float:
    return asyncio.get_running_loop().time()
