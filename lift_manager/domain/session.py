"""Who may command a lift, and for how long. Pure functions; every face goes through them."""

from __future__ import annotations

import math
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from drivers.model import FloorName
from lift_manager.domain.asking import Ask, Blocking, Refusal, Refused
from lift_manager.domain.boarding import KeptBoarding
from lift_manager.domain.state import Holder

if TYPE_CHECKING:
    # what outlives the manager has a session, and is of that module
    from lift_manager.domain.service import EndReason

NO_LEASE: Mapping[str, str] = {
    "rmf": "on humble, RMF asks no more once the lift is where it is wanted, so silence says nothing (open-rmf 1.6.12)",
}
"""Faces whose callers cannot renew a lease, and why. Their sessions end by a word, or after `max_session_s`."""

NO_WORDS: Mapping[str, str] = {
    "rmf": "a request of RMF names a floor and a door, and nothing of what the robot does (rmf_lift_msgs/LiftRequest)",
}
"""Faces whose sessions stay and whose callers have no words for their robots, and why: the end of a session is all they say."""

ACTS_ONCE: Mapping[str, str] = {
    "rmf": "RMF sends its robot on one OPEN and does not look again: one publish period, its decision and the crossing (open-rmf 1.6)",
}
"""Faces whose robots need longer between the withdrawal of OPEN and the release of the door (`rmf.clear_s`), and why."""

CLEARS_IN_A_LIMIT = 3
"""A lease or a limit of the door hold is at least this many times `clear_s`. Chosen: two thirds of it are left for crossing."""

_ID_BYTES = 16

SILENT_S = 30.0
"""A holder that was not heard for so long, while another asks, is worth a person's look (DESIGN section 7)."""


@dataclass(frozen=True, slots=True)
class Session:
    """One caller's right to command one lift."""

    number: int
    holder: Holder
    floor: FloorName | None
    """Where the car is wanted; None before anybody said."""
    hold_door: bool
    """Hold the door open there; otherwise a session that does not stay ends on arrival."""
    opened_at: float
    lease_from: float
    """The lease runs from here: the later of the last request and the moment the door stood open at `floor`."""
    stood_open: bool = False
    """The door has stood open at `floor` since that floor was asked for."""
    holding_since: float | None = None
    """Since when the door has been held for this session without a break."""
    hold_spent: bool = False
    """The hold reached its limit and was let go; it is not taken up again at this floor."""
    heard_at: float | None = None
    """When its holder last asked for anything; None while it has not since a restart of the manager."""
    restored_at: float | None = None
    """When it was taken up after a restart of the manager."""
    restored: bool = False
    """It is from before a restart, and its holder has not been obeyed since: what is found off is not put on."""
    id: str = field(default="", repr=False)
    """Told to the holder alone: in no event, no log line and no row of the journal."""
    stays: bool = False
    """Its holder closes it: neither arrival nor letting go of the door ends it."""
    lease_s: float | None = None
    """The lease that its holder asked for; the site's is the longest, and the one where it asked for none."""
    key: str = field(default="", repr=False)
    """Idempotency key that it was opened with; empty for none."""
    key_ttl_s: float | None = None
    """The lease that was asked for with the key, which renewing does not change."""
    over_at: float | None = None
    """It is over then, at its holder's request or because it is `closing`: until then outputs stay on, and nothing is pressed for it."""
    closing: tuple[EndReason, str] | None = None
    """Why it ends at `over_at` although its holder wants to go on, as a code and in words; None where that is not so."""
    shut_at: float | None = None
    """When the door was first seen shut after the hold was spent."""

    @property
    def ending(self) -> bool:
        """Whether it is over soon: its holder may still think again, unless it is `closing`."""
        return self.over_at is not None

    @property
    def may_begin(self) -> bool:
        """Whether what is found off is put on for it."""
        return not (self.restored or self.ending)

    @property
    def has_words(self) -> bool:
        """Whether its holder can say that the robot left, and so has to."""
        return self.stays and self.holder.face not in NO_WORDS


def new_id() -> str:
    """Return an id that nobody guesses."""
    return secrets.token_urlsafe(_ID_BYTES)


def opened(holder: Holder, *, number: int, lease_s: float | None, key: str, now: float) -> Session:
    """Return a session that stays until its holder closes it. Nothing is wanted by it yet."""
    return Session(
        number,
        holder,
        floor=None,
        hold_door=False,
        opened_at=now,
        lease_from=now,
        heard_at=now,
        id=new_id(),
        stays=True,
        lease_s=lease_s,
        key=key,
        key_ttl_s=lease_s if key else None,
    )


