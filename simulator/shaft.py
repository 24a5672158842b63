"""The mechanics of one lift: a car in its shaft and the doors it carries.

Pure, and exact: between two orders the motion is solved in closed form, so it does not matter how time is cut into
steps. The interlocks live here, below any controller: the car never travels with a door not fully closed, and a door
opens only where the car stands in the door zone of a floor that has this door, whatever is ordered. Within a door zone
a car that is not level may creep back with its doors open, as real lifts do.

What goes wrong with the doors comes in as `DoorFaults`; a wrong floor or a stop between floors is a different
`target_m`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

from register_maps.words import Motion, Side
from simulator import doors
from simulator.doors import NO_TROUBLE, DoorFaults, Leaf

FLOOR_SPACING_M = 3.2
"""Chosen: a usual storey of an office building."""
NEGLIGIBLE_M = 1e-6
"""Rounding only; a thousandth of what any levelling sensor can see."""
NEGLIGIBLE_S = 1e-9
"""Rounding only: what is due within a nanosecond is due, so that it cannot depend on how time was cut."""
SINKING_M_S = 0.05
"""How fast a standing car sinks. Chosen: a load that rolls in stretches the ropes by a centimetre in a quarter of a second."""


def even_heights(floors: int, *, spacing_m: float = FLOOR_SPACING_M) -> tuple[float, ...]:
    """Heights of so many floors, evenly spaced, the lowest at 0 m."""
    return tuple(index * spacing_m for index in range(floors))


@dataclass(frozen=True, slots=True)
class Parameters:
    """The building and the machine. Metres and seconds."""

    heights_m: tuple[float, ...] = even_heights(4)
    """Height of each floor, ascending; index 0 is the lowest floor."""
    doors_at: tuple[frozenset[Side], ...] = ()
    """Which doors exist at each floor; left empty: a front door everywhere."""
    top_speed_m_s: float = 1.0
    """Chosen: typical of a passenger lift in a low building."""
    acceleration_m_s2: float = 0.8
    """Chosen: typical of a passenger lift; jerk is not modelled."""
    deceleration_m_s2: float = 0.8
    """Chosen: as the acceleration."""
    creep_speed_m_s: float = 0.1
    """Speed of the last centimetres, so that the car stops level. Chosen: typical of a levelling speed."""
    creep_distance_m: float = 0.05
    """How far the car creeps before its last braking. Chosen: half a second at creep speed."""
    level_tolerance_m: float = 0.005
    """Standing this near to a floor is level. Chosen: half of the 10 mm a passenger lift is usually accepted with."""
    door_zone_m: float = 0.2
    """Doors may open this near to a floor, above or below. Chosen: a usual unlocking zone."""
    door_open_s: float = 2.0
    """Closed to fully open. Chosen: typical of a 900 mm passenger door."""
    door_close_s: float = 2.5
    """Fully open to closed; slower than opening, to be gentle. Chosen: typical of a 900 mm passenger door."""

    def __post_init__(self) -> None:
        if not self.doors_at:
            object.__setattr__(self, "doors_at", (frozenset({Side.FRONT}),) * len(self.heights_m))
        self._check_building()
        positive = {
            "top_speed_m_s": self.top_speed_m_s,
            "acceleration_m_s2": self.acceleration_m_s2,
            "deceleration_m_s2": self.deceleration_m_s2,
            "creep_speed_m_s": self.creep_speed_m_s,
            "door_open_s": self.door_open_s,
            "door_close_s": self.door_close_s,
        }
        for name, value in positive.items():
            if value <= 0:
                raise ValueError(f"{name} must be above 0, not {value}")
        if self.creep_distance_m < 0:
            raise ValueError(f"creep_distance_m must not be below 0, not {self.creep_distance_m}")
        if self.creep_speed_m_s > self.top_speed_m_s:
            raise ValueError("creep_speed_m_s must not be above top_speed_m_s")

    def _check_building(self) -> None:
        gaps = [upper - lower for lower, upper in pairwise(self.heights_m)]
        if not gaps or min(gaps) <= 2 * self.door_zone_m:
            raise ValueError("heights_m needs two floors or more, ascending, with door zones that do not overlap")
        if not 0 <= self.level_tolerance_m <= self.door_zone_m:
            raise ValueError("level_tolerance_m must lie between 0 and door_zone_m")
        if len(self.doors_at) != len(self.heights_m) or not all(self.doors_at):
            raise ValueError(f"doors_at must name a door for each of the {len(self.heights_m)} floors")

    @property
    def floors(self) -> range:
        return range(len(self.heights_m))

    @property
    def sides(self) -> tuple[Side, ...]:
        """The doors the car carries, in a fixed order."""
        return tuple(side for side in Side if any(side in doors for doors in self.doors_at))


class State(NamedTuple):
    """Where the car is and how far its doors are open. A tuple: each scan of a moving car makes one."""

    position_m: float
    speed_m_s: float
    """Upwards is positive."""
    floor: int
    """Floor whose door zone the car was in last: it changes when a floor is reached, not when one is left."""
    doors: Mapping[Side, Leaf]

    @property
    def standing(self) -> bool:
        return self.speed_m_s == 0.0

    @property
    def motion(self) -> Motion:
        if self.standing:
            return Motion.STOPPED
        return Motion.UP if self.speed_m_s > 0 else Motion.DOWN

    @property
    def doors_closed(self) -> bool:
        for leaf in self.doors.values():  # noqa: SIM110  # looked at in every scan, and three times as fast as `all`
            if leaf.fraction > 0.0:
                return False
        return True


class Orders(NamedTuple):
    """The controller's orders to the machine; the interlocks decide which are carried out. A tuple: each scan gives some."""

    target_m: float | None = None
    """Height to go to; None: brake and stand, wherever that is."""
    open_doors: frozenset[Side] = frozenset()
    """Doors to open and keep open; all others close."""
    levels: bool = False
    """Creep level with the floor of this door zone although a door is open."""
    sinks_m: float = 0.0
    """How far below the floor a standing car with an open door sinks, never out of the door zone. No order, but a load."""
    trouble: DoorFaults = NO_TROUBLE


