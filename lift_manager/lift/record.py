"""Everything the manager remembers about one lift, as one frozen value. `DurableRecord` is the part that outlives the manager."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

from drivers.model import Command, FloorName, OutputState, PressId
from lift_manager.lift.call import Call, CallOutput, CallPhase
from lift_manager.lift.commands import CommandEntry, CommandProgress, PastSession, SavedCommand, SavedPast
from lift_manager.lift.events import Acknowledged, Restriction, RestrictionKind
from lift_manager.lift.inputs import Outputs
from lift_manager.lift.observation import Observation
from lift_manager.lift.occupancy import BoardingProgress, Occupancy, SavedBoarding
from lift_manager.lift.queue import Queue
from lift_manager.lift.session import EndReason, Holder, Session
from lift_manager.lift.trust import Track, Trust
from lift_manager.lift.value import Value
from register_maps.words import Side

_set = object.__setattr__
_GIVEN = frozenset({OutputState.REQUESTED, OutputState.ON, OutputState.HELD})


@dataclass(frozen=True, slots=True)
class Occupied:
    """A robot may be in the car, and its session is over or may end with this process."""

    holder: Holder
    aboard: bool
    """It was reported or inferred to be aboard; otherwise it was merely possible."""
    since: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class SavedSession:
    """A session as it outlives the manager. Times are wall-clock times in UTC, taken all at once at `saved_at`."""

    holder: Holder
    floor: FloorName | None
    hold_door: bool
    opened_at: datetime
    lease_from: datetime
    holding_since: datetime | None
    saved_at: datetime
    opened_at_target: bool
    hold_spent: bool
    pressed: bool
    """Its call was given to the lift, or may have been."""
    boarding: SavedBoarding
    id: str = field(default="", repr=False)
    stays: bool = False
    lease_s: float | None = None
    key: str = field(default="", repr=False)
    key_ttl_s: float | None = None
    ends_at: datetime | None = None
    """When it ends whatever its holder requests: a person has ended it, and a robot may still be in its doorway."""
    ends_for: tuple[EndReason, str] | None = None
    """Why it ends then, as a code and in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DurableRecord:
    """What of one lift outlives the manager. A step that changes it waits for the disk before anything is pressed."""

    fire_since: datetime | None = None
    """When the fire was seen that nobody has acknowledged."""
    restrictions: tuple[Restriction, ...] = ()
    """At most one of a kind."""
    occupied: Occupied | None = None
    robot_left_pending_since: datetime | None = None
    """Since when the lift has not taken that a robot left; None if nothing is to be reported."""
    robot_mode_until: datetime | None = None
    """Until when robot mode is kept at most although its session is over; None if it is not kept."""
    acknowledged: Acknowledged | None = None
    """The newest one."""
    session: SavedSession | None = None
    """Who holds the lift."""
    commands: tuple[SavedCommand, ...] = ()
    """Of that session, those with idempotency keys."""
    past_sessions: tuple[SavedPast, ...] = ()
    """The newest of those that are over and were opened with idempotency keys."""
    trust: Trust = field(default_factory=Trust)
    """What its readings have proved, and what they contradicted."""

    @property
    def keeps_robots_out(self) -> bool:
        """Whether some robot is refused, or not let through the door, because of it."""
        has_reason = self.fire_since is not None or self.occupied is not None
        return has_reason or bool(self.restrictions or self.trust.distrust)

    def restriction(self, kind: RestrictionKind) -> Restriction | None:
        """Return the restriction of a kind, if a person has begun one."""
        return next((one for one in self.restrictions if one.kind is kind), None)


