"""The mechanics of one lift: a car in its shaft and the doors it carries.

Pure, and exact: between two orders the motion is solved in closed form, so it does not matter how time is cut into
steps. The interlocks live here, below any controller: the car never moves with a door not fully closed, and a door
opens only where the car stands in the door zone of a floor that has this door, whatever is ordered.

Faults and other ways to stop come in as `Orders`: a wrong floor, a stop between floors or a re-levelling run is a
different `target_m`; a stuck door is a side left out of `open_doors` or kept in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import sqrt

from register_maps.words import Door, Motion, Side

FLOOR_SPACING_M = 3.2
"""Chosen: a usual storey of an office building."""
NEGLIGIBLE_M = 1e-6
"""Rounding only; a thousandth of what any levelling sensor can see."""
NEGLIGIBLE_S = 1e-9
"""Rounding only: what is due within a nanosecond is due, so that it cannot depend on how time was cut."""
NEGLIGIBLE_FRACTION = 1e-9
"""Rounding only: a door this near to its limit is at it."""


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


@dataclass(frozen=True, slots=True)
class Leaf:
    """One door."""

    fraction: float = 0.0
    """0 closed to 1 fully open."""
    opening: bool = False
    """Which way it moves, or moved last."""

    @property
    def word(self) -> Door:
        if self.fraction <= 0.0:
            return Door.CLOSED
        if self.fraction >= 1.0:
            return Door.OPEN
        return Door.OPENING if self.opening else Door.CLOSING


@dataclass(frozen=True, slots=True)
class State:
    """Where the car is and how far its doors are open."""

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
        return all(leaf.fraction <= 0.0 for leaf in self.doors.values())


@dataclass(frozen=True, slots=True)
class Orders:
    """What the controller's outputs tell the machine; the interlocks decide what becomes of it."""

    target_m: float | None = None
    """Height to go to; None: brake and stand, wherever that is."""
    open_doors: frozenset[Side] = field(default_factory=frozenset)
    """Doors to open and keep open; all others close."""


def at_floor(floor: int, parameters: Parameters) -> State:
    """The car standing level at a floor, doors closed."""
    doors = {side: Leaf() for side in parameters.sides}
    return State(position_m=parameters.heights_m[floor], speed_m_s=0.0, floor=floor, doors=doors)


def zone_floor(state: State, parameters: Parameters) -> int | None:
    """Floor whose door zone the car is in now, moving or not."""
    return _floor_within(state.position_m, parameters.door_zone_m, parameters)


def level_floor(state: State, parameters: Parameters) -> int | None:
    """Floor at which the car stands level; None while it moves."""
    if not state.standing:
        return None
    return _floor_within(state.position_m, parameters.level_tolerance_m, parameters)


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
        to_open = _may_open(state, orders, parameters)
        if to_open or not state.doors_closed:
            after, used_s = _move_doors(state, to_open, left_s, parameters)
        else:
            after, used_s = _move_car(state, orders.target_m, left_s, parameters)
        if used_s <= 0 and after == state:
            break  # nothing is left to do under these orders
        state = after
        left_s -= used_s
    return state


# -- doors


def _may_open(state: State, orders: Orders, parameters: Parameters) -> frozenset[Side]:
    if not orders.open_doors or not state.standing:
        return frozenset()
    floor = zone_floor(state, parameters)
    return frozenset() if floor is None else orders.open_doors & parameters.doors_at[floor]


def _move_doors(state: State, to_open: frozenset[Side], dt: float, parameters: Parameters) -> tuple[State, float]:
    """Doors after `dt`, or after the moment at which the last one has closed and the car may go."""
    if not to_open:
        widest = max(leaf.fraction for leaf in state.doors.values())
        dt = min(dt, widest * parameters.door_close_s)
    doors = {side: _move_leaf(leaf, dt, parameters, opens=side in to_open) for side, leaf in state.doors.items()}
    return State(state.position_m, state.speed_m_s, state.floor, doors), dt


