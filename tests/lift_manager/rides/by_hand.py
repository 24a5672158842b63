"""Rides, and what they see of their lifts, by hand."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from drivers.model import Capabilities
from lift_manager.lift.commands import CommandRequest, CommandType, SessionInfo, SessionOver
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import Alarm
from lift_manager.lift.inputs import CloseSession, EndSession, GiveCommand, OpenSession, RenewSession
from lift_manager.lift.observation import Moment, RobotDoor
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.queue import Queue
from lift_manager.lift.session import Advice, EndReason, Holder
from lift_manager.lift.state import LiftState, Quality, Restrictions
from lift_manager.rides.inputs import CancelRide, Input, LiftAction, RideRequestToLift, RobotReport, Tick
from lift_manager.rides.observation import LiftView, RideInDoubt, RideObservation
from lift_manager.rides.record import RideRecord
from lift_manager.rides.ride import OVER, Phase, RideLimits, RideRequest, RideWord
from lift_manager.rides.step import Step, step
from register_maps.words import Door, Mode, Motion, Side

NOON = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
CALLER = Holder("ride", "fleet")
LIMITS = RideLimits(queued_s=600.0, called_s=300.0, boarding_s=120.0, riding_s=200.0, alighting_s=100.0)
REQUEST = RideRequest(
    lifts=("A",), any_lift=False, start="L1", destination="L3", robot="amr-7", caller=CALLER, key="k1", limits=LIMITS
)
ANY = replace(REQUEST, lifts=("A", "B", "C"), any_lift=True)
HOLDER = Holder("ride", "fleet/amr-7")
OTHER = Holder("rmf", "tiny")
CLEAR_S = 10.0
ABLE = Capabilities(
    commands=frozenset({"go_to", "hold_door.front"}),
    signals=frozenset({"car_floor", "motion", "door.front"}),
    doors=(Side.FRONT,),
    one_block=True,
    evidence="motion_stopped",
    evidence_for_s=0.0,
    max_age_s=1.0,
    requires={},
    granted_within_s=60.0,
    arrive_within_s=120.0,
    until={},
    held_commands=frozenset({"hold_door.front"}),
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
FLOORS = ("L1", "L2", "L3", "L4")
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
    robot=Occupancy.OUTSIDE,
    waiting_for="",
    restored=False,
)


# -- what is requested of the lift


def to_lift(request: RideRequestToLift) -> LiftAction:
    return LiftAction("A", request)


def go_to(floor: str) -> LiftAction:
    return to_lift(GiveCommand(CommandRequest(session="s1", holder=HOLDER, kind=CommandType.GO_TO, floor=floor)))


OPEN = to_lift(OpenSession(HOLDER, key="r1"))
IN_PLACE = to_lift(GiveCommand(CommandRequest(session="s1", holder=HOLDER, kind=CommandType.ROBOT_IN_PLACE)))
RENEW = to_lift(RenewSession("s1", HOLDER))
CLOSE = to_lift(CloseSession("s1", HOLDER))
CLOSE_LEFT = to_lift(CloseSession("s1", HOLDER, RobotWord.LEFT))
END = to_lift(EndSession(HOLDER, CLEAR_S))


# -- what is seen


@dataclass(frozen=True, kw_only=True)
class Sight:
    """What a ride sees, and when."""

    state: LiftState
    session: SessionInfo | None
    now: float
    ahead: int = 0
    gone: str = ""
    busy: str = ""
    doubt: RideInDoubt | None = None

    @property
    def seen(self) -> RideObservation:
        return RideObservation(
            state=self.state,
            clear_s=CLEAR_S,
            session=self.session,
            gone=self.gone,
            ahead=self.ahead,
            busy=self.busy,
            doubt=self.doubt,
        )

    @property
    def moment(self) -> Moment:
        return at(self.now)


def at(now: float) -> Moment:
    return Moment(now, NOON + timedelta(seconds=now))


def sight(
    state: LiftState = STATE, session: SessionInfo | None = None, *, now: float = 1.0, ahead: int = 0, gone: str = ""
) -> Sight:
    return Sight(state=state, session=session, now=now, ahead=ahead, gone=gone)


def here(floor: str, door: RobotDoor = RobotDoor.OPEN) -> LiftState:
    """The car stands at a floor for the ride's session."""
    doors = {RobotDoor.OPEN: Door.OPEN, RobotDoor.CLOSED: Door.CLOSED, RobotDoor.MOVING: Door.CLOSING}
    return replace(
        STATE, floor=floor, destination=floor, robot_door=door, doors={Side.FRONT: doors[door]}, holder=HOLDER
    )


