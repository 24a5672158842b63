"""A session as its holder sees it. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime

from lift_manager.core.options import LiftOptions
from lift_manager.domain import session as sessions
from lift_manager.domain.boarding import Who
from lift_manager.domain.session import Session
from lift_manager.domain.session_requests import SessionInfo, SessionOver


@dataclass(frozen=True, slots=True)
class Facts:
    """What a session has on its lift, beside itself."""

    opened_at: datetime
    arrived: bool
    door_held: bool
    robot: Who
    waits: str


def info_of(session: Session, options: LiftOptions, facts: Facts, now: float) -> SessionInfo:
    """Return a session that goes on."""
    limits = options.limits(session.holder)
    releases_at = sessions.releases_at(session, limits)
    lease_ends_at = sessions.lease_ends_at(session, options.lease_s)
    hold_ends_at = sessions.hold_ends_at(session, options.max_session_hold_s) if session.hold_door else None
    return SessionInfo(
        id=session.id,
        lift=options.name,
        holder=session.holder,
        floor=session.floor,
        hold_door=session.hold_door,
        opened_at=facts.opened_at,
        lease_ends_in_s=None if math.isinf(lease_ends_at) else max(0.0, lease_ends_at - now),
        ends_in_s=max(0.0, sessions.ends_at(session, options.max_session_s) - now),
        hold_ends_in_s=None if hold_ends_at is None else max(0.0, hold_ends_at - now),
        releases_in_s=max(0.0, releases_at - now),
        releasing=now >= sessions.invites_until(session, limits),
        arrived=facts.arrived,
        door_held=session.hold_door and facts.door_held and facts.arrived,
        robot=facts.robot,
        waiting_for=facts.waits,
        restored=session.restored,
    )


def ended_info(was: SessionInfo, robot: Who, over: SessionOver) -> SessionInfo:
    """Return a session that is over. Nothing of it is on the lift any more."""
    return replace(
        was,
        hold_door=False,
        lease_ends_in_s=None,
        ends_in_s=None,
        hold_ends_in_s=None,
        releases_in_s=None,
        releasing=False,
        arrived=False,
        door_held=False,
        robot=robot,
        waiting_for="",
        restored=False,
        over=over,
    )
