"""A fire, told to RMF over ROS."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import rmf_fleet_msgs.msg
from std_msgs.msg import Bool

from lift_manager.rmf.views import Alarms, Site

_log = logging.getLogger(__name__)


class Publisher(Protocol):
    """What is used of a publisher of rclpy."""

    def publish(self, message: Any) -> None:
        """Send it."""
        ...

    def get_subscription_count(self) -> int:
        """Return how many readers are matched with it."""
        ...


@dataclass(frozen=True)
class Publishers:
    """Makes and ends publishers that are RELIABLE and TRANSIENT_LOCAL and keep one message."""

    make: Callable[[type[Any], str], Publisher]
    """Of a type of messages, on a topic."""
    end: Callable[[Publisher], object]


class _Alarm:
    """One topic on which a fire is told."""

    def __init__(self, publishers: Publishers, kind: type[Any], topic: str) -> None:
        self._publishers = publishers
        self._kind = kind
        self._topic = topic
        self._publisher = publishers.make(kind, topic)
        self._lit: Any = None
        """The message that told of a fire, while there is one."""
        self._readers = 0
        self._looks: int | None = None
        """Since something was said; None when nothing was."""

    def say(self, message: Any, *, lit: bool) -> None:
        self._lit = message if lit else None
        self._looks = 0
        self._readers = self._publisher.get_subscription_count()
        self._publisher.publish(message)

    def over(self) -> None:
        self._lit = None

    def look(self) -> None:
        """Tell of the fire again where a reader has come: those of humble, iron and jazzy are volatile and get no history (open-rmf 1.3).

        Once it is over and its last message has had time to arrive, that is forgotten: as history it would be an alarm, or the
        end of somebody else's, for a reader that comes a day later.
        """
        if self._looks is None:
            return
        self._looks += 1
        if self._lit is None and self._looks > 1:
            self._publishers.end(self._publisher)
            self._publisher, self._looks = self._publishers.make(self._kind, self._topic), None
            return
        readers = self._publisher.get_subscription_count()
        if self._lit is not None and readers > self._readers:
            self._publisher.publish(self._lit)
        self._readers = readers


class RosAlarms:
    """Both topics. Each is there as soon as the site wants it: a volatile reader that is found after a message misses it."""

    def __init__(self, publishers: Publishers, fire_topic: str, emergency_topic: str) -> None:
        self._publishers = publishers
        self._fire_topic = fire_topic
        self._emergency_topic = emergency_topic
        self._fire: _Alarm | None = None
        self._emergency: _Alarm | None = None
        self._signal: type[Any] | None = getattr(rmf_fleet_msgs.msg, "EmergencySignal", None)
        self._told_missing = False

    def heard(self, site: Site) -> None:
        """Take what the site wants, and whether there is a fire still. Before the adapter, which may call `say` on it."""
        if site.alarms.fire_alarm and self._fire is None:
            self._fire = _Alarm(self._publishers, Bool, self._fire_topic)
        if site.alarms.emergency_signal and self._emergency is None:
            self._emergency = self._emergency_alarm()
        if not any(lift.fire_latched or lift.mode == "fire" for lift in site.lifts):
            for alarm in self._alarms():
                alarm.over()

    def say(self, alarms: Alarms, *, on: bool) -> None:
        """Publish that there is a fire, or that it is over, on the topics that the site wants."""
        if alarms.fire_alarm and self._fire is not None:
            self._fire.say(Bool(data=on), lit=on)
        if alarms.emergency_signal and self._emergency is not None and self._signal is not None:
            fleets = list(alarms.emergency_fleets)
            self._emergency.say(self._signal(fleet_names=fleets, is_emergency=on), lit=on)

    def look(self) -> None:
        """See whether readers have come. Once a second."""
        for alarm in self._alarms():
            alarm.look()

    def _alarms(self) -> list[_Alarm]:
        return [alarm for alarm in (self._fire, self._emergency) if alarm is not None]

    def _emergency_alarm(self) -> _Alarm | None:
        if self._signal is not None:
            return _Alarm(self._publishers, self._signal, self._emergency_topic)
        if not self._told_missing:
            self._told_missing = True
            _log.error(
                "the site wants emergency_signal, and the rmf_fleet_msgs of this distribution has no EmergencySignal"
                " (kilted and later have it); fire_alarm of the site file is known to all of them"
            )
        return None