def _move_leaf(leaf: Leaf, dt: float, parameters: Parameters, *, opens: bool) -> Leaf:
    fraction = leaf.fraction + (dt / parameters.door_open_s if opens else -dt / parameters.door_close_s)
    if fraction <= NEGLIGIBLE_FRACTION:
        fraction = 0.0
    elif fraction >= 1.0 - NEGLIGIBLE_FRACTION:
        fraction = 1.0
    return Leaf(fraction=fraction, opening=opens)


# -- car


@dataclass(frozen=True, slots=True)
class _Leg:
    """A stretch of constant acceleration."""

    duration_s: float
    end_speed_m_s: float


def _move_car(state: State, target_m: float | None, dt: float, parameters: Parameters) -> tuple[State, float]:
    """Car after `dt`, or after the moment at which it comes to rest; 0 s used: it rests where it should."""
    if target_m is not None:
        target_m = min(max(target_m, parameters.heights_m[0]), parameters.heights_m[-1])
    legs, arrives = _plan(state, target_m, parameters)
    left_s = dt
    for leg in legs:
        if leg.duration_s > left_s + NEGLIGIBLE_S:
            share = left_s / leg.duration_s
            speed = state.speed_m_s + (leg.end_speed_m_s - state.speed_m_s) * share
            return _travelled(state, left_s, speed, parameters), dt
        state = _travelled(state, leg.duration_s, leg.end_speed_m_s, parameters)
        left_s -= leg.duration_s
    if arrives and target_m is not None:
        state = State(target_m, 0.0, state.floor, state.doors)  # what is corrected here is rounding, below NEGLIGIBLE_M
    return state, dt - left_s


def _plan(state: State, target_m: float | None, parameters: Parameters) -> tuple[list[_Leg], bool]:
    """Legs until the car next comes to rest, and whether that is at the target."""
    speed = state.speed_m_s
    brake = [_Leg(abs(speed) / parameters.deceleration_m_s2, 0.0)] if speed else []
    if target_m is None:
        return brake, False
    distance_m = target_m - state.position_m
    if distance_m == 0.0:
        return brake, False
    sign = 1.0 if distance_m > 0 else -1.0
    if speed * sign < 0 or _braking_m(speed, parameters) > abs(distance_m) + NEGLIGIBLE_M:
        return brake, False
    legs = _approach(abs(distance_m), abs(speed), parameters)
    return [_Leg(leg.duration_s, leg.end_speed_m_s * sign) for leg in legs], True


def _approach(distance_m: float, speed: float, parameters: Parameters) -> list[_Leg]:
    """Accelerate, cruise, brake, creep, stop; each may be empty. Needs a target that can still be braked for."""
    acceleration, deceleration = parameters.acceleration_m_s2, parameters.deceleration_m_s2
    creep_speed = parameters.creep_speed_m_s

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
    legs = [
        _Leg((peak - speed) / acceleration, peak),
        _Leg((level_m - creep_m) / peak, peak),
        _Leg((peak - low) / deceleration, low),
        _Leg(creep_m / low, low),
        _Leg(low / deceleration, 0.0),
    ]
    return [leg for leg in legs if leg.duration_s > 0]


def _braking_m(speed: float, parameters: Parameters) -> float:
    return speed**2 / (2 * parameters.deceleration_m_s2)


def _travelled(state: State, duration_s: float, end_speed: float, parameters: Parameters) -> State:
    """After one leg, or part of one; the floor follows the door zones passed on the way."""
    position_m = state.position_m + (state.speed_m_s + end_speed) / 2 * duration_s
    low, high = sorted((state.position_m, position_m))
    zone = parameters.door_zone_m
    passed = [floor for floor in parameters.floors if low - zone <= parameters.heights_m[floor] <= high + zone]
    floor = state.floor
    if passed:
        floor = passed[-1] if position_m >= state.position_m else passed[0]
    return State(position_m, end_speed, floor, state.doors)


def _floor_within(position_m: float, margin_m: float, parameters: Parameters) -> int | None:
    for floor, height in enumerate(parameters.heights_m):
        if abs(height - position_m) <= margin_m:
            return floor
    return None