def admit(session: Session | None, ask: Ask, *, number: int, now: float) -> Session | Refused:
    """Open, renew or refuse a session for a request that passed every other check."""
    if session is None:
        return Session(
            number,
            ask.holder,
            ask.floor,
            ask.hold_door,
            opened_at=now,
            lease_from=now,
            heard_at=now,
            id=new_id(),
            stays=ask.stays,
        )
    if session.holder != ask.holder:
        return held(session, now)
    after = wanting(session, ask.floor, hold_door=ask.hold_door, now=now)
    return replace(after, stays=True) if ask.stays else after


def renewed(session: Session, now: float) -> Session:
    """Begin the lease anew at the holder's word; one from before a restart goes on, and one that was to end does.

    One that is `closing` is renewed in vain.
    """
    over_at = session.over_at if session.closing is not None else None
    return replace(session, lease_from=now, heard_at=now, restored=False, over_at=over_at)


def ending(session: Session, grace_s: float, now: float) -> Session:
    """Take its holder's word that it is over in so many seconds; said again, the earlier time counts."""
    over_at = now + grace_s if session.over_at is None else min(session.over_at, now + grace_s)
    return replace(session, heard_at=now, over_at=over_at)


def closing(session: Session, reason: EndReason, text: str, at: float) -> Session:
    """End a session at `at` whatever its holder wants; until then its door is held, and invites nobody."""
    return replace(session, over_at=at, closing=(reason, text))


def over_soon(session: Session | None, now: float) -> Refused | None:
    """Refuse what the holder of a session that is `closing` asks for; a release is none of it."""
    if session is None or session.closing is None or session.over_at is None:
        return None
    text = f"the session ends in {max(0.0, session.over_at - now):.0f} s: {session.closing[1]}"
    return Refused(Refusal.SESSION_OVER, text)


def hold_again(session: Session, turn_s: float, now: float) -> Session:
    """Allow a spent hold to begin again at its holder's request: the door has been shut, and people have had it for `turn_s`."""
    if not may_hold_again(session, turn_s, now):
        return session
    return replace(session, hold_spent=False, holding_since=None, stood_open=False, shut_at=None)


def may_hold_again(session: Session, turn_s: float, now: float) -> bool:
    """Whether a spent hold may begin again."""
    return session.hold_spent and session.shut_at is not None and now >= session.shut_at + turn_s


def wanting(session: Session, floor: FloorName, *, hold_door: bool, now: float) -> Session:
    """Take its holder's wish for a floor: another one, or the same again."""
    after = replace(renewed(session, now), hold_door=hold_door)
    if session.floor == floor:
        return after
    return replace(
        after,
        floor=floor,
        stood_open=False,
        holding_since=None,
        hold_spent=False,
        shut_at=None,
    )


def stood_open(session: Session, now: float) -> Session:
    """Note the first time the door stands open at the session's floor: the lease begins anew.

    Not for one that is about to end: whoever has ended it may not see the door open.
    """
    return (
        session
        if session.stood_open or session.ending
        else replace(session, stood_open=True, lease_from=max(session.lease_from, now))
    )


def held(session: Session, now: float) -> Refused:
    """Return the refusal of everybody but the holder."""
    since_s = now - session.opened_at
    blocking = Blocking(holder=session.holder, since_s=since_s)
    return Refused(Refusal.HELD, f"held by {session.holder} since {since_s:.0f} s", blocking)


def handed_over(session: Session, to: Holder, now: float) -> Session:
    """Give a session to another caller. Its lease starts anew; how long it may last in all does not.

    It gets an id of its own, which the holder before does not know.
    """
    return replace(renewed(session, now), holder=to, id=new_id(), key="", key_ttl_s=None)


def unclaimed(session: Session) -> bool:
    """Whether its holder has not been heard since a restart."""
    return session.heard_at is None


def silent_for(session: Session, now: float) -> float:
    """Return for how long the holder has not been heard, as far as this process can know."""
    since = session.restored_at if session.heard_at is None else session.heard_at
    return 0.0 if since is None else now - since


def lease_ends_at(session: Session, lease_s: float) -> float:
    """Return the time at which the lift goes back to people unless the holder asks again; infinite for faces without a lease.

    `lease_s` is the site's.
    """
    return math.inf if session.holder.face in NO_LEASE else session.lease_from + lease_of(session, lease_s)


def lease_of(session: Session, lease_s: float) -> float:
    """Return the length of its lease in seconds; `lease_s` is the site's."""
    return lease_s if session.lease_s is None else min(session.lease_s, lease_s)


def ends_at(session: Session, max_session_s: float) -> float:
    """Return the time from which the session ends as soon as that harms nobody, however often it is renewed or handed over."""
    return session.opened_at + max_session_s


