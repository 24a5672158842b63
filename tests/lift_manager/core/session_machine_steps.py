"""What the session machine does with sessions of their holders' own, and with the line of those who wait."""

from dataclasses import dataclass, field

from lift_manager.core.manager import LiftManager
from lift_manager.domain.asking import Accepted, Ask, Refusal, Refused, RobotWord
from lift_manager.domain.session_requests import Do, Followed, OpenSession, SessionInfo, SessionRequest, Status
from lift_manager.domain.state import Holder
from lift_manager.lab.world.witness import Witness

LINE = (Holder("ride", "a"), Holder("ride", "b"))
STAYERS = (Holder("api", "r1"), Holder("api", "r3"), *LINE)


@dataclass
class Stayers:
    """Callers that open sessions, and what they remember of them."""

    lift: str
    witnesses: tuple[Witness, ...]
    opened: list[SessionInfo] = field(default_factory=list)
    pending: list[tuple[SessionInfo, str]] = field(default_factory=list)
    """Requests of the process that runs."""

    def open(self, manager: LiftManager, holder: Holder, ttl_s: float | None, at: float) -> None:
        """Open a session; whoever is refused learns the right reason."""
        state = manager.state(self.lift)
        assert state is not None
        ahead = manager.line(self.lift).ahead(holder, at)
        answer = manager.open_session(OpenSession(self.lift, holder, ttl_s=ttl_s))
        if isinstance(answer, Refused):
            if answer.code is Refusal.HELD:
                assert answer.blocking is not None
                after = manager.state(self.lift)
                assert after is not None
                assert answer.blocking.holder == after.holder
            if answer.code is Refusal.QUEUED:
                assert answer.blocking is not None
                assert answer.blocking.ahead == ahead > 0
            return
        assert answer.session.over is None
        assert ahead == 0 or state.restrictions.maybe_aboard == holder
        self.opened.append(answer.session)
        self._tell(holder, "", at)

    def do(self, manager: LiftManager, which: int, do: Do, floor: str, at: float, *, hold: bool) -> None:
        """Ask for something within some session, which may be over."""
        if not self.opened:
            return
        session = self.opened[which % len(self.opened)]
        goes = do is Do.GO_TO
        request = SessionRequest(
            lift=self.lift,
            session=session.id,
            holder=session.holder,
            do=do,
            floor=floor if goes else None,
            hold_door=hold,
        )
        live = _live(manager, session)
        if live:
            # heard before it is done: what follows from it may follow at once
            self._tell(session.holder, floor if goes else "", at)
        answer = manager.ask_within(request)
        assert live or isinstance(answer, Refused)
        if isinstance(answer, Followed):
            self.pending.append((session, answer.id))

    def renew(self, manager: LiftManager, which: int, at: float) -> None:
        """Renew some session, which may be over."""
        if self.opened:
            session = self.opened[which % len(self.opened)]
            if live := _live(manager, session):
                self._tell(session.holder, "", at)
            answer = manager.renew_session(self.lift, session.id, session.holder, None)
            assert live is not isinstance(answer, Refused)

    def close(self, manager: LiftManager, which: int, robot: RobotWord | None) -> None:
        """Close some session; the lift of another holder stays that one's."""
        if not self.opened:
            return
        session = self.opened[which % len(self.opened)]
        before, live = manager.state(self.lift), _live(manager, session)
        answer = manager.close_session(self.lift, session.id, session.holder, robot)
        after = manager.state(self.lift)
        assert before is not None
        assert after is not None
        assert isinstance(answer, Refused) or answer.over is not None
        assert after.holder == (None if live else before.holder)

    def look(self, manager: LiftManager) -> None:
        """See that nobody but a live session has anything pending."""
        for session, number in self.pending:
            answer = manager.followed(self.lift, session.id, session.holder, number)
            if isinstance(answer, Followed) and answer.status is Status.PENDING:
                assert _live(manager, session)

    def _tell(self, holder: Holder, floor: str, at: float) -> None:
        for witness in self.witnesses:
            witness.asked(at, Ask(self.lift, holder, floor, hold_door=True), Accepted())


def _live(manager: LiftManager, session: SessionInfo) -> bool:
    read = manager.session(session.lift, session.id, session.holder)
    return isinstance(read, SessionInfo) and read.over is None
