"""Which floor a car goes to next: collective control, pure.

The car serves the calls ahead of it in its direction, then turns. Landing calls have no direction here.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from register_maps.words import Motion
from simulator import shaft


def next_stop(
    car: shaft.State, calls: AbstractSet[int], direction: Motion, parameters: shaft.Parameters
) -> tuple[int | None, Motion]:
    """The stop to travel to (None: stay) and the direction that this commits the car to.

    A moving car gets the first call that it can still stop for, or else the first floor at which it can stop and turn. A
    car that stands between floors drives to the nearest one even without a call.
    """
    if car.speed_m_s != 0.0:
        return _next_while_moving(car, calls, parameters), car.motion
    level = shaft.level_floor(car, parameters)
    floors = calls - {level}
    if not floors:
        if level is not None:
            return None, Motion.STOPPED
        floors = {shaft.nearest_floor(car, parameters)}
    return _next_from_standstill(car, floors, direction, parameters)


def _next_while_moving(car: shaft.State, calls: AbstractSet[int], parameters: shaft.Parameters) -> int:
    reachable = [floor for floor in calls if shaft.can_stop_at(car, floor, parameters)]
    if not reachable:
        return shaft.nearest_stop(car, parameters)
    return min(reachable) if car.motion is Motion.UP else max(reachable)


def _next_from_standstill(
    car: shaft.State, floors: AbstractSet[int], direction: Motion, parameters: shaft.Parameters
) -> tuple[int, Motion]:
    heights = parameters.heights_m
    above = [floor for floor in floors if heights[floor] > car.position_m]
    below = [floor for floor in floors if heights[floor] <= car.position_m]
    if direction is Motion.STOPPED:
        # the nearest call sets the direction; of two as near the upper one, so that a run can be repeated
        nearest = min(floors, key=lambda floor: (abs(heights[floor] - car.position_m), -floor))
        direction = Motion.UP if nearest in above else Motion.DOWN
    if above and (direction is Motion.UP or not below):
        return min(above), Motion.UP
    return max(below), Motion.DOWN