def away(floor: str | None = None) -> LiftState:
    """The car is under way for the ride's session."""
    return replace(STATE, floor=floor, standing=False, motion=Motion.UP, robot_door=RobotDoor.CLOSED, holder=HOLDER)


def session(floor: str | None, robot: Occupancy = Occupancy.OUTSIDE, *, there: bool = False) -> SessionInfo:
    """The ride's session, on its way to a floor or there with its door held."""
    return replace(SESSION, floor=floor, hold_door=floor is not None, robot=robot, arrived=there, door_held=there)


def ended(
    reason: EndReason, text: str, advice: Advice | None = None, robot: Occupancy = Occupancy.OUTSIDE
) -> SessionInfo:
    return replace(SESSION, robot=robot, over=SessionOver(reason, text, advice, NOON))


def kept_out(**restrictions: object) -> LiftState:
    return replace(STATE, restrictions=Restrictions(**restrictions))  # type: ignore[arg-type]  # fields of Restrictions


# -- rides and their steps


def ride(phase: Phase = Phase.QUEUED, **more: object) -> RideRecord:
    """A ride in a phase, begun and last requested for at 0 s."""
    known: dict[str, object] = {} if phase is Phase.QUEUED else {"session": "s1", "requested_at": 0.0}
    if phase in (Phase.BOARDING, Phase.RIDING, Phase.ALIGHTING, Phase.CLEARING):
        known["maybe_aboard"] = True
    if phase in (Phase.RIDING, Phase.ALIGHTING):
        known["has_entered"] = True
    if phase in OVER:
        known["ended_at"] = 0.0
    made = RideRecord(id="r1", request=REQUEST, lift="A", phase=phase, phase_since=0.0, begun_at=NOON, changed_at=NOON)
    return replace(made, **known | more)  # type: ignore[arg-type]  # fields of RideRecord


def take(record: RideRecord, happened: Input, seen: Sight) -> Step:
    return step(record, happened, seen.seen, seen.moment)


def tick(record: RideRecord, seen: Sight) -> Step:
    return take(record, Tick(), seen)


def report(record: RideRecord, word: RideWord, seen: Sight) -> Step:
    return take(record, RobotReport(word), seen)


def cancel(record: RideRecord, seen: Sight, reason: str = "no order", *, by_operator: bool = False) -> Step:
    return take(record, CancelRide(reason, by_operator=by_operator), seen)


def alarms(done: Step) -> list[str]:
    """Return what people are told by a step."""
    return [event.text for event in done.events if isinstance(event, Alarm)]


# -- lifts


def config(lift: str = "A", floors: tuple[str, ...] = FLOORS, **more: object) -> LiftConfig:
    made = LiftConfig(
        name=lift,
        source="by hand",
        floors=floors,
        doors_at=dict.fromkeys(floors, (Side.FRONT,)),
        control=True,
        capabilities=ABLE,
        clear_s=CLEAR_S,
    )
    return replace(made, **more)  # type: ignore[arg-type]  # fields of LiftConfig


def view(lift: str = "A", state: LiftState = STATE, *waiting: Holder, departures: int = 0) -> LiftView:
    """A lift, and who waits for it."""
    return LiftView(config(lift), replace(state, lift=lift), Queue(waiting, departures=departures))


def lifts(*views: LiftView) -> dict[str, LiftView]:
    return {one.config.name: one for one in views}