def hold_ends_at(session: Session, max_session_hold_s: float) -> float | None:
    """Return the time at which the door is let go whatever the holder wants; None while it is not held."""
    return None if session.holding_since is None else session.holding_since + max_session_hold_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What bounds how long a door is held for a session."""

    lease_s: float
    max_session_s: float
    max_session_hold_s: float
    clear_s: float
    """From the withdrawal of OPEN to the release of the door: what a robot in the doorway needs to be out of it."""


def releases_at(session: Session, limits: Limits) -> float:
    """Return the earliest time at which the manager releases the door of a session by itself, as far as it knows."""
    hold_ends = hold_ends_at(session, limits.max_session_hold_s)
    return min(
        lease_ends_at(session, limits.lease_s),
        ends_at(session, limits.max_session_s),
        math.inf if hold_ends is None else hold_ends,
        math.inf if session.over_at is None else session.over_at,
    )


def invites_until(session: Session, limits: Limits) -> float:
    """Return the time from which the door of a session invites nobody any more, although it is held for `clear_s` longer."""
    return -math.inf if session.ending else releases_at(session, limits) - limits.clear_s


@dataclass(frozen=True, slots=True)
class KeptSession:
    """A session as it outlives the manager. Times are wall-clock times, taken all at once at `kept_at`."""

    holder: Holder
    floor: FloorName | None
    hold_door: bool
    opened_at: datetime
    lease_from: datetime
    holding_since: datetime | None
    kept_at: datetime
    stood_open: bool
    hold_spent: bool
    pressed: bool
    """Its call was given to the lift, or may have been."""
    boarding: KeptBoarding
    id: str = field(default="", repr=False)
    stays: bool = False
    lease_s: float | None = None
    key: str = field(default="", repr=False)
    key_ttl_s: float | None = None
    closes_at: datetime | None = None
    """When it ends whatever its holder wants, where a person has ended it and a robot may still be in its doorway."""
    closing: tuple[EndReason, str] | None = None
    """Why it ends then, as a code and in words."""


def kept(session: Session, boarding: KeptBoarding, *, pressed: bool, at: datetime, now: float) -> KeptSession:
    """Return what a restart must know, in UTC. `at` is the wall clock at the monotonic time `now`."""
    # in a zone, arithmetic is that of the hands of the clock, and wrong by an hour around a change of the clock
    at = at.astimezone(UTC)

    def wall(when: float) -> datetime:
        return at + timedelta(seconds=when - now)

    return KeptSession(
        holder=session.holder,
        floor=session.floor,
        hold_door=session.hold_door,
        opened_at=wall(session.opened_at),
        lease_from=wall(session.lease_from),
        holding_since=None if session.holding_since is None else wall(session.holding_since),
        kept_at=at,
        stood_open=session.stood_open,
        hold_spent=session.hold_spent,
        pressed=pressed,
        boarding=boarding,
        id=session.id,
        stays=session.stays,
        lease_s=session.lease_s,
        key=session.key,
        key_ttl_s=session.key_ttl_s,
        closes_at=None if session.closing is None or session.over_at is None else wall(session.over_at),
        closing=session.closing,
    )


def restored(kept: KeptSession, *, number: int, at: datetime, now: float) -> Session:
    """Return the session after a restart, at the wall clock `at` and the monotonic time `now`.

    What had passed by `kept_at` is known, whatever the clocks do. What has passed since is the difference of two readings of
    the wall clock: a clock that went back counts as no time at all, so that a lease starts anew at most; one that jumped
    forward ends a lease early, and never makes it longer.
    """
    kept_at = kept.kept_at.astimezone(UTC)
    gone_s = max(0.0, (at.astimezone(UTC) - kept_at).total_seconds())

    def monotonic(when: datetime) -> float:
        return now - gone_s - max(0.0, (kept_at - when.astimezone(UTC)).total_seconds())

    closes_at = kept.closes_at
    return Session(
        number=number,
        holder=kept.holder,
        floor=kept.floor,
        hold_door=kept.hold_door,
        opened_at=monotonic(kept.opened_at),
        lease_from=monotonic(kept.lease_from),
        stood_open=kept.stood_open,
        holding_since=None if kept.holding_since is None else monotonic(kept.holding_since),
        hold_spent=kept.hold_spent,
        restored=True,
        restored_at=now,
        id=kept.id or new_id(),
        stays=kept.stays,
        lease_s=kept.lease_s,
        key=kept.key,
        key_ttl_s=kept.key_ttl_s,
        over_at=None if closes_at is None else now - gone_s + (closes_at.astimezone(UTC) - kept_at).total_seconds(),
        closing=kept.closing,
    )
