"""What is known of the lifts of rides, from memory."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import Protocol

from lift_manager.core.facade import LiftFacade, SessionFacade
from lift_manager.core.rides.book import RideBook
from lift_manager.core.waiting import WaitingLine
from lift_manager.domain.asking import Refused
from lift_manager.domain.ride import Phase
from lift_manager.domain.ride_choice import Choice
from lift_manager.domain.ride_record import Doubt, RideRecord, RideSight
from lift_manager.domain.ride_sight import is_live
from lift_manager.domain.session_requests import SessionInfo
from lift_manager.domain.state import Holder, LiftState
from lift_manager.runtime.recorder import Clock

TURNED_AWAY_S = 30.0
"""So long a lift that refused a ride counts as taking no robots, where a ride has others to choose."""


class Core(LiftFacade, SessionFacade, Protocol):
    """What rides are a client of."""


Lines = Callable[[str], WaitingLine]
"""Who waits for a lift, by its name."""


@dataclass(frozen=True, slots=True)
class _TurnedAway:
    at: float
    why: str


class Seeing:
    """Looks at lifts, sessions and lines for the rides of a book."""

    def __init__(self, core: Core, lines: Lines, book: RideBook, clock: Clock) -> None:
        self._core = core
        self._lines = lines
        self._book = book
        self._clock = clock
        self._lost: dict[str, str] = {}
        """Since what time of day each lift is offline."""
        self._turned_away: dict[str, _TurnedAway] = {}
        self.begun = False
        """Sessions of before this start have been taken up: one that nobody knows is gone."""

    def of(self, record: RideRecord) -> RideSight:
        """Return what is known for a ride now."""
        state = self.state(record.lift)
        session, gone = self._session(record)
        now = _now()
        return RideSight(
            state=state,
            session=session,
            gone=gone,
            ahead=self._lines(record.lift).ahead(record.holder, now),
            busy=self._busy(record),
            doubt=self.doubt(record),
            offline_since=self._offline_since(state),
            now=now,
            at=self._clock(),
        )

    def state(self, lift: str) -> LiftState:
        """Return the state of a lift of the site."""
        state = self._core.state(lift)
        if state is None:
            raise KeyError(lift)
        return state

    def first(self, lift: str) -> Holder | None:
        """Return the ride's holder that comes next at a lift that nobody holds: a robot inside first, then the head of the line."""
        state = self.state(lift)
        inside = state.restrictions.maybe_aboard
        if state.holder is None and inside is not None:
            return inside
        head = self._lines(lift).first(_now())
        return head if isinstance(head, Holder) else None

    def left_line(self, lift: str) -> int:
        """Return how many have left the line of a lift so far."""
        return self._lines(lift).left

    def turned_away(self, lift: str, why: str) -> None:
        """Remember for a while that a lift refused a ride for a reason of its own."""
        self._turned_away[lift] = _TurnedAway(_now(), why)

    def choices(self, record: RideRecord) -> tuple[Choice, ...]:
        """Return the lifts that a ride may take, as far as the site has them."""
        return tuple(choice for lift in record.wish.lifts if (choice := self.choice(lift, record.holder)) is not None)

    def choice(self, lift: str, holder: Holder) -> Choice | None:
        """Return one lift as a holder may choose it; None for one that the site does not have."""
        described, state = self._core.describe(lift), self._core.state(lift)
        if described is None or state is None:
            return None
        refused = self._turned_away.get(lift)
        is_fresh = refused is not None and _now() - refused.at < TURNED_AWAY_S
        why = refused.why if refused is not None and is_fresh else ""
        return Choice(described, state, self._lines(lift).ahead(holder, _now()), why)

    def _session(self, record: RideRecord) -> tuple[SessionInfo | None, str]:
        if not record.session or record.over:
            return None, ""
        answer = self._core.session(record.lift, record.session, record.holder)
        if not isinstance(answer, Refused):
            return answer, ""
        return None, f"its session is over: {answer.message}" if self.begun else ""

    def _busy(self, record: RideRecord) -> str:
        if record.phase is not Phase.QUEUED:
            return ""
        for other in self._book.under_way(record.lift):
            if other.id != record.id:
                return f"ride {other.id} of {other.holder} has {record.lift}"
        return ""

    def doubt(self, record: RideRecord) -> Doubt | None:
        """Return the newest other ride of the same holder whose robot may be in a car; None for a ride that does not wait."""
        if record.phase is not Phase.QUEUED:
            return None
        found = [
            Doubt(one.id, one.lift, math.inf if one.ended_at is None else one.ended_at)
            for one in self._book.maybe_aboard(record.holder)
            if one.id != record.id and self._stands(one, record)
        ]
        return max(found, key=lambda one: one.since, default=None)

    def _stands(self, other: RideRecord, record: RideRecord) -> bool:
        """Whether another ride speaks against one: a robot with a name is known to be that of its own ride that goes on."""
        if not other.over:
            return not record.wish.robot
        return self.state(other.lift).restrictions.maybe_aboard == record.holder

    def _offline_since(self, state: LiftState) -> str:
        if is_live(state) or state.age_s is None:
            self._lost.pop(state.lift, None)
            return ""
        if state.lift not in self._lost:
            now = self._clock()
            at = now - timedelta(seconds=state.age_s)
            shown = "%H:%M:%S" if at.date() == now.date() else "%Y-%m-%d %H:%M:%S"
            self._lost[state.lift] = f"{at:{shown}}"
        return self._lost[state.lift]


def _now() -> float:
    return asyncio.get_running_loop().time()
