"""Who commands a lift: the session, what it may do, and its end. How long it lasts is in `lease.py`.

A session has one end, `Session.end`. From it follow the withdrawal of OPEN, the release of the door, and what is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import FloorName
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.value import Value
from register_maps.words import Door, Side

RMF = "rmf"
"""The face of every holder that Open-RMF has."""

NO_LEASE: Mapping[str, str] = {
    RMF: "on humble, RMF sends nothing once the lift is at the requested floor, so silence means nothing (open-rmf 1.6.12)",
}
"""Faces whose callers cannot renew a lease, and why. Their sessions end by request, or after `max_session_s`."""

NO_ROBOT_WORDS: Mapping[str, str] = {
    RMF: "a request of RMF names a floor and a door, and nothing of what the robot does (rmf_lift_msgs/LiftRequest)",
}
"""Faces whose callers cannot report where their robots are, and why: the end of a session is all they report."""

ACTS_ONCE: Mapping[str, str] = {
    RMF: "RMF sends its robot on one OPEN and does not look again: one publish period, its decision and the crossing (open-rmf 1.6)",
}
"""Faces whose robots need `rmf_clear_s` between the withdrawal of OPEN and the release of the door, and why."""

SILENT_S = 30.0
"""A holder that is silent for this long while another caller requests the lift deserves a person's attention (DESIGN section 6)."""

CLEAR_AT_STOP_S = 3.0
"""`clear_s` of a manager that stops: the process has five seconds in all. A robot at 0.5 m/s drives 1.5 m in that time."""

STOPPING_TEXT = "the manager is stopping; the session is kept and continues at the next start"


@dataclass(frozen=True, slots=True)
class Holder:
    """The caller whose session it is: the face it came through and its name there."""

    face: str
    name: str

    def __str__(self) -> str:
        return self.name if self.face == self.name else f"{self.face}:{self.name}"


@unique
class EndReason(StrEnum):
    """Why a session is over; stable codes for faces."""

    RELEASED = "released"
    ARRIVED = "arrived"
    """It only wanted to get there."""
    LEASE = "lease"
    NOT_GRANTED = "not_granted"
    """The lift did not grant what the call needs, such as robot mode."""
    MODE = "mode"
    FIRE = "fire"
    LOCKOUT = "lockout"
    STOPPING = "stopping"
    """The manager stops. The session continues when it starts again, if its time is not over by then."""
    FORCED = "forced"
    """A person ended it."""
    TAKEN_OVER = "taken_over"
    """Its holder was silent for as long as the site allows, and another caller requested the lift."""
    MAX_SESSION = "max_session"
    """It lasted for as long as the site allows."""
    UNCLAIMED = "unclaimed"
    """It is from before a restart, and another caller sent the first request."""
    NOT_RESTORED = "not_restored"
    """It is from before a restart, and the site file no longer has what it needs."""


BY_HOLDER = frozenset({EndReason.RELEASED, EndReason.ARRIVED})
"""Its holder ended it, and needs no advice."""


@unique
class Advice(StrEnum):
    """The robot's best course when the lift is taken from it."""

    CLEAR_DOORWAY = "clear_doorway"
    """Keep out of the doorway: leave it by the nearer side, and do not enter it."""
    STAY_ABOARD = "stay_aboard"
    """The door is shut: a robot inside stays where it is, and alerts its people."""


def advise(doors: Mapping[Side, Door] | None, *, may_be_aboard: bool) -> Advice:
    """Return the best course for the robot of the session. `doors` is None while they are unknown.

    Behind a door that is not seen to be shut the doorway decides, because there a robot is hit and keeps people in. A robot that
    cannot be inside only has to keep out.
    """
    is_shut = bool(doors) and doors is not None and all(door is Door.CLOSED for door in doors.values())
    return Advice.STAY_ABOARD if is_shut and may_be_aboard else Advice.CLEAR_DOORWAY


@dataclass(frozen=True, slots=True)
class SessionPolicy:
    """How the sessions of one kind of caller differ from those of another."""

    stays: bool
    """It ends at its holder's request only; otherwise arrival, or the release of the door, ends it as well."""
    has_lease: bool
    has_robot_words: bool
    """Its holder can report that the robot left, and so has to."""
    clear_s: float
    """From the withdrawal of OPEN to the release of a held door."""


def policy_for(config: LiftConfig, holder: Holder, *, stays: bool) -> SessionPolicy:
    """Return the policy of a session of this holder."""
    return SessionPolicy(
        stays=stays,
        has_lease=holder.face not in NO_LEASE,
        has_robot_words=stays and holder.face not in NO_ROBOT_WORDS,
        clear_s=config.rmf_clear_s if holder.face in ACTS_ONCE else config.clear_s,
    )


@dataclass(frozen=True, slots=True)
class SessionEnd:
    """The end of a session that goes on until `at`. Until then outputs stay on, and nothing is pressed for it."""

    reason: EndReason
    text: str
    at: float
    is_announced: bool
    """A person or the manager ends it whatever its holder requests; otherwise its holder did, and may still change its mind."""


