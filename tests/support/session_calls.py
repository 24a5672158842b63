"""What a client of sessions does with one lift."""

from lift_manager.core.lift import LiftTask
from lift_manager.domain.asking import Refused, RobotWord
from lift_manager.domain.session_requests import (
    Do,
    Followed,
    OpenSession,
    SessionBegun,
    SessionInfo,
    SessionRequest,
    Status,
)
from lift_manager.domain.state import Holder
from register_maps.words import Side

ROBOT, SECOND = Holder("api", "amr-7"), Holder("api", "amr-8")


class SessionCalls:
    """Sessions of one lift."""

    task: LiftTask

    def opened(self, holder: Holder = ROBOT, *, key: str = "", ttl_s: float | None = None) -> SessionInfo:
        """Open a session, which nothing speaks against."""
        answer = self.task.sessions.open(OpenSession(self.task.options.name, holder, key, ttl_s))
        assert isinstance(answer, SessionBegun), answer
        return answer.session

    def open_refused(self, holder: Holder = ROBOT, *, key: str = "", ttl_s: float | None = None) -> Refused:
        answer = self.task.sessions.open(OpenSession(self.task.options.name, holder, key, ttl_s))
        assert isinstance(answer, Refused), answer
        return answer

    def within(
        self,
        session: SessionInfo,
        do: Do,
        floor: str | None = None,
        *,
        hold: bool = True,
        key: str = "",
        side: Side | None = None,
    ) -> Followed | Refused:
        """Ask for something within a session."""
        return self.task.sessions.ask(
            SessionRequest(
                lift=self.task.options.name,
                session=session.id,
                holder=session.holder,
                do=do,
                floor=floor,
                hold_door=hold,
                side=side,
                key=key,
            )
        )

    def taken(self, session: SessionInfo, do: Do, floor: str | None = None, *, hold: bool = True) -> Followed:
        """The same, and it is taken."""
        answer = self.within(session, do, floor, hold=hold)
        assert isinstance(answer, Followed), answer
        return answer

    async def ended(self, session: SessionInfo, followed: Followed, within_s: float = 120.0) -> Followed:
        """What became of a request."""
        answer = await self.task.sessions.until_ended(session.id, session.holder, followed.id, within_s)
        assert isinstance(answer, Followed), answer
        assert answer.status is not Status.PENDING, answer
        return answer

    async def done(self, session: SessionInfo, do: Do, floor: str | None = None, *, hold: bool = True) -> Followed:
        """Ask for something, and wait until the lift shows it."""
        answer = await self.ended(session, self.taken(session, do, floor, hold=hold))
        assert answer.status is Status.CONFIRMED, answer
        return answer

    def read(self, session: SessionInfo) -> SessionInfo:
        """The session as it is now."""
        answer = self.task.sessions.read(session.id, session.holder)
        assert isinstance(answer, SessionInfo), answer
        return answer

    def closed(self, session: SessionInfo, robot: RobotWord | None = None) -> SessionInfo:
        """Close it; it is over then."""
        answer = self.task.sessions.close(session.id, session.holder, robot)
        assert isinstance(answer, SessionInfo), answer
        assert answer.over is not None
        return answer

    def refused_within(self, session: SessionInfo, do: Do, floor: str | None = None) -> Refused:
        """Ask for something that is refused."""
        answer = self.within(session, do, floor)
        assert isinstance(answer, Refused), answer
        return answer

    def now(self, session: SessionInfo, followed: Followed) -> Followed:
        """A request as it is now."""
        answer = self.task.sessions.followed(session.id, session.holder, followed.id)
        assert isinstance(answer, Followed), answer
        return answer
