"""Whether a map can say and call every floor of a lift, and has the doors that serve it."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from register_maps.codec import Codec, SignalCodec, Value
from register_maps.schema import CALLS, Kind

_FLOOR_SIGNALS = ("car_floor", "destination", "call_accepted", "calls_registered")


def check_floors(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    """Yield codes that two floors share or the map cannot express, and doors that it does not have."""
    named: dict[int, str] = {}
    sides = {name.removeprefix("door.") for name in codec.signals if name.startswith("door.")}
    for floor, entry in lift.floors.items():
        where = (*key, "floors", floor)
        if entry.code in named:
            yield Problem(where, f"code {entry.code} is floor {named[entry.code]} already")
        named.setdefault(entry.code, floor)
        for message in _uncodable(entry.code, codec, writes=lift.access == "control"):
            yield Problem(where, message)
        if entry.doors == ():
            yield Problem(where, "lists no door; leave `doors` out if all of them serve this floor")
        for side in entry.doors or ():
            if side not in sides:
                yield Problem(
                    where, f"{codec.map.name} has no {side} door; it has {', '.join(sorted(sides)) or 'none'}"
                )


def _uncodable(code: int, codec: Codec, *, writes: bool) -> Iterator[str]:
    """Say once why the map's coding cannot express this floor."""
    for name in (name for name in CALLS if name in codec.commands and writes):
        try:
            codec.commands[name].encode(code)
        except ValueError as error:
            yield str(error)
            return
    for name in (name for name in _FLOOR_SIGNALS if name in codec.signals):
        if (message := _untellable(code, codec.signals[name])) is not None:
            yield message
            return


def _untellable(code: int, signal: SignalCodec) -> str | None:
    told: Value = frozenset({code}) if signal.kind is Kind.FLOORS else code
    try:
        heard = signal.decode(signal.encode(told) & (1 << signal.width) - 1)
    except ValueError as error:
        return str(error)
    if heard == told:
        return None
    meaning = "means that there is no floor" if heard is None else f"would read back as {heard}"
    return f"code {code} cannot be told apart: in {signal.name} it {meaning}"
