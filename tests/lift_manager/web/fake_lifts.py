"""Lifts of a fake manager: as they are said to be."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from drivers.model import Capabilities, SignalValue
from lift_manager.domain.description import LiftDescription, LiftSignals
from lift_manager.domain.state import LiftState, Quality, RobotDoor
from register_maps.words import Mode, Motion, Side

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
    levels=frozenset(),
    max_hold_s={},
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
DOOR = SignalValue(name="door.front", value="open", raw=2, addresses=("holding:12",), age_s=0.1)


@dataclass
class FakeLifts:
    """Each has the capabilities of `able` and the signals of `says`."""

    lifts: Mapping[str, LiftState] = field(default_factory=lambda: {"lift": IDLE, "Güter": replace(IDLE, lift="Güter")})
    able: Capabilities = field(default=ABLE, kw_only=True)
    says: tuple[SignalValue, ...] = field(default=(DOOR,), kw_only=True)

    def lift_names(self) -> tuple[str, ...]:
        return tuple(self.lifts)

    def state(self, lift: str) -> LiftState | None:
        return self.lifts.get(lift)

    def describe(self, lift: str) -> LiftDescription | None:
        state = self.state(lift)
        return None if state is None else described(state, self.able)

    def signals(self, lift: str) -> LiftSignals | None:
        state = self.state(lift)
        return None if state is None else LiftSignals(lift, state.age_s, self.able.max_age_s, self.says)


def described(state: LiftState, able: Capabilities) -> LiftDescription:
    return LiftDescription(
        lift=state.lift,
        floors=state.floors,
        doors_at=dict.fromkeys(state.floors, able.doors),
        control=True,
        able=able,
        poll_s=0.2,
        lease_s=300.0,
        max_session_s=1800.0,
        max_session_hold_s=900.0,
        clear_s=10.0,
        robot_hours="",
    )
