"""The adapter for all lifts of a manager, between RMF and the manager. One thread; it has no clock of its own and never waits."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

from lift_manager.plain.rmf import PartialSiteView, SiteView
from lift_manager.rmf.alarms import AlarmPublisher, FireAlarm
from lift_manager.rmf.counts import Counts
from lift_manager.rmf.early_ends import EarlyEnds
from lift_manager.rmf.ignored_requests import USUAL, explain_ignored, quoted
from lift_manager.rmf.lift_sessions import REPLAY_S, Disposition, LiftSessions
from lift_manager.rmf.lift_state import Cadence, as_offline, make_state, stale_at
from lift_manager.rmf.messages import END_SESSION, LiftRequest, LiftState
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, Manager

_log = logging.getLogger(__name__)

IDLE_S = 60.0
"""Until the next tick if nothing is due."""
_RIVAL = "rival"
_HANDLED = frozenset(
    {Disposition.BEGUN, Disposition.UPDATED, Disposition.REPEATED, Disposition.REFUSED, Disposition.ENDED}
)
"""These are not logged for each message; their results are logged when they happen."""
_LOGGED_ONCE = frozenset(
    {_RIVAL, *(disposition.value for disposition in Disposition if disposition is not Disposition.HELD)}
)
"""Causes that are logged once per lift; the others are logged again after a session has had the lift."""


@dataclass(frozen=True)
class RmfOutput:
    """Where the adapter publishes to RMF."""

    publish: Callable[[LiftState], None]
    alarm: AlarmPublisher


class _Lift:
    """One lift, and when its next state is due."""

    def __init__(self, sessions: LiftSessions, cadence: Cadence, sent_at: float) -> None:
        self.sessions = sessions
        self.cadence = cadence
        self.sent_at = sent_at
        self.next_at = -math.inf

    def make_state(self, now: float, ros_time: float) -> LiftState:
        return make_state(self.sessions, self.sent_at, now, ros_time)


class Adapter:
    """Implements `port.ManagerListener`; `run` and `ros_node` call it with events. Times are monotonic seconds."""

    def __init__(
        self,
        manager: Manager,
        output: RmfOutput,
        ros_time: Callable[[], float],
        counts: Counts | None = None,
        *,
        adapter_id: str = "",
        first_reading_s: float = 0.0,
    ) -> None:
        """`ros_time` is RMF's clock in seconds: the wall clock, or /clock in a simulation. `adapter_id` is the same after each start.

        A lift that the manager has not read yet is published `first_reading_s` after the manager's first answer: where another adapter has
        published it until now, RMF need not see that this one knows nothing yet.
        """
        self._adapter_id = adapter_id
        self.counts = counts or Counts()
        self._manager = manager
        self._output = output
        self._ros_time = ros_time
        self._lifts: dict[str, _Lift] = {}
        """By RMF's name."""
        self._by_site_name: dict[str, _Lift] = {}
        self._site: SiteView | None = None
        self._lost_reason: str | None = None
        self._replay_until = -math.inf
        self._early_ends = EarlyEnds()
        """ENDs before the manager's first answer."""
        self._early_ends_of_fleets = EarlyEnds()
        """The same for ENDs that fleets send to their supervisor."""
        self._first_reading_s = first_reading_s
        self._unread_until = -math.inf
        """Until then a lift without a reading is not published."""
        self._fire = FireAlarm(output.alarm)
        self._logged: set[tuple[str, str]] = set()
        """Lift and cause of the lines that were logged."""

    def on_request(self, request: LiftRequest, now: float) -> None:
        """Process a request with any content."""
        lift = self._lifts.get(request.lift_name)
        if lift is None:
            disposition = self._handle_without_lift(request, now)
            self._count("", disposition)
            if disposition is not Disposition.NO_MANAGER or request.request_type != END_SESSION:
                self._explain(disposition, request, None)
            return
        held = lift.sessions.holds_lift
        disposition = lift.sessions.handle_request(request, now, replay=now < self._replay_until)
        if held and disposition is Disposition.ENDED:
            _log.info("%s: %s has ended its session", request.lift_name, quoted(request.session_id))
        lift.next_at = -math.inf
        self._count(request.lift_name, disposition)
        self._explain(disposition, request, lift.sessions)

    def on_fleet_request(self, request: LiftRequest, now: float) -> None:
        """Process what a fleet sends to its lift supervisor: an END ends the session even if the supervisor does not pass it on."""
        lift = self._lifts.get(request.lift_name)
        if lift is not None:
            lift.sessions.handle_fleet_request(request, now)
            lift.next_at = min(lift.next_at, lift.sessions.due_at(now))
        elif self._site is None:
            self._early_ends_of_fleets.note(request, now)

    def on_unreadable(self, text: str, now: float) -> None:
        """Count a request that cannot be decoded."""
        self._count("", Disposition.BROKEN)
        self._log_once("", Disposition.BROKEN, f"ignored a lift request that cannot be read: {quoted(text)}")

    def on_request_writer(self, now: float) -> None:
        """Treat the next requests as a possible replay: a writer of lift requests has appeared."""
        self._replay_until = now + REPLAY_S

    def on_rival(self, lift_name: str, now: float) -> None:
        """Warn that another program publishes the state of a lift."""
        if lift_name in self._lifts:
            text = (
                f"another program publishes the state of {lift_name} too; robots act on whichever message comes last,"
                " so stop one of the two"
            )
            self._log_once(lift_name, _RIVAL, text)

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        """Take over an answer of the manager; a partial one only after a complete one."""
        if self._lost_reason is not None or self._site is None:
            _log.info("the manager answers: %s", ", ".join(view.name for view in site.lifts) or "it has no lifts")
        if self._site is None:
            self._unread_until = now + self._first_reading_s
        complete = site.completed(self._site) if isinstance(site, PartialSiteView) and self._site is not None else site
        self._lost_reason, self._site = None, complete
        self._forget_gone(complete, now)
        for index, view in enumerate(site.lifts):
            lift = self._lifts.get(view.name)
            if lift is None or lift.sessions.view.lift != view.lift:
                # another lift of the site has this name now: the answer to a request about the old one does not count any more
                sessions = LiftSessions(view, site.end_grace_s, self._adapter_id)
                lift = self._lifts[view.name] = _Lift(sessions, Cadence(index, len(site.lifts), now), sent_at)
            sessions = lift.sessions
            sessions.grace_s, lift.next_at = site.end_grace_s, -math.inf
            before = sessions.session if sessions.holds_lift else ""
            if sessions.update_view(view, site.boot, site.event, now):
                lift.sent_at = sent_at
            self._log_holder_change(view.name, before, sessions.session if sessions.holds_lift else "")
        self._by_site_name = {lift.sessions.view.lift: lift for lift in self._lifts.values()}
        self._apply_early_ends(now)
        self._fire.update(complete, now)

    def on_answer(self, answer: Answer, now: float) -> None:
        """Process the answer to a request."""
        lift = self._by_site_name.get(answer.request.lift)
        if lift is None:
            return  # of an earlier site file
        lift.next_at = -math.inf
        before, name = lift.sessions.holds_lift, lift.sessions.view.name
        lift.sessions.handle_answer(answer, now)
        if lift.sessions.holds_lift and not before:
            _log.info("%s: %s has the lift", name, quoted(answer.request.session))
            self._logged = {logged for logged in self._logged if logged[0] != name or logged[1] in _LOGGED_ONCE}
        if not answer.accepted and answer.code not in (UNREACHABLE, NOT_SENT):
            what = "the end of" if isinstance(answer.request, EndOfSession) else "a request of"
            text = f"{name}: the manager refuses {what} {quoted(answer.request.session)}: {answer.reason}"
            self._log_once(name, answer.code, text)

    def on_manager_lost(self, reason: str, now: float) -> None:
        """Show the lifts as offline while the manager does not answer; sessions stay."""
        if reason != self._lost_reason:
            _log.warning("the manager does not answer: %s; its lifts are offline for RMF", reason)
        self._lost_reason = reason
        for lift in self._lifts.values():
            lift.sessions.manager_lost, lift.next_at = True, -math.inf

    def tick(self, now: float) -> float:
        """Publish and send what is due; return when to call this again at the latest. Call it after every method above, too."""
        lifts = min((self._update_lift(lift, now) for lift in self._lifts.values()), default=now + IDLE_S)
        return min(lifts, self._fire.tick(now))

    def stop(self, now: float) -> None:
        """Publish every lift as offline with its door not open, one last time, so that waiting robots stand still. Sessions stay."""
        for lift in self._lifts.values():
            self._output.publish(as_offline(lift.make_state(now, self._ros_time())))

    def _update_lift(self, lift: _Lift, now: float) -> float:
        if now < lift.next_at:
            return lift.next_at
        sessions = lift.sessions
        if session := sessions.enforce_fleet_end(now):
            self._count(sessions.view.name, Disposition.ENDED)
            text = "%s: %s has ended its session, and the lift supervisor has not passed the END on; the session ends all the same"
            _log.warning(text, sessions.view.name, quoted(session))
        if (request := sessions.next_request(now)) is not None:
            self._manager.send(request)
        if sessions.view.age_s is None and now < self._unread_until:
            lift.next_at = min(self._unread_until, sessions.due_at(now))
            return lift.next_at
        state = lift.make_state(now, self._ros_time())
        if lift.cadence.is_due(state, now):
            self._output.publish(state)
            self.counts.states[state.lift_name] += 1
            lift.cadence.mark_sent(state, now)
        stale = stale_at(sessions.view, lift.sent_at)
        lift.next_at = min(lift.cadence.next_at(state), sessions.due_at(now), stale if stale > now else math.inf)
        return lift.next_at

    def _handle_without_lift(self, request: LiftRequest, now: float) -> Disposition:
        if self._site is not None:
            return Disposition.UNKNOWN_LIFT
        self._early_ends.note(request, now)
        return Disposition.NO_MANAGER

    def _apply_early_ends(self, now: float) -> None:
        for name, session in self._early_ends.at(now):
            if (lift := self._lifts.get(name)) is not None and lift.sessions.session == session:
                lift.sessions.end_session(session, now)
        for name, session in self._early_ends_of_fleets.at(now):
            if (lift := self._lifts.get(name)) is not None:
                lift.sessions.handle_fleet_end(session, now)
        self._early_ends.clear()
        self._early_ends_of_fleets.clear()

    def _forget_gone(self, site: SiteView, now: float) -> None:
        names = {view.name for view in site.lifts}
        for name in [one for one in self._lifts if one not in names]:
            _log.warning("the manager no longer has a lift %s", name)
            lift = self._lifts.pop(name)
            # a reader that keeps the last state would see an open door forever
            self._output.publish(as_offline(lift.make_state(now, self._ros_time())))
            if sessions := lift.sessions.undelivered_sessions:
                ended = ", ".join(map(quoted, sessions))
                text = (
                    "%s: the manager has not confirmed the end of the session of %s, which is forgotten with the lift"
                )
                _log.warning(text, name, ended)

    def _count(self, lift: str, disposition: Disposition) -> None:
        self.counts.requests[lift, disposition.value] += 1

    def _explain(self, disposition: Disposition, request: LiftRequest, sessions: LiftSessions | None) -> None:
        """Log one line for each cause and lift, not one for each message."""
        name = "" if sessions is None else sessions.view.name
        if disposition not in _HANDLED:
            level = logging.INFO if disposition in USUAL else logging.WARNING
            self._log_once(name, disposition.value, explain_ignored(disposition, request, sessions), level)

    def _log_holder_change(self, name: str, before: str, now: str) -> None:
        """Log a change of the holder that only the manager's answer shows."""
        if now and now != before:
            _log.info("%s: %s has the lift already", name, quoted(now))
        elif before and not now:
            _log.warning("%s: the manager ended the session of %s", name, quoted(before))

    def _log_once(self, lift: str, cause: str, text: str, level: int = logging.WARNING) -> None:
        if (lift, cause) not in self._logged:
            self._logged.add((lift, cause))
            _log.log(level, "%s", text)
