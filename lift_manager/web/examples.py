"""The examples that /docs shows: one of each object."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from lift_manager.api.lifts import (
    ClosedEvidence,
    Held,
    Lift,
    LiftCapabilities,
    LiftCommand,
    LiftCommands,
    Lifts,
    PlannedWrite,
    PlannedWrites,
    Restricted,
    Signal,
    Signals,
)
from lift_manager.api.logins import LoginAnswer
from lift_manager.api.rides import Plan, Ride, Rides
from lift_manager.api.rmf import RmfAccepted, RmfAlarms, RmfHolder, RmfLiftAnswer, RmfSiteAnswer
from lift_manager.api.roles import Role
from lift_manager.api.sessions import Command, Session
from lift_manager.lift.commands import CommandState, CommandType
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.state import Quality
from lift_manager.rides.ride import Guidance, Phase
from register_maps.words import Door, Mode, Motion, Side

_AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)

LIFT = Lift(
    name="east",
    floors=("L1", "L2", "L3"),
    quality=Quality.LIVE,
    reason="",
    age_s=0.12,
    max_age_s=2.0,
    floor="L1",
    standing=True,
    destination="L1",
    robot_door=RobotDoor.OPEN,
    doors={Side.FRONT: Door.OPEN},
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    permissions={"robots_allowed": True},
    session=Held(face="api", name="amr-7", for_s=12.5),
    releases_in_s=287.5,
    waiting=1,
    restrictions=Restricted(fire_latched=False, lockout="", maybe_occupied_by=None, waiting_for=""),
    not_visible={"overload": "the map has no signal for it"},
)
CAPABILITIES = LiftCapabilities(
    name="east",
    display_name="East wing, goods",
    floors=("L1", "L2", "L3"),
    doors_at={"L1": (Side.FRONT,), "L2": (Side.FRONT,), "L3": (Side.FRONT,)},
    access="control",
    commands=("go_to", "hold_door.front"),
    signals=("door.front", "floor", "mode", "motion"),
    evidence="level",
    closed_evidence={Side.FRONT: ClosedEvidence.REPORTED},
    max_age_s=2.0,
    poll_s=0.2,
    lease_s=300.0,
    max_session_s=1800.0,
    max_session_hold_s=900.0,
    arrive_within_s=120.0,
    robot_hours="",
    robot_words=False,
    not_visible={"overload": "the map has no signal for it"},
    map="generic-registers",
    trust="vendor-manual",
)
SIGNALS = Signals(
    name="east",
    age_s=0.12,
    max_age_s=2.0,
    signals=(
        Signal(name="door.front", value="open", raw=2, addresses=("holding:12",), wire=("holding 11",), age_s=0.12),
    ),
)
COMMANDS = LiftCommands(
    name="east",
    same_floor_call=False,
    commands=(
        LiftCommand(
            name="hold_door.front",
            meaning="opens the front door and keeps it open, as the door-open button does",
            takes_floor=False,
            addresses=("holding:17",),
            wire=("holding 17",),
            action="hold",
            ends_itself=False,
            width_s=None,
            max_hold_s=30.0,
            refresh_s=1.0,
            until="",
            on_link_loss="device_watchdog",
            requires=(),
            confirmed_within_s=2.0,
            state="at rest",
        ),
    ),
)
PLANNED_WRITES = PlannedWrites(
    name="east",
    writes=(
        PlannedWrite(
            name="hold_door.front",
            what="press",
            addresses=("holding:17",),
            function=6,
            text="write register 17 := 1, unit 1",
            frame="010600110001",
            is_read_first=False,
        ),
        PlannedWrite(
            name="hold_door.front",
            what="release",
            addresses=("holding:17",),
            function=6,
            text="write register 17 := 0, unit 1",
            frame="010600110000",
            is_read_first=False,
        ),
    ),
)
SESSION = Session(
    id="s-4f1d2c",
    lift="east",
    holder="api:amr-7",
    floor=None,
    hold_door=False,
    opened_at=_AT,
    lease_ends_in_s=60.0,
    ends_in_s=1800.0,
    hold_ends_in_s=None,
    releases_in_s=287.5,
    arrived=False,
    door_held=False,
    robot=Occupancy.OUTSIDE,
    waiting_for="",
    restored=False,
    over=None,
)
_PENDING = Command(
    id="7",
    lift="east",
    do=CommandType.GO_TO,
    floor="L2",
    status=CommandState.PENDING,
    reason="",
    proof="none",
    asked_at=_AT,
    ended_at=None,
)
COMMAND = _PENDING.model_copy(
    update={"status": CommandState.CONFIRMED, "proof": "lamp", "ended_at": _AT + timedelta(seconds=0.4)}
)
RIDE = Ride.model_validate(
    {
        "id": "r-81c0",
        "lift": "east",
        "any_lift": True,
        "from": "L1",
        "to": "L3",
        "door": None,
        "robot": "amr-7",
        "caller": "ride:amr-7",
        "phase": Phase.BOARDING,
        "guidance": Guidance.ENTER,
        "reason": "",
        "advice": None,
        "ahead": None,
        "phase_ends_in_s": 118.0,
        "maybe_aboard": True,
        "begun_at": _AT,
        "changed_at": _AT + timedelta(seconds=20),
    }
)
LIFTS = Lifts(lifts=(LIFT,))
RIDES = Rides(rides=(RIDE,))
PLAN = Plan(lift="east", ahead=1, reason="1 waits before it")
_RMF_LIFT = RmfLiftAnswer(
    lift="east",
    name="east_lift",
    floors={"L1": "L1", "L2": "L2", "L3": "level 3"},
    live=True,
    reason="",
    age_s=0.12,
    max_age_s=2.0,
    floor="L1",
    standing=True,
    destination="L1",
    door=RobotDoor.OPEN,
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    robot_mode_on=True,
    holder=RmfHolder(face="rmf", name="fleet/amr-7"),
    ending=False,
    fire_latched=False,
    waiting_for="",
    keeps_off="",
)
_ALARMS = RmfAlarms(fire_alarm=False, emergency_signal=False, emergency_fleets=(), clear_on_acknowledge=False)
RMF_SITE = RmfSiteAnswer(boot="18c2f3a90b", event=412, lifts=(_RMF_LIFT,), end_grace_s=3.0, alarms=_ALARMS)
RMF_TAKEN = RmfAccepted(boot="18c2f3a90b", event=413)
LOGIN = LoginAnswer(
    key="desk", role=Role.OPERATOR, csrf="Wm1yq0cQ2n1o9n4gV0i8sJ8Yy3cXo6m0bqkq3l2vT5E", ends_in_s=43200.0
)
