"""What the lift's mode and signals mean for robots: which modes forbid them, and what counts as a fire."""

from __future__ import annotations

from drivers.model import Capabilities, LiftValues
from register_maps.words import ROBOT_FORBIDDEN_MODES, Mode


def robots_forbidden(mode: Mode) -> bool:
    """Whether a mode belongs to people: nothing is pressed and no robot is invited in it."""
    return mode in ROBOT_FORBIDDEN_MODES


def is_on_fire(values: LiftValues) -> bool:
    """Whether any signal reports a fire, whatever else the mode is."""
    flags = values.flags
    return values.mode is Mode.FIRE or values.fire_word or flags.get("fire", False) or flags.get("fireman", False)


def unreadable_fire_signal(values: LiftValues, capabilities: Capabilities) -> str | None:
    """Return the signal without which nobody knows whether there is a fire; None when all of them can be read."""
    for flag in ("fire", "fireman"):
        if flag in capabilities.signals and flag not in values.flags:
            return flag
    return "mode" if values.mode is Mode.UNKNOWN or "mode" in values.unknown else None
