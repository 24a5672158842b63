"""Sessions of a fake site, and commands within them."""

from drivers.model import Proof
from lift_manager.lift.commands import CommandState, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.session import Holder
from tests.lift_manager.web.fake_lifts import AT


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
        robot=Occupancy.OUTSIDE,
        waiting_for="",
        restored=False,
    )


def a_command(session: SessionInfo, number: str) -> CommandStatus:
    return CommandStatus(
        id=number,
        lift=session.lift,
        holder=session.holder,
        kind=CommandType.GO_TO,
        floor="L2",
        state=CommandState.PENDING,
        reason="",
        proof=Proof.NONE,
        requested_at=AT,
        ended_at=None,
    )
