"""From decoded signals to what one lift says: floor names, one mode, no guesses. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.model import FloorName, LiftValues
from register_maps.codec import Value
from register_maps.words import Door, Mode, Motion, Side

_FLAG_MODES: tuple[tuple[Mode, tuple[str, ...]], ...] = (
    (Mode.INSPECTION, ("inspection",)),
    (Mode.FIRE, ("fire", "fireman")),
    (Mode.EMERGENCY, ("emergency_power", "passenger_alarm")),
    (Mode.OUT_OF_SERVICE, ("out_of_service", "fault")),
    (Mode.INDEPENDENT, ("independent",)),
    (Mode.ATTENDANT, ("attendant",)),
    (Mode.ROBOT, ("robot_mode_on",)),
)
"""Highest first: the table in register_maps/README.md."""

_RANK = {mode: rank for rank, (mode, _) in enumerate(reversed(_FLAG_MODES), start=1)}
_FLOORS = ("car_floor", "destination", "call_accepted")


def lift_values(
    signals: Mapping[str, Value], unlisted: Mapping[str, int], floors: Mapping[int, FloorName]
) -> LiftValues:
    """Put the decoded signals of one poll into the words of the manager.

    `floors` names the site's floor codes; a code it does not list is unknown, and kept with its raw value.
    """
    unknown = dict(unlisted)
    named: dict[str, FloorName | None] = {}
    for signal in _FLOORS:
        code = signals.get(signal)
        named[signal] = floors.get(code) if isinstance(code, int) else None
        if isinstance(code, int) and code not in floors:
            unknown[signal] = code
    motion = signals.get("motion")
    return LiftValues(
        floor=named["car_floor"],
        destination=named["destination"],
        call_accepted=named["call_accepted"],
        motion=(motion if isinstance(motion, Motion) else Motion.UNKNOWN) if "motion" in signals else None,
        mode=lift_mode(signals),
        doors={side: _door(signals[f"door.{side}"]) for side in Side if f"door.{side}" in signals},
        flags={name: value for name, value in signals.items() if isinstance(value, bool)},
        unknown=unknown,
    )


def lift_mode(signals: Mapping[str, Value]) -> Mode:
    """Return the highest mode that the mode word or any flag tells; an unreadable mode word is UNKNOWN unless a flag outranks it."""
    told = [mode for mode, flags in _FLAG_MODES if any(signals.get(flag) is True for flag in flags)]
    if "mode" in signals:
        word = signals["mode"]
        told.append(word if isinstance(word, Mode) else Mode.UNKNOWN)
    if Mode.UNKNOWN in told and not any(_RANK.get(mode, 0) > _RANK[Mode.ROBOT] for mode in told):
        return Mode.UNKNOWN
    return max(told, key=lambda mode: _RANK.get(mode, 0), default=Mode.NORMAL)


def _door(value: Value) -> Door:
    return value if isinstance(value, Door) else Door.UNKNOWN
