"""A fire, told to RMF where the site says so. Pure: monotonic seconds go in."""

from __future__ import annotations

import math
from typing import Protocol

from lift_manager.rmf.views import Alarms, Site

AGAIN_S = 2.0
"""How often a fire is told while it lasts: the fleet adapters of humble, iron and jazzy get no history (open-rmf 1.3), and one that
starts during a fire has to hear of it. It is no news to those that know. Chosen: a robot gets no further than the next door."""
FORGET_S = 2.0
"""After the end of a fire, until what was said last has arrived. Chosen."""


class AlarmOut(Protocol):
    """Tells RMF. Readers that join later get the last word, until it is forgotten."""

    def offer(self, alarms: Alarms) -> None:
        """Be ready to tell what the site wants told: a reader that is found only after a message may miss it."""
        ...

    def say(self, alarms: Alarms, *, on: bool) -> None:
        """Tell that there is a fire, or that it is over, in every way that the site wants."""
        ...

    def forget(self) -> None:
        """Keep the last word for nobody: to whoever joins a day later it would be an alarm, or the end of somebody else's."""
        ...


class FireAlarm:
    """Whether there is a fire for RMF. A `false` clears other systems' alarms too (open-rmf 1.7): at most one after each fire."""

    def __init__(self, out: AlarmOut) -> None:
        self._out = out
        self._alarms = Alarms()
        self._on = False
        self._again_at = math.inf
        self._forget_at = math.inf

    def heard(self, site: Site, now: float) -> None:
        """Take the manager's answer."""
        if site.alarms != self._alarms:
            self._alarms = site.alarms
            self._out.offer(site.alarms)
        burns = any(view.fire_latched or view.mode == "fire" for view in site.lifts)
        if burns == self._on or not (self._alarms.fire_alarm or self._alarms.emergency_signal):
            return
        self._on = burns
        if burns:
            self._forget_at = math.inf
            self._say(now)
            return
        self._again_at, self._forget_at = math.inf, now + FORGET_S
        if self._alarms.clear_on_acknowledge:
            self._out.say(self._alarms, on=False)

    def tick(self, now: float) -> float:
        """Tell again what is due; return when to come again."""
        if now >= self._again_at:
            self._say(now)
        if now >= self._forget_at:
            self._forget_at = math.inf
            self._out.forget()
        return min(self._again_at, self._forget_at)

    def _say(self, now: float) -> None:
        self._again_at = now + AGAIN_S
        self._out.say(self._alarms, on=True)