def at_floor(floor: int, parameters: Parameters) -> State:
    """The car standing level at a floor, doors closed."""
    leaves = {side: Leaf() for side in parameters.sides}
    return State(position_m=parameters.heights_m[floor], speed_m_s=0.0, floor=floor, doors=leaves)


def zone_floor(state: State, parameters: Parameters) -> int | None:
    """Floor whose door zone the car is in now, moving or not."""
    return _floor_within(state.position_m, parameters.door_zone_m, parameters)


def level_floor(state: State, parameters: Parameters) -> int | None:
    """Floor at which the car stands level; None while it moves."""
    if not state.standing:
        return None
    return _floor_within(state.position_m, parameters.level_tolerance_m, parameters)


def sinks_by(sinks_m: float, parameters: Parameters) -> float:
    """How far a load can make a standing car sink: the car stays well within its door zone."""
    return min(sinks_m, parameters.door_zone_m / 2)


def nearest_floor(state: State, parameters: Parameters) -> int:
    return min(parameters.floors, key=lambda floor: abs(parameters.heights_m[floor] - state.position_m))


def can_stop_at(state: State, floor: int, parameters: Parameters) -> bool:
    """Whether the floor lies ahead (or anywhere, for a standing car) and far enough away to brake."""
    if state.standing:
        return True
    ahead_m = parameters.heights_m[floor] - state.position_m
    if state.speed_m_s < 0:
        ahead_m = -ahead_m
    return _braking_m(state.speed_m_s, parameters) <= ahead_m + NEGLIGIBLE_M


