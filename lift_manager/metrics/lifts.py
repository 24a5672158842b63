"""Metrics of the published lift states."""

from __future__ import annotations

from lift_manager.lift.state import LiftState, Quality
from lift_manager.metrics.exposition import Family, Kind, format_labels
from register_maps.words import Mode

_FLAGS = {
    "live": "Whether there is a reading young enough to act on.",
    "held": "Whether somebody holds the lift.",
    "fire_latched": "Whether there was a fire that no person has acknowledged.",
    "locked_out": "Whether a person keeps robots off the lift.",
    "draining": "Whether a person lets sessions end and no new one begin.",
    "maybe_occupied": "Whether a robot may be in the car: others are refused while it holds no session.",
    "distrusted": "Whether signals of the lift contradicted each other: no door counts as open for robots.",
}


class LiftFamilies:
    """The families about lifts, filled lift by lift."""

    def __init__(self) -> None:
        def gauge(name: str, text: str) -> Family:
            return Family(f"lift_manager_{name}", Kind.GAUGE, text)

        self._flags = {name: gauge(f"lift_{name}", text) for name, text in _FLAGS.items()}
        self._age = gauge("lift_reading_age_seconds", "Age of the newest whole reading; absent before the first.")
        self._mode = gauge("lift_mode", "1 for the mode that the lift is in, 0 for every other.")
        self._held_for = gauge(
            "session_held_seconds", "How long the session has lasted; 0 while nobody holds the lift."
        )
        self._waiting = gauge("lift_waiting", "Rides and faces that wait for the lift.")

    def add(self, state: LiftState) -> None:
        """Add the state of one lift."""
        label, restrictions = format_labels(lift=state.lift), state.restrictions
        flags = {
            "live": state.quality is Quality.LIVE,
            "held": state.holder is not None,
            "fire_latched": restrictions.fire_latched,
            "locked_out": bool(restrictions.lockout),
            "draining": bool(restrictions.drain),
            "maybe_occupied": restrictions.maybe_aboard is not None,
            "distrusted": bool(restrictions.distrusted),
        }
        for name, is_so in flags.items():
            self._flags[name].add(label, int(is_so))
        if state.age_s is not None:
            self._age.add(label, state.age_s)
        for mode in Mode:
            self._mode.add(f'{label},mode="{mode}"', int(mode is state.mode))
        self._held_for.add(label, state.held_since_s or 0.0)
        self._waiting.add(label, state.waiting)

    def families(self) -> list[Family]:
        """Return all families."""
        return [*self._flags.values(), self._age, self._mode, self._held_for, self._waiting]
