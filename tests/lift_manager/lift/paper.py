"""A lift on paper: inputs by hand, a driver that obeys, and a clock that moves when a test says so."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta

from drivers.model import (
    Capabilities,
    Command,
    CommandKind,
    LiftReading,
    LiftValues,
    Outcome,
    OutputState,
    Proof,
    Result,
)
from lift_manager.lift.commands import CommandRequest, CommandStatus, CommandType, SessionInfo
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm, Event
from lift_manager.lift.inputs import (
    Cancel,
    Committed,
    GiveCommand,
    Input,
    LiftRequest,
    OpenSession,
    Press,
    PressEnded,
    Reading,
    Tick,
)
from lift_manager.lift.observation import Moment, RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.outputs import Hold, outputs
from lift_manager.lift.record import DurableRecord, LiftRecord
from lift_manager.lift.refusals import Accepted, Refusal, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, state
from lift_manager.lift.step import Reply, Step, is_repetition, start, step
from lift_manager.lift.trust import Trust
from register_maps.words import Door, Mode, Motion, Side

FRONT = Side.FRONT
GIVEN = (OutputState.REQUESTED, OutputState.ON, OutputState.HELD)
NOON = datetime(2026, 1, 5, 12, tzinfo=UTC)
"""A Monday."""
ROBOT, OTHER, RMF = Holder("workshop", "workshop"), Holder("fleet", "r2"), Holder("rmf", "fleet/r1")

PLAIN = Capabilities(
    commands=frozenset({"go_to", "hold_door.front", "close_door.front", "robot_mode"}),
    signals=frozenset({"car_floor", "motion", "door.front", "robot_mode_on"}),
    doors=(FRONT,),
    one_block=True,
    evidence="motion_stopped",
    evidence_for_s=0.0,
    max_age_s=1.0,
    requires={},
    granted_within_s=60.0,
    arrive_within_s=120.0,
    until={},
    held_commands=frozenset({"hold_door.front", "robot_mode"}),
    max_hold_s={},
    released_after_s={},
    excludes={},
    needs_occupancy=False,
    door_opens_within_s=10.0,
    door_closes_within_s=10.0,
    open_contacts=frozenset(),
    watched=False,
    same_floor_call=False,
    not_visible={},
    map_name="by-hand",
    map_hash="1f",
    printed={},
    trust="template",
)
"""One call for the empty and the occupied car, a door hold, a close button, and robot mode."""
HANDSHAKE = replace(
    PLAIN,
    commands=frozenset({"call", "go", "robot_in_place", "robot_left"}),
    signals=frozenset({"car_floor", "motion", "door.front"}),
    until={"call": "robot_in_place", "go": "robot_left"},
    held_commands=frozenset({"call", "go"}),
    needs_occupancy=True,
)
"""Calls that stay on until the robot is in place or has left, and pulses for both (elevator-interfaces 1.1)."""


@dataclass
class PaperLift:
    """One record, stepped by hand. Its driver does at once what is declared, and presses when the test answers."""

    able: Capabilities = PLAIN
    durable: DurableRecord = field(default_factory=lambda: DurableRecord(trust=Trust("1f", door_proven=True)))
    site: Mapping[str, object] = field(default_factory=dict)
    commits: bool = True
    """Every step is on the disk at once."""
    now: float = 100.0
    read_at: float = -math.inf
    events: list[Event] = field(default_factory=list)
    pressed: list[Press] = field(default_factory=list)
    """Without an outcome, the oldest first."""
    cancelled: list[Cancel] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    """Every press so far."""
    obeys: bool = True
    """The controller does at once what is declared."""
    status: dict[str, OutputState] = field(default_factory=dict)
    values: LiftValues = field(
        default_factory=lambda: LiftValues(
            floor="L1",
            motion=Motion.STOPPED,
            mode=Mode.NORMAL,
            doors={FRONT: Door.CLOSED},
            flags={"robot_mode_on": True},
        )
    )
    config: LiftConfig = field(init=False)
    record: LiftRecord = field(init=False)
    newest: Step = field(init=False)
    reads: bool = True
    """The lift can be read."""

    def __post_init__(self) -> None:
        site: dict[str, object] = {"between_sessions_s": 0.0, **self.site}
        floors = ("L1", "L2", "L3")
        self.config = LiftConfig(
            name="lift",
            source="by hand",
            floors=floors,
            doors_at=dict.fromkeys(floors, (FRONT,)),
            control=bool(site.pop("control", True)),
            capabilities=self.able,
            **site,  # type: ignore[arg-type]  # settings of the site by name
        )
        self.record = LiftRecord()
        self._did(start(self.config, self.durable, self.moment))

    @property
    def moment(self) -> Moment:
        return Moment(self.now, NOON + timedelta(seconds=self.now), self.read_at)

    @property
    def state(self) -> LiftState:
        return state(self.config, self.record, self.moment)

    @property
    def door(self) -> RobotDoor:
        """What robots are told."""
        return self.state.robot_door

    @property
    def holder(self) -> Holder | None:
        return self.state.holder

    @property
    def holds(self) -> dict[str, Hold]:
        """What is declared, by command."""
        return {command.name: hold for command, hold in outputs(self.config, self.record).items()}

    @property
    def alarms(self) -> list[str]:
        return [event.text for event in self.events if isinstance(event, Alarm)]

    def take(self, happened: Input) -> Reply | None:
        """Step the record by one input."""
        self._did(step(self.config, self.record, happened, self.moment))
        if isinstance(happened, Reading):
            self.read_at = happened.reading.at
        if self.commits and self.record.sequence > self.record.committed:
            self._did(step(self.config, self.record, Committed(self.record.sequence), self.moment), replies=False)
        return self.newest.reply

    def read(self, floor: str | None = "", door: Door | None = None, **changes: object) -> None:
        """Let the lift say something else, and read it; by default it says what it said before."""
        values = self.values
        values = values if floor == "" else replace(values, floor=floor)
        values = values if door is None else replace(values, doors={FRONT: door})
        flags = {name: on for name, on in changes.items() if isinstance(on, bool)}
        others = {name: value for name, value in changes.items() if not isinstance(value, bool)}
        if flags or others:
            values = replace(values, flags={**values.flags, **flags}, **others)  # type: ignore[arg-type]
        self.values = values
        self.poll()

    def poll(self) -> None:
        """Read the lift once."""
        reading = LiftReading(self.now, 1, self.values)
        if not self.repeats(reading):
            self.take(Reading(reading, dict(self.status)))
        self.read_at = self.now

    def repeats(self, reading: LiftReading) -> bool:
        """Whether a reading need not be stepped."""
        known, steady_until = self.record.observation, self.newest.steady_until
        return is_repetition(self.config, known, reading, steady_until=steady_until, read_at=self.read_at, now=self.now)

    def wait(self, seconds: float) -> None:
        """Let time pass, with a reading every half second if the lift can be read, and a tick when one is due."""
        end = self.now + seconds
        while self.now < end:
            self.now = min(end, self.now + 0.5)
            if self.reads:
                self.poll()
            else:
                self.take(Tick())

    def answer(self, result: Result = Result.CONFIRMED, reason: str = "", *, not_granted: bool = False) -> None:
        """Let every press so far have its outcome."""
        for press in tuple(self.pressed):
            self.pressed.remove(press)
            stays = press.command.name in self.able.held_commands and result is Result.CONFIRMED
            self.status[press.command.name] = OutputState.HELD if stays else OutputState.AT_REST
            proof = Proof.LAMP if result is Result.CONFIRMED else Proof.NONE
            outcome = Outcome(press.command, result, reason, proof, grant_missing=not_granted)
            self.take(PressEnded(press.id, outcome))

    # -- what callers do

    def ask(
        self,
        floor: str,
        *,
        hold: bool = True,
        holder: Holder = ROBOT,
        robot: RobotWord | None = None,
        stays: bool = False,
    ) -> Reply | None:
        """Ask as a face that knows no sessions."""
        return self.take(LiftRequest(holder, floor, hold, robot, stays, new_id=f"session {self.now:g}"))

    def accept(self, floor: str, **how: object) -> None:
        reply = self.ask(floor, **how)  # type: ignore[arg-type]  # those of `ask`
        assert reply == Accepted(), reply

    def refused(self, floor: str, **how: object) -> Refusal:
        reply = self.ask(floor, **how)  # type: ignore[arg-type]  # those of `ask`
        assert isinstance(reply, Refused), reply
        return reply.code

    def open(self, holder: Holder = OTHER, key: str = "", ttl_s: float | None = None) -> SessionInfo:
        """Open a session as a face that knows sessions."""
        reply = self.take(OpenSession(holder, key, ttl_s, new_id=f"session {self.now:g}"))
        assert isinstance(reply, SessionBegun), reply
        return reply.session

    def command(self, kind: CommandType, floor: str | None = None, **more: object) -> CommandStatus | Refused:
        """Give a command within the session that goes on."""
        session = self.record.session
        assert session is not None
        made = CommandRequest(session=session.id, holder=session.holder, kind=kind, floor=floor, **more)  # type: ignore[arg-type]
        reply = self.take(GiveCommand(made, new_id=f"command {self.now:g} {kind}"))
        assert isinstance(reply, CommandStatus | Refused), reply
        return reply

    def called_to(self, floor: str, **how: object) -> None:
        """Call the car and let it arrive with its door open, held and read."""
        if self.read_at == -math.inf:
            self.read()
        self.accept(floor, **how)
        self.wait(0.5)
        self.answer()
        self.read(None, Door.CLOSED, motion=Motion.UP)
        self.wait(1.0)
        self.read(floor, Door.OPEN, motion=Motion.STOPPED)
        self.wait(1.5)

    def restarted(self, after_s: float = 5.0) -> "PaperLift":
        """Kill the manager and start it again with what was saved; outputs stay as they are."""
        after = PaperLift(self.able, self.record.durable, self.site, now=self.now + after_s)
        after.status, after.values = dict(self.status), self.values
        return after

    def _did(self, done: Step, *, replies: bool = True) -> None:
        self.record = done.record
        self.newest = done if replies else replace(done, reply=self.newest.reply)
        self.events += done.events
        for action in done.actions:
            match action:
                case Press():
                    self.pressed.append(action)
                    self.log.append(str(action.command))
                case Cancel(id=gone):
                    self.cancelled.append(action)
                    self.pressed = [press for press in self.pressed if press.id != gone]
        if self.obeys:
            self._obey()

    def _obey(self) -> None:
        """Do at once what is declared, as a controller does that obeys."""
        declared = {command.name: hold for command, hold in outputs(self.config, self.record).items()}
        for name in {*declared, *self.status}:
            hold, is_given = declared.get(name), self.status.get(name, OutputState.AT_REST) in GIVEN
            if hold is None and any(press.command.name == name for press in self.pressed):
                continue
            on = hold is not None and (hold.begin or is_given)
            self.status[name] = OutputState.HELD if on else OutputState.AT_REST


def command(name: str, floor: str | None = None) -> Command:
    """Return a command by its name in the map."""

    kind, _, side = name.partition(".")
    return Command(CommandKind(kind), floor, Side(side) if side else None)