def nearest_stop(state: State, parameters: Parameters) -> int:
    """The first floor at which the car can come to stand without turning back."""
    stops = [floor for floor in parameters.floors if can_stop_at(state, floor, parameters)]
    return min(
        stops or parameters.floors,
        key=lambda floor: abs(parameters.heights_m[floor] - state.position_m),
    )


def step(state: State, orders: Orders, dt: float, parameters: Parameters) -> State:
    """What `dt` mechanical seconds under the same orders make of the lift.

    A target too near to brake for is passed, and the car comes back: speed is continuous whatever is ordered. An
    opening door goes before a departing car.
    """
    if dt < 0:
        raise ValueError(f"time does not run backwards: dt is {dt}")
    left_s = dt
    while left_s > NEGLIGIBLE_S:
        to_open = _may_open(state, orders, parameters) if orders.open_doors else orders.open_doors
        if to_open or not state.doors_closed:
            after, used_s = _stand_open(state, orders, to_open, left_s, parameters)
        elif state.speed_m_s == 0.0 and (orders.target_m is None or orders.target_m == state.position_m):
            break  # it rests where it should
        else:
            after, used_s = _move_car(state, orders.target_m, left_s, parameters)
        if used_s <= 0 and after == state:
            break  # nothing is left to do under these orders
        state = after
        left_s -= used_s
    return state


# -- a car with its doors open


def _may_open(state: State, orders: Orders, parameters: Parameters) -> frozenset[Side]:
    if not state.standing and state.doors_closed:
        return frozenset()
    floor = zone_floor(state, parameters)
    return frozenset() if floor is None else orders.open_doors & parameters.doors_at[floor]


def _stand_open(
    state: State, orders: Orders, to_open: frozenset[Side], dt: float, parameters: Parameters
) -> tuple[State, float]:
    """A car with an open door, or one about to open, after `dt`, or after the moment at which it may go."""
    open_s, close_s = parameters.door_open_s, parameters.door_close_s
    leaves, used_s = doors.move(state.doors, to_open, orders.trouble, dt, open_s=open_s, close_s=close_s)
    if state.speed_m_s == 0.0 and not orders.levels and not orders.sinks_m:
        if leaves is not state.doors:
            state = State(state.position_m, state.speed_m_s, state.floor, leaves)
        return state, used_s
    car, car_s = _shift(state, orders, used_s or dt, parameters)
    return State(car.position_m, car.speed_m_s, car.floor, leaves), used_s or car_s


def _shift(state: State, orders: Orders, dt: float, parameters: Parameters) -> tuple[State, float]:
    """The car with an open door after `dt`: it creeps level, sinks, or brakes; 0 s used: it does none of these."""
    floor = zone_floor(state, parameters)
    height_m = None if floor is None else parameters.heights_m[floor]
    if orders.sinks_m and not orders.levels and state.standing and height_m is not None:
        lowest_m = height_m - sinks_by(orders.sinks_m, parameters)
        position_m = max(state.position_m - SINKING_M_S * dt, min(lowest_m, state.position_m))
        return State(position_m, 0.0, state.floor, state.doors), dt if position_m != state.position_m else 0.0
    creeping = replace(parameters, top_speed_m_s=parameters.creep_speed_m_s)
    left_s = dt
    while left_s > NEGLIGIBLE_S:
        after, used_s = _move_car(state, height_m if orders.levels else None, left_s, creeping)
        if used_s <= 0 and after == state:
            break
        state = after
        left_s -= used_s
    return state, dt - left_s


# -- car


_Leg = tuple[float, float]
"""A stretch of constant acceleration: how long it takes, and the speed at its end. A tuple: a moving car is planned again in
every scan."""


