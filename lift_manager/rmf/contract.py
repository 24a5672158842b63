"""One lift between RMF and the manager: who holds it on the wire, and what the manager is asked. Pure: monotonic seconds go in.

What RMF does, and where that was read: `shared/field/open-rmf.md`, sections 1.2 to 1.6 (rmf_ros2 humble 2.1.8 to main 2.12.0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from lift_manager.plain.rmf import HeldBy, LiftView
from lift_manager.rmf.messages import ASKED_DOORS, DOOR_OPEN, END_SESSION, HUMAN_MODE, REQUEST_TYPES, LiftRequest
from lift_manager.rmf.port import NOT_SENT, UNREACHABLE, Answer, EndOfSession, ManagerRequest, SessionDemand

FACE = "rmf"
_OFFLINE = "offline"
"""The manager's word for a lift that cannot be read."""
_STOPPING = "stopping"
"""And for itself, when it ends; it knows the session again when it is back."""
_NOTHING_TO_END = ("held", "unknown_lift")
"""Its answers to an end besides yes. Every other no is about the key, its disk or what is in between: the session goes on there."""

REPLAY_S = 5.0
"""So long after a writer of requests appeared, what comes may be a replay of old ones: up to 100 per fleet adapter, in a burst."""
SETTLE_S = 0.25
"""So long no other wish may come before one is told, while it may be a replay. Chosen: a burst takes milliseconds."""
REFUSED_S = 1.0
"""Pause before the manager is asked again after a no. Below 5 s, after which it counts RMF as waiting no longer."""
REPEAT_S = 2.0
"""How often a repeated wish is passed on while the lift does not show it: one lost press must not strand a robot (DESIGN section 7)."""
HEARD_S = 10.0
"""The same for one that is fulfilled, so that the manager does not take its holder for silent (it does after 30 s)."""
FRESH_S = 5.0
"""An older wish is not told any more: RMF repeats each that is not fulfilled with every LiftState, twice a second."""
END_AGAIN_S = 5.0
"""Beyond the grace; then a session that is still there is ended once more."""
PASS_ON_S = 2.0
"""How long the lift supervisor may take to pass on the END of a fleet. Every distribution passes it on at once, or drops it for good;
chosen above any delay of a network."""
UNDELIVERED_S = 30.0
"""How long an ended session is published while the manager cannot be reached. EndLiftSession repeats END for as long as it reads its own
session (open-rmf 1.5), so the END outlives a restart of the adapter. Chosen: a killed manager is back after 5 to 7 s (measured), and a
robot outside must not wait much longer for one that is not."""
DOUBTS = 16
"""Chosen: of so many sessions it is remembered that the manager may have heard them, and of as many that they are over."""
TEXT_LIMIT = 256
"""Characters of a session id; a longer one is none that a fleet adapter makes (`<fleet>/<robot>`)."""


class Disposition(str, Enum):
    """What was done with a request; the values are the words of the metrics."""

    BEGUN = "begun"
    """It is the first of its session: the manager is asked."""
    UPDATED = "updated"
    REPEATED = "repeated"
    ENDED = "ended"
    # ignored, and nothing written:
    HELD = "held_by_another"
    REFUSED = "refused"
    """The manager said no a moment ago."""
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
    """What a session wants."""

    floor: str
    """In the site's words."""
    hold_door: bool


