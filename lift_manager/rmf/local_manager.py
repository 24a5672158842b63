"""The connection to a manager in the same process, by direct calls of its `Site` in the shared loop."""

from __future__ import annotations

import asyncio
from asyncio import TimerHandle
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import replace

from lift_manager.lift.rmf_view import rmf_holder, rmf_lift
from lift_manager.lift.state import LiftState
from lift_manager.plain.rmf import LiftView, PartialSiteView, SiteView
from lift_manager.rmf.port import Answer, Deliver, EndOfSession, ManagerListener, ManagerRequest
from lift_manager.runtime.bus import Occurrence, StateChanged
from lift_manager.runtime.errors import RequestRefused
from lift_manager.runtime.rmf_view import rmf_site_of
from lift_manager.runtime.site import Site

REFRESHES_PER_MAX_AGE = 3
"""How often the site is published within the shortest `max_age_s`, changed or not."""
MAX_GAP_S = 1.0
"""The longest time between two complete sites, whatever `max_age_s` is. Chosen: as in `remote_manager`."""


class LocalManager:
    """Implements `port.Manager`. Changes within one turn of the loop are reported together, and at once.

    Such a report contains the lifts that have changed and no others: all of them for each change of one would cost more than RMF gains by
    hearing of it sooner.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._views: dict[str, LiftView] = {}
        """Every lift, as of its newest event."""
        self._listener: ManagerListener | None = None
        self._deliver: Deliver | None = None
        self._taps = ExitStack()
        self._timer: TimerHandle | None = None
        self._changed: dict[str, None] = {}
        """The lifts of the next partial site, in the order of their news; the site is under way while there are any."""
        ages = (site.config(name).capabilities.max_age_s for name in site.lift_names())
        self._every_s = min([MAX_GAP_S, *(age / REFRESHES_PER_MAX_AGE for age in ages)])

    def start(self, listener: ManagerListener, deliver: Deliver) -> None:
        """Report the lifts to `listener`, and every change from then on."""
        self._listener, self._deliver = listener, deliver
        self._changed.clear()
        self._taps.enter_context(self._site.tap(self._on_event))
        self._refresh()

    def close(self) -> None:
        """Report nothing any more, not even answers that are due."""
        self._listener = self._deliver = None
        self._taps.close()
        if self._timer is not None:
            self._timer.cancel()

    def send(self, request: ManagerRequest) -> None:
        """Decide at once; the answer is delivered after this has returned."""
        answer = self._answer(request)
        self._deliver_soon(lambda listener: listener.on_answer(answer, _now()))
        if answer.accepted:
            # it may have changed nothing, but the adapter waits for a site that is as new as the answer
            self._report(request.lift)

    def _answer(self, request: ManagerRequest) -> Answer:
        site, holder = self._site, rmf_holder(request.session, request.adapter)
        try:
            with site.numbering(request.lift):
                if isinstance(request, EndOfSession):
                    site.end_session(request.lift, holder, request.grace_s)
                else:
                    site.request(request.lift, holder, request.floor, hold_door=request.hold_door, stays=True)
        except RequestRefused as refused:
            return Answer(request, accepted=False, code=refused.code, reason=refused.message)
        return Answer(request, accepted=True, boot=site.boot, event=site.newest)

    def _on_event(self, occurrence: Occurrence) -> None:
        if isinstance(occurrence.event, StateChanged):
            self._views[occurrence.event.lift] = self._view(occurrence.event.state)
        if occurrence.event.lift in self._views:
            self._report(occurrence.event.lift)

    def _report(self, lift: str) -> None:
        """Report a lift with the others that change in this turn."""
        if not self._changed:
            self._deliver_soon(self._publish_changed)
        self._changed[lift] = None

    def _refresh(self) -> None:
        """Report the lifts, changed or not, and schedule the next time."""
        self._views = {name: self._view(self._site.state(name)) for name in self._site.lift_names()}
        self._timer = asyncio.get_running_loop().call_later(self._every_s, self._refresh)
        self._deliver_soon(lambda listener: self._publish(listener, self._views, SiteView))

    def _publish_changed(self, listener: ManagerListener) -> None:
        changed, self._changed = self._changed, {}
        self._publish(listener, changed, PartialSiteView)

    def _publish(self, listener: ManagerListener, lifts: Iterable[str], kind: type[SiteView]) -> None:
        now = _now()
        if self._site.stopping:
            return  # no session holds a lift while the manager stops, but sessions are restored: RMF keeps the last states
        views = (replace(self._views[lift], age_s=self._site.age_s(lift)) for lift in lifts)
        listener.on_site(rmf_site_of(self._site, views, kind), now, now)

    def _view(self, state: LiftState) -> LiftView:
        return rmf_lift(state, self._site.config(state.lift))

    def _deliver_soon(self, call: Callable[[ManagerListener], None]) -> None:
        if self._deliver is None:
            return

        def deliver() -> None:
            if self._listener is not None:
                call(self._listener)

        self._deliver(deliver)


def _now() -> float:
    return asyncio.get_running_loop().time()
