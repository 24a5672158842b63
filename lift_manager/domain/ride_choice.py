"""Which lift a ride takes. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.description import LiftDescription
from lift_manager.domain.ride import RideRequest
from lift_manager.domain.ride_sight import is_live
from lift_manager.domain.state import Holder, LiftState
from register_maps.words import ROBOT_FORBIDDEN_MODES


@dataclass(frozen=True, slots=True)
class Choice:
    """One lift among which a ride is chosen."""

    described: LiftDescription
    state: LiftState
    waiting: int
    """How many wait for it, this ride left out."""
    refused: str
    """Why it turned a ride away not long ago; empty where it did not."""

    @property
    def lift(self) -> str:
        """Its name."""
        return self.described.lift


def unfit(wish: RideRequest, lift: LiftDescription) -> Refused | None:
    """Refuse a lift that can never take this ride, however long it waits."""
    name = lift.lift
    for floor in (wish.start, wish.destination):
        if floor not in lift.floors:
            return Refused(
                Refusal.UNKNOWN_FLOOR, f"{name} has no floor {floor!r}; its floors are {', '.join(lift.floors)}"
            )
    if wish.start == wish.destination:
        return Refused(Refusal.NOT_POSSIBLE, f"the ride begins and ends at {wish.start}")
    doors = lift.doors_at.get(wish.start, ())
    if wish.door is not None and wish.door not in doors:
        text = f"{name} has no {wish.door} door at {wish.start}; there it has {', '.join(doors) or 'none'}"
        return Refused(Refusal.NOT_POSSIBLE, text)
    if not lift.control:
        return Refused(Refusal.MONITOR_ONLY, f"{name} is only watched: its site file does not say `access: control`")
    if not lift.able.commands & {"go_to", "call"}:
        text = f"{name} cannot be called: its map {lift.able.map_name} has neither go_to nor call"
        return Refused(Refusal.NOT_POSSIBLE, text)
    if (why := _why_no_way(wish, lift)) is not None:
        return Refused(
            Refusal.NOT_POSSIBLE, f"{name} lets no robot through its door: its map {lift.able.map_name} {why}"
        )
    return None


_KEEPS_OPEN = frozenset({"robot_in_place", "robot_left"})
"""What ends a call that keeps the door open while a robot goes in or out."""


def _why_no_way(wish: RideRequest, lift: LiftDescription) -> str | None:
    """Say why the door can never stand open and held for a robot; None where it can."""
    by_call = bool(_KEEPS_OPEN.intersection(lift.able.until.values()))
    for floor in (wish.start, wish.destination):
        doors = lift.doors_at.get(floor, ())
        if not doors or not lift.able.doors:
            return f"shows no door at {floor}"
        lacks = [side for side in doors if f"hold_door.{side}" not in lift.able.commands]
        if lacks and not by_call:
            return f"has no hold for the {lacks[0]} door at {floor}"
    return None


def choose(wish: RideRequest, holder: Holder, lifts: Sequence[Choice]) -> Choice | Refused:
    """Return the best lift: one that takes robots now, with the shortest wait, the nearest car, and then in the site's order."""
    fit: list[Choice] = []
    refusals: list[Refused] = []
    for lift in lifts:
        refused = unfit(wish, lift.described)
        if refused is None:
            fit.append(lift)
        else:
            refusals.append(refused)
    if fit:
        inside = [lift for lift in fit if may_hold(lift.state, holder)]
        if wish.robot and inside:
            return inside[0]
        return min(fit, key=lambda lift: (rank(lift, holder), _distance(lift, wish)))
    if len(refusals) == 1:
        return refusals[0]
    codes = {refused.code for refused in refusals}
    code = codes.pop() if len(codes) == 1 else Refusal.NOT_POSSIBLE
    whys = "; ".join(refused.message for refused in refusals) or "there is none to choose among"
    return Refused(code, f"no lift brings a robot from {wish.start} to {wish.destination}: {whys}")


def may_hold(state: LiftState, holder: Holder) -> bool:
    """Whether the robot of an earlier ride of this holder may be in a car that nobody holds."""
    return state.holder is None and state.restrictions.maybe_aboard == holder


def rank(lift: Choice, holder: Holder) -> tuple[bool, int]:
    """Return what decides first between lifts, the smaller the better: whether it turns robots away, and how many wait."""
    return not takes_robots(lift, holder), wait(lift, holder)


def wait(lift: Choice, holder: Holder) -> int:
    """Return how many wait before another one, whoever holds the lift counted."""
    return lift.waiting + int(lift.state.holder not in (None, holder))


def takes_robots(lift: Choice, holder: Holder) -> bool:
    """Whether a lift takes robots now, as far as anybody can tell without asking it."""
    state, told = lift.state, lift.state.restrictions
    kept_out = told.lockout or told.fire_latched or told.drain or told.distrusted or lift.refused
    in_car = told.maybe_aboard not in (None, holder, state.holder)
    return is_live(state) and not kept_out and not in_car and state.mode not in ROBOT_FORBIDDEN_MODES


def _distance(lift: Choice, wish: RideRequest) -> int:
    """Return how many floors the car is away; more than any where nobody knows."""
    floors, at = lift.described.floors, lift.state.floor
    if at is None or at not in floors:
        return len(floors)
    return abs(floors.index(at) - floors.index(wish.start))
