"""Whether a map can say and call every floor of a lift, and has the doors that serve it."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from register_maps.codec import Codec, SignalCodec, Value
from register_maps.schema import CALLS, Kind, RegisterMap, Signal
from register_maps.signal_codec import listed_codes

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


def unused_codes(lift: Lift, source: RegisterMap) -> Iterator[str]:
    """Yield the codes of a map that belong to no floor of a lift: spare ones, or a list that is shifted by one."""
    floors = {entry.code for entry in lift.floors.values()}
    commands = source.commands.items() if lift.access == "control" else ()
    lists = {name: part for name, part in (*source.signals.items(), *commands) if name not in source.derived}
    parts: dict[tuple[int, ...], list[str]] = {}
    for name, part in lists.items():
        codes = (part.positions if isinstance(part, Signal) else None) or part.floor_codes
        if spare := tuple(code for code in codes if code not in floors):
            parts.setdefault(spare, []).append(name)
    for spare, names in parts.items():
        more = "codes" if len(spare) > 1 else "code"
        text = f"{more} {listed_codes(spare)} of {', '.join(names)} {'belong' if len(spare) > 1 else 'belongs'} to no floor of this lift"
        counted = [name for name in names if lists[name].codes is None and lists[name].floor_codes]
        if counted and 0 in spare:
            text += f"; without `codes`, the first entry of {', '.join(counted)} has code 0: if it is that of the lowest floor here, give `codes`"
        yield text


def _uncodable(code: int, codec: Codec, *, writes: bool) -> Iterator[str]:
    """Say once why the map's coding cannot express this floor."""
    for name in (name for name in CALLS if name in codec.commands and writes):
        spec = codec.commands[name].spec
        try:
            codec.commands[name].encode(code)
        except ValueError as error:
            counted = spec.one_of is not None and spec.codes is None
            yield f"{error}{'; if its outputs count otherwise, give `codes`' if counted else ''}"
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
