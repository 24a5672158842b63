"""Everything that can happen to a ride, as values; what a step asks the runtime to do; and what it publishes."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.lift import inputs as lift_inputs
from lift_manager.lift.commands import CommandStatus, SessionInfo
from lift_manager.lift.events import Advised, Alarm, CommandFollowed
from lift_manager.lift.inputs import CloseSession, EndSession, GiveCommand, LiftRequest, OpenSession, RenewSession
from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.lift.refusals import Accepted, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.rides.ride import Phase, Ride, RideWord

# -- what happens to a ride


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed, or there is news of the lift: continue with the present observation."""


@dataclass(frozen=True, slots=True)
class RobotReport:
    """The robot of the ride, or somebody for it, reports where it is."""

    word: RideWord


@dataclass(frozen=True, slots=True)
class BeginAgain:
    """The caller repeats the request of the ride with its idempotency key: its robot continues the ride."""


@dataclass(frozen=True, slots=True)
class CancelRide:
    """The caller or an operator cancels the ride. A robot that may be inside is let out first; a repetition changes nothing."""

    reason: str
    by_operator: bool
    """Not by the caller that reports for the robot; so is everybody who sends this through the hub."""


@dataclass(frozen=True, slots=True)
class LiftReply:
    """The immediate reply to an action of the ride."""

    request: RideRequestToLift
    reply: SessionBegun | SessionInfo | CommandStatus | Accepted | Refused


@dataclass(frozen=True, slots=True)
class FoundOutside:
    """No robot of this ride is in its car any more: its holder's newer ride, or a person, has settled that."""


@dataclass(frozen=True, slots=True)
class TakeLift:
    """The ride waits for another lift from now on. The observation is already that of the new one."""

    lift: str


Input = Tick | RobotReport | BeginAgain | CancelRide | LiftReply | FoundOutside | TakeLift | Advised | CommandFollowed
"""`Advised` and `CommandFollowed` are the events of the ride's lift for the ride's holder (`rides.concerned`)."""


# -- what a step asks for

RideRequestToLift = OpenSession | RenewSession | CloseSession | EndSession | GiveCommand | LiftRequest
"""What a ride requests of its lift, like any caller. The ids are missing: the runtime makes them."""


@dataclass(frozen=True, slots=True)
class LiftAction:
    """Request something of the ride's lift; the reply is the next input, `LiftReply`."""

    lift: str
    request: RideRequestToLift


@dataclass(frozen=True, slots=True)
class SettleOthers:
    """The robot is out of the car: the holder's earlier rides there get `FoundOutside` (`rides.in_doubt`)."""


Action = LiftAction | SettleOthers


@dataclass(frozen=True, slots=True)
class QueueChange:
    """A holder joins or leaves the queue of a lift."""

    lift: str
    input: lift_inputs.JoinQueue | lift_inputs.LeaveQueue


# -- what a step publishes


@dataclass(frozen=True, slots=True)
class RideChanged:
    """A ride has begun, changed in more than the passing of time, or ended."""

    lift: str
    """The lift that it is on now."""
    ride: Ride
    before: Phase | None = None
    """Its phase before; None for one that has just begun."""


Event = RideChanged | Alarm


def row_of(event: RideChanged) -> Row | None:
    """Return the row of a ride that begins, enters another phase, or ends; a change of its guidance alone has none."""
    ride = event.ride
    if ride.phase is event.before:
        return None
    robot = f" of {ride.robot}" if ride.robot else ""
    way = f"ride {ride.id}{robot} from {ride.start} to {ride.destination}"
    text = f"{way} is {ride.phase}" + (f": {ride.reason}" if ride.reason else "")
    data: dict[str, Json] = {"ride": ride.id, "phase": ride.phase, "reason": ride.reason}
    return Row(RowKind.SESSION, text, event.lift, str(ride.caller), data)
