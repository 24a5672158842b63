"""Lifts of a fake site."""

from datetime import UTC, datetime

from drivers.model import Capabilities, CommandInfo, OutputState, PlannedWrite, SignalValue
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.state import LiftState, Quality
from register_maps.words import Mode, Motion, Side

AT = datetime(2026, 3, 1, 20, 15, tzinfo=UTC)
IDLE = LiftState(
    lift="lift",
    floors=("L1", "L2"),
    quality=Quality.LIVE,
    reason="",
    age_s=0.1,
    floor="L1",
    standing=True,
    destination="L1",
    robot_door=RobotDoor.CLOSED,
    doors={},
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    holder=None,
    held_since_s=None,
    not_visible={},
)
ABLE = Capabilities(
    commands=frozenset({"go_to", "hold_door.front"}),
    signals=frozenset({"door.front", "floor"}),
    doors=(Side.FRONT,),
    one_block=True,
    evidence="level",
    evidence_for_s=0.0,
    max_age_s=2.0,
    requires={},
    granted_within_s=0.0,
    arrive_within_s=120.0,
    until={},
    held_commands=frozenset(),
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
    map_name="generic-registers",
    map_hash="1f",
    printed={},
    trust="vendor-manual",
)
DOOR = SignalValue(name="door.front", value="open", raw=2, addresses=("holding:12",), age_s=0.1, wire=("holding 11",))

HOLD = CommandInfo(
    name="hold_door.front",
    meaning="opens the front door and keeps it open",
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
    state=OutputState.AT_REST,
)
PRESS = PlannedWrite(
    name="hold_door.front",
    what="press",
    addresses=("holding:17",),
    function=6,
    text="write register 17 := 1, unit 1",
    frame="010600110001",
    is_read_first=False,
)


def config_of(state: LiftState, able: Capabilities) -> LiftConfig:
    return LiftConfig(
        name=state.lift,
        source="by hand",
        floors=state.floors,
        doors_at=dict.fromkeys(state.floors, able.doors),
        control=True,
        capabilities=able,
        max_session_s=1800.0,
    )
