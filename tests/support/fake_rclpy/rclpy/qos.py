from __future__ import annotations

from enum import IntEnum

from ros_world import Offer

from rclpy.duration import Duration


class InvalidQoSProfileException(Exception):
    pass


class HistoryPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3


class DurabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3


class QoSProfile:
    """With the five policies that the adapter names; rclpy has more, and reads the type of each."""

    def __init__(
        self,
        *,
        history: HistoryPolicy,
        depth: int,
        reliability: ReliabilityPolicy,
        durability: DurabilityPolicy,
        lifespan: Duration | None = None,
    ) -> None:
        kinds = (type(history), type(depth), type(reliability), type(durability))
        if kinds != (HistoryPolicy, int, ReliabilityPolicy, DurabilityPolicy):
            raise InvalidQoSProfileException(f"policies of the wrong types: {kinds}")
        if lifespan is not None and not isinstance(lifespan, Duration):
            raise InvalidQoSProfileException(f"a lifespan is a Duration, and no {type(lifespan)}")
        self.history = history
        self.depth = depth
        self.reliability = reliability
        self.durability = durability
        self.lifespan = lifespan

    def offer(self) -> Offer:
        if self.history is not HistoryPolicy.KEEP_LAST or self.depth < 1:
            raise AssertionError("of this world is only KEEP_LAST with a depth known")
        return Offer(
            self.depth,
            self.reliability is ReliabilityPolicy.RELIABLE,
            self.durability is DurabilityPolicy.TRANSIENT_LOCAL,
            None if self.lifespan is None else self.lifespan.nanoseconds * 1e-9,
        )
