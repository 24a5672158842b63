"""Every lift of a manager, between its two neighbours: RMF and the manager. One thread, no clock of its own, nothing here waits."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

from lift_manager.plain.rmf import SiteView
from lift_manager.rmf.alarms import AlarmOut, FireAlarm
from lift_manager.rmf.contract import REPLAY_S, TEXT_LIMIT, Disposition, LiftContract
from lift_manager.rmf.counts import Counts
from lift_manager.rmf.messages import END_SESSION, LiftRequest, LiftState
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, Manager
from lift_manager.rmf.publishing import Cadence, message, offline, stale_at
from lift_manager.rmf.words import USUAL, quoted, why_ignored

_log = logging.getLogger(__name__)

EARLY_ENDS = 100
"""Chosen: of so many ends is kept word while the manager was never heard; a supervisor sends humble's only once."""
REST_S = 60.0
"""When to look again where nothing is due."""
_RIVAL = "rival"
_TAKEN = frozenset(
    {Disposition.BEGUN, Disposition.UPDATED, Disposition.REPEATED, Disposition.REFUSED, Disposition.ENDED}
)
"""These come with every message; what becomes of them is said when it happens."""
_LASTING = frozenset({_RIVAL, *(done.value for done in Disposition if done is not Disposition.HELD)})
"""Causes that are no news a second time; why a lift is not to be had is, once it was."""


@dataclass(frozen=True)
class RmfOutput:
    """What goes out to RMF."""

    publish: Callable[[LiftState], None]
    alarm: AlarmOut


class _Lift:
    """One lift, and what was last told of it."""

    def __init__(self, contract: LiftContract, cadence: Cadence, sent_at: float) -> None:
        self.contract = contract
        self.cadence = cadence
        self.sent_at = sent_at
        self.next_at = -math.inf

    def message(self, now: float, ros_time: float) -> LiftState:
        return message(self.contract, self.sent_at, now, ros_time)


