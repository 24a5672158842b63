"""Which lift a ride takes, when it begins and while it waits; and whether it may begin at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.model import FloorName
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.inhibits import never_called
from lift_manager.lift.observation import Moment
from lift_manager.lift.queue import ahead_of
from lift_manager.lift.refusals import STOPPING, Refusal, Refused
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.rides.observation import Lifts, is_live, remember_observed, why_not_taken
from lift_manager.rides.record import RideRecord
from lift_manager.rides.ride import RidePlan, RideRequest
from lift_manager.rides.rides import REFUSED_FOR_S, Rides, observe, too_many
from lift_manager.rides.step import Step, begin
from register_maps.words import ROBOT_FORBIDDEN_MODES, Side

_KEEPS_OPEN = frozenset({"robot_in_place", "robot_left"})
"""What ends a call that keeps the door open while a robot goes in or out."""
_NOBODY = Holder("ride", "")


@dataclass(frozen=True, slots=True)
class Candidate:
    """One lift among which a ride chooses."""

    config: LiftConfig
    state: LiftState
    waiting: int
    """How many wait for it, not counting this ride."""
    refused: str
    """Why it refused a ride recently; empty if it did not."""

    @property
    def lift(self) -> str:
        """Its name."""
        return self.config.name


# -- when a ride begins


def begin_ride(
    choices: Choices, request: RideRequest, ride_id: str, moment: Moment, *, is_stopping: bool, is_remote: bool = False
) -> Step | Refused:
    """Return the first step of a ride that was requested."""
    if (refused := too_many(choices.rides, request.caller)) is not None:
        return refused
    lift = _lift_for(choices, request, is_stopping=is_stopping)
    return lift if isinstance(lift, Refused) else begin(request, lift, ride_id, moment, is_remote=is_remote)


def plan_ride(choices: Choices, request: RideRequest, moment: Moment, *, is_stopping: bool) -> RidePlan | Refused:
    """Return what a ride would come to now; nothing is begun."""
    lift = _lift_for(choices, request, is_stopping=is_stopping)
    if isinstance(lift, Refused):
        return lift
    record = begin(request, lift, "", moment).record
    observed = observe(choices.rides, choices.lifts, record, None, moment)
    why = why_not_taken(remember_observed(record, observed, moment), observed, moment)
    return RidePlan(record.lift, observed.ahead + int(observed.is_held_by_another(record.holder)), why)


def _lift_for(choices: Choices, request: RideRequest, *, is_stopping: bool) -> str | Refused:
    if is_stopping:
        return STOPPING
    names = tuple(choices.lifts)
    for name in request.lifts:
        if name not in names:
            return Refused(Refusal.UNKNOWN_LIFT, f"no lift {name!r}; the lifts are {', '.join(names)}")
    return choices.first(request)


class Choices:
    """The lifts that rides may take at one moment.

    The best lift is the same for all rides of one trip, so it is found once. In a pass over many rides `go_on` keeps it.
    """

    def __init__(self, rides: Rides, lifts: Lifts, now: float) -> None:
        self.rides = rides
        self.lifts = lifts
        self._now = now
        self._best: dict[tuple[tuple[str, ...], FloorName, FloorName, Side | None], Candidate | None] = {}

    def go_on(self, rides: Rides, now: float) -> Choices:
        """Return the choices a moment later in the same pass: what was best for a trip still is, and rides are as they are then."""
        later = Choices(rides, self.lifts, now)
        later._best = self._best
        return later

    def first(self, request: RideRequest) -> str | Refused:
        """Return the lift that a ride takes when it begins."""
        holder = request.holder
        chosen = choose(request, holder, [self.candidate(lift, holder) for lift in request.lifts])
        if isinstance(chosen, Refused):
            return chosen
        inside = self._maybe_in_car(request)
        if inside and chosen.lift not in inside:
            lift, ride = next(iter(inside.items()))
            text = (
                f"your robot may be in the car of {lift}: send `left` for ride {ride} once it is outside, or begin a ride with"
                f" {lift} from inside"
            )
            return Refused(Refusal.NOT_NOW, text)
        return chosen.lift

    def better(self, record: RideRecord) -> str | None:
        """Return the lift with which a waiting ride is better off; None if it stays, or may not move."""
        request, holder = record.request, record.holder
        if not record.is_flexible:
            return None
        inside = self._maybe_in_car(request)
        if inside or record.lift not in self.lifts:
            if record.lift in inside:
                return None
            able = (lift for lift in request.lifts if lift in inside and lift != record.lift)
            return next((lift for lift in able if why_never(request, self.lifts[lift].config) is None), None)
        best = self._best_for(request)
        if best is None or best.lift == record.lift:
            return None
        return best.lift if rank(best, holder) < rank(self.candidate(record.lift, holder), holder) else None

    def candidate(self, lift: str, holder: Holder) -> Candidate:
        """Return one lift as a holder may choose it."""
        view, refused = self.lifts[lift], self.rides.refused.get(lift)
        is_recent = refused is not None and self._now - refused.at < REFUSED_FOR_S
        why = refused.why if refused is not None and is_recent else ""
        return Candidate(view.config, view.state, ahead_of(view.queue, holder, self._now), why)

    def _best_for(self, request: RideRequest) -> Candidate | None:
        trip = (request.lifts, request.start, request.destination, request.door)
        if trip not in self._best:
            known = [self.candidate(lift, _NOBODY) for lift in request.lifts if lift in self.lifts]
            best = choose(request, _NOBODY, known)
            self._best[trip] = None if isinstance(best, Refused) else best
        return self._best[trip]

    def _maybe_in_car(self, request: RideRequest) -> dict[str, str]:
        """Return the lifts in whose car the robot of a ride may be, each with the ride that left it there.

        For a robot without a name this is unknown.
        """
        if not request.robot:
            return {}
        return {
            one.lift: one.id
            for one in self.rides.of_holder_maybe_aboard(request.holder)
            if one.is_over and may_contain(self.lifts[one.lift].state, request.holder)
        }


# -- among lifts


def choose(request: RideRequest, holder: Holder, lifts: Sequence[Candidate]) -> Candidate | Refused:
    """Return the best lift: one that takes robots now, with the shortest wait, the nearest car, and then in the site's order."""
    fit: list[Candidate] = []
    refusals: list[Refused] = []
    for lift in lifts:
        refused = why_never(request, lift.config)
        if refused is None:
            fit.append(lift)
        else:
            refusals.append(refused)
    if fit:
        inside = [lift for lift in fit if may_contain(lift.state, holder)]
        if request.robot and inside:
            return inside[0]
        return min(fit, key=lambda lift: (rank(lift, holder), _distance(lift, request)))
    if len(refusals) == 1:
        return refusals[0]
    codes = {refused.code for refused in refusals}
    code = codes.pop() if len(codes) == 1 else Refusal.NOT_POSSIBLE
    whys = "; ".join(refused.message for refused in refusals) or "there is none to choose among"
    return Refused(code, f"no lift brings a robot from {request.start} to {request.destination}: {whys}")


