"""One lift between RMF and the manager: which session RMF sees as its holder, and what to send to the manager.

Pure: times are monotonic seconds. What RMF does, with sources: `shared/field/open-rmf.md`, sections 1.2 to 1.6 (rmf_ros2 humble 2.1.8
to main 2.12.0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from lift_manager.plain.rmf import HeldBy, LiftView
from lift_manager.rmf.messages import DOOR_OPEN, END_SESSION, HUMAN_MODE, REQUEST_DOORS, REQUEST_TYPES, LiftRequest
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, ManagerRequest, SessionDemand

FACE = "rmf"
_OFFLINE = "offline"
"""The manager's code for a lift that cannot be read."""
_STOPPING = "stopping"
"""The manager's code while it shuts down; it restores the session when it is back."""
_NOTHING_TO_END = ("held", "unknown_lift")
"""Refusals of an end which mean that the session is over. Every other refusal is about the key, the manager's disk or the network between:
the session goes on there."""

REPLAY_S = 5.0
"""For this long after a writer of requests appears, requests may be a replay of old ones: up to 100 per fleet adapter, in a burst."""
REPLAY_SETTLE_S = 0.25
"""While requests may be a replay, a demand is sent only after no other has come for this long. Chosen: a burst takes milliseconds."""
REFUSAL_PAUSE_S = 1.0
"""Pause after a refusal. Less than 5 s, after which the manager no longer counts RMF as waiting."""
REPEAT_S = 2.0
"""How often a repeated demand is passed on while the lift does not fulfil it: one lost press must not strand a robot (DESIGN section 7)."""
RENEW_S = 10.0
"""How often a fulfilled demand is passed on, so that the manager does not take its holder for silent (it does after 30 s)."""
DEMAND_MAX_AGE_S = 5.0
"""An older demand is not sent: RMF repeats each unfulfilled one with every LiftState, twice a second."""
END_RETRY_S = 5.0
"""After the grace period, until a session that still holds the lift is ended once more."""
PASS_ON_S = 2.0
"""How long the lift supervisor may take to pass on the END of a fleet. Every distribution passes it on at once, or drops it for good.
Chosen: longer than any network delay."""
UNDELIVERED_S = 30.0
"""How long an ended session is still published while the manager cannot be reached. EndLiftSession repeats END for as long as it reads its
own session (open-rmf 1.5), so the END outlives a restart of the adapter. Chosen: a killed manager is back after 5 to 7 s (measured), and a
robot outside must not wait much longer for one that does not come back."""
MAX_REMEMBERED = 16
"""How many uncertain sessions, and how many ended ones, are remembered. Chosen."""
TEXT_LIMIT = 256
"""Characters of a session id. Fleet adapters make no longer ones (`<fleet>/<robot>`)."""


class Disposition(str, Enum):
    """What was done with a request; the values are label values of the metrics."""

    BEGUN = "begun"
    """It is the first of its session."""
    UPDATED = "updated"
    REPEATED = "repeated"
    ENDED = "ended"
    # ignored:
    HELD = "held_by_another"
    REFUSED = "refused"
    """The manager refused a moment ago."""
    END_NOBODY = "end_without_session"
    """Jazzy and iron send it with every LiftState of an idle lift; `request_lift.py` of rmf_demos sends it for a request."""
    END_NOT_HOLDER = "end_not_holder"
    END_FOREIGN = "end_of_another_face"
    UNKNOWN_LIFT = "unknown_lift"
    UNKNOWN_FLOOR = "unknown_floor"
    BAD_DOOR = "bad_door_state"
    BAD_TYPE = "bad_request_type"
    BAD_SESSION = "bad_session_id"
    NO_MANAGER = "no_manager"
    BROKEN = "broken_text"


@dataclass(frozen=True)
class RmfDemand:
    """The floor and the door hold that a session requests."""

    floor: str
    """By the site's name."""
    hold_door: bool


