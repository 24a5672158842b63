"""Checks that a map can report and call every floor of a lift, and has its doors."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import Lift
from register_maps.codec import Codec, SignalCodec, Value
from register_maps.schema import CALLS, Kind, RegisterMap, Signal
from register_maps.signal_codec import listed_codes

_FLOOR_SIGNALS = ("car_floor", "destination", "call_accepted", "calls_registered")


def check_floors(key: Key, lift: Lift, codec: Codec) -> Iterator[Problem]:
    """Yield codes that two floors share or that the map cannot express, and doors that the map does not have."""
    taken: dict[int, str] = {}
    sides = {name.removeprefix("door.") for name in codec.signals if name.startswith("door.")}
    for floor, entry in lift.floors.items():
        where = (*key, "floors", floor)
        if entry.code in taken:
            yield Problem(where, f"code {entry.code} is floor {taken[entry.code]} already")
        taken.setdefault(entry.code, floor)
        for message in _encoding_problems(entry.code, codec, writes=lift.access == "control"):
            yield Problem(where, message)
        if entry.doors == ():
            yield Problem(where, "lists no door; leave `doors` out if all of them serve this floor")
        for side in entry.doors or ():
            if side not in sides:
                yield Problem(
                    where, f"{codec.map.name} has no {side} door; it has {', '.join(sorted(sides)) or 'none'}"
                )


def unused_codes(lift: Lift, source: RegisterMap) -> Iterator[str]:
    """Yield codes of the map without a floor: they are spare, or the list is shifted by one."""
    floors = {entry.code for entry in lift.floors.values()}
    commands = source.commands.items() if lift.access == "control" else ()
    lists = {name: part for name, part in (*source.signals.items(), *commands) if name not in source.derived}
    parts: dict[tuple[int, ...], list[str]] = {}
    for name, part in lists.items():
        codes = (part.positions if isinstance(part, Signal) else None) or part.floor_codes
        if spare := tuple(code for code in codes if code not in floors):
            parts.setdefault(spare, []).append(name)
    for spare, names in parts.items():
        noun = "codes" if len(spare) > 1 else "code"
        text = f"{noun} {listed_codes(spare)} of {', '.join(names)} {'belong' if len(spare) > 1 else 'belongs'} to no floor of this lift"
        is_counted = [name for name in names if lists[name].codes is None and lists[name].floor_codes]
        if is_counted and 0 in spare:
            text += f"; without `codes`, the first entry of {', '.join(is_counted)} has code 0: if it is that of the lowest floor here, give `codes`"
        yield text


def _encoding_problems(code: int, codec: Codec, *, writes: bool) -> Iterator[str]:
    """Yield the first reason why the coding of the map cannot express this floor."""
    for name in (name for name in CALLS if name in codec.commands and writes):
        spec = codec.commands[name].spec
        try:
            codec.commands[name].encode(code)
        except ValueError as error:
            is_counted = spec.one_of is not None and spec.codes is None
            yield f"{error}{'; if its outputs count otherwise, give `codes`' if is_counted else ''}"
            return
    for name in (name for name in _FLOOR_SIGNALS if name in codec.signals):
        if (message := _decoding_problem(code, codec.signals[name])) is not None:
            yield message
            return


def _decoding_problem(code: int, signal: SignalCodec) -> str | None:
    value: Value = frozenset({code}) if signal.kind is Kind.FLOORS else code
    try:
        decoded = signal.decode(signal.encode(value) & (1 << signal.width) - 1)
    except ValueError as error:
        return str(error)
    if decoded == value:
        return None
    meaning = "means that there is no floor" if decoded is None else f"would read back as {decoded}"
    return f"code {code} cannot be told apart: in {signal.name} it {meaning}"
