"""The way to a manager in the same process: its `Site` is called directly, in the loop of both."""

from __future__ import annotations

import asyncio
import math
from asyncio import TimerHandle
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

from lift_manager.lift.rmf import rmf_holder, rmf_lift
from lift_manager.lift.state import LiftState
from lift_manager.plain.rmf import LiftView
from lift_manager.rmf.port import Answer, Deliver, EndOfSession, ManagerListener, ManagerRequest
from lift_manager.runtime.bus import Occurrence, StateChanged
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.rmf import rmf_site_of
from lift_manager.runtime.site import Site

ASKED_WITHIN = 3
"""So often the lifts are looked at within the shortest `max_age_s`, changed or not."""
BETWEEN_S = 0.02
"""Chosen: no more than fifty answers a second, however many lifts change; each tells of all of them."""
AT_MOST_S = 1.0
"""Chosen: as `beside` does, whatever `max_age_s` is."""


class LocalManager:
    """Implements `port.Manager`. What changed within one turn of the loop is told once."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._views: dict[str, LiftView] = {}
        """Every lift, as of its newest event."""
        self._listener: ManagerListener | None = None
        self._deliver: Deliver | None = None
        self._taps = ExitStack()
        self._timer: TimerHandle | None = None
        self._due = False
        self._told_at = -math.inf
        self._later: TimerHandle | None = None
        ages = (site.config(name).capabilities.max_age_s for name in site.lift_names())
        self._every_s = min([AT_MOST_S, *(age / ASKED_WITHIN for age in ages)])

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Tell `listener` how the lifts are, and of every change from then on."""
        self._listener, self._deliver = listener, deliver
        self._taps.enter_context(self._site.tap(self._changed))
        self._look()

    def close(self) -> None:
        """Tell nothing any more, answers that are due included."""
        self._listener = self._deliver = None
        self._taps.close()
        for timer in filter(None, (self._timer, self._later)):
            timer.cancel()
        self._due = False

    def send(self, request: ManagerRequest) -> None:
        """Decide at once; the answer comes after this has returned."""
        answer = self._answer(request)
        self._soon(lambda listener: listener.on_answer(answer, _now()))

    def _answer(self, request: ManagerRequest) -> Answer:
        site, holder = self._site, rmf_holder(request.session, request.adapter)
        try:
            if isinstance(request, EndOfSession):
                site.end_session(request.lift, holder, request.grace_s)
            else:
                site.request(request.lift, holder, request.floor, hold_door=request.hold_door, stays=True)
        except RequestRefused as refused:
            return Answer(request, accepted=False, code=refused.code, reason=refused.message)
        site.freshen(request.lift)
        return Answer(request, accepted=True, boot=site.boot, event=site.newest)

    def _changed(self, occurrence: Occurrence) -> None:
        if isinstance(occurrence.event, StateChanged):
            self._views[occurrence.event.lift] = self._view(occurrence.event.state)
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
        self._views = {name: self._view(self._site.state(name)) for name in self._site.lift_names()}
        self._timer = asyncio.get_running_loop().call_later(self._every_s, self._look)
        self._soon(self._tell)

    def _tell(self, listener: ManagerListener) -> None:
        now = _now()
        if self._site.stopping:
            return  # nobody holds a lift any more, and sessions are kept: what RMF was told last stays
        views = (replace(view, age_s=self._site.age_s(name)) for name, view in self._views.items())
        site = rmf_site_of(self._site, views)
        self._due, self._told_at = False, now
        listener.on_site(site, now, now)

    def _view(self, state: LiftState) -> LiftView:
        return rmf_lift(state, self._site.config(state.lift))

    def _soon(self, tell: Callable[[ManagerListener], None]) -> None:
        if self._deliver is None:
            return

        def told() -> None:
            if self._listener is not None:
                tell(self._listener)

        self._deliver(told)


def _now() -> float:
    return asyncio.get_running_loop().time()