@dataclass(frozen=True, kw_only=True)
class Session(Value):
    """One caller's right to command one lift. One request copies it several times."""

    number: int
    holder: Holder
    policy: SessionPolicy
    floor: FloorName | None
    """Its target; None before the first request for a floor."""
    hold_door: bool
    """Hold the door open there; otherwise a session that does not stay ends on arrival."""
    opened_at: float
    opened_clock: datetime
    """The same by the clock of the building, over restarts and hand-overs."""
    lease_from: float
    """The lease runs from here: the later of the last request and the moment the door stood open at the target."""
    opened_at_target: bool = False
    """The door has stood open at the target since that floor was requested."""
    holding_since: float | None = None
    """Since when the door has been held for this session without a break."""
    hold_spent: bool = False
    """The hold reached its limit and was released; it does not begin again at this stop by itself."""
    shut_at: float | None = None
    """When the door was first seen shut after the hold was spent."""
    contacted_at: float | None = None
    """When its holder last sent a request; None while it has not since a restart of the manager."""
    restored_at: float | None = None
    """When it continued after a restart of the manager."""
    is_restored: bool = False
    """It is from before a restart, and its holder has sent no request since: what is found off is not switched on."""
    id: str = field(default="", repr=False)
    """Known to the holder alone: in no event, no log line and no row of the journal."""
    lease_s: float | None = None
    """The lease that its holder requested; the site's is the longest, and the default."""
    key: str = field(default="", repr=False)
    """Idempotency key that it was opened with; empty for none."""
    key_ttl_s: float | None = None
    """The lease that was requested with the key, which renewing does not change."""
    end: SessionEnd | None = None

    @property
    def is_ending(self) -> bool:
        """Whether its end is known."""
        return self.end is not None

    @property
    def end_is_announced(self) -> bool:
        """Whether it ends whatever its holder wants."""
        return self.end is not None and self.end.is_announced

    @property
    def ended_by_holder(self) -> bool:
        """Whether its holder has ended it and may still change its mind."""
        return self.end is not None and not self.end.is_announced

    @property
    def may_begin(self) -> bool:
        """Whether what is found off is switched on for it."""
        return not (self.is_restored or self.is_ending)

    @property
    def is_unclaimed(self) -> bool:
        """Whether its holder has sent no request since a restart."""
        return self.contacted_at is None

    def may_have_invited(self, now: float) -> bool:
        """Whether its robot may be in the door: it was invited, or was just before a restart, and that did not reach the disk."""
        return self.opened_at_target or self.is_just_restored(now)

    def is_just_restored(self, now: float) -> bool:
        """Whether a robot that was invited immediately before a restart may still be in the door."""
        return self.restored_at is not None and now < self.restored_at + self.policy.clear_s

    def silent_for(self, now: float) -> float:
        """Return for how long its holder has been silent, as far as this process can know."""
        since = self.restored_at if self.contacted_at is None else self.contacted_at
        return 0.0 if since is None else now - since


# -- what its holder requests


def renew(session: Session, now: float) -> Session:
    """Begin the lease again at the holder's request.

    One from before a restart continues, and so does one that its holder ended. One whose end was announced is renewed in vain.
    """
    end = session.end if session.end_is_announced else None
    return session.having(lease_from=now, contacted_at=now, is_restored=False, end=end)


def set_target(session: Session, floor: FloorName, now: float, *, hold_door: bool) -> Session:
    """Take its holder's request for a floor: another one, or the same again."""
    after = renew(session, now).having(hold_door=hold_door)
    if session.floor == floor:
        return after
    return after.having(floor=floor, opened_at_target=False, holding_since=None, hold_spent=False, shut_at=None)


def end_by_holder(session: Session, grace_s: float, now: float) -> Session:
    """End a session at its holder's request in this many seconds; of two requests the earlier end counts."""
    at = now + grace_s if session.end is None else min(session.end.at, now + grace_s)
    end = SessionEnd(EndReason.RELEASED, "released", at, is_announced=False)
    return session.having(contacted_at=now, end=end if not session.end_is_announced else _at(session.end, at))


def announce_end(session: Session, reason: EndReason, text: str, at: float) -> Session:
    """End a session at `at` whatever its holder requests; until then its door is held and invites nobody."""
    return session.having(end=SessionEnd(reason, text, at, is_announced=True))


def hand_session_over(session: Session, config: LiftConfig, to: Holder, session_id: str, now: float) -> Session:
    """Hand a session to another caller. Its lease starts again; its longest time does not.

    It gets an id of its own, which the former holder does not know.
    """
    policy = policy_for(config, to, stays=session.policy.stays)
    return renew(session, now).having(holder=to, policy=policy, id=session_id, key="", key_ttl_s=None)


def door_opened_at_target(session: Session, now: float) -> Session:
    """Note the first time the door stands open at the target: the lease begins again.

    Not for one that is about to end: whoever has ended it may not see the door open.
    """
    if session.opened_at_target or session.is_ending:
        return session
    return session.having(opened_at_target=True, lease_from=max(session.lease_from, now))


def may_hold_again(session: Session, config: LiftConfig, now: float) -> bool:
    """Whether a spent hold may begin again: the door has been shut, and people have had it for `between_sessions_s`."""
    return session.hold_spent and session.shut_at is not None and now >= session.shut_at + config.between_sessions_s


def hold_again(session: Session, config: LiftConfig, now: float) -> Session:
    """Let a spent hold begin again at its holder's request, once it may."""
    if not may_hold_again(session, config, now):
        return session
    return session.having(hold_spent=False, holding_since=None, opened_at_target=False, shut_at=None)


def _at(end: SessionEnd | None, at: float) -> SessionEnd | None:
    return None if end is None else replace(end, at=at)