class LiftSessions:
    """Grants, updates and ends RMF's sessions on one lift in the order of the requests; the manager gets one request at a time."""

    def __init__(self, view: LiftView, grace_s: float, adapter: str = "") -> None:
        """`adapter` is the id of the adapter: a session of another adapter counts as one of another face."""
        self.view, self.grace_s, self._adapter = view, grace_s, adapter
        self.manager_lost = False
        """The manager does not answer."""
        self.session = ""
        """RMF's session that has the lift or is to get it; empty for none."""
        self.is_granted = False
        """RMF sees the session as the holder: the manager has accepted it, or only the grace of the previous session has to run out."""
        self.demand: RmfDemand | None = None
        """None for a session that began before this adapter and has sent no request since."""
        self.human_mode = False
        """The session requests HUMAN mode."""
        self._accepted: RmfDemand | None = None
        """The demand that the manager has accepted."""
        self._accepted_at = -math.inf
        self._resend_due = False
        """RMF has repeated the demand, and it is due to be sent again."""
        self._had_lift = False
        """The manager has held the lift for the session."""
        self._requested_at = self._send_demand_from = -math.inf
        self._paused_until = -math.inf
        """No demand is sent before."""
        self._send_end_from = -math.inf
        """No end is sent before."""
        self._in_flight: ManagerRequest | None = None
        self._pending_ends: list[str] = []
        """Sessions whose end the manager does not know yet, the oldest first."""
        self._ended_at: dict[str, float] = {}
        """When sessions ended for RMF: the manager may still show one of them as the holder."""
        self._revoked_session = ""
        """The last session that the manager ended without an END."""
        self._uncertain_sessions: list[str] = []
        """Sessions whose demand may have reached the manager although no answer came."""
        self._fleet_end_due_at = math.inf
        """After the END of the fleet: when the session ends although the lift supervisor has not passed it on."""
        self._undelivered_session = ""
        """The last session whose END came while the manager did not answer."""
        self._decided_event: tuple[str, int] = ("", 0)
        """Boot and event of the manager's last decision; `_view_event` has those of the view."""
        self._view_event = self._decided_event

    @property
    def holder(self) -> HeldBy | None:
        """The holder of the lift in the manager's latest answer."""
        return self.view.holder

    @property
    def foreign_holder(self) -> HeldBy | None:
        """The holder, if it is another face or another RMF."""
        return None if self._is_held_by_rmf() else self.view.holder

    @property
    def holds_lift(self) -> bool:
        """Whether the manager has confirmed that the session holds the lift."""
        return self._had_lift

    @property
    def undelivered_sessions(self) -> tuple[str, ...]:
        """Sessions whose end the manager does not know yet."""
        return tuple(self._pending_ends)

    @property
    def is_settled(self) -> bool:
        """Whether the manager holds the lift for the session that RMF sees, and for its latest demand."""
        held = self._is_held_by(self.session) and not self.view.ending and self._is_view_current()
        return self.is_granted and held and (self.demand is None or self.demand == self._accepted)

    def handle_request(self, request: LiftRequest, now: float, *, replay: bool) -> Disposition:
        """Process a request for this lift; `replay` means that it may be an old one."""
        if request.request_type == END_SESSION:
            return self.end_session(request.session_id, now)
        demand = self._demand_of(request)
        if isinstance(demand, Disposition):
            return demand
        session = request.session_id
        if self.session and session != self.session:
            if not self._is_abandoned(now):
                return Disposition.HELD
            self._clear_session()
        if not self.session:
            if now < self._paused_until:
                return Disposition.REFUSED
            self._begin_session(session)
            self._set_demand(demand, now, replay=replay)
            self.human_mode = request.request_type == HUMAN_MODE
            return Disposition.BEGUN
        self._requested_at, self.human_mode = now, request.request_type == HUMAN_MODE
        if demand == self.demand:
            self._repeat_demand(now, replay=replay)
            return Disposition.REPEATED
        self._set_demand(demand, now, replay=replay)
        return Disposition.UPDATED

    def handle_fleet_request(self, request: LiftRequest, now: float) -> None:
        """Process what a fleet sends to its lift supervisor. Only its END of the session that has the lift counts."""
        if request.request_type == END_SESSION:
            self.handle_fleet_end(request.session_id, now)
        elif request.session_id == self.session:
            self._fleet_end_due_at = math.inf  # it goes on

    def handle_fleet_end(self, session: str, now: float) -> None:
        """Give the lift supervisor PASS_ON_S to pass on a fleet's END of the session that has the lift."""
        if session and session == self.session:
            self._fleet_end_due_at = min(self._fleet_end_due_at, now + PASS_ON_S)

    def enforce_fleet_end(self, now: float) -> str:
        """End the session if the lift supervisor has not passed on its END in time; return it, empty for none.

        Humble drops an END without a current request, and every supervisor drops the END of a session that it does not serve
        (open-rmf 1.4).
        """
        if now < self._fleet_end_due_at:
            return ""
        session = self.session
        self.end_session(session, now)
        return session

    def undelivered_session(self, now: float) -> str:
        """Return the ended session that is still published because its END has not reached the manager; empty for none."""
        ended_at = self._ended_at.get(self._undelivered_session, -math.inf)
        return (
            self._undelivered_session
            if self._undelivered_session in self._pending_ends and now - ended_at < UNDELIVERED_S
            else ""
        )

    def update_view(self, view: LiftView, boot: str, event: int, now: float) -> bool:
        """Take over the lift from the manager's answer of this number; return False if the answer is older than a decision."""
        self.manager_lost = False
        if boot == self._decided_event[0] and event < self._decided_event[1]:
            return False  # it was made before the manager's latest decision
        if boot != self._decided_event[0]:
            self._decided_event = (boot, 0)
            # after a restart the manager presses nothing before the holder's next request, which has to come from RMF and not from us
            self._accepted, self._requested_at = None, -math.inf
        if _blockers(view) != _blockers(self.view):
            self._paused_until = -math.inf
        self.view, self._view_event = view, (boot, event)
        if self._in_flight is None:
            self._reconcile(now)
        return True

    def handle_answer(self, answer: Answer, now: float) -> None:
        """Process the manager's answer to a request."""
        request, self._in_flight = answer.request, None
        if answer.accepted:
            self._decided_event = (answer.boot, answer.event)
            self._clear_uncertainty(request.session)
        if isinstance(request, EndOfSession):
            self._handle_end_answer(request, answer, now)
        else:
            self._handle_demand_answer(request, answer, now)

    def next_request(self, now: float) -> ManagerRequest | None:
        """Return the request to send to the manager now, if any. It counts as sent."""
        if self._in_flight is not None or self.manager_lost:
            return None
        self._in_flight = self._choose_request(now)
        return self._in_flight

    def due_at(self, now: float) -> float:
        """Return when `next_request` is due even if nothing happens; infinite for never."""
        times = [self._fleet_end_due_at]
        if self._in_flight is None and not self.manager_lost:
            times += (self._send_demand_from, self._paused_until, self._send_end_from)
        return min((at for at in times if at > now), default=math.inf)

    def _demand_of(self, request: LiftRequest) -> RmfDemand | Disposition:
        if request.request_type not in REQUEST_TYPES:
            return Disposition.BAD_TYPE
        if request.door_state not in REQUEST_DOORS:
            return Disposition.BAD_DOOR
        session = request.session_id
        if not 0 < len(session) <= TEXT_LIMIT or not session.isprintable():
            return Disposition.BAD_SESSION
        floor = next((site for site, name in self.view.floors.items() if name == request.destination_floor), None)
        if floor is None:
            return Disposition.UNKNOWN_FLOOR
        # AGV mode: the doors are open whenever the lift has stopped (LiftRequest.msg)
        return RmfDemand(floor, request.request_type != HUMAN_MODE or request.door_state == DOOR_OPEN)

    def _begin_session(self, session: str) -> None:
        self._clear_session()
        self.session = session
        if session in self._pending_ends:
            self._pending_ends.remove(session)
        # in the grace of a session RMF still has the lift, so the next session has no competitor; nor has a revoked one on a free lift
        known = self._is_held_by_rmf() or (session == self._revoked_session and self._is_free())
        self.is_granted = not self.manager_lost and self.view.live and known
        self._ended_at.pop(session, None)

    def _set_demand(self, demand: RmfDemand, now: float, *, replay: bool) -> None:
        self.demand, self._requested_at = demand, now
        # a robot that was waiting for the end of its session when the manager ended it sends END as soon as it reads that it has the lift
        # again; until then the supervisor repeats its last request (found with the models of section 1.4)
        settles = replay or self.session == self._revoked_session
        self._send_demand_from = now + REPLAY_SETTLE_S if settles else now
        if not replay:
            self._revoked_session = ""

    def _repeat_demand(self, now: float, *, replay: bool) -> None:
        """Mark an accepted demand to be sent again, if it is time. In a replay another floor may come behind it."""
        if self.demand is None or self._accepted != self.demand:
            return
        if replay:
            self._send_demand_from = now + REPLAY_SETTLE_S
        again_s = RENEW_S if self._is_fulfilled(self.demand) else REPEAT_S
        self._resend_due = now - self._accepted_at >= again_s

    def end_session(self, session: str, now: float) -> Disposition:
        """Process END_SESSION: in any mode, for any floor, as often as it comes. It does not move the car."""
        if session and session == self.session:
            may_hold = (
                self._had_lift
                or self._has_demand_in_flight(session)
                or self._is_held_by(session)
                or session in self._uncertain_sessions
            )
            self._clear_session()
            self._paused_until = -math.inf
            if may_hold:
                self._queue_end(session, now)
            return Disposition.ENDED
        if session and session in self._uncertain_sessions:
            self._queue_end(session, now)
            return Disposition.ENDED
        if session in self._pending_ends:
            return Disposition.ENDED
        if self.foreign_holder is not None and session == str(self.foreign_holder):
            return Disposition.END_FOREIGN
        return Disposition.END_NOT_HOLDER if session else Disposition.END_NOBODY

    def _queue_end(self, session: str, now: float) -> None:
        if self.manager_lost:
            self._undelivered_session = session
        elif session == self._undelivered_session:
            self._undelivered_session = ""
        self._clear_uncertainty(session)
        self._remember_end(session, now)
        if session not in self._pending_ends:
            self._pending_ends.append(session)

    def _remember_end(self, session: str, now: float) -> None:
        """Remember an ended session: an unanswered demand may be executed much later, and would hold the lift for nobody."""
        self._ended_at.pop(session, None)
        self._ended_at[session] = now
        while len(self._ended_at) > MAX_REMEMBERED:
            del self._ended_at[next(iter(self._ended_at))]

    def _clear_session(self) -> None:
        self.session, self.is_granted, self.demand, self._accepted, self._resend_due, self._had_lift = (
            "",
            False,
            None,
            None,
            False,
            False,
        )
        self.human_mode, self._fleet_end_due_at = False, math.inf

    def _choose_request(self, now: float) -> ManagerRequest | None:
        lift = self.view.lift
        if self._pending_ends:
            session = self._pending_ends[0]
            remaining_s = max(0.0, self._ended_at.get(session, now) + self.grace_s - now)
            return EndOfSession(lift, session, remaining_s, self._adapter) if now >= self._send_end_from else None
        demand = self.demand
        if demand is None or now < max(self._send_demand_from, self._paused_until):
            return None
        if self._accepted == demand and not self._resend_due:
            return None
        if self._waits_for_grace() or now - self._requested_at > DEMAND_MAX_AGE_S:
            return None
        return SessionDemand(lift, self.session, demand.floor, demand.hold_door, self._adapter)

    def _waits_for_grace(self) -> bool:
        """Whether another session of RMF, which has ended, still has the lift."""
        return self._is_held_by_rmf() and not self._is_held_by(self.session)

    def _handle_end_answer(self, request: EndOfSession, answer: Answer, now: float) -> None:
        ended = answer.accepted or answer.code in _NOTHING_TO_END
        reached = answer.code not in (UNREACHABLE, _STOPPING)
        if not ended and not (reached and self._is_view_current() and not self._is_held_by(request.session)):
            self._send_end_from = now + REFUSAL_PAUSE_S
        elif request.session in self._pending_ends:
            self._pending_ends.remove(request.session)

    def _handle_demand_answer(self, request: SessionDemand, answer: Answer, now: float) -> None:
        if answer.code == UNREACHABLE and request.session not in self._pending_ends:
            self._clear_uncertainty(request.session)
            self._uncertain_sessions = [*self._uncertain_sessions[-(MAX_REMEMBERED - 1) :], request.session]
        if request.session != self.session:
            return  # it has ended meanwhile; the end is sent next
        self._resend_due = False
        if answer.accepted:
            self.is_granted, self._had_lift = True, True
            self._accepted, self._accepted_at = RmfDemand(request.floor, request.hold_door), now
            return
        self._paused_until = now + REFUSAL_PAUSE_S
        if answer.code == NOT_SENT:
            return  # it did not reach the manager, where nothing changes
        self._accepted, self._revoked_session = None, ""
        # a session that RMF sees as the holder stays while the lift is offline, as every session does
        waits = answer.code == UNREACHABLE or (self.is_granted and answer.code == _OFFLINE)
        if not waits and not self._is_held_by(request.session):
            self._clear_session()

    def _reconcile(self, now: float) -> None:
        """Reconcile the session that RMF sees with the actual holder of the lift."""
        holder = self.view.holder
        rmf_session = holder.name if holder is not None and self._is_held_by_rmf() else ""
        if rmf_session and self.view.ending:
            self._accept_ending(rmf_session, now)
        since = self._ended_at.get(rmf_session)
        if since is not None and now - since > self.grace_s + END_RETRY_S and rmf_session not in self._pending_ends:
            self._queue_end(rmf_session, now)
        if rmf_session == self.session != "" and self.view.ending:
            return
        if rmf_session and rmf_session not in self._ended_at:
            if rmf_session != self.session:
                # from before this adapter, or of a demand that seemed lost
                self._clear_session()
                self.session = rmf_session
            self.is_granted = self._had_lift = True
        elif self._had_lift:
            self._revoked_session = self.session  # by a fire, by a person, or because its lease ran out
            self._clear_session()
        elif self._is_abandoned(now):
            self._clear_session()
        elif self.foreign_holder is not None:
            self.is_granted = False  # another face was faster

    def _accept_ending(self, session: str, now: float) -> None:
        """Process that the session which has the lift has ended at the manager."""
        if session != self.session:
            if session not in self._ended_at:
                self._remember_end(session, now)  # perhaps by this adapter before a restart
        elif self._had_lift:
            # ended by another caller, or by a late END of ours: RMF's next request decides whether it goes on
            self._accepted = None

    def _is_abandoned(self, now: float) -> bool:
        """Whether the session never had the lift and has sent no request for a while; it need not during the grace of another."""
        idle = not self._has_demand_in_flight(self.session) and now - self._requested_at > DEMAND_MAX_AGE_S
        return not self._had_lift and idle and not (self.is_granted and self._waits_for_grace())

    def _clear_uncertainty(self, session: str) -> None:
        self._uncertain_sessions = [one for one in self._uncertain_sessions if one != session]

    def _is_held_by(self, session: str) -> bool:
        return bool(session) and self.view.holder == HeldBy(FACE, session, self._adapter)

    def _is_view_current(self) -> bool:
        """Whether the view includes the manager's latest decision."""
        return self._view_event[0] == self._decided_event[0] and self._view_event[1] >= self._decided_event[1]

    def _is_held_by_rmf(self) -> bool:
        """Whether a session of this adapter's RMF holds the lift."""
        holder = self.view.holder
        return holder is not None and (holder.face, holder.adapter) == (FACE, self._adapter)

    def _is_free(self) -> bool:
        """Whether nothing known prevents a session."""
        return self.view.holder is None and not self.view.fire_latched and not self.view.keeps_off

    def _has_demand_in_flight(self, session: str) -> bool:
        return isinstance(self._in_flight, SessionDemand) and self._in_flight.session == session

    def _is_fulfilled(self, demand: RmfDemand) -> bool:
        view = self.view
        there = view.live and view.standing and view.floor == demand.floor
        return there and (view.door == "open" or not demand.hold_door)


def _blockers(view: LiftView) -> tuple[object, ...]:
    """Return what may have caused a refusal."""
    return view.holder, view.live, view.mode, view.fire_latched, view.keeps_off
