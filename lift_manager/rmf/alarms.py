"""Announces a fire to RMF, if the site file says so. Pure: times are monotonic seconds."""

from __future__ import annotations

import logging
import math
from typing import Protocol

from lift_manager.plain.rmf import Alarms, SiteView

_log = logging.getLogger(__name__)

REPEAT_S = 2.0
"""How often a fire is announced while it lasts: the fleet adapters of humble, iron and jazzy get no history (open-rmf 1.3), so one that
starts during a fire needs a repetition. The others ignore it. Chosen: a robot gets no further than the next door."""
FORGET_S = 2.0
"""After the end of a fire, until the last announcement has arrived. Chosen."""


class AlarmPublisher(Protocol):
    """Publishes alarms in RMF. Readers that join later get the latest one, until it is forgotten."""

    def offer(self, alarms: Alarms) -> None:
        """Open the topics of these alarms: a reader that is found only after a message may miss it."""
        ...

    def publish_alarms(self, alarms: Alarms, *, on: bool) -> None:
        """Announce that there is a fire, or that it is over, on every topic that the site uses."""
        ...

    def forget(self) -> None:
        """Drop the latest message: for a reader that joins a day later it would be an alarm, or the end of another system's alarm."""
        ...


class FireAlarm:
    """Decides when RMF gets a fire alarm. A `false` clears other systems' alarms too (open-rmf 1.7): at most one after each fire."""

    def __init__(self, publisher: AlarmPublisher) -> None:
        self._publisher = publisher
        self._alarms = Alarms()
        self._is_announced = False
        self._lifts_on_fire: set[str] = set()
        self._repeat_at = math.inf
        self._forget_at = math.inf

    def update(self, site: SiteView, now: float) -> None:
        """Take over the manager's latest answer."""
        if site.alarms != self._alarms:
            self._change(site.alarms, now)
        if not _topics(self._alarms):
            return
        on_fire = {view.name for view in site.lifts if view.fire_latched or view.mode == "fire"}
        missing = self._lifts_on_fire - {view.name for view in site.lifts}
        if on_fire and not self._is_announced:
            self._begin(on_fire, now)
        elif self._is_announced and not on_fire:
            self._end(missing, now)
        self._lifts_on_fire = on_fire | (missing if on_fire else set())

    def _change(self, alarms: Alarms, now: float) -> None:
        """Apply another site file. A topic that it no longer uses keeps no history for new readers, and gets no `false` either."""
        drops_topic = not _topics(self._alarms) <= _topics(alarms)
        self._alarms = alarms
        self._publisher.offer(alarms)
        if not drops_topic:
            return
        if self._is_announced:
            _log.warning(
                "the site file now announces fires to RMF on other topics: the alarm of this fire is dropped there, not cleared"
            )
        self._forget_at = math.inf
        self._publisher.forget()
        if self._is_announced and _topics(alarms):
            self._announce(now)
        else:
            self._is_announced, self._repeat_at, self._lifts_on_fire = False, math.inf, set()

    def _begin(self, on_fire: set[str], now: float) -> None:
        _log.warning("fire in %s: announced to RMF", ", ".join(sorted(on_fire)))
        self._is_announced, self._forget_at = True, math.inf
        self._announce(now)

    def _end(self, missing: set[str], now: float) -> None:
        """End the alarm. Nobody has acknowledged a lift that the manager no longer has: then only a person clears the alarm in RMF."""
        self._is_announced, self._repeat_at, self._forget_at = False, math.inf, now + FORGET_S
        if missing:
            _log.warning("the manager no longer has %s, where there was a fire", ", ".join(sorted(missing)))
        elif self._alarms.clear_on_acknowledge:
            _log.info("the fire was acknowledged: the alarm in RMF is cleared")
            self._publisher.publish_alarms(self._alarms, on=False)
        else:
            _log.info("the fire was acknowledged; the building's own alarm has to clear it in RMF")

    def tick(self, now: float) -> float:
        """Publish what is due; return when to call this again."""
        if now >= self._repeat_at:
            self._announce(now)
        if now >= self._forget_at:
            self._forget_at = math.inf
            self._publisher.forget()
        return min(self._repeat_at, self._forget_at)

    def _announce(self, now: float) -> None:
        self._repeat_at = now + REPEAT_S
        self._publisher.publish_alarms(self._alarms, on=True)


def _topics(alarms: Alarms) -> set[str]:
    """Return the topics on which a fire is announced."""
    used = {"fire_alarm": alarms.fire_alarm, "emergency_signal": alarms.emergency_signal}
    return {topic for topic, is_used in used.items() if is_used}
