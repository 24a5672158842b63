"""Rides and sights of lifts, by hand."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

from lift_manager.domain.boarding import Who
from lift_manager.domain.ride import OVER, Phase, RideLimits, RideRequest
from lift_manager.domain.ride_record import RideRecord, RideSight
from lift_manager.domain.service import Advice, EndReason
from lift_manager.domain.session_requests import SessionInfo, SessionOver
from lift_manager.domain.state import Holder, LiftState, Quality, Restrictions, RobotDoor
from register_maps.words import Door, Mode, Motion, Side

NOON = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
CALLER = Holder("ride", "fleet")
LIMITS = RideLimits(queued_s=600.0, called_s=300.0, boarding_s=120.0, riding_s=200.0, alighting_s=100.0)
WISH = RideRequest(
    lifts=("A",), any_lift=False, start="L1", destination="L3", robot="amr-7", caller=CALLER, key="k1", limits=LIMITS
)
HOLDER = Holder("ride", "fleet/amr-7")
STATE = LiftState(
    lift="A",
    floors=("L1", "L2", "L3"),
    quality=Quality.LIVE,
    reason="",
    age_s=0.1,
    floor="L2",
    standing=True,
    destination="L2",
    robot_door=RobotDoor.CLOSED,
    doors={Side.FRONT: Door.CLOSED},
    motion=Motion.STOPPED,
    mode=Mode.NORMAL,
    holder=None,
    held_since_s=None,
    not_visible={},
)
OFFLINE = replace(
    STATE,
    quality=Quality.OFFLINE,
    age_s=9.0,
    floor=None,
    standing=False,
    doors={},
    motion=Motion.UNKNOWN,
    holder=HOLDER,
)
SESSION = SessionInfo(
    id="s1",
    lift="A",
    holder=HOLDER,
    floor=None,
    hold_door=False,
    opened_at=NOON,
    lease_ends_in_s=60.0,
    ends_in_s=3600.0,
    hold_ends_in_s=None,
    arrived=False,
    door_held=False,
    robot=Who.EMPTY,
    waiting_for="",
    restored=False,
)


def ride(phase: Phase = Phase.QUEUED, **more: object) -> RideRecord:
    """A ride in a phase, begun and last asked for at 0 s."""
    known: dict[str, object] = {} if phase is Phase.QUEUED else {"session": "s1", "asked_at": 0.0}
    if phase in (Phase.BOARDING, Phase.RIDING, Phase.ALIGHTING, Phase.CLEARING):
        known["maybe_aboard"] = True
    if phase in (Phase.RIDING, Phase.ALIGHTING):
        known["entered"] = True
    if phase in OVER:
        known["ended_at"] = 0.0
    made = RideRecord(id="r1", wish=WISH, lift="A", phase=phase, phase_since=0.0, begun_at=NOON, changed_at=NOON)
    return replace(made, **known | more)  # type: ignore[arg-type]  # fields of RideRecord


def sight(
    state: LiftState = STATE, session: SessionInfo | None = None, *, now: float = 1.0, ahead: int = 0, gone: str = ""
) -> RideSight:
    return RideSight(
        state=state,
        session=session,
        gone=gone,
        ahead=ahead,
        offline_since="11:59:52",
        now=now,
        at=NOON + timedelta(seconds=now),
    )


def here(floor: str, door: RobotDoor = RobotDoor.OPEN) -> LiftState:
    """The car stands at a floor for the ride's session."""
    doors = {RobotDoor.OPEN: Door.OPEN, RobotDoor.CLOSED: Door.CLOSED, RobotDoor.MOVING: Door.CLOSING}
    return replace(
        STATE, floor=floor, destination=floor, robot_door=door, doors={Side.FRONT: doors[door]}, holder=HOLDER
    )


def away(floor: str | None = None) -> LiftState:
    """The car is under way for the ride's session."""
    return replace(STATE, floor=floor, standing=False, motion=Motion.UP, robot_door=RobotDoor.CLOSED, holder=HOLDER)


def session(floor: str | None, robot: Who = Who.EMPTY, *, there: bool = False) -> SessionInfo:
    """The ride's session, on its way to a floor or there with its door held."""
    return replace(SESSION, floor=floor, hold_door=floor is not None, robot=robot, arrived=there, door_held=there)


def ended(reason: EndReason, text: str, advice: Advice | None = None, robot: Who = Who.EMPTY) -> SessionInfo:
    return replace(SESSION, robot=robot, over=SessionOver(reason, text, advice, NOON))


def kept_out(**restrictions: object) -> LiftState:
    return replace(STATE, restrictions=Restrictions(**restrictions))  # type: ignore[arg-type]  # fields of Restrictions
