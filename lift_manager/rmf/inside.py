"""The way to a manager in the same process: its facade is asked directly, in the loop of both."""

from __future__ import annotations

import asyncio
import math
from asyncio import TimerHandle
from collections.abc import Callable
from contextlib import ExitStack

from lift_manager.core.facade import Facade
from lift_manager.core.rmf_site import described, rmf_site
from lift_manager.domain.asking import Accepted, Ask, Refused
from lift_manager.domain.events import Occurrence
from lift_manager.domain.rmf import rmf_holder
from lift_manager.rmf.port import Answer, Asked, Deliver, Ended, Hears

ASKED_WITHIN = 3
"""So often the lifts are looked at within the shortest `max_age_s`, changed or not."""
BETWEEN_S = 0.02
"""Chosen: no more than fifty answers a second, however many lifts change; each tells of all of them."""
AT_MOST_S = 1.0
"""Chosen: as `beside` does, whatever `max_age_s` is."""


class Inside:
    """Implements `port.Manager`. What changed within one turn of the loop is told once."""

    def __init__(self, facade: Facade) -> None:
        self._facade = facade
        self._hears: Hears | None = None
        self._deliver: Deliver | None = None
        self._taps = ExitStack()
        self._timer: TimerHandle | None = None
        self._due = False
        self._told_at = -math.inf
        self._later: TimerHandle | None = None
        self._abouts = described(facade)
        ages = [about.able.max_age_s / ASKED_WITHIN for about in self._abouts.values()]
        self._every_s = min([AT_MOST_S, *ages])

    def start(self, hears: Hears, deliver: Deliver) -> None:
        """Tell `hears` how the lifts are, and of every change from then on."""
        self._hears, self._deliver = hears, deliver
        self._taps.enter_context(self._facade.tap(self._changed))
        self._look()

    def close(self) -> None:
        """Tell nothing any more, answers that are due included."""
        self._hears = self._deliver = None
        self._taps.close()
        for timer in filter(None, (self._timer, self._later)):
            timer.cancel()
        self._due = False

    def ask(self, asked: Asked) -> None:
        """Decide at once; the answer comes after this has returned."""
        answer = self._answer(asked)
        self._soon(lambda hears: hears.answered(answer, _now()))

    def _answer(self, asked: Asked) -> Answer:
        said = self._decide(asked)
        if isinstance(said, Refused):
            return Answer(asked, yes=False, code=said.code, reason=said.message)
        self._facade.freshen(asked.lift)
        return Answer(asked, yes=True, boot=self._facade.boot, event=self._facade.newest)

    def _decide(self, asked: Asked) -> Accepted | Refused:
        holder = rmf_holder(asked.session, asked.adapter)
        if isinstance(asked, Ended):
            return self._facade.end_session(asked.lift, holder, asked.grace_s)
        return self._facade.request(Ask(asked.lift, holder, asked.floor, asked.hold_door, stays=True))

    def _changed(self, _: Occurrence) -> None:
        if self._due:
            return
        self._due = True
        wait_s = self._told_at + BETWEEN_S - _now()
        if wait_s <= 0:
            self._soon(self._tell)
        else:
            self._later = asyncio.get_running_loop().call_later(wait_s, self._soon, self._tell)

    def _look(self) -> None:
        """Tell how the lifts are, changed or not, and do so again in time."""
        self._timer = asyncio.get_running_loop().call_later(self._every_s, self._look)
        self._soon(self._tell)

    def _tell(self, hears: Hears) -> None:
        now = _now()
        if self._facade.stopping:
            return  # nobody holds a lift any more, and sessions are kept: what RMF was told last stays
        site = rmf_site(self._facade, self._abouts)
        self._due, self._told_at = False, now
        hears.heard(site, now, now)

    def _soon(self, tell: Callable[[Hears], None]) -> None:
        if self._deliver is None:
            return

        def told() -> None:
            if self._hears is not None:
                tell(self._hears)

        self._deliver(told)


def _now() -> float:
    return asyncio.get_running_loop().time()
