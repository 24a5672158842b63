"""Decides from readings whether a car is known to stand. Pure; the caller passes the time."""

from __future__ import annotations

import math

from drivers.model import FloorName, LiftValues
from register_maps.schema import Evidence
from register_maps.words import Door, Motion

STILL_S = 10.0
"""A shut car without a motion signal stands once it has reported the same floor for so long; used if the map gives no time.
Chosen: a car passes a floor of 4 m in less, at 0.5 m/s including acceleration; the slowest lifts for robots run faster."""

_NOT_SHUT = frozenset({Door.OPEN, Door.OPENING, Door.CLOSING, Door.MOVING})


class StandstillEvidence:
    """Collects from the readings of one lift whether its car stands; takes each reading that differs from the one before."""

    def __init__(self, evidence: Evidence) -> None:
        """`evidence` is the rule of the map."""
        self._uses_level = evidence.kind == "level"
        self._still_s = STILL_S if evidence.for_s is None else evidence.for_s
        self._since = math.inf
        """From when it counts as standing, if no other reading comes."""
        self._shut_at: FloorName | None = None

    def update(self, values: LiftValues, at: float) -> None:
        """Take the values of a reading requested at `at`."""
        is_standing = self._reported(values)
        shut_at = values.floor if is_standing is None else None
        if is_standing is not None:
            self._since = at if is_standing else math.inf
        elif shut_at is None:
            self._since = math.inf
        elif shut_at != self._shut_at:
            self._since = at + self._still_s
        self._shut_at = shut_at

    def reset(self) -> None:
        """Forget everything after a gap in the readings."""
        self._since, self._shut_at = math.inf, None

    def is_standing(self, at: float) -> bool:
        """Whether the car is known to stand at `at`, if no reading has changed since."""
        return at >= self._since

    def _reported(self, values: LiftValues) -> bool | None:
        """Return whether the values report standstill or motion; None for a shut car without evidence."""
        if values.motion is Motion.STOPPED or not _NOT_SHUT.isdisjoint(values.doors.values()):
            return True
        if values.motion in (Motion.UP, Motion.DOWN, Motion.MOVING):
            return False
        return True if self._uses_level and values.flags.get("level", False) else None