def _move_car(state: State, target_m: float | None, dt: float, parameters: Parameters) -> tuple[State, float]:
    """Car after `dt`, or after the moment at which it comes to rest; 0 s used: it rests where it should."""
    if target_m is not None:
        target_m = min(max(target_m, parameters.heights_m[0]), parameters.heights_m[-1])
    legs, arrives = _plan(state, target_m, parameters)
    left_s = dt
    for duration_s, end_speed in legs:
        if duration_s > left_s + NEGLIGIBLE_S:
            share = left_s / duration_s
            speed = state.speed_m_s + (end_speed - state.speed_m_s) * share
            return _travelled(state, left_s, speed, parameters), dt
        state = _travelled(state, duration_s, end_speed, parameters)
        left_s -= duration_s
    if arrives and target_m is not None:
        state = State(target_m, 0.0, state.floor, state.doors)  # what is corrected here is rounding, below NEGLIGIBLE_M
    return state, dt - left_s


def _plan(state: State, target_m: float | None, parameters: Parameters) -> tuple[list[_Leg], bool]:
    """Legs until the car next comes to rest, and whether that is at the target."""
    speed = state.speed_m_s
    distance_m = 0.0 if target_m is None else target_m - state.position_m
    if distance_m == 0.0 or speed * distance_m < 0 or _braking_m(speed, parameters) > abs(distance_m) + NEGLIGIBLE_M:
        return [(abs(speed) / parameters.deceleration_m_s2, 0.0)] if speed else [], False
    return _approach(distance_m, abs(speed), parameters), True


def _approach(distance_m: float, speed: float, parameters: Parameters) -> list[_Leg]:
    """Accelerate, cruise, brake, creep, stop; each may be empty. Needs a target that can still be braked for."""
    acceleration, deceleration = parameters.acceleration_m_s2, parameters.deceleration_m_s2
    creep_speed = parameters.creep_speed_m_s
    sign, distance_m = (1.0, distance_m) if distance_m > 0 else (-1.0, -distance_m)

    def peak_over(reach_m: float) -> float:
        """Speed at the top of a profile without a cruise that covers so many metres."""
        energy = max(reach_m + speed**2 / (2 * acceleration), 0.0)
        return sqrt(energy / (1 / (2 * acceleration) + 1 / (2 * deceleration)))

    peak = min(peak_over(distance_m - parameters.creep_distance_m), parameters.top_speed_m_s)
    if peak < creep_speed:  # so short a way that the car never does more than creep
        peak = min(peak_over(distance_m), creep_speed)
    peak = max(peak, speed)
    level_m = distance_m - (peak**2 - speed**2) / (2 * acceleration) - _braking_m(peak, parameters)
    level_m = max(level_m, 0.0)
    creep_m = min(level_m, parameters.creep_distance_m) if peak > creep_speed else 0.0
    low = min(peak, creep_speed)
    legs = (
        ((peak - speed) / acceleration, peak * sign),
        ((level_m - creep_m) / peak, peak * sign),
        ((peak - low) / deceleration, low * sign),
        (creep_m / low, low * sign),
        (low / deceleration, 0.0),
    )
    return [leg for leg in legs if leg[0] > 0]


def _braking_m(speed: float, parameters: Parameters) -> float:
    return speed**2 / (2 * parameters.deceleration_m_s2)


def _travelled(state: State, duration_s: float, end_speed: float, parameters: Parameters) -> State:
    """After one leg, or part of one; the floor follows the door zones passed on the way."""
    position_m = state.position_m + (state.speed_m_s + end_speed) / 2 * duration_s
    zone = parameters.door_zone_m
    floor = state.floor
    if position_m >= state.position_m:
        for passed, height in enumerate(parameters.heights_m):
            if state.position_m - zone <= height <= position_m + zone:
                floor = passed
    else:
        for passed, height in enumerate(parameters.heights_m):
            if position_m - zone <= height <= state.position_m + zone:
                floor = passed
                break
    return State(position_m, end_speed, floor, state.doors)


def _floor_within(position_m: float, margin_m: float, parameters: Parameters) -> int | None:
    for floor, height in enumerate(parameters.heights_m):
        if abs(height - position_m) <= margin_m:
            return floor
    return None
