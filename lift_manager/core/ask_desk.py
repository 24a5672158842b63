"""Requests of faces that know no sessions: each says the floor, and the session follows from it. Nothing here waits."""

from __future__ import annotations

import asyncio
from dataclasses import replace

from lift_manager.core.handing_over import hand_over
from lift_manager.core.keeper import STOPPING, SessionKeeper
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused, RobotWord
from lift_manager.domain.call import CallPhase
from lift_manager.domain.session import Session
from lift_manager.domain.state import Holder

PASSING = frozenset({Refusal.OFFLINE, Refusal.OCCUPANCY_UNKNOWN, Refusal.TOO_OFTEN})
"""Why a request may be refused that is taken when it comes again a little later."""


class AskDesk:
    """Decides on such requests for one lift."""

    def __init__(self, keeper: SessionKeeper, line: WaitingLine) -> None:
        self._keeper = keeper
        self._line = line

    def request(self, ask: Ask, *, is_release: bool, offline: str) -> Accepted | Refused:
        """Decide on a request and act on it. `offline` says why, should the lift be offline."""
        keeper, now = self._keeper, _now()
        answer = self._decide(ask, now, is_release=is_release, offline=offline)
        if isinstance(answer, Refused) and _is_wish(ask, is_release=is_release):
            self._line.refused(ask.holder, answer, now)
        if not isinstance(answer, Session):
            return answer
        refused = keeper.handshake.hear(ask, keeper.session, keeper.sight(now), arrived=keeper.arrived, now=now)
        if refused is not None:
            return refused
        self._line.leave(ask.holder)
        keeper.take(answer, now)
        if keeper.sight(now) is None:
            self._leave_call(now)
        return Accepted()

    def refused(self, ask: Ask, answer: Refused) -> None:
        """Hear the answer no: a holder that asks again within its grace has not ended, should nothing but time speak against it.

        What is on stays on for it, and a call that its end kept back waits for a request that is taken.
        """
        keeper, session, now = self._keeper, self._keeper.session, _now()
        mine = session is not None and session.ending and ask.stays and session.holder == ask.holder
        if session is None or session.closing is not None or not mine or not self._passes(ask, answer):
            return
        self._leave_call(now)
        keeper.take(replace(session, heard_at=now, over_at=None), now, anew=False)

    def _leave_call(self, now: float) -> None:
        """Leave a call that was not pressed to the next request: nobody knows how long the lift cannot be read, nor who still wants it then."""
        call = self._keeper.serving.call
        if call.now is not None and call.now.phase is CallPhase.WANTED:
            call.restore(call.now.floor, pressed=False, now=now)

    def end(self, holder: Holder, grace_s: float) -> Accepted | Refused:
        """End the session at its holder's word, after the grace; one that is over already is over. No line is left by it."""
        keeper, now = self._keeper, _now()
        if keeper.stopping:
            return STOPPING
        if (session := keeper.session) is None:
            return Accepted()
        if session.holder != holder:
            return sessions.held(session, now)
        keeper.end_soon(session, grace_s, now)
        return Accepted()

    def hand_over(self, holder: Holder, to: Holder) -> Accepted | Refused:
        """Give the session to another caller at its holder's word, with what is known of the robot; nothing else changes."""
        now = _now()
        if isinstance(held := self._keeper.held_by(holder, now), Refused):
            return held
        hand_over(self._keeper, held, to, now)
        return Accepted()

    def _decide(self, ask: Ask, now: float, *, is_release: bool, offline: str) -> Session | Accepted | Refused:
        keeper = self._keeper
        if keeper.stopping:
            return STOPPING
        if (unknown := keeper.admission.unknown_floor(ask.floor)) is not None:
            return unknown
        if keeper.session is not None and keeper.session.holder == ask.holder:
            keeper.session = replace(keeper.session, heard_at=now)
        elif keeper.session is not None and _is_wish(ask, is_release=is_release):
            over = self._contest(keeper.session, ask, now, offline)
            if over is not None:
                return over
        session = keeper.session
        mine = session is None or session.holder == ask.holder
        if mine and is_release:
            keeper.release(ask, now)
            return Accepted()
        if session is not None and mine and _lets_go(ask, session):
            keeper.serving.let_go_of_door()
            session = replace(session, holding_since=None)
            return sessions.admit(session, ask, number=session.number, now=now)
        if mine and (refused := self._refusal(ask, session, now, offline)) is not None:
            return refused
        return sessions.admit(session, ask, number=keeper.opened + 1, now=now)

    def _passes(self, ask: Ask, answer: Refused) -> bool:
        """Whether all that speaks against a request passes by itself; the answer names one reason of several."""
        admission = self._keeper.admission
        reasons = (answer, admission.unknown_floor(ask.floor), admission.refusal(offline="", goes_on=True))
        return all(reason is None or reason.code in PASSING for reason in reasons)

    def _refusal(self, ask: Ask, session: Session | None, now: float, offline: str) -> Refused | None:
        """Return what speaks against a request for a lift that nobody else holds."""
        keeper = self._keeper
        if (over := sessions.over_soon(session, now)) is not None:
            return over
        goes_on = session is not None or keeper.handshake.goes_on(ask.holder)
        refused = keeper.admission.refusal(offline=offline, goes_on=goes_on)
        if refused is not None and session is not None and session.ending and refused.code is Refusal.OFFLINE:
            # it thinks again in its grace and keeps what is on; nothing is pressed for it before the lift is read
            return None
        if refused is not None or goes_on:
            return refused
        without_words = keeper.handshake.no_words() if ask.stays else None
        return without_words or self._line.why_not_yet(ask.holder, now)

    def _contest(self, session: Session, ask: Ask, now: float, offline: str) -> Refused | None:
        """End a session that has to make way for this request, if it has to; a refusal says more than that it is held."""
        keeper = self._keeper
        aboard = ask.robot is RobotWord.IN_PLACE
        refusal = keeper.admission.refusal(offline=offline, goes_on=False)
        refusal = refusal or keeper.handshake.impossible(ask.floor, aboard=aboard)
        queued = self._line.ahead(ask.holder, now) > 0
        return keeper.contest(session, ask.holder, now, refusal, queued=queued)


def _is_wish(ask: Ask, *, is_release: bool) -> bool:
    """Whether it wants the lift for itself; an idle client posts requests without a hold once a second."""
    return (ask.hold_door or ask.stays) and not is_release


def _lets_go(ask: Ask, session: Session) -> bool:
    """Whether it wants the door no longer where the session has it, and nothing else: a release, against which nothing speaks."""
    return ask.stays and not ask.hold_door and session.hold_door and ask.floor == session.floor


def _now() -> float:
    return asyncio.get_running_loop().time()
