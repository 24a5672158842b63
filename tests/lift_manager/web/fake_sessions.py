"""Sessions of a fake manager: kept in a dict, and every command is pending until it is asked for with a wait."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from drivers.model import Proof
from lift_manager.domain.asking import Refusal, Refused, RobotWord
from lift_manager.domain.boarding import Who
from lift_manager.domain.service import EndReason
from lift_manager.domain.session_requests import (
    Do,
    Followed,
    OpenSession,
    SessionBegun,
    SessionInfo,
    SessionOver,
    SessionRequest,
    Status,
)
from lift_manager.domain.state import Holder
from tests.lift_manager.web.fake_lifts import FakeLifts

AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)
NO_SESSION = Refused(Refusal.NO_SUCH_SESSION, "the manager's own words")
FLOORS = ("L1", "L2")


def a_session(holder: Holder, session: str = "s1", lift: str = "lift") -> SessionInfo:
    return SessionInfo(
        id=session,
        lift=lift,
        holder=holder,
        floor=None,
        hold_door=False,
        opened_at=AT,
        lease_ends_in_s=300.0,
        ends_in_s=1800.0,
        hold_ends_in_s=None,
        arrived=False,
        door_held=False,
        robot=Who.EMPTY,
        waiting_for="",
        restored=False,
    )


def a_command(session: SessionInfo, number: str) -> Followed:
    return Followed(
        id=number,
        lift=session.lift,
        holder=session.holder,
        do=Do.GO_TO,
        floor="L2",
        status=Status.PENDING,
        reason="",
        proof=Proof.NONE,
        asked_at=AT,
        ended_at=None,
    )


@dataclass(kw_only=True)
class FakeSessions(FakeLifts):
    """The holder is checked as `SessionFacade` says it is; a lift has as many sessions as are wanted."""

    sessions: dict[tuple[str, str], SessionInfo] = field(default_factory=dict)
    """By lift and id."""
    commands: dict[tuple[str, str], Followed] = field(default_factory=dict)
    """By session and number."""
    done: list[object] = field(default_factory=list)
    """What was asked of sessions and rides that changes something, as it was asked."""
    refuses: Refused | None = None
    """What every such request is told."""
    waited_s: list[float] = field(default_factory=list)
    _keys: dict[tuple[Holder, str], str] = field(default_factory=dict)

    def there(self, *sessions: SessionInfo) -> None:
        """Let these sessions be open."""
        self.sessions |= {(session.lift, session.id): session for session in sessions}

    def open_session(self, wish: OpenSession) -> SessionBegun | Refused:
        self.done.append(wish)
        if no := self._no_lift(wish.lift) or self.refuses:
            return no
        if wish.key and (known := self._keys.get((wish.holder, wish.key))):
            return SessionBegun(self.sessions[wish.lift, known], anew=False)
        session = a_session(wish.holder, f"s{len(self.sessions) + 1}", wish.lift)
        self._keys[wish.holder, wish.key] = session.id
        self.there(session)
        return SessionBegun(session, anew=True)

    def session(self, lift: str, session: str, holder: Holder | None) -> SessionInfo | Refused:
        if no := self._no_lift(lift):
            return no
        found = self.sessions.get((lift, session))
        return found if found is not None and holder in {None, found.holder} else NO_SESSION

    def renew_session(self, lift: str, session: str, holder: Holder, ttl_s: float | None) -> SessionInfo | Refused:
        return self._changed(("renew", lift, session, holder, ttl_s), lease_ends_in_s=ttl_s or 300.0)

    def close_session(self, lift: str, session: str, holder: Holder, robot: RobotWord | None) -> SessionInfo | Refused:
        over = SessionOver(EndReason.RELEASED, "released by its holder", None, AT)
        return self._changed(("close", lift, session, holder, robot), over=over)

    def hand_session_over(self, lift: str, session: str, holder: Holder, to: Holder) -> SessionInfo | Refused:
        said = self._changed(("hand over", lift, session, holder, to), holder=to, id=f"{session}-2")
        if isinstance(said, SessionInfo):
            del self.sessions[lift, session]
            self.there(said)
        return said

    def ask_within(self, request: SessionRequest) -> Followed | Refused:
        self.done.append(request)
        if isinstance(found := self.session(request.lift, request.session, request.holder), Refused):
            return found
        if request.floor not in (None, *FLOORS):
            return Refused(Refusal.UNKNOWN_FLOOR, f"no floor {request.floor!r}; the floors are L1, L2")
        if self.refuses:
            return self.refuses
        said = replace(a_command(found, str(len(self.commands) + 1)), do=request.do, floor=request.floor)
        self.commands[request.session, said.id] = said
        return said

    def followed(self, lift: str, session: str, holder: Holder | None, number: str) -> Followed | Refused:
        if isinstance(found := self.session(lift, session, holder), Refused):
            return found
        return self.commands.get((session, number), Refused(Refusal.NO_SUCH_COMMAND, f"no command {number!r}"))

    async def until_ended(
        self, lift: str, session: str, holder: Holder | None, number: str, within_s: float
    ) -> Followed | Refused:
        self.waited_s.append(within_s)
        if isinstance(found := self.followed(lift, session, holder, number), Refused):
            return found
        ended = replace(found, status=Status.CONFIRMED, proof=Proof.LAMP, ended_at=AT)
        self.commands[session, number] = ended
        return ended

    def _changed(self, asked: tuple[str, str, str, Holder, object], **change: object) -> SessionInfo | Refused:
        self.done.append(asked)
        _, lift, session, holder, _ = asked
        if isinstance(found := self.session(lift, session, holder), Refused):
            return found
        if self.refuses:
            return self.refuses
        changed = replace(found, **change)  # type: ignore[arg-type]  # some of its fields
        self.sessions[lift, session] = changed
        return changed

    def _no_lift(self, lift: str) -> Refused | None:
        known = self.lift_names()
        return None if lift in known else Refused(Refusal.UNKNOWN_LIFT, f"no lift {lift!r}; the lifts are {known}")
