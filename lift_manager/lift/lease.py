"""When a session is over by its time, and when its door is released: its lease, its longest time, its longest hold."""

from __future__ import annotations

import math

from lift_manager.lift.config import LiftConfig
from lift_manager.lift.session import EndReason, Session


def lease_of(session: Session, config: LiftConfig) -> float:
    """Return the length of a session's lease in seconds."""
    return config.lease_s if session.lease_s is None else min(session.lease_s, config.lease_s)


def lease_ends_at(session: Session, config: LiftConfig) -> float:
    """Return when the lift goes back to people unless the holder renews; infinity for faces without a lease."""
    return session.lease_from + lease_of(session, config) if session.policy.has_lease else math.inf


def longest_until(session: Session, config: LiftConfig) -> float:
    """Return the time after which the session ends as soon as that harms nobody, however often it is renewed or handed over."""
    return session.opened_at + config.max_session_s


def hold_ends_at(session: Session, config: LiftConfig) -> float:
    """Return when the door is released whatever the holder requests; infinity while it is not held."""
    return math.inf if session.holding_since is None else session.holding_since + config.hold_limit.seconds


def releases_at(session: Session, config: LiftConfig) -> float:
    """Return the earliest time at which the manager releases the door by itself, as far as it knows."""
    end_at = math.inf if session.end is None else session.end.at
    return min(lease_ends_at(session, config), longest_until(session, config), hold_ends_at(session, config), end_at)


def time_is_over(session: Session, config: LiftConfig, now: float, *, rides: bool) -> tuple[EndReason, str] | None:
    """Return why a session is over by its time. `rides` means that a robot may be under way in the car: that is waited for."""
    if now >= lease_ends_at(session, config):
        return EndReason.LEASE, f"the lease of {lease_of(session, config):g} s ran out"
    patience_s = config.capabilities.arrive_within_s if rides else 0.0
    if now < longest_until(session, config) + patience_s:
        return None
    return EndReason.MAX_SESSION, f"it lasted for {config.max_session_s:g} s, as long as the site allows"
