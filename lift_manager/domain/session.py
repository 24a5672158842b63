"""Who may command a lift, and for how long. Pure functions; every face goes through them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from drivers.model import FloorName
from lift_manager.domain.asking import Ask, Refusal, Refused
from lift_manager.domain.state import Holder


@dataclass(frozen=True, slots=True)
class Session:
    """One caller's right to command one lift."""

    number: int
    holder: Holder
    floor: FloorName
    """Where the car is wanted."""
    hold_door: bool
    """Hold the door open there; otherwise the session ends on arrival."""
    opened_at: float
    lease_from: float
    """The lease runs from here: the later of the last request and the moment the door stood open at `floor`."""
    stood_open: bool = False
    """The door has stood open at `floor` since that floor was asked for."""
    holding_since: float | None = None
    """Since when the door has been held for this session without a break."""
    hold_spent: bool = False
    """The hold reached its limit and was let go; it is not taken up again at this floor."""


def admit(session: Session | None, ask: Ask, *, number: int, now: float) -> Session | Refused:
    """Open, renew or refuse a session for a request that passed every other check."""
    if session is None:
        return Session(number, ask.holder, ask.floor, ask.hold_door, opened_at=now, lease_from=now)
    if session.holder != ask.holder:
        return Refused(Refusal.HELD, f"held by {session.holder} since {now - session.opened_at:.0f} s")
    if session.floor == ask.floor:
        return replace(session, hold_door=ask.hold_door, lease_from=now)
    return replace(
        session,
        floor=ask.floor,
        hold_door=ask.hold_door,
        lease_from=now,
        stood_open=False,
        holding_since=None,
        hold_spent=False,
    )


def stood_open(session: Session, now: float) -> Session:
    """Note the first time the door stands open at the session's floor: the lease begins anew."""
    return session if session.stood_open else replace(session, stood_open=True, lease_from=max(session.lease_from, now))


def lease_ends_at(session: Session, lease_s: float) -> float:
    """Return the time at which the lift goes back to people unless the holder asks again."""
    return session.lease_from + lease_s


def hold_ends_at(session: Session, max_session_hold_s: float) -> float | None:
    """Return the time at which the door is let go whatever the holder wants; None while it is not held."""
    return None if session.holding_since is None else session.holding_since + max_session_hold_s
