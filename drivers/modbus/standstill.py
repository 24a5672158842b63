"""Whether a car is known to stand. Pure: readings and seconds of any clock go in."""

from __future__ import annotations

import math

from drivers.model import FloorName, LiftValues
from register_maps.schema import Evidence
from register_maps.words import Door, Motion

STILL_S = 10.0
"""A shut car whose motion nobody tells stands once it has told the same floor for so long, where the map does not say how long that is.
Chosen: one that drives passes a floor of 4 m in less, at 0.5 m/s with the time to pick up speed; the slowest lifts for robots run faster."""

_NOT_SHUT = frozenset({Door.OPEN, Door.OPENING, Door.CLOSING, Door.MOVING})


class StandstillEvidence:
    """What the readings of one lift say about whether its car stands; it is shown each reading that differs from the one before."""

    def __init__(self, evidence: Evidence) -> None:
        """`evidence` is what the map says about it."""
        self._uses_level = evidence.kind == "level"
        self._still_s = STILL_S if evidence.for_s is None else evidence.for_s
        self._since = math.inf
        """From when on it counts as standing, if nothing else is told."""
        self._shut_at: FloorName | None = None

    def update(self, values: LiftValues, at: float) -> None:
        """Take what the lift says, asked for at `at`."""
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
        """Nobody looked for a while."""
        self._since, self._shut_at = math.inf, None

    def is_standing(self, at: float) -> bool:
        """Whether the car is known to stand, if nothing has changed until `at`."""
        return at >= self._since

    def _reported(self, values: LiftValues) -> bool | None:
        """Return whether it stands, as far as anything tells; None for a shut car without a word about it."""
        if values.motion is Motion.STOPPED or not _NOT_SHUT.isdisjoint(values.doors.values()):
            return True
        if values.motion in (Motion.UP, Motion.DOWN, Motion.MOVING):
            return False
        return True if self._uses_level and values.flags.get("level", False) else None