@dataclass(frozen=True, slots=True)
class HandshakeWord:
    """One report to the controller about its passenger. It follows the rules of a call: pressed once, and again after a pause."""

    call: Call | None = None
    """None if the lift need not know."""
    is_on: bool = False
    """A report that is a level stays on from its press until it is released."""
    renewed_at: float = -math.inf

    @property
    def is_pending(self) -> bool:
        """Whether it is to be pressed, or on its way."""
        return self.call is not None and self.call.phase in (CallPhase.REQUESTED, CallPhase.PRESSED)

    @property
    def is_requested(self) -> bool:
        """Whether it is to be pressed."""
        return self.call is not None and self.call.phase is CallPhase.REQUESTED

    @property
    def is_unacknowledged(self) -> bool:
        """Whether it was wanted, and the lift has not taken it."""
        return self.call is not None and self.call.phase is not CallPhase.CONFIRMED

    @property
    def is_late(self) -> bool:
        """Whether it is still to be taken after it failed, or after a restart."""
        if self.call is None or not self.is_unacknowledged:
            return False
        return self.call.phase is CallPhase.FAILED or self.call.failures > 0


@dataclass(frozen=True, slots=True)
class DoorHold:
    """The doors of a floor are held."""

    floor: FloorName
    may_begin: bool
    """What is found off is switched on; otherwise only what is on stays."""
    renewed_at: float
    """How long it stays on is counted from the newest reading at which it was wanted."""