class Adapter:
    """Implements `port.Hears`; the shells (`run`, `ros_node`) bring it what happens. Times are monotonic seconds."""

    def __init__(
        self,
        manager: Manager,
        out: RmfOutput,
        ros_time: Callable[[], float],
        counts: Counts | None = None,
        *,
        adapter_id: str = "",
    ) -> None:
        """`ros_time` is RMF's clock in seconds: the wall clock, or /clock in a simulation. `adapter_id` is that of every start."""
        self._adapter_id = adapter_id
        self.counts = counts or Counts()
        self._manager = manager
        self._out = out
        self._ros_time = ros_time
        self._lifts: dict[str, _Lift] = {}
        """By RMF's name."""
        self._by_site_name: dict[str, _Lift] = {}
        self._site: SiteView | None = None
        self._lost_why: str | None = None
        self._replay_until = -math.inf
        self._early_ends: dict[tuple[str, str], None] = {}
        """Lift and session, while the manager was never heard."""
        self._early_ends_of_fleets: dict[tuple[str, str], None] = {}
        """The same of what fleets send to their supervisor."""
        self._fire = FireAlarm(out.alarm)
        self._told: set[tuple[str, str]] = set()
        """Lift and cause of which a line was written."""

    def on_request(self, request: LiftRequest, now: float) -> None:
        """Take a request, whatever is in it."""
        lift = self._lifts.get(request.lift_name)
        if lift is None:
            done = self._for_no_lift(request)
            self._count("", done)
            self._explain(done, request, None)
            return
        held = lift.contract.holds_lift
        done = lift.contract.handle_request(request, now, replay=now < self._replay_until)
        if held and done is Disposition.ENDED:
            _log.info("%s: %s has ended its session", request.lift_name, quoted(request.session_id))
        lift.next_at = -math.inf
        self._count(request.lift_name, done)
        self._explain(done, request, lift.contract)

    def on_fleet_request(self, request: LiftRequest, now: float) -> None:
        """Take what a fleet sends to its lift supervisor: an END that is not passed on ends the session all the same."""
        lift = self._lifts.get(request.lift_name)
        if lift is not None:
            lift.contract.handle_fleet_request(request, now)
            lift.next_at = min(lift.next_at, lift.contract.due_at(now))
        elif self._site is None:
            self._note_early(request, self._early_ends_of_fleets)

    def on_unreadable(self, text: str, now: float) -> None:
        """Count a request that could not be read at all."""
        self._count("", Disposition.BROKEN)
        self._once("", Disposition.BROKEN, f"a lift request cannot be read and is left out: {quoted(text)}")

    def on_request_writer(self, now: float) -> None:
        """A writer of lift requests appeared: what it sends first may be a replay of old requests."""
        self._replay_until = now + REPLAY_S

    def on_rival(self, lift_name: str, now: float) -> None:
        """Somebody else publishes the state of a lift."""
        if lift_name in self._lifts:
            text = (
                f"another program publishes the state of {lift_name} too; robots act on whichever message comes last,"
                " so end one of the two"
            )
            self._once(lift_name, _RIVAL, text)

    def on_site(self, site: SiteView, sent_at: float, now: float) -> None:
        """Take a whole answer of the manager."""
        if self._lost_why is not None or self._site is None:
            _log.info("the manager answers: %s", ", ".join(view.name for view in site.lifts) or "it has no lifts")
        self._lost_why, self._site = None, site
        self._forget_gone(site, now)
        for place, view in enumerate(site.lifts):
            lift = self._lifts.get(view.name)
            if lift is None or lift.contract.view.lift != view.lift:
                # another lift of the site has this name now: what the old one was asked is not answered any more
                made = LiftContract(view, site.end_grace_s, self._adapter_id)
                lift = self._lifts[view.name] = _Lift(made, Cadence(place, len(site.lifts), now), sent_at)
            contract = lift.contract
            contract.grace_s, lift.next_at = site.end_grace_s, -math.inf
            before = contract.session if contract.holds_lift else ""
            if contract.update_view(view, site.boot, site.event, now):
                lift.sent_at = sent_at
            self._say_change(view.name, before, contract.session if contract.holds_lift else "")
        self._by_site_name = {lift.contract.view.lift: lift for lift in self._lifts.values()}
        self._say_early_ends(now)
        self._fire.update(site, now)

    def on_answer(self, answer: Answer, now: float) -> None:
        """Take what became of something asked."""
        lift = self._by_site_name.get(answer.request.lift)
        if lift is None:
            return  # of a site file that is no more
        lift.next_at = -math.inf
        before, name = lift.contract.holds_lift, lift.contract.view.name
        lift.contract.handle_answer(answer, now)
        if lift.contract.holds_lift and not before:
            _log.info("%s: %s has the lift", name, quoted(answer.request.session))
            self._told = {told for told in self._told if told[0] != name or told[1] in _LASTING}
        if not answer.accepted and answer.code not in (UNREACHABLE, NOT_SENT):
            what = "the end of" if isinstance(answer.request, EndOfSession) else "a request of"
            text = f"{name}: the manager refuses {what} {quoted(answer.request.session)}: {answer.reason}"
            self._once(name, answer.code, text)

    def on_manager_lost(self, reason: str, now: float) -> None:
        """The manager cannot be heard: its lifts are offline, sessions stay."""
        if reason != self._lost_why:
            _log.warning("the manager cannot be heard: %s; its lifts are offline for RMF", reason)
        self._lost_why = reason
        for lift in self._lifts.values():
            lift.contract.manager_lost, lift.next_at = True, -math.inf

    def tick(self, now: float) -> float:
        """Publish what is due, ask what is due; return when to come again, at the latest. Call it after everything above, too."""
        lifts = min((self._look(lift, now) for lift in self._lifts.values()), default=now + REST_S)
        return min(lifts, self._fire.tick(now))

    def stop(self, now: float) -> None:
        """Publish every lift as offline, door not open, one last time: a robot that waits stands still. Sessions stay."""
        for lift in self._lifts.values():
            self._out.publish(offline(lift.message(now, self._ros_time())))

    def _look(self, lift: _Lift, now: float) -> float:
        if now < lift.next_at:
            return lift.next_at
        contract = lift.contract
        if session := contract.enforce_fleet_end(now):
            self._count(contract.view.name, Disposition.ENDED)
            text = "%s: %s has ended its session, and the lift supervisor has not passed it on; it ends without"
            _log.warning(text, contract.view.name, quoted(session))
        if (request := contract.next_request(now)) is not None:
            self._manager.send(request)
        state = lift.message(now, self._ros_time())
        if lift.cadence.due(state, now):
            self._out.publish(state)
            self.counts.states[state.lift_name] += 1
            lift.cadence.sent(state, now)
        stale = stale_at(contract.view, lift.sent_at)
        lift.next_at = min(lift.cadence.next(state), contract.due_at(now), stale if stale > now else math.inf)
        return lift.next_at

    def _for_no_lift(self, request: LiftRequest) -> Disposition:
        if self._site is not None:
            return Disposition.UNKNOWN_LIFT
        self._note_early(request, self._early_ends)
        return Disposition.NO_MANAGER

    def _note_early(self, request: LiftRequest, ends: dict[tuple[str, str], None]) -> None:
        """Remember the sessions whose last request is END_SESSION."""
        ends.pop((request.lift_name, request.session_id), None)
        fits = len(request.lift_name) <= TEXT_LIMIT and 0 < len(request.session_id) <= TEXT_LIMIT
        if request.request_type == END_SESSION and fits and len(ends) < EARLY_ENDS:
            ends[request.lift_name, request.session_id] = None

    def _say_early_ends(self, now: float) -> None:
        for name, session in self._early_ends:
            if (lift := self._lifts.get(name)) is not None and lift.contract.session == session:
                lift.contract.end_session(session, now)
        for name, session in self._early_ends_of_fleets:
            if (lift := self._lifts.get(name)) is not None:
                lift.contract.handle_fleet_end(session, now)
        self._early_ends.clear()
        self._early_ends_of_fleets.clear()

    def _forget_gone(self, site: SiteView, now: float) -> None:
        names = {view.name for view in site.lifts}
        for name in [one for one in self._lifts if one not in names]:
            _log.warning("the manager has no lift %s any more", name)
            lift = self._lifts.pop(name)
            # whoever keeps the last state would see an open door for ever
            self._out.publish(offline(lift.message(now, self._ros_time())))
            if sessions := lift.contract.undelivered_sessions:
                ended = ", ".join(map(quoted, sessions))
                text = "%s: the manager has not answered that %s has ended its session; with the lift that is forgotten"
                _log.warning(text, name, ended)

    def _count(self, lift: str, done: Disposition) -> None:
        self.counts.requests[lift, done.value] += 1

    def _explain(self, done: Disposition, request: LiftRequest, contract: LiftContract | None) -> None:
        """Write one line for each cause and lift, not one for each message."""
        name = "" if contract is None else contract.view.name
        if done not in _TAKEN:
            level = logging.INFO if done in USUAL else logging.WARNING
            self._once(name, done.value, why_ignored(done, request, contract), level)

    def _say_change(self, name: str, before: str, now: str) -> None:
        """Say who has a lift, where the manager's answer shows another one than was known."""
        if now and now != before:
            _log.info("%s: %s has the lift already", name, quoted(now))
        elif before and not now:
            _log.warning("%s: the manager ended the session of %s", name, quoted(before))

    def _once(self, lift: str, cause: str, text: str, level: int = logging.WARNING) -> None:
        if (lift, cause) not in self._told:
            self._told.add((lift, cause))
            _log.log(level, "%s", text)
