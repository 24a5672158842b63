"""What is remembered of the sessions of one lift and of the requests within them, for as long as the process lives."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime

from drivers.model import FloorName, Proof
from lift_manager.core.announce import Announcer
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.following import TAKEN, Pending, Verdict, View, broken_off, judge, takes_place_of
from lift_manager.domain.service import EndReason
from lift_manager.domain.session import Session, new_id
from lift_manager.domain.session_requests import Do, Followed, OpenSession, SessionInfo, SessionRequest, Status
from lift_manager.domain.state import Holder
from lift_manager.runtime.recorder import Clock

SESSIONS, SESSIONS_FOR_S = 32, 3600.0
"""How many sessions are remembered once they are over, and for how long. Chosen: a caller that lost its answer asks again within
minutes, and a busy lift has thirty sessions an hour."""
REQUESTS = 64
"""Requests of one session that are remembered, the newest. Chosen: a ride needs ten."""


@dataclass
class _Request:
    """One request of a session."""

    wish: SessionRequest
    followed: Followed
    pending: Pending | None
    noted: bool
    """It has a row of its own in the journal, and so its end has."""
    ended: asyncio.Event = field(default_factory=asyncio.Event)


@dataclass
class _Sheet:
    """One session."""

    id: str
    holder: Holder
    opened_at: datetime
    requests: OrderedDict[str, _Request] = field(default_factory=OrderedDict)
    key: str = ""
    key_ttl_s: float | None = None
    """The lease that was asked for with the key."""
    over: SessionInfo | None = None
    over_at: float = 0.0

    def pending(self) -> Iterator[tuple[_Request, Pending]]:
        """Yield what has not ended."""
        for request in self.requests.values():
            if request.pending is not None:
                yield request, request.pending


class SessionBook:
    """The session that goes on, and those that are over."""

    def __init__(self, lift: str, say: Announcer, clock: Clock) -> None:
        self._lift = lift
        self._say = say
        self._clock = clock
        self._now: _Sheet | None = None
        self._over: OrderedDict[str, _Sheet] = OrderedDict()

    @property
    def opened_at(self) -> datetime:
        """When the session that goes on began, by the clock on the wall."""
        return self._clock() if self._now is None else self._now.opened_at

    def begun(self, session: Session, opened_at: datetime) -> None:
        """Begin with a session, or go on with one under another id."""
        self._now = _Sheet(session.id, session.holder, opened_at, key=session.key, key_ttl_s=session.key_ttl_s)

    def over(self, info: SessionInfo, why: str, now: float) -> None:
        """Remember a session that is over, as it was. Whatever was pending in it ends with it."""
        sheet, self._now = self._now, None
        if sheet is None:
            return
        for request, pending in tuple(sheet.pending()):
            self._end(request, _over_with_session(pending, info, why))
        sheet.over, sheet.over_at = info, now
        self._over[sheet.id] = sheet
        if len(self._over) > SESSIONS:
            self._over.popitem(last=False)

    def past(self, session: str, now: float) -> SessionInfo | None:
        """Return a session that is over, if it is remembered."""
        sheet = self._past(session, now)
        return None if sheet is None else sheet.over

    def past_by_key(self, wish: OpenSession, now: float) -> SessionInfo | Refused | None:
        """Return the newest session of a holder that was opened with this key and is over; refuse another wish with it."""
        found = [sheet for sheet in self._over.values() if (sheet.holder, sheet.key) == (wish.holder, wish.key)]
        if not found or not wish.key or (past := self.past(found[-1].id, now)) is None:
            return None
        return reused(wish, found[-1].key_ttl_s) or past

    def by_key(self, wish: SessionRequest, now: float) -> Followed | Refused | None:
        """Return the request of a session that was made with this key; refuse another wish with it."""
        sheet = self._sheet(wish.session, now)
        if sheet is None or not wish.key:
            return None
        request = next((one for one in sheet.requests.values() if one.wish.key == wish.key), None)
        if request is None or request.wish == wish:
            return None if request is None else request.followed
        text = f"this idempotency key was used for {_in_words(request.wish)}; another wish needs another key"
        return Refused(Refusal.KEY_REUSED, text)

    def find(self, session: str, number: str, now: float) -> tuple[Followed, asyncio.Event] | None:
        """Return a request of a session by its id, and what is set once it has ended."""
        sheet = self._sheet(session, now)
        request = None if sheet is None else sheet.requests.get(number)
        return None if request is None else (request.followed, request.ended)

    def displace(self, do: Do, floor: FloorName | None, *, hold_door: bool) -> None:
        """End what a request takes the place of; `floor` and `hold_door` are the session's with it."""
        for request, pending in self._pending():
            if takes_place_of(do, floor, pending, hold_door=hold_door):
                self._end(request, broken_off(pending, TAKEN))

    def take(self, request: SessionRequest, pending: Pending, *, noted: bool) -> str:
        """Follow a request of the session that goes on; returns its id."""
        followed = Followed(
            id=new_id(),
            lift=self._lift,
            holder=request.holder,
            do=request.do,
            floor=request.floor,
            status=Status.PENDING,
            reason=pending.waits,
            proof=Proof.NONE,
            asked_at=self._clock(),
            ended_at=None,
        )
        if self._now is not None:
            requests = self._now.requests
            requests[followed.id] = _Request(request, followed, pending, noted)
            if len(requests) > REQUESTS:
                self._forget(requests.popitem(last=False)[1])
        self._say.followed(followed, noted=noted)
        return followed.id

    @property
    def waiting(self) -> bool:
        """Whether some request has not ended."""
        return any(True for _ in self._pending())

    def look(self, view: View, now: float) -> None:
        """Judge what has not ended."""
        for request, pending in self._pending():
            after = judge(pending, view, now)
            if isinstance(after, Verdict):
                self._end(request, after)
            elif after != pending:
                request.pending = after
                request.followed = replace(request.followed, reason=after.waits)

    def _pending(self) -> tuple[tuple[_Request, Pending], ...]:
        return () if self._now is None else tuple(self._now.pending())

    def _forget(self, request: _Request) -> None:
        if request.pending is not None:
            self._end(request, broken_off(request.pending, f"more than {REQUESTS} requests came after it"))

    def _end(self, request: _Request, verdict: Verdict) -> None:
        request.pending = None
        request.followed = replace(
            request.followed,
            status=verdict.status,
            reason=verdict.reason,
            proof=verdict.proof,
            ended_at=self._clock(),
        )
        request.ended.set()
        self._say.followed(request.followed, noted=request.noted)

    def _sheet(self, session: str, now: float) -> _Sheet | None:
        if self._now is not None and self._now.id == session:
            return self._now
        return self._past(session, now)

    def _past(self, session: str, now: float) -> _Sheet | None:
        sheet = self._over.get(session)
        return None if sheet is None or now - sheet.over_at > SESSIONS_FOR_S else sheet


