"""Publishers, subscriptions, timers and guard conditions. In rclpy each kind has a module of its own; nobody imports them."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ros_messages import Message
from ros_world import Reader, Writer, world

from rclpy.exceptions import InvalidHandle, RCLError
from rclpy.qos import QoSProfile


def takes(callback: Callable[..., object], count: int) -> None:
    if len(inspect.signature(callback).parameters) != count:
        raise TypeError(f"a callback of {count} arguments is expected")


def is_message(kind: type[Any]) -> None:
    if not issubclass(kind, Message):
        raise TypeError(f"{kind} is no type of messages")


@dataclass(frozen=True)
class TopicEndpointInfo:
    node_name: str
    node_namespace: str
    topic_type: str
    endpoint_gid: list[int]


class Publisher:
    def __init__(self, writer: Writer, qos_profile: QoSProfile) -> None:
        self.writer = writer
        self.qos_profile = qos_profile

    @property
    def topic_name(self) -> str:
        return self.writer.topic

    def publish(self, msg: Any) -> None:
        if not world.context_is_up:
            raise RCLError("Failed to publish: publisher's context is invalid")
        if threading.get_ident() != world.thread:
            raise AssertionError("published from another thread than that of the executor")
        msg.check_whole()
        self.writer.publish(msg)

    def get_subscription_count(self) -> int:
        return len(self.writer.readers())


class Subscription:
    def __init__(self, topic: str, reader: Reader, callback: Callable[[Any], None], qos_profile: QoSProfile) -> None:
        self.reader = reader
        self.callback = callback
        self.qos_profile = qos_profile
        self.matched: Callable[[Any], None] | None = None
        self._topic = topic

    @property
    def topic_name(self) -> str:
        return self._topic


class GuardCondition:
    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback = callback
        self.is_triggered = False
        self.is_destroyed = False

    def trigger(self) -> None:
        if self.is_destroyed:
            raise InvalidHandle("Tried to use a guard condition that is destroyed")
        self.is_triggered = True
        world.wake()


class Timer:
    def __init__(self, callback: Callable[[], None], period_ns: int) -> None:
        self.callback = callback
        self._period_ns = period_ns
        self.next_ns = world.steady() + period_ns
        self.resets = 0

    @property
    def timer_period_ns(self) -> int:
        return self._period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        if type(value) is not int or value < 0:
            raise TypeError("a period is a number of nanoseconds")
        self._period_ns = value

    def reset(self) -> None:
        self.resets += 1
        self.next_ns = world.steady() + self._period_ns

    def called(self) -> None:
        self.next_ns += self._period_ns