@dataclass(frozen=True, slots=True)
class DoorClosing:
    """The close button, for one door or several."""

    sides: tuple[Side, ...] = ()
    since: float = 0.0
    progress: CommandProgress = field(default_factory=CommandProgress)
    presses: tuple[PressId, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotModeHold:
    """The lift's robot mode, as far as it is ours."""

    is_requested: bool = False
    may_begin: bool = False
    was_pressed: bool = False
    """Its bytes have left, or it may be found on after a restart."""
    kept_until: float | None = None
    """Its session is over, and the car still moves: it is kept until then at most."""
    renewed_at: float = -math.inf
    """As `DoorHold.renewed_at`."""


@dataclass(frozen=True, slots=True)
class PendingPress:
    """A press without an outcome."""

    id: PressId
    command: Command
    sequence: int
    """The step that made it: it leaves once that is on the disk."""
    session: int | None
    """The number of the session that it is for; None for the word of a robot that left after its session."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A holder that does not renew while others request the lift: for which callers people were alerted to it."""

    session: int
    holder: Holder
    contacted_at: float | None
    callers: frozenset[Holder] = frozenset()


@dataclass(frozen=True, kw_only=True)
class LiftRecord(Value):
    """One lift. Only `step` changes it, a dozen times in some steps."""

    durable: DurableRecord = field(default_factory=DurableRecord)

    # what the lift reports
    observation: Observation | None = None
    """None before the first reading."""
    track: Track = field(default_factory=Track)
    """The evidence for its door signal and against it, since the connection began."""
    fault: str = "no answer yet"
    """Why the last poll failed, or could not be used; empty if it did not."""
    outputs: Outputs = field(default_factory=dict)
    departed_at: Mapping[FloorName, float] = field(default_factory=dict)
    """When the car last left each floor while nobody held the lift."""

    # who holds it, and for what
    session: Session | None = None
    sessions_opened: int = 0
    used_by: int = 0
    """The newest session for which anything was pressed or held."""
    people_until: float = -math.inf
    """Until then it is the turn of people, between two robots."""
    released_open: bool = False
    """A session has ended with its door open, and the door has not been seen to close since."""
    waiting_for: str = ""
    """What the lift, or the holder, still has to do before anything is pressed."""
    ungranted: tuple[int, FloorName, float] | None = None
    """Session, stop and time since which a door was to be held without robot mode."""
    silence: Silence | None = None
    queue: Queue = field(default_factory=Queue)
    turns: Mapping[Holder, tuple[float, float]] = field(default_factory=dict)
    """How many turns each caller had used up, and when; one that is absent has all of them."""

    # what is pressed and held for it
    call: Call | None = None
    """The call of the session."""
    call_output: CallOutput | None = None
    """The button of the call that was pressed last, which may outlast its session."""
    door_call: Command | None = None
    """The newest call that kept the door open."""
    door_hold: DoorHold | None = None
    door_hold_found: bool = False
    """A door hold from before a restart waits until the car is seen to stand there."""
    door_on_since: float | None = None
    """For a controller that releases a held door by itself: since when one has been held, or was to be, and not seen at rest."""
    door_held_since: float | None = None
    """Since when what keeps the door open has been seen to be on."""
    closing: DoorClosing = field(default_factory=DoorClosing)
    robot_mode: RobotModeHold = field(default_factory=RobotModeHold)
    presses: tuple[PendingPress, ...] = ()
    presses_made: int = 0

    # where its robot is
    boarding: BoardingProgress = field(default_factory=BoardingProgress)
    abandoned_by: Holder | None = None
    """The holder whose session ended while its robot was, or may have been, in the car."""
    in_place: HandshakeWord = field(default_factory=HandshakeWord)
    robot_left: HandshakeWord = field(default_factory=HandshakeWord)

    # what was commanded in it, and in those before
    commands: tuple[CommandEntry, ...] = ()
    past_sessions: tuple[PastSession, ...] = ()

    # fire, stopping and the disk
    fire_release_at: float | None = None
    """The robot has been informed of the fire; then everything is released."""
    is_stopping: bool = False
    saved_as: tuple[Session, SavedBoarding, bool] | None = None
    """The session, its robot, and whether its call was pressed, as they were saved last."""
    sequence: int = 0
    """Rises with every step that has something for the disk."""
    committed: int = 0
    """The newest sequence number that is on the disk."""
    disk_trouble: str = ""
    """Why nothing may be pressed, because it cannot be recorded; empty while it can."""

    def __post_init__(self) -> None:
        # CPython makes the table of an object with more than 30 attributes twice as large as it has to be, and so each copy of it
        _set(self, "__dict__", dict(vars(self).items()))

    def status(self, command: Command) -> OutputState:
        """Return where an output is."""
        return self.outputs.get(command.name, OutputState.AT_REST)

    def is_given(self, command: Command) -> bool:
        """Whether an output is requested or on, and neither lost nor released."""
        return self.status(command) in _GIVEN

    def restriction(self, kind: RestrictionKind) -> Restriction | None:
        """Return the restriction of a kind, if a person has begun one."""
        return self.durable.restriction(kind)

    @property
    def holder(self) -> Holder | None:
        """Whose session holds the lift."""
        return None if self.session is None else self.session.holder

    @property
    def call_has_arrived(self) -> bool:
        """Whether the session's call is fulfilled, or was and the car has not left since."""
        return self.call is not None and self.call.has_arrived

    @property
    def has_robot_left_pending(self) -> bool:
        """Whether the lift has not taken that a robot left. With one aboard again, what it believes is right."""
        return self.robot_left.is_unacknowledged and self.boarding.occupancy is not Occupancy.ABOARD

    @property
    def repeats_robot_left(self) -> bool:
        """Whether the report that a robot left is repeated until it is taken: not while one may be going in."""
        return self.robot_left.is_unacknowledged and not self.boarding.may_be_in_car

    @property
    def robot_in_car(self) -> tuple[Holder, bool] | None:
        """The holder whose robot may be in the car, and whether it is known to be; None if there is none."""
        holder = self.session.holder if self.session is not None else self.abandoned_by
        if holder is None or not self.boarding.may_be_in_car:
            return None
        return holder, self.boarding.occupancy is Occupancy.ABOARD

    def renewed(self, at: float) -> LiftRecord:
        """Return this with every hold renewed at that time."""
        door, call = self.door_hold, self.call_output
        return self.having(
            door_hold=None if door is None else replace(door, renewed_at=at),
            call_output=None if call is None else replace(call, renewed_at=at),
            robot_mode=replace(self.robot_mode, renewed_at=at),
            in_place=replace(self.in_place, renewed_at=at),
            robot_left=replace(self.robot_left, renewed_at=at),
        )

    @property
    def is_busy(self) -> bool:
        """Whether a reading may matter although it repeats the one before."""
        return self.session is not None or self.robot_mode.kept_until is not None or self.has_robot_left_pending
