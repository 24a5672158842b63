"""The sessions of every lift of a site: `SessionFacade`, lift by lift."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TypeVar

from lift_manager.core.lift import LiftTask
from lift_manager.core.lift_sessions import LiftSessions
from lift_manager.domain.asking import Refusal, Refused, RobotWord
from lift_manager.domain.session_requests import Followed, OpenSession, SessionBegun, SessionInfo, SessionRequest
from lift_manager.domain.state import Holder

Answer = TypeVar("Answer")
_Told = TypeVar("_Told")


class SiteSessions(ABC):
    """The part of the manager that has to do with sessions of their holders' own."""

    def __init__(self, lifts: Mapping[str, LiftTask]) -> None:
        self._lifts = dict(lifts)

    @abstractmethod
    def _told(self, lift: str, answer: _Told | Refused) -> _Told | Refused:
        """Pass an answer on."""

    def open_session(self, wish: OpenSession) -> SessionBegun | Refused:
        """Take the lift for a caller; nothing is called by it."""
        return self._at(wish.lift, lambda sessions: sessions.open(wish))

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo | Refused:
        """Return a session by its id, or one that was over not long ago; `holder` None reads whosesoever it is."""
        return self._at(lift, lambda sessions: sessions.read(session, holder))

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        """Begin its lease anew; a session from before a restart goes on."""
        return self._at(lift, lambda sessions: sessions.renew(session, holder, ttl_s))

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        """End it at its holder's word, the car where it is."""
        return self._at(lift, lambda sessions: sessions.close(session, holder, robot))

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        """Give it to another caller at its holder's word, under a new id."""
        return self._at(lift, lambda sessions: sessions.hand_over(session, holder, to))

    def ask_within(self, request: SessionRequest) -> Followed | Refused:
        """Take a request of a session's holder."""
        return self._at(request.lift, lambda sessions: sessions.ask(request))

    def followed(self, lift: str, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        """Return a request within a session by its id, as it is now."""
        return self._at(lift, lambda sessions: sessions.followed(session, holder, number))

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        """Return the same, once it is no longer pending or `within_s` has passed."""
        if (task := self._lifts.get(lift)) is None:
            return self._told(lift, self._unknown(lift))
        return self._told(lift, await task.sessions.until_ended(session, holder, number, within_s))

    def _at(self, lift: str, ask: Callable[[LiftSessions], Answer | Refused]) -> Answer | Refused:
        task = self._lifts.get(lift)
        return self._told(lift, self._unknown(lift) if task is None else ask(task.sessions))

    def _unknown(self, lift: str) -> Refused:
        return Refused(
            Refusal.UNKNOWN_LIFT,
            f"no lift {json.dumps(lift, ensure_ascii=not lift.isprintable())}; the lifts are {', '.join(self._lifts)}",
        )
