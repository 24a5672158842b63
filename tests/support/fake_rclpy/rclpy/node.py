from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ros_world import world

from rclpy.clock import Clock, ClockType
from rclpy.endpoint import GuardCondition, Publisher, Subscription, Timer, TopicEndpointInfo, is_message, takes
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidTopicNameException,
    ParameterAlreadyDeclaredException,
    ParameterNotDeclaredException,
    RCLError,
)
from rclpy.logging import RcutilsLogger
from rclpy.qos import QoSProfile

_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class Parameter:
    name: str
    value: Any


class Context:
    def get_domain_id(self) -> int:
        if not world.context_is_up:
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return world.domain


class Node:
    def __init__(self, node_name: str) -> None:
        if not world.context_is_up:
            raise RCLError("rclpy.init() has not been called")
        self._name = node_name
        self._parameters: dict[str, Parameter] = {}
        self._logger = RcutilsLogger()
        self._clock = Clock(clock_type=ClockType.ROS_TIME)
        self.context = Context()
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.timers: list[Timer] = []
        self.guards: list[GuardCondition] = []
        self.is_destroyed = False
        self._clock.is_simulated = bool(self.declare_parameter("use_sim_time", False).value)

    def get_name(self) -> str:
        return self._name

    def get_namespace(self) -> str:
        return world.namespace

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        return _whole(topic)

    def get_logger(self) -> RcutilsLogger:
        return self._logger

    def get_clock(self) -> Clock:
        return self._clock

    def declare_parameter(self, name: str, value: Any) -> Parameter:
        if name in self._parameters:
            raise ParameterAlreadyDeclaredException(name)
        said = world.parameters.get(name, value)
        if type(said) is not type(value):
            raise InvalidParameterTypeException(f"{name}: {said!r} is no {type(value).__name__}")
        self._parameters[name] = Parameter(name, said)
        return self._parameters[name]

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        return self._parameters[name]

    def create_publisher(self, msg_type: type[Any], topic: str, qos_profile: QoSProfile) -> Publisher:
        is_message(msg_type)
        offer = qos_profile.offer()
        writer = world.writer(_whole(topic), msg_type, offer, self._name, world.namespace)
        publisher = Publisher(writer, qos_profile)
        self.publishers.append(publisher)
        return publisher

    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        qos_profile: QoSProfile,
        *,
        event_callbacks: Any = None,
    ) -> Subscription:
        is_message(msg_type)
        takes(callback, 1)
        if event_callbacks is not None:
            _supported(event_callbacks)
        whole = _whole(topic)
        reader = world.reader(whole, msg_type, qos_profile.offer(), self._name)
        subscription = Subscription(whole, reader, callback, qos_profile)
        if event_callbacks is not None:
            subscription.matched = event_callbacks.matched
        self.subscriptions.append(subscription)
        return subscription

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], None], callback_group: None = None, clock: Any = None
    ) -> Timer:
        takes(callback, 0)
        if clock is None or clock.clock_type is not ClockType.STEADY_TIME:
            raise AssertionError("without a steady clock a timer stands still while the simulation does")
        timer = Timer(callback, int(float(timer_period_sec) * 1_000_000_000))
        self.timers.append(timer)
        return timer

    def create_guard_condition(self, callback: Callable[[], None], callback_group: None = None) -> GuardCondition:
        takes(callback, 0)
        guard = GuardCondition(callback)
        self.guards.append(guard)
        return guard

    def destroy_publisher(self, publisher: Any) -> bool:
        if publisher not in self.publishers:
            return False
        self.publishers.remove(publisher)
        world.remove_writer(publisher.writer)
        return True

    def destroy_subscription(self, subscription: Subscription) -> bool:
        if subscription not in self.subscriptions:
            return False
        self.subscriptions.remove(subscription)
        world.remove_reader(subscription.topic_name, subscription.reader)
        return True

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        world.looks += 1
        writers = world.topics[_whole(topic_name)].writers
        return [
            TopicEndpointInfo(writer.node, writer.namespace, writer.kind.__name__, writer.gid) for writer in writers
        ]

    def destroy_node(self) -> None:
        self.is_destroyed = True
        for guard in self.guards:
            guard.is_destroyed = True
        for subscription in list(self.subscriptions):
            self.destroy_subscription(subscription)
        for publisher in list(self.publishers):
            self.destroy_publisher(publisher)


def _whole(topic: str) -> str:
    if not _TOPIC.fullmatch(topic):
        raise InvalidTopicNameException(topic)
    return world.whole(topic)


def _supported(event_callbacks: Any) -> None:
    from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError

    if not isinstance(event_callbacks, SubscriptionEventCallbacks):
        raise TypeError("event_callbacks must be SubscriptionEventCallbacks")
    takes(event_callbacks.matched, 1)
    if not world.supports_matched:
        raise UnsupportedEventTypeError("event type 5 is not supported")