class LiftContract:
    """Grants, updates and ends, in the order in which they come; what the manager is asked follows, one thing at a time."""

    def __init__(self, view: LiftView, grace_s: float, adapter: str = "") -> None:
        """`adapter` is the id of the adapter: a session of another one is as that of another face."""
        self.view, self.grace_s, self._adapter = view, grace_s, adapter
        self.lost = False
        """The manager cannot be heard."""
        self.session = ""
        """RMF's session that has the lift, or is to have it; empty for none."""
        self.granted = False
        """It is told to RMF: the manager said yes, or the lift only waits for the grace of the session before."""
        self.wish: RmfDemand | None = None
        """None for a session that was there before this adapter and was not heard since."""
        self.human = False
        """It asks for HUMAN mode."""
        self._told: RmfDemand | None = None
        """What the manager said yes to."""
        self._told_at = -math.inf
        self._again = False
        """It was repeated, and is to be told again."""
        self._had = False
        """The manager has held the lift for the session."""
        self._heard_at = self._tell_from = -math.inf
        self._paused_until = -math.inf
        """Wishes are not told before."""
        self._end_from = -math.inf
        """Nor are ends."""
        self._in_flight: ManagerRequest | None = None
        self._ends: list[str] = []
        """Sessions whose end the manager has to hear, the oldest first."""
        self._ended: dict[str, float] = {}
        """Sessions that are over for RMF, and when: the manager may still show one as the holder."""
        self._taken_from = ""
        """The last session that the manager ended without END."""
        self._perhaps: list[str] = []
        """Sessions of which nobody knows whether the manager heard their wish."""
        self._pass_on_until = math.inf
        """The fleet has ended the session, and the lift supervisor may take until then to pass it on."""
        self._undelivered = ""
        """The last session whose END came while the manager could not be reached."""
        self._as_of: tuple[str, int] = ("", 0)
        """Boot and event of the manager's last word; `_seen` has those of the view."""
        self._seen = self._as_of

    @property
    def holder(self) -> HeldBy | None:
        """Who holds the lift, as the manager said last."""
        return self.view.holder

    @property
    def foreign(self) -> HeldBy | None:
        """Another face that holds the lift, or another RMF."""
        return None if self._is_rmf() else self.view.holder

    @property
    def holds(self) -> bool:
        """Whether the manager has said that the session holds the lift."""
        return self._had

    @property
    def undelivered(self) -> tuple[str, ...]:
        """Sessions whose end the manager has not heard."""
        return tuple(self._ends)

    @property
    def settled(self) -> bool:
        """Whether the manager holds the lift for the session that RMF is told of, for what that wants."""
        held = self._is_held_by(self.session) and not self.view.ending and self._is_current()
        return self.granted and held and (self.wish is None or self.wish == self._told)

    def requested(self, request: LiftRequest, now: float, *, replay: bool) -> Disposition:
        """Take a request for this lift; `replay` says that it may be an old one."""
        if request.request_type == END_SESSION:
            return self.end(request.session_id, now)
        wish = self._wish_of(request)
        if isinstance(wish, Disposition):
            return wish
        session = request.session_id
        if self.session and session != self.session:
            if not self._is_given_up(now):
                return Disposition.HELD
            self._drop()
        if not self.session:
            if now < self._paused_until:
                return Disposition.REFUSED
            self._begin(session)
            self._want(wish, now, replay=replay)
            self.human = request.request_type == HUMAN_MODE
            return Disposition.BEGUN
        self._heard_at, self.human = now, request.request_type == HUMAN_MODE
        if wish == self.wish:
            self._repeat(now)
            return Disposition.REPEATED
        self._want(wish, now, replay=replay)
        return Disposition.UPDATED

    def fleet_requested(self, request: LiftRequest, now: float) -> None:
        """Note what a fleet sends to its lift supervisor. Only its END of the session that has the lift counts, and moves nothing."""
        if request.request_type == END_SESSION:
            self.fleet_ended(request.session_id, now)
        elif request.session_id == self.session:
            self._pass_on_until = math.inf  # it goes on

    def fleet_ended(self, session: str, now: float) -> None:
        """Note that a fleet has ended a session; the lift supervisor has PASS_ON_S to say so, too."""
        if session and session == self.session:
            self._pass_on_until = min(self._pass_on_until, now + PASS_ON_S)

    def end_not_passed_on(self, now: float) -> str:
        """End a session whose END the lift supervisor has not passed on in time; return it, empty for none.

        Humble drops an END without a current request, and every supervisor one of a session that it does not serve (open-rmf 1.4).
        """
        if now < self._pass_on_until:
            return ""
        session = self.session
        self.end(session, now)
        return session

    def undelivered_end(self, now: float) -> str:
        """Return the session that is published although it has ended, as its END has not reached the manager; empty for none."""
        ended_at = self._ended.get(self._undelivered, -math.inf)
        return self._undelivered if self._undelivered in self._ends and now - ended_at < UNDELIVERED_S else ""

    def heard(self, view: LiftView, boot: str, event: int, now: float) -> bool:
        """Take the lift as the manager shows it in its answer of that number; False for one that is overtaken by another."""
        self.lost = False
        if boot == self._as_of[0] and event < self._as_of[1]:
            return False  # it left before the manager's last answer
        if boot != self._as_of[0]:
            self._as_of = (boot, 0)
            # after a restart nothing is pressed before the holder is heard again, and that is RMF's word, not ours
            self._told, self._heard_at = None, -math.inf
        if _blocking(view) != _blocking(self.view):
            self._paused_until = -math.inf
        self.view, self._seen = view, (boot, event)
        if self._in_flight is None:
            self._reconcile(now)
        return True

    def answered(self, answer: Answer, now: float) -> None:
        """Take the manager's word on what it was asked."""
        request, self._in_flight = answer.request, None
        if answer.accepted:
            self._as_of = (answer.boot, answer.event)
            self._forget_doubt(request.session)
        if isinstance(request, EndOfSession):
            self._end_answered(request, answer, now)
        else:
            self._wanted_answered(request, answer, now)

    def next_request(self, now: float) -> ManagerRequest | None:
        """Return what the manager is to be asked now, if anything. It counts as asked."""
        if self._in_flight is not None or self.lost:
            return None
        self._in_flight = self._next(now)
        return self._in_flight

    def due(self, now: float) -> float:
        """Return when to ask again although nothing happens; infinite for never."""
        times = [self._pass_on_until]
        if self._in_flight is None and not self.lost:
            times += (self._tell_from, self._paused_until, self._end_from)
        return min((at for at in times if at > now), default=math.inf)

    def _wish_of(self, request: LiftRequest) -> RmfDemand | Disposition:
        if request.request_type not in REQUEST_TYPES:
            return Disposition.BAD_TYPE
        if request.door_state not in ASKED_DOORS:
            return Disposition.BAD_DOOR
        session = request.session_id
        if not 0 < len(session) <= TEXT_LIMIT or not session.isprintable():
            return Disposition.BAD_SESSION
        floor = next((site for site, name in self.view.floors.items() if name == request.destination_floor), None)
        if floor is None:
            return Disposition.UNKNOWN_FLOOR
        # AGV mode: the doors are open whenever the lift has stopped (LiftRequest.msg)
        return RmfDemand(floor, request.request_type != HUMAN_MODE or request.door_state == DOOR_OPEN)

    def _begin(self, session: str) -> None:
        self._drop()
        self.session = session
        if session in self._ends:
            self._ends.remove(session)
        # one whose grace has not run out has the lift still, and one that comes next has nobody to compete with
        known = self._is_rmf() or (session == self._taken_from and self._is_free())
        self.granted = not self.lost and self.view.live and known
        self._ended.pop(session, None)

    def _want(self, wish: RmfDemand, now: float, *, replay: bool) -> None:
        self.wish, self._heard_at = wish, now
        # whoever was waiting for its session to end when the manager ended it says END as soon as it reads that it has it again;
        # until then the supervisor repeats its last request (seen with the models of section 1.4)
        settles = replay or self.session == self._taken_from
        self._tell_from = now + SETTLE_S if settles else now
        if not replay:
            self._taken_from = ""

    def _repeat(self, now: float) -> None:
        """Let a wish that was told be told again, if it is time."""
        if self.wish is None or self._told != self.wish:
            return
        again_s = HEARD_S if self._is_fulfilled(self.wish) else REPEAT_S
        self._again = now - self._told_at >= again_s

    def end(self, session: str, now: float) -> Disposition:
        """Take END_SESSION: in any mode, for any floor, as often as it comes. The car is not moved by it."""
        if session and session == self.session:
            may_hold = self._had or self._is_asked(session) or self._is_held_by(session) or session in self._perhaps
            self._drop()
            self._paused_until = -math.inf
            if may_hold:
                self._say_end(session, now)
            return Disposition.ENDED
        if session and session in self._perhaps:
            self._say_end(session, now)
            return Disposition.ENDED
        if session in self._ends:
            return Disposition.ENDED
        if self.foreign is not None and session == str(self.foreign):
            return Disposition.END_FOREIGN
        return Disposition.END_NOT_HOLDER if session else Disposition.END_NOBODY

    def _say_end(self, session: str, now: float) -> None:
        if self.lost:
            self._undelivered = session
        elif session == self._undelivered:
            self._undelivered = ""
        self._forget_doubt(session)
        self._note_ended(session, now)
        if session not in self._ends:
            self._ends.append(session)

    def _note_ended(self, session: str, now: float) -> None:
        """Remember it: a wish that nobody answered may be executed long after, and the lift would be held for nobody."""
        self._ended.pop(session, None)
        self._ended[session] = now
        while len(self._ended) > DOUBTS:
            del self._ended[next(iter(self._ended))]

    def _drop(self) -> None:
        self.session, self.granted, self.wish, self._told, self._again, self._had = "", False, None, None, False, False
        self.human, self._pass_on_until = False, math.inf

    def _next(self, now: float) -> ManagerRequest | None:
        lift = self.view.lift
        if self._ends:
            session = self._ends[0]
            left_s = max(0.0, self._ended.get(session, now) + self.grace_s - now)
            return EndOfSession(lift, session, left_s, self._adapter) if now >= self._end_from else None
        wish = self.wish
        if wish is None or now < max(self._tell_from, self._paused_until):
            return None
        if self._told == wish and not self._again:
            return None
        if self._waits_for_grace() or now - self._heard_at > FRESH_S:
            return None
        return SessionDemand(lift, self.session, wish.floor, wish.hold_door, self._adapter)

    def _waits_for_grace(self) -> bool:
        """Whether another session of RMF, which is over, has the lift still."""
        return self._is_rmf() and not self._is_held_by(self.session)

    def _end_answered(self, request: EndOfSession, answer: Answer, now: float) -> None:
        heard = answer.accepted or answer.code in _NOTHING_TO_END
        reached = answer.code not in (UNREACHABLE, _STOPPING)
        if not heard and not (reached and self._is_current() and not self._is_held_by(request.session)):
            self._end_from = now + REFUSED_S
        elif request.session in self._ends:
            self._ends.remove(request.session)

    def _wanted_answered(self, request: SessionDemand, answer: Answer, now: float) -> None:
        if answer.code == UNREACHABLE and request.session not in self._ends:
            self._forget_doubt(request.session)
            self._perhaps = [*self._perhaps[-(DOUBTS - 1) :], request.session]
        if request.session != self.session:
            return  # it ended meanwhile; that is said next
        self._again = False
        if answer.accepted:
            self.granted, self._had = True, True
            self._told, self._told_at = RmfDemand(request.floor, request.hold_door), now
            return
        self._paused_until = now + REFUSED_S
        if answer.code == NOT_SENT:
            return  # the manager has heard nothing, and goes on as before
        self._told, self._taken_from = None, ""
        # one that was told to RMF stays while the lift is offline, as every session does
        waits = answer.code == UNREACHABLE or (self.granted and answer.code == _OFFLINE)
        if not waits and not self._is_held_by(request.session):
            self._drop()

    def _reconcile(self, now: float) -> None:
        """Bring what RMF was told together with who holds the lift."""
        holder = self.view.holder
        theirs = holder.name if holder is not None and self._is_rmf() else ""
        if theirs and self.view.ending:
            self._is_ending(theirs, now)
        since = self._ended.get(theirs)
        if since is not None and now - since > self.grace_s + END_AGAIN_S and theirs not in self._ends:
            self._say_end(theirs, now)
        if theirs == self.session != "" and self.view.ending:
            return
        if theirs and theirs not in self._ended:
            if theirs != self.session:
                # from before this adapter, or by a word that was thought to be lost
                self._drop()
                self.session = theirs
            self.granted = self._had = True
        elif self._had:
            self._taken_from = self.session  # by fire, a person's word, or its time was over
            self._drop()
        elif self._is_given_up(now):
            self._drop()
        elif self.foreign is not None:
            self.granted = False  # another face was quicker

    def _is_ending(self, session: str, now: float) -> None:
        """Take it that the manager has heard the end of the session that has the lift."""
        if session != self.session:
            if session not in self._ended:
                self._note_ended(session, now)  # perhaps by our own word from before a restart
        elif self._had:
            # somebody else's word, or one of ours that came late: RMF says with its next request whether it is meant
            self._told = None

    def _is_given_up(self, now: float) -> bool:
        """Whether the session never had the lift, and nobody has asked for it for a while; in the grace of another it need not."""
        idle = not self._is_asked(self.session) and now - self._heard_at > FRESH_S
        return not self._had and idle and not (self.granted and self._waits_for_grace())

    def _forget_doubt(self, session: str) -> None:
        self._perhaps = [one for one in self._perhaps if one != session]

    def _is_held_by(self, session: str) -> bool:
        return bool(session) and self.view.holder == HeldBy(FACE, session, self._adapter)

    def _is_current(self) -> bool:
        """Whether the view shows what the manager said last."""
        return self._seen[0] == self._as_of[0] and self._seen[1] >= self._as_of[1]

    def _is_rmf(self) -> bool:
        """Whether a session of this adapter's RMF holds the lift."""
        holder = self.view.holder
        return holder is not None and (holder.face, holder.adapter) == (FACE, self._adapter)

    def _is_free(self) -> bool:
        """Whether nothing is known to speak against a session."""
        return self.view.holder is None and not self.view.fire_latched and not self.view.keeps_off

    def _is_asked(self, session: str) -> bool:
        return isinstance(self._in_flight, SessionDemand) and self._in_flight.session == session

    def _is_fulfilled(self, wish: RmfDemand) -> bool:
        view = self.view
        there = view.live and view.standing and view.floor == wish.floor
        return there and (view.door == "open" or not wish.hold_door)


def _blocking(view: LiftView) -> tuple[object, ...]:
    """Return what a refusal may have been about."""
    return view.holder, view.live, view.mode, view.fire_latched, view.keeps_off
