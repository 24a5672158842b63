"""What the judge must know of a lift, and what it says when something must never happen and did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.model import FloorName
from lift_manager.commissioning.detection import Detection, Lie
from register_maps.words import Table

Read = tuple[str, int, Table, int, int]
"""One block of a poll: controller, unit id, table, first address on the wire, and how many."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that must never happen."""

    at: float
    lift: str
    rule: str
    text: str
    lie: Lie | None = None
    """What kind of thing is wrong, where a fault may make it so."""

    def __str__(self) -> str:
        return f"{self.at:8.3f} s  {self.lift}: {self.rule}: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What the judge must know of one lift."""

    controllers: tuple[str, ...]
    floors: tuple[FloorName, ...]
    """Lowest first."""
    max_age_s: float
    max_session_hold_s: float
    arrive_within_s: float
    detections: Mapping[str, Detection]
    """What becomes of each fault, by its name; without any, nothing is excused."""
    told_by_doors: bool = False
    """Only an open door tells where the car is."""
    blocks: frozenset[Read] = frozenset()
    """What a poll reads; a state is no fresher than the oldest of them."""
    poll_s: float = 0.2
    between_sessions_s: float = 0.0
    holds: frozenset[str] = frozenset()
    """Door holds that the map has, for every door of every floor."""
    tells_robot_mode: bool = False
    tells_motion: bool = False
    """Something tells that the car has left a floor before it tells another one."""
    repeated: frozenset[str] = frozenset()
    """Commands that the map itself has pressed again and again."""
    fleeting: frozenset[str] = frozenset()
    """Commands that the device ends by itself."""
