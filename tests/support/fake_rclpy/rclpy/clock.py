from __future__ import annotations

from enum import IntEnum

from ros_world import world

from rclpy.time import Time


class ClockType(IntEnum):
    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


class Clock:
    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        self._clock_type = clock_type
        self.is_simulated = False

    @property
    def clock_type(self) -> ClockType:
        return self._clock_type

    def now(self) -> Time:
        if self._clock_type is ClockType.STEADY_TIME:
            return Time(nanoseconds=world.steady())
        return Time(nanoseconds=world.sim_ns if self.is_simulated else world.system_ns)
