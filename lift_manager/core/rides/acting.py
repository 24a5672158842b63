"""Carries out what rides need, as a client of sessions like any other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from lift_manager.core.rides.seeing import Core, Seeing
from lift_manager.domain import ride_steps as steps
from lift_manager.domain.asking import Ask, Refusal, Refused, RobotWord
from lift_manager.domain.events import Alarm, Event
from lift_manager.domain.ride_record import (
    Action,
    Close,
    GoTo,
    InPlace,
    Open,
    Renew,
    RideRecord,
    RideSight,
    Warn,
)
from lift_manager.domain.service import how_to_acknowledge
from lift_manager.domain.session_requests import Do, OpenSession, SessionRequest

_NOT_ITS_OWN = frozenset({Refusal.HELD, Refusal.QUEUED, Refusal.STOPPING})
"""Refusals that say nothing of the lift itself."""


class Acting:
    """Returns a ride as it is after what was done for it."""

    def __init__(self, core: Core, seeing: Seeing, publish: Callable[[Event], object]) -> None:
        self._core = core
        self._seeing = seeing
        self._publish = publish

    def carry_out(self, record: RideRecord, action: Action, seen: RideSight) -> RideRecord:
        """Do one thing."""
        match action:
            case Open():
                return self._open(record, seen)
            case GoTo(floor):
                return self._ask(record, Do.GO_TO, floor, seen)
            case InPlace():
                return self._ask(record, Do.ROBOT_IN_PLACE, None, seen)
            case Renew():
                answer = self._core.renew_session(record.lift, record.session, record.holder, None)
                return steps.asked(record, answer.message if isinstance(answer, Refused) else record.trouble, seen)
            case Close(left, clears):
                if clears and (described := self._core.describe(record.lift)) is not None:
                    self._core.end_session(record.lift, record.holder, described.clear_s)
                    return record
                return self._close(record, left=left)
            case Warn(text):
                self._publish(Alarm(record.lift, text, record.holder))
                return record

    def _open(self, record: RideRecord, seen: RideSight) -> RideRecord:
        answer = self._core.open_session(OpenSession(record.lift, record.holder, key=record.id))
        if not isinstance(answer, Refused):
            return steps.opened(record, answer.session.id, seen)
        if answer.code not in _NOT_ITS_OWN:
            self._seeing.turned_away(record.lift, answer.message)
        return steps.asked(record, answer.message, seen)

    def _ask(self, record: RideRecord, do: Do, floor: str | None, seen: RideSight) -> RideRecord:
        request = SessionRequest(lift=record.lift, session=record.session, holder=record.holder, do=do, floor=floor)
        answer = self._core.ask_within(request)
        return steps.asked(record, answer.message if isinstance(answer, Refused) else "", seen)

    def _close(self, record: RideRecord, *, left: bool) -> RideRecord:
        """End the session. A lift that has not seen how the robot got out keeps its doubt until a person has looked."""
        word = RobotWord.LEFT if left else None
        self._core.close_session(record.lift, record.session, record.holder, word)
        if not left or not self._in_doubt(record):
            return record
        state = self._seeing.state(record.lift)
        if state.holder is None:
            floor = state.floor or record.wish.destination
            self._core.request(Ask(record.lift, record.holder, floor, hold_door=False, robot=RobotWord.LEFT))
        if not self._in_doubt(record):
            return record
        doubt = f"the lift has not shown how the robot got out; a person must look: {how_to_acknowledge(record.lift)}"
        return replace(record, maybe_aboard=True, reason=f"{record.reason}; {doubt}" if record.reason else doubt)

    def _in_doubt(self, record: RideRecord) -> bool:
        return self._seeing.state(record.lift).restrictions.maybe_aboard == record.holder
