"""The doors of a car: how far open each is, how they open and close, and what may keep them from it. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from register_maps.words import Door, Side

NEGLIGIBLE_FRACTION = 1e-9
"""Rounding only: a door this near to its limit is at it."""
JAMMED_AT = 0.1
"""How far a door is open still when something in its sill stops it. Chosen: 9 cm of a 900 mm door, a shoe or a castor."""
NUDGING = 1 / 3
"""Share of their closing speed at which doors nudge. Chosen: slow enough to be pushed against by hand."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """One door."""

    fraction: float = 0.0
    """0 closed to 1 fully open."""
    opening: bool = False
    """Which way it moves, or moved last."""

    @property
    def word(self) -> Door:
        if self.fraction <= 0.0:
            return Door.CLOSED
        if self.fraction >= 1.0:
            return Door.OPEN
        return Door.OPENING if self.opening else Door.CLOSING


@dataclass(frozen=True, slots=True)
class DoorFaults:
    """What goes wrong with the doors."""

    stuck: frozenset[Side] = frozenset()
    """Doors that stay where they are."""
    jammed: frozenset[Side] = frozenset()
    """Doors with something in the sill: they stop before they are shut."""
    nudging: bool = False
    """The doors close slowly."""


NO_TROUBLE = DoorFaults()


def move(
    doors: Mapping[Side, Leaf],
    to_open: frozenset[Side],
    trouble: DoorFaults,
    dt: float,
    *,
    open_s: float,
    close_s: float,
) -> tuple[Mapping[Side, Leaf], float]:
    """The doors after `dt` seconds, or after the moment at which the last of them has closed, or closes no further.

    `open_s` and `close_s` are what the whole way takes. Also returns the seconds used: 0 where
    none is to open and none closes any further.
    """
    if trouble.nudging:
        close_s /= NUDGING
    if not to_open:
        dt = min(dt, close_s * max(leaf.fraction - _end(side, leaf, trouble) for side, leaf in doors.items()))
    after, moves = {}, False
    for side, leaf in doors.items():
        after[side] = leaf
        if side in trouble.stuck or (leaf.opening and leaf.fraction >= 1.0 and side in to_open):
            continue
        if side in to_open:
            after[side] = _at(leaf.fraction + dt / open_s, 0.0, opening=True)
        else:
            after[side] = _at(leaf.fraction - dt / close_s, _end(side, leaf, trouble), opening=False)
        moves = True
    return (after if moves else doors), dt


def _end(side: Side, leaf: Leaf, trouble: DoorFaults) -> float:
    """How far a closing door is open still where it closes no further."""
    if trouble is NO_TROUBLE:
        return 0.0
    if side in trouble.stuck:
        return leaf.fraction
    return min(leaf.fraction, JAMMED_AT) if side in trouble.jammed else 0.0


def _at(fraction: float, lowest: float, *, opening: bool) -> Leaf:
    if fraction <= lowest + NEGLIGIBLE_FRACTION:
        fraction = lowest
    elif fraction >= 1.0 - NEGLIGIBLE_FRACTION:
        fraction = 1.0
    return Leaf(fraction=fraction, opening=opening)
