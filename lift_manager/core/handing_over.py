"""One session, from one caller to another. Nothing here waits."""

from __future__ import annotations

from lift_manager.core.keeper import SessionKeeper
from lift_manager.core.session_info import ended_info
from lift_manager.domain import session as sessions
from lift_manager.domain.service import EndReason
from lift_manager.domain.session import Session
from lift_manager.domain.session_requests import SessionOver
from lift_manager.domain.state import Holder


def hand_over(keeper: SessionKeeper, session: Session, to: Holder, now: float) -> Session:
    """Give a session to another caller at its holder's word, with what is known of the robot. Returns it under its new id.

    The car and its door stay as they are. For its holder it is over.
    """
    opened_at, was = keeper.book.opened_at, keeper.info(session, now)
    over = SessionOver(EndReason.RELEASED, f"handed over to {to}", None, keeper.people.clock())
    keeper.book.over(ended_info(was, was.robot, over), over.text, now)
    keeper.session = after = sessions.handed_over(session, to, now)
    keeper.book.begun(after, opened_at)
    keeper.handshake.handed_over(to)
    if to != session.holder:
        keeper.say.handed_over(session.holder, to)
    keeper.act(now)
    keeper.changed()
    return after
