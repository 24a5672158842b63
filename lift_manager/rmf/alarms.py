"""A fire, told to RMF where the site says so. Pure: monotonic seconds go in."""

from __future__ import annotations

import logging
import math
from typing import Protocol

from lift_manager.plain.rmf import Alarms, SiteView

_log = logging.getLogger(__name__)

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
        self._burning: set[str] = set()
        self._again_at = math.inf
        self._forget_at = math.inf

    def update(self, site: SiteView, now: float) -> None:
        """Take the manager's answer."""
        if site.alarms != self._alarms:
            self._change(site.alarms, now)
        if not _ways(self._alarms):
            return
        burns = {view.name for view in site.lifts if view.fire_latched or view.mode == "fire"}
        gone = self._burning - {view.name for view in site.lifts}
        if burns and not self._on:
            self._begins(burns, now)
        elif self._on and not burns:
            self._is_over(gone, now)
        self._burning = burns | (gone if burns else set())

    def _change(self, alarms: Alarms, now: float) -> None:
        """Take another site file. What is not to be told any more is no history for whoever joins, and no `false` either."""
        fewer = not _ways(self._alarms) <= _ways(alarms)
        self._alarms = alarms
        self._out.offer(alarms)
        if not fewer:
            return
        if self._on:
            _log.warning(
                "the site tells RMF of fires in another way: what was told of this one is forgotten, not cleared"
            )
        self._forget_at = math.inf
        self._out.forget()
        if self._on and _ways(alarms):
            self._say(now)
        else:
            self._on, self._again_at, self._burning = False, math.inf, set()

    def _begins(self, burns: set[str], now: float) -> None:
        _log.warning("there was a fire, in %s: RMF is told", ", ".join(sorted(burns)))
        self._on, self._forget_at = True, math.inf
        self._say(now)

    def _is_over(self, gone: set[str], now: float) -> None:
        """A lift that is not told of any more was acknowledged by nobody: then only a person tells RMF that it is over."""
        self._on, self._again_at, self._forget_at = False, math.inf, now + FORGET_S
        if gone:
            _log.warning("the manager tells nothing of %s any more, where there was a fire", ", ".join(sorted(gone)))
        elif self._alarms.clear_on_acknowledge:
            _log.info("the fire was acknowledged: RMF is told that it is over")
            self._out.say(self._alarms, on=False)
        else:
            _log.info("the fire was acknowledged; that it is over, RMF hears from the building's own alarm")

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


def _ways(alarms: Alarms) -> set[str]:
    """Return the topics on which a fire is told."""
    said = {"fire_alarm": alarms.fire_alarm, "emergency_signal": alarms.emergency_signal}
    return {topic for topic, wanted in said.items() if wanted}