def why_never(request: RideRequest, lift: LiftConfig) -> Refused | None:
    """Refuse a lift that can never take this ride, however long it waits."""
    name, able = lift.name, lift.capabilities
    for floor in (request.start, request.destination):
        if floor not in lift.floors:
            text = f"{name} has no floor {floor!r}; its floors are {', '.join(lift.floors)}"
            return Refused(Refusal.UNKNOWN_FLOOR, text)
    if request.start == request.destination:
        return Refused(Refusal.NOT_POSSIBLE, f"the ride begins and ends at {request.start}")
    doors = lift.doors_at.get(request.start, ())
    if request.door is not None and request.door not in doors:
        text = f"{name} has no {request.door} door at {request.start}; there it has {', '.join(doors) or 'none'}"
        return Refused(Refusal.NOT_POSSIBLE, text)
    if (refused := never_called(lift)) is not None:
        return refused
    if why := _why_unreachable(request, lift):
        return Refused(Refusal.NOT_POSSIBLE, f"{name} lets no robot through its door: its map {able.map_name} {why}")
    return None


def _why_unreachable(request: RideRequest, lift: LiftConfig) -> str:
    """Return why the door can never stand open and held for a robot; empty where it can."""
    able = lift.capabilities
    is_kept_by_call = bool(_KEEPS_OPEN.intersection(able.until.values()))
    for floor in (request.start, request.destination):
        doors = lift.doors_at.get(floor, ())
        if not doors or not able.doors:
            return f"shows no door at {floor}"
        lacking = [side for side in doors if f"hold_door.{side}" not in able.commands]
        if lacking and not is_kept_by_call:
            return f"has no hold for the {lacking[0]} door at {floor}"
    return ""


def may_contain(state: LiftState, holder: Holder) -> bool:
    """Whether the robot of an earlier ride of this holder may be in a car that nobody holds."""
    return state.holder is None and state.restrictions.maybe_aboard == holder


def rank(lift: Candidate, holder: Holder) -> tuple[bool, int]:
    """Return what decides first between lifts, the smaller the better: whether it refuses robots, and how many wait."""
    return not takes_robots(lift, holder), lift.waiting + int(lift.state.holder not in (None, holder))


def takes_robots(lift: Candidate, holder: Holder) -> bool:
    """Whether a lift takes robots now, as far as is known without a request."""
    state, told = lift.state, lift.state.restrictions
    is_kept_out = told.lockout or told.fire_latched or told.drain or told.distrusted or lift.refused
    is_occupied = told.maybe_aboard not in (None, holder, state.holder)
    return is_live(state) and not is_kept_out and not is_occupied and state.mode not in ROBOT_FORBIDDEN_MODES


def _distance(lift: Candidate, request: RideRequest) -> int:
    """Return how many floors the car is away; more than any if that is unknown."""
    floors, at = lift.config.floors, lift.state.floor
    if at is None or at not in floors:
        return len(floors)
    return abs(floors.index(at) - floors.index(request.start))
