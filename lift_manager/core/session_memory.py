"""How a session outlives the manager: written down as it changes, and taken up again at the next start."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from datetime import UTC, timedelta
from operator import attrgetter

from lift_manager.core.handshake import LeftBehind
from lift_manager.core.options import LiftOptions
from lift_manager.core.people import PeopleFirst
from lift_manager.domain import session as sessions
from lift_manager.domain.boarding import KeptBoarding
from lift_manager.domain.service import EndReason
from lift_manager.domain.session import KeptSession, Session

RENEWED_EVERY_S = 10.0
"""A lease that is merely renewed is written at most so often, and four times in its length, but never more than once a second: a
caller may renew it several times a second, and a memory card wears out. Chosen: after a restart a lease ends at most that much
early, and no sooner than `clear_s` after the restart."""

_LASTING = attrgetter(*(one.name for one in fields(Session) if one.name not in ("lease_from", "heard_at")))


class SessionMemory:
    """What is on the disk about the session of one lift."""

    def __init__(self, options: LiftOptions, people: PeopleFirst) -> None:
        self._options = options
        self._people = people
        self._noted: tuple[object, KeptBoarding, bool] | None = None
        """What was written, its lease left out."""
        self._lease_from = -math.inf
        self._mode_until: float | None = math.nan
        """Until when robot mode is kept, as it was written; not a number before that."""

    @property
    def kept(self) -> KeptSession | None:
        """The session as it was written down last."""
        return self._people.remembered.session

    def take_up(self, kept: KeptSession, number: int, now: float) -> Session | tuple[EndReason, str]:
        """Return the session of before a restart, or why it is over."""
        options, people = self._options, self._people
        session = sessions.restored(kept, number=number, at=people.clock(), now=now)
        if not options.control:
            return EndReason.NOT_RESTORED, "the site file no longer says `access: control`"
        if session.floor is not None and session.floor not in options.floors:
            return EndReason.NOT_RESTORED, f"the site file no longer has its floor {session.floor}"
        if people.lockout and session.closing is None:
            return EndReason.LOCKOUT, f"the lift is locked out {people.lockout}"
        if people.fire_latched:
            return EndReason.FIRE, "there was a fire"
        if session.closing is not None and session.over_at is not None:
            # a lockout lets go only then: its robot may be in the doorway
            return session if now < session.over_at else session.closing
        lease_s, ends_at = sessions.lease_of(session, options.lease_s), sessions.lease_ends_at(session, options.lease_s)
        if now >= ends_at + _written_every_s(lease_s):
            return EndReason.LEASE, f"the lease of {lease_s:g} s ran out while the manager was not running"
        # its robot may have been invited until the restart, by a lease that was renewed and not written down any more
        soonest = now + options.limits(session.holder).clear_s
        if ends_at < soonest:
            session = replace(session, lease_from=session.lease_from + soonest - ends_at)
        return session

    def robot_mode_until(self, now: float, most_s: float) -> float | None:
        """Return until when robot mode from before a restart is kept where its session does not go on.

        `most_s` is how long a car may be under way.
        """
        people, until = self._people, self._people.remembered.robot_mode_until
        if people.fire_latched or not self._options.control:
            return None
        if self.kept is not None:
            return now + most_s
        if until is None:
            return None
        rest_s = (until.astimezone(UTC) - people.clock().astimezone(UTC)).total_seconds()
        return None if rest_s <= 0 else now + min(rest_s, most_s)

    def note_rest(self, left: LeftBehind) -> None:
        """Write down what a session leaves behind in the car: a robot that may be there, the word that it left."""
        self._people.note_occupied(left.occupied)
        self._people.note_left_untold(owed=left.left_untold)

    def note_mode(self, mode_until: float | None, now: float) -> None:
        """Write down until when robot mode is kept although its session is over."""
        if mode_until != self._mode_until:
            self._mode_until = mode_until
            at = None
            if mode_until is not None:
                at = self._people.clock().astimezone(UTC) + timedelta(seconds=mode_until - now)
            self._people.note_robot_mode(at)

    def note(self, session: Session | None, boarding: KeptBoarding, *, pressed: bool, now: float) -> None:
        """Write down what a restart must know, if it has changed; called often.

        One that its holder has ended is over for a restart: it would come back for as long as a session may last.
        """
        if session is None or (session.ending and session.closing is None):
            self._noted = None
            self._people.note_session(None)
            return
        noted = (_LASTING(session), boarding, pressed)
        every_s = _written_every_s(sessions.lease_of(session, self._options.lease_s))
        if noted == self._noted and session.lease_from - self._lease_from < every_s:
            return
        self._noted, self._lease_from = noted, session.lease_from
        at = self._people.clock()
        self._people.note_session(sessions.kept(session, boarding, pressed=pressed, at=at, now=now))


def _written_every_s(lease_s: float) -> float:
    """Return how often the renewal of a lease is written down: what is kept may be that much older than the newest one."""
    return min(RENEWED_EVERY_S, max(1.0, lease_s / 4))
