"""The sessions of one lift as faces see them: written down before they are decided on, and answered at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from lift_manager.core.gate import Gate
from lift_manager.core.keeper import SessionKeeper
from lift_manager.core.options import LiftOptions
from lift_manager.core.recording import LiftLog
from lift_manager.core.session_desk import SessionDesk
from lift_manager.domain import wish as wishes
from lift_manager.domain.asking import Accepted, Refused, RobotWord
from lift_manager.domain.session_requests import (
    Do,
    Followed,
    OpenSession,
    SessionBegun,
    SessionInfo,
    SessionRequest,
)
from lift_manager.domain.state import Holder, LiftState
from lift_manager.domain.wish import Wish

Answer = TypeVar("Answer")


class LiftSessions:
    """`SessionFacade` for one lift."""

    def __init__(
        self,
        options: LiftOptions,
        keeper: SessionKeeper,
        desk: SessionDesk,
        gate: Gate,
        log: LiftLog,
        *,
        state: Callable[[], LiftState],
    ) -> None:
        self._options = options
        self._keeper = keeper
        self._desk = desk
        self._gate = gate
        self._log = log
        self._state = state

    def open(self, wish: OpenSession) -> SessionBegun | Refused:
        """Take the lift for a caller; nothing is called by it."""
        self._keeper.begin()
        if (known := self._desk.known_by_key(wish)) is not None:
            return known if isinstance(known, Refused) else SessionBegun(known, anew=False)
        state, said = self._state(), wishes.opening(wish.lift, wish.holder)
        self._log.asked(said)
        answer = (
            self._gate.takes_nobody()
            or self._gate.too_often(wish.holder)
            or self._desk.open(wish, self._gate.offline(state))
        )
        if not isinstance(answer, Refused):
            self._gate.took_a_turn(wish.holder)
        return self._answered(said, answer, state)

    def read(self, session: str, holder: Holder | None) -> SessionInfo | Refused:
        """Return a session by its id; `holder` None reads whosesoever it is."""
        self._keeper.begin()
        return self._desk.read(session, holder)

    def renew(self, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        """Begin its lease anew."""
        return self._heard(
            wishes.renewing(self._options.name, holder), lambda: self._desk.renew(session, holder, ttl_s)
        )

    def close(self, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        """End it at its holder's word."""
        said = wishes.closing(self._options.name, holder, robot)
        return self._heard(said, lambda: self._desk.close(session, holder, robot))

    def hand_over(self, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        """Give it to another caller."""
        said = wishes.handing_over(self._options.name, holder, to)
        return self._heard(said, lambda: self._desk.hand_over(session, holder, to))

    def ask(self, request: SessionRequest) -> Followed | Refused:
        """Take a request of a session's holder."""
        self._keeper.begin()
        if (known := self._desk.known_request(request)) is not None:
            return known
        state, said = self._state(), wishes.within(request)
        noted = self._log.asked(said, known=self._known(said))
        return self._answered(said, self._asked(request, state, noted=noted), state)

    def followed(self, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        """Return a request within a session as it is now."""
        return self._desk.followed(session, holder, number)

    async def until_ended(
        self, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        """Return it once it has ended, or as it is after so long."""
        return await self._desk.until_ended(session, holder, number, within_s)

    def _asked(self, request: SessionRequest, state: LiftState, *, noted: bool) -> Followed | Refused:
        anew = self._is_anew(request)
        if anew and (too_often := self._gate.too_often(request.holder)) is not None:
            return too_often
        answer = self._desk.ask(request, self._gate.offline(state), noted=noted)
        if anew and not isinstance(answer, Refused):
            self._gate.took_a_turn(request.holder)
        return answer

    def _is_anew(self, request: SessionRequest) -> bool:
        """Whether it changes what is wanted. Letting go is free: nothing may stand in its way."""
        session = self._keeper.session
        if session is None or session.id != request.session or session.holder != request.holder:
            return False
        if request.do is Do.GO_TO:
            return self._gate.is_anew(request.holder, request.floor, hold_door=request.hold_door)
        return request.do is Do.CLOSE_DOOR or (request.do is Do.HOLD_DOOR and not session.hold_door)

    def _heard(self, said: Wish, decide: Callable[[], Answer | Refused]) -> Answer | Refused:
        self._keeper.begin()
        self._log.asked(said)
        return self._answered(said, decide(), self._state())

    def _answered(self, said: Wish, answer: Answer | Refused, state: LiftState) -> Answer | Refused:
        answered = answer if isinstance(answer, Refused) else Accepted()
        self._log.answered(said, answered, known=self._known(said))
        return self._gate.told(answer, state)

    def _known(self, said: Wish) -> bool:
        return said.floor is None or said.floor in self._options.floors
