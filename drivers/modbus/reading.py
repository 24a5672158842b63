"""Turns decoded signals into the values of one lift: floor names, one mode, no guesses. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.model import FloorName, LiftValues
from register_maps.codec import Value
from register_maps.vocabulary import FLAG_MODES, SAFETY_FLAGS
from register_maps.words import Door, Mode, Motion, Side

_RANK = {mode: rank for rank, (mode, _) in enumerate(reversed(FLAG_MODES), start=1)}
_NO_CALLS: frozenset[FloorName] = frozenset()
"""One for all lifts: an empty frozenset takes 216 bytes, and Python makes a new one for each call."""
_FLOORS = ("car_floor", "destination", "call_accepted")


def lift_values(
    signals: Mapping[str, Value],
    unlisted: Mapping[str, int],
    floors: Mapping[int, FloorName],
    *,
    watchdog_unit_s: float = 1.0,
    is_floor_known_under_way: bool = True,
) -> LiftValues:
    """Turn the decoded signals of one poll into lift values.

    `floors` has the names by floor code; an unlisted code is unknown, and kept with its raw value. `watchdog_unit_s` is one
    count of the module's watchdog. Without `is_floor_known_under_way` the floor counts only while the car is reported stopped.
    """
    calls = signals.get("calls_registered")
    counts = signals.get("watchdog_time")
    unknown = dict(unlisted)
    named: dict[str, FloorName | None] = {}
    for signal in _FLOORS:
        code = signals.get(signal)
        named[signal] = floors.get(code) if isinstance(code, int) else None
        if isinstance(code, int) and code not in floors:
            unknown[signal] = code
    mode = lift_mode(signals)
    motion = signals.get("motion")
    if not is_floor_known_under_way and motion is not Motion.STOPPED:
        named["car_floor"] = None
    return LiftValues(
        floor=named["car_floor"],
        destination=named["destination"],
        call_accepted=named["call_accepted"],
        motion=(motion if isinstance(motion, Motion) else Motion.UNKNOWN) if "motion" in signals else None,
        mode=mode,
        fire_word=signals.get("mode") is Mode.FIRE and mode is not Mode.FIRE,
        doors={side: _door(signals[f"door.{side}"]) for side in Side if f"door.{side}" in signals},
        flags={name: value for name, value in signals.items() if isinstance(value, bool)},
        unknown=unknown,
        calls=frozenset(floors[code] for code in calls if code in floors)
        if isinstance(calls, frozenset) and calls
        else _NO_CALLS,
        watchdog_s=counts * watchdog_unit_s if isinstance(counts, int) else None,
    )


def lift_mode(signals: Mapping[str, Value]) -> Mode:
    """Return the highest-ranking mode that the mode word or any flag reports.

    A mode word or safety flag that cannot be read makes it UNKNOWN, unless a flag reports a mode without robots.
    """
    reported = [mode for mode, flags in FLAG_MODES if any(signals.get(flag) is True for flag in flags)]
    if any(flag in signals and signals[flag] is None for flag in SAFETY_FLAGS):
        reported.append(Mode.UNKNOWN)
    if "mode" in signals:
        word = signals["mode"]
        reported.append(word if isinstance(word, Mode) else Mode.UNKNOWN)
    if Mode.UNKNOWN in reported and not any(_RANK.get(mode, 0) > _RANK[Mode.ROBOT] for mode in reported):
        return Mode.UNKNOWN
    return max(reported, key=lambda mode: _RANK.get(mode, 0), default=Mode.NORMAL)


def _door(value: Value) -> Door:
    return value if isinstance(value, Door) else Door.UNKNOWN
