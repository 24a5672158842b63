"""What the site says about one lift, as far as the manager needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import FloorName
from lift_manager.domain.hours import RobotHours
from lift_manager.domain.session import ACTS_ONCE, CLEARS_IN_A_LIMIT, Limits
from lift_manager.domain.state import Holder
from register_maps.words import Side


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftOptions:
    """One lift of the site."""

    name: str
    floors: tuple[FloorName, ...]
    """Lowest first."""
    doors_at: Mapping[FloorName, tuple[Side, ...]]
    """Which doors serve each floor."""
    control: bool
    poll_s: float = 0.2
    first_poll_s: float = 0.0
    """Delay of the first poll, so that the lifts of a site do not poll in one burst."""
    lease_s: float = 300.0
    """For callers that can renew it (`domain.session.NO_LEASE`). Chosen: it outlives RMF's 300 s localise step."""
    max_session_s: float = 3600.0
    """How long a session lasts at most, renewed or not: robot mode is on for as long, and people are without their lift. Chosen:
    above the longest ride that the other limits allow, two stops of `max_session_hold_s` and the trips between them."""
    takeover_after_s: float | None = None
    """A holder silent for so long loses an empty car to the next caller; never where the site does not say."""
    max_session_hold_s: float = 900.0
    clear_s: float = 10.0
    """From the withdrawal of OPEN to the release of a held door. Chosen: a robot at 0.5 m/s that has just begun to drive through is
    out of the doorway twice over."""
    rmf_clear_s: float = 30.0
    """The same for sessions of RMF (`domain.session.ACTS_ONCE`). Chosen: its publish period, its decision and the crossing."""
    infer_occupancy: bool = False
    """A caller that has no word for it boards and leaves by what it asks: for faces without one, such as RMF."""
    board_min_s: float = 5.0
    """A floor asked sooner than this after the door stood open is no sign of boarding. Chosen: a robot at 0.5 m/s takes that long for
    the 2.5 m from where it waits into the car, so a floor asked sooner is a change of plan."""
    robot_hours: RobotHours | None = None
    """When robots may begin; always where the site does not say."""
    between_sessions_s: float = 5.0
    """What people get for themselves between two robots: from the end of a session to the first press of the next."""
    fire_release_delay_s: float = 0.0
    """From telling robots of a fire to letting everything go."""
    rmf_name: str = ""
    """In RMF's building map; empty where it is the same there."""
    rmf_floors: Mapping[FloorName, str] = field(default_factory=dict)
    """Those that RMF's building map names otherwise."""

    def limits(self, holder: Holder) -> Limits:
        """Return what bounds the door hold of a session of this holder."""
        return Limits(
            lease_s=self.lease_s,
            max_session_s=self.max_session_s,
            max_session_hold_s=self.max_session_hold_s,
            clear_s=self.rmf_clear_s if holder.face in ACTS_ONCE else self.clear_s,
        )

    def lease_for(self, ttl_s: float | None) -> float | None:
        """Return the lease of a session that was requested with `ttl_s`: a shorter one than three times `clear_s` is raised to that."""
        return None if ttl_s is None else max(ttl_s, CLEARS_IN_A_LIMIT * self.clear_s)
