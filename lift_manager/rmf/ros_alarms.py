"""Publishes fire alarms over ROS."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import rmf_fleet_msgs.msg
from std_msgs.msg import Bool

from lift_manager.plain.rmf import Alarms

_log = logging.getLogger(__name__)


class Publisher(Protocol):
    """The part of a publisher of rclpy that is used here."""

    def publish(self, message: Any) -> None:
        """Send it."""
        ...


@dataclass(frozen=True)
class Publishers:
    """Creates and destroys publishers that are RELIABLE and TRANSIENT_LOCAL and keep one message."""

    make: Callable[[type[Any], str], Publisher]
    """For a type of messages, on a topic."""
    end: Callable[[Publisher], object]


class RosAlarms:
    """Both alarm topics. Implements `alarms.AlarmPublisher`; a topic is opened only if the site uses it."""

    def __init__(self, publishers: Publishers, fire_topic: str, emergency_topic: str) -> None:
        self._publishers = publishers
        self._fire_topic = fire_topic
        self._emergency_topic = emergency_topic
        self._alarms = Alarms()
        self._fire: Publisher | None = None
        self._emergency: Publisher | None = None
        self._signal: type[Any] | None = getattr(rmf_fleet_msgs.msg, "EmergencySignal", None)
        self._reported_missing = False

    def offer(self, alarms: Alarms) -> None:
        """Open the topics, so that readers find them."""
        self._alarms = alarms
        if alarms.fire_alarm and self._fire is None:
            self._fire = self._publishers.make(Bool, self._fire_topic)
        if alarms.emergency_signal and self._emergency is None:
            self._emergency = self._offer_emergency()

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        """Publish that there is a fire, or that it is over, on the topics that the site uses."""
        self.offer(alarms)
        if alarms.fire_alarm and self._fire is not None:
            self._fire.publish(Bool(data=on))
        if alarms.emergency_signal and self._emergency is not None and self._signal is not None:
            self._emergency.publish(self._signal(fleet_names=list(alarms.emergency_fleets), is_emergency=on))

    def forget(self) -> None:
        """Destroy both publishers with their history, and create them again."""
        for publisher in filter(None, (self._fire, self._emergency)):
            self._publishers.end(publisher)
        self._fire = self._emergency = None
        self.offer(self._alarms)

    def _offer_emergency(self) -> Publisher | None:
        if self._signal is not None:
            return self._publishers.make(self._signal, self._emergency_topic)
        if not self._reported_missing:
            self._reported_missing = True
            _log.error(
                "the site file has emergency_signal, but rmf_fleet_msgs of this distribution has no EmergencySignal"
                " (kilted and later have it); fire_alarm of the site file works with all of them"
            )
        return None
