"""What one may wait for."""

from __future__ import annotations

from collections.abc import Callable

from lift_manager.api.lifts import Lift
from lift_manager.domain.state import Quality, RobotDoor

Condition = Callable[[Lift], bool]


def open_at(floor: str) -> Condition:
    """Return the condition that the lift stands at a floor with its door open for the robot."""

    def met(lift: Lift) -> bool:
        at_floor = lift.quality is Quality.LIVE and lift.standing and lift.floor == floor
        return at_floor and lift.robot_door is RobotDoor.OPEN

    return met
