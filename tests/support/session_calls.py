"""What clients do with one lift, with sessions of their own or without."""

from lift_manager.lift.commands import CommandRequest, CommandState, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.record import DurableRecord
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.recorder import Recorder
from lift_manager.runtime.site import Site
from register_maps.words import Side
from tests.support.refusals import refusal

ROBOT, SECOND = Holder("api", "amr-7"), Holder("api", "amr-8")


class SessionCalls:
    """Requests for one lift."""

    site: Site
    lift: str = "lift"
    caller: Holder
    """Who requests, unless a request names another holder."""

    @property
    def state(self) -> LiftState:
        return self.site.state(self.lift)

    def accept(
        self, floor: str, robot: RobotWord | None = None, *, hold: bool = True, holder: Holder | None = None
    ) -> None:
        """Make a request that is taken."""
        self.site.request(self.lift, holder or self.caller, floor, hold_door=hold, robot=robot)

    def refuse(
        self, floor: str, robot: RobotWord | None = None, *, hold: bool = True, holder: Holder | None = None
    ) -> RequestRefused:
        """Make a request that is refused."""
        return refusal(lambda: self.accept(floor, robot, hold=hold, holder=holder))

    def opened(self, holder: Holder = ROBOT, *, key: str = "", ttl_s: float | None = None) -> SessionInfo:
        """Open a session, which nothing forbids."""
        return self.site.open_session(self.lift, holder, key=key, ttl_s=ttl_s).session

    def open_refused(self, holder: Holder = ROBOT, *, key: str = "", ttl_s: float | None = None) -> RequestRefused:
        return refusal(lambda: self.site.open_session(self.lift, holder, key=key, ttl_s=ttl_s))

    def taken(
        self,
        session: SessionInfo,
        kind: CommandType,
        floor: str | None = None,
        *,
        hold: bool = True,
        key: str = "",
        side: Side | None = None,
    ) -> CommandStatus:
        """Command something within a session, and it is taken."""
        request = CommandRequest(
            session=session.id,
            holder=session.holder,
            kind=kind,
            floor=floor,
            hold_door=hold,
            side=side,
            key=key,
        )
        return self.site.command(self.lift, request)

    def refused_within(
        self,
        session: SessionInfo,
        kind: CommandType,
        floor: str | None = None,
        *,
        hold: bool = True,
        key: str = "",
        side: Side | None = None,
    ) -> RequestRefused:
        """Command something that is refused."""
        return refusal(lambda: self.taken(session, kind, floor, hold=hold, key=key, side=side))

    async def ended(self, session: SessionInfo, command: CommandStatus, within_s: float = 120.0) -> CommandStatus:
        """What became of a command."""
        status = await self.site.until_ended(self.lift, session.id, session.holder, command.id, within_s)
        assert status.state is not CommandState.PENDING, status
        return status

    async def done(
        self, session: SessionInfo, kind: CommandType, floor: str | None = None, *, hold: bool = True
    ) -> CommandStatus:
        """Command something, and wait until the lift shows it."""
        status = await self.ended(session, self.taken(session, kind, floor, hold=hold))
        assert status.state is CommandState.CONFIRMED, status
        return status

    def read(self, session: SessionInfo) -> SessionInfo:
        """The session as it is now."""
        return self.site.session(self.lift, session.id, session.holder)

    def closed(self, session: SessionInfo, robot: RobotWord | None = None) -> SessionInfo:
        """Close it; it is over then."""
        info = self.site.close_session(self.lift, session.id, session.holder, robot)
        assert info.over is not None
        return info

    def now(self, session: SessionInfo, command: CommandStatus) -> CommandStatus:
        """A command as it is now."""
        return self.site.command_status(self.lift, session.id, session.holder, command.id)


def saved(recorder: Recorder, lift: str = "lift") -> DurableRecord:
    """What a recorder has of a lift."""
    found = recorder.recall(lift)
    assert found is not None
    return found.record
