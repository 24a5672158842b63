"""How long a holder keeps the lift: by time, against another caller's request, and whose it is to give away."""

from __future__ import annotations

from dataclasses import replace

from lift_manager.core.announce import Announcer
from lift_manager.core.handshake import Handshake
from lift_manager.core.options import LiftOptions
from lift_manager.core.serving import End
from lift_manager.domain import session as sessions
from lift_manager.domain.asking import Refusal, Refused
from lift_manager.domain.service import EndReason, how_to_acknowledge, silent_text, unclaimed_text
from lift_manager.domain.session import SILENT_S, Session
from lift_manager.domain.state import Holder

_MOST_TOLD = 100
"""Of more askers than this people are not told one by one: a client may give itself another name each time."""

_Silence = tuple[int, Holder | None, float | None]
"""A session, its holder, and when that was heard last: it ends when the holder is heard, or another one is."""


class Tenure:
    """The rules by which a session ends although its holder does not say so."""

    def __init__(self, options: LiftOptions, say: Announcer, *, arrive_within_s: float) -> None:
        """`arrive_within_s` is how long a car may be under way."""
        self._options = options
        self._say = say
        self._arrive_within_s = arrive_within_s
        self._told: set[Holder] = set()
        """Askers for whom people were told of the present silence."""
        self._silence: _Silence = (0, None, None)

    def expired(self, session: Session, now: float, *, rides: bool) -> End | None:
        """Return why a session is over by its time. `rides` says that a robot may be under way in the car: that is waited for."""
        options = self._options
        if now >= sessions.lease_ends_at(session, options.lease_s):
            return EndReason.LEASE, f"the lease of {sessions.lease_of(session, options.lease_s):g} s ran out"
        ends_at = sessions.ends_at(session, options.max_session_s) + (self._arrive_within_s if rides else 0.0)
        if now < ends_at:
            return None
        return EndReason.MAX_SESSION, f"it lasted for {options.max_session_s:g} s, as long as the site allows"

    def contest(
        self, session: Session, asker: Holder, now: float, handshake: Handshake, refusal: Refused | None
    ) -> End | Refused | None:
        """Return why a session ends because of another caller's request, if it does; people hear of a holder that is silent.

        A robot of the holder that may be in the car keeps it: nobody else would get the lift then. A refusal says how a
        person ends such a session from before a restart. A wish that would be refused whoever holds the lift ends none:
        `refusal` is what else speaks against it. Neither does one that needs no open door, which is not to be given here: an
        idle client posts such requests once a second, for floors that the car may have left (`lift.RECENT_FLOOR_S`).
        """
        if refusal is not None:
            return None
        occupied = handshake.occupied_by(session) is not None
        silent_s, unclaimed = sessions.silent_for(session, now), sessions.unclaimed(session)
        if unclaimed and not occupied:
            return EndReason.UNCLAIMED, f"{asker} was heard first after a restart of the manager"
        if silent_s >= SILENT_S:
            self._tell(session, asker, silent_s)
        if unclaimed:
            held = sessions.held(session, now)
            return replace(held, message=f"{held.message}; {unclaimed_text(self._options.name)}")
        allowed_s = self._options.takeover_after_s
        if allowed_s is None or silent_s < allowed_s or occupied:
            return None
        return EndReason.TAKEN_OVER, f"{session.holder} was not heard for {silent_s:.0f} s, and {asker} asked"

    def held_by(
        self, session: Session | None, holder: Holder | None, now: float, *, in_car: tuple[Holder, bool] | None
    ) -> Session | Refused:
        """Return the session if it is this holder's, or whoever's where none is named.

        `in_car` tells whose robot may be in the car without a session.
        """
        name = self._options.name
        if session is None:
            robot = (
                f"; a robot of {in_car[0]} may be in its car: {how_to_acknowledge(name)}" if in_car is not None else ""
            )
            return Refused(Refusal.NOT_HELD, f"nobody holds {name}{robot}")
        return session if holder in (None, session.holder) else sessions.held(session, now)

    def _tell(self, session: Session, asker: Holder, silent_s: float) -> None:
        silence = (session.number, session.holder, session.heard_at)
        if silence != self._silence:
            self._silence, self._told = silence, set()
        if asker not in self._told and len(self._told) < _MOST_TOLD:
            self._told.add(asker)
            self._say.alarm(silent_text(self._options.name, session.holder, asker, silent_s), session.holder)
