"""What the session machine does with sessions of their holders' own, and with the queue."""

from dataclasses import dataclass, field

from lift_manager.lab.world.witness import FloorRequest, Witness
from lift_manager.lift import queue
from lift_manager.lift.commands import CommandRequest, CommandState, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.queue import Queue
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.site import Site
from tests.support.refusals import reply

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
    floors: dict[str, str] = field(default_factory=dict)
    """Where each session was last sent; its robot's words and renewals leave that as it is."""

    def open(self, site: Site, waits: Queue, holder: Holder, ttl_s: float | None, at: float) -> None:
        """Open a session; a caller that is refused learns the right reason. `waits` is the queue before."""
        state = site.state(self.lift)
        ahead = queue.ahead_of(waits, holder, at)
        answer = reply(site.open_session, self.lift, holder, ttl_s=ttl_s)
        if isinstance(answer, RequestRefused):
            if answer.code is Refusal.HELD:
                assert answer.blocking is not None
                assert answer.blocking.holder == site.state(self.lift).holder
            if answer.code is Refusal.QUEUED:
                assert answer.blocking is not None
                assert answer.blocking.ahead == ahead > 0
            return
        assert answer.session.over is None
        assert ahead == 0 or state.restrictions.maybe_aboard == holder
        self.opened.append(answer.session)
        self._tell(holder, "", at)

    def command(self, site: Site, which: int, kind: CommandType, floor: str, at: float, *, hold: bool) -> None:
        """Command something within some session, which may be over."""
        if not self.opened:
            return
        session = self.opened[which % len(self.opened)]
        goes = kind is CommandType.GO_TO
        request = CommandRequest(
            session=session.id,
            holder=session.holder,
            kind=kind,
            floor=floor if goes else None,
            hold_door=hold,
        )
        live = _live(site, session)
        if live:
            # heard before it is done: what follows from it may follow at once
            if goes:
                self.floors[session.id] = floor
            self._tell(session.holder, self.floors.get(session.id, ""), at)
        answer = reply(site.command, self.lift, request)
        assert live or isinstance(answer, RequestRefused)
        if isinstance(answer, CommandStatus):
            self.pending.append((session, answer.id))

    def renew(self, site: Site, which: int, at: float) -> None:
        """Renew some session, which may be over."""
        if self.opened:
            session = self.opened[which % len(self.opened)]
            if live := _live(site, session):
                self._tell(session.holder, self.floors.get(session.id, ""), at)
            answer = reply(site.renew_session, self.lift, session.id, session.holder, None)
            assert live is not isinstance(answer, RequestRefused)

    def close(self, site: Site, which: int, robot: RobotWord | None) -> None:
        """Close some session; the lift of another holder stays that one's."""
        if not self.opened:
            return
        session = self.opened[which % len(self.opened)]
        before, live = site.state(self.lift), _live(site, session)
        answer = reply(site.close_session, self.lift, session.id, session.holder, robot)
        after = site.state(self.lift)
        assert isinstance(answer, RequestRefused) or answer.over is not None
        assert after.holder == (None if live else before.holder)

    def look(self, site: Site) -> None:
        """See that nobody but a live session has anything pending."""
        for session, number in self.pending:
            answer = reply(site.command_status, self.lift, session.id, session.holder, number)
            if isinstance(answer, CommandStatus) and answer.state is CommandState.PENDING:
                assert _live(site, session)

    def _tell(self, holder: Holder, floor: str, at: float) -> None:
        for witness in self.witnesses:
            witness.on_request(at, FloorRequest(self.lift, holder, floor, hold_door=True), None)


def _live(site: Site, session: SessionInfo) -> bool:
    read = reply(site.session, session.lift, session.id, session.holder)
    return isinstance(read, SessionInfo) and read.over is None
