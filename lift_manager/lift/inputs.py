"""Everything that can happen to a lift, as values; and what a step asks the runtime to do.

Readings, requests, outcomes, people and the passing of time are all inputs of one function, `step.step`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import Command, FloorName, LiftReading, Outcome, OutputState, PressId
from lift_manager.lift.commands import CommandRequest
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import CLEAR_AT_STOP_S, Holder

LEAVE_WITHIN_S = 10.0
"""How long a press may wait to be written, beyond the pauses of its map. Chosen: a caller that waited longer repeats its request,
and nobody expects a button to be pressed for a request of long ago."""


Outputs = Mapping[str, OutputState]
"""The state of every output by command name; one that is absent is at rest."""


# -- from the driver and the store


@dataclass(frozen=True, slots=True)
class Reading:
    """A poll that was answered as a whole."""

    reading: LiftReading
    """`Moment.read_at` is still that of the reading before."""
    outputs: Outputs


@dataclass(frozen=True, slots=True)
class ReadFailed:
    """A poll that failed."""

    fault: str
    """Why, in words."""


@dataclass(frozen=True, slots=True)
class OutputChanged:
    """Outputs are in another state than in the newest reading."""

    outputs: Outputs


@dataclass(frozen=True, slots=True)
class PressEnded:
    """A press has its outcome."""

    id: PressId
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class Committed:
    """Everything up to this sequence number is on the disk."""

    sequence: int


@dataclass(frozen=True, slots=True)
class CommitFailed:
    """What was handed to the store since the last commit is not on the disk, and may never be."""

    reason: str
    """Why, with what a person can do."""


# -- from callers


@dataclass(frozen=True, slots=True)
class LiftRequest:
    """A request of a face that knows no sessions: each names the floor, and the session follows from it."""

    holder: Holder
    floor: FloorName
    hold_door: bool
    """Hold the door open at `floor`; otherwise a session that does not stay ends on arrival."""
    robot: RobotWord | None = None
    stays: bool = False
    """Its session ends by `EndSession`, and neither on arrival nor by a request without a door hold."""
    new_id: str = field(default="", compare=False, repr=False)
    """The id of the session that this may open."""


@dataclass(frozen=True, slots=True)
class EndSession:
    """A holder of a face that knows no sessions ends its own, after a grace in which it may change its mind."""

    holder: Holder
    grace_s: float


@dataclass(frozen=True, slots=True)
class OpenSession:
    """A caller takes the lift for itself. The session lasts until it is closed or its time is over."""

    holder: Holder
    key: str = field(default="", repr=False)
    """Idempotency key: the same one of the same holder gives the same session, as long as that is remembered; empty for none."""
    ttl_s: float | None = None
    """The lease that is requested; the site's is the longest, and the default."""
    new_id: str = field(default="", compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RenewSession:
    """The holder of a session renews its lease."""

    session: str = field(repr=False)
    holder: Holder
    ttl_s: float | None = None


@dataclass(frozen=True, slots=True)
class CloseSession:
    """The holder of a session ends it, the car where it is."""

    session: str = field(repr=False)
    holder: Holder
    robot: RobotWord | None = None


@dataclass(frozen=True, slots=True)
class HandOver:
    """The holder of a session hands it to another caller; `session` is None for faces that know no sessions."""

    holder: Holder
    to: Holder
    new_id: str = field(default="", compare=False, repr=False)
    session: str | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class GiveCommand:
    """The holder of a session commands something."""

    request: CommandRequest
    new_id: str = field(default="", compare=False, repr=False)
    is_recorded: bool = True
    """The journal has a row of it."""


@dataclass(frozen=True, slots=True)
class JoinQueue:
    """A ride waits for this lift."""

    holder: Holder


@dataclass(frozen=True, slots=True)
class LeaveQueue:
    """A ride no longer waits for this lift."""

    holder: Holder


# -- from people


@dataclass(frozen=True, slots=True)
class Restrict:
    """A person keeps robots off. The door of a session that a lockout ends is released `clear_s` later unless `at_once`."""

    kind: RestrictionKind
    by: str
    reason: str
    at_once: bool = False


@dataclass(frozen=True, slots=True)
class Unrestrict:
    """A person ends a restriction: robots may command the lift again."""

    kind: RestrictionKind
    by: str


@dataclass(frozen=True, slots=True)
class ForceRelease:
    """A person takes the lift from its holder; a held door is released `clear_s` later unless `at_once`."""

    by: str
    reason: str
    at_once: bool = False


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """A person has checked the lift after a fire or a contradiction, or found no robot in its car."""

    by: str


# -- from the runtime


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed: `Step.wake_at` is due, or the newest reading became too old."""


@dataclass(frozen=True, slots=True)
class AnnounceStop:
    """The manager begins to stop: OPEN is withdrawn, and a door that a robot may be in is held for a moment more."""

    clear_s: float = CLEAR_AT_STOP_S


@dataclass(frozen=True, slots=True)
class Stop:
    """The manager stops: everything is released, and the session rests until the next start."""


Request = LiftRequest | EndSession | OpenSession | RenewSession | CloseSession | HandOver | GiveCommand
"""What callers request; each has a reply."""
OperatorAction = Restrict | Unrestrict | ForceRelease | Acknowledge
"""What people decide; each has a reply."""
News = (
    Reading
    | ReadFailed
    | OutputChanged
    | PressEnded
    | CommitFailed
    | JoinQueue
    | LeaveQueue
    | Tick
    | AnnounceStop
    | Stop
)
"""What the driver, the store, the rides and the runtime report; nobody waits for a reply. `Committed` beside it decides nothing."""
Input = Request | OperatorAction | News | Committed


# -- what a step asks for


@dataclass(frozen=True, slots=True)
class Press:
    """Press a command once, as soon as the record of this step and the row of the press (`audit.press_row`) are on the disk."""

    id: PressId
    command: Command
    leave_by: float
    """When a press that has not left by then is given up, beyond the pauses of its map."""
    holder: Holder | None
    """Whose session it is pressed for."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Withdraw a press: it does not leave any more, and what it put on is released, unless `outputs` declares it."""

    id: PressId


Action = Press | Cancel