def reused(wish: OpenSession, ttl_s: float | None) -> Refused | None:
    """Refuse to open with a key that stands for a session with another lease; `ttl_s` is what was asked for then."""
    if wish.ttl_s == ttl_s:
        return None
    lease = "without `ttl_s`" if ttl_s is None else f"with `ttl_s` {ttl_s:g}"
    text = f"this idempotency key was used to open a session {lease}; another wish needs another key"
    return Refused(Refusal.KEY_REUSED, text)


def _over_with_session(pending: Pending, info: SessionInfo, why: str) -> Verdict:
    if info.over is None or info.over.reason is not EndReason.STOPPING:
        return broken_off(pending, f"the session is over: {why}")
    sent = (
        "it was sent to the lift, and nobody watches what comes of it" if pending.pressed else "nothing was sent for it"
    )
    text = f"the manager is stopping: {sent}; the session goes on when the manager has started again, then ask again"
    return broken_off(pending, text)


def _in_words(wish: SessionRequest) -> str:
    to = "" if wish.floor is None else f" {wish.floor}"
    hold = " without `hold_door`" if wish.do is Do.GO_TO and not wish.hold_door else ""
    side = "" if wish.side is None else f" of the {wish.side} door"
    return f"{wish.do}{to}{hold}{side}"
