"""What a lift is, and what it says signal by signal, for whoever asks. Values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.model import Capabilities, FloorName, SignalValue
from register_maps.words import Side


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftDescription:
    """One lift of the site: its map, and what the site says."""

    lift: str
    floors: tuple[FloorName, ...]
    """Lowest first."""
    doors_at: Mapping[FloorName, tuple[Side, ...]]
    control: bool
    """The site lets robots command it."""
    able: Capabilities
    poll_s: float
    lease_s: float
    max_session_s: float
    max_session_hold_s: float
    clear_s: float
    """From the withdrawal of OPEN to the release of a held door; sessions of RMF have their own."""
    robot_hours: str
    """In words; empty for always."""
    rmf_name: str = ""
    """In RMF's building map; empty where it is the site's."""
    rmf_floors: Mapping[FloorName, str] = field(default_factory=dict)
    """Those that RMF's building map names otherwise."""


@dataclass(frozen=True, slots=True)
class LiftSignals:
    """Every signal of a lift as it was read last."""

    lift: str
    age_s: float | None
    """Of the last whole reading; None when there never was one."""
    max_age_s: float
    """Older than this nothing of it may be acted on."""
    signals: tuple[SignalValue, ...]


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One frame that left, or arrived."""

    link: str
    sent: bool
    """To the controller; otherwise from it."""
    frame: bytes
    """Whole, with its MBAP header."""
    at: float
    """Monotonic seconds of the event loop."""
