from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ros_world import world

if not world.has("iron"):
    raise ModuleNotFoundError("No module named 'rclpy.event_handler'", name="rclpy.event_handler")


class UnsupportedEventTypeError(Exception):
    pass


@dataclass(frozen=True)
class QoSSubscriptionMatchedInfo:
    total_count: int
    total_count_change: int
    current_count: int
    current_count_change: int


class SubscriptionEventCallbacks:
    def __init__(self, *, matched: Callable[[QoSSubscriptionMatchedInfo], None]) -> None:
        self.matched = matched
