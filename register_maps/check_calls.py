"""Checks that the calls of a map fit each other, the floors that it can show, and the handshake with robots."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator

from register_maps.errors import Problem
from register_maps.schema import CALLS, SIGNALS, Command, Kind, RegisterMap, Signal
from register_maps.signal_codec import from_bcd, listed_codes
from register_maps.words import BIT_TABLES, Side

_LISTS = {"one_of": Kind.FLOOR, "each_of": Kind.FLOORS, "open_limits": Kind.DOOR}
"""Keys with one bit per floor, each with its kind of signal."""

_SIDED = tuple(f"go_to.{side}" for side in Side)


def check_calls(source: RegisterMap) -> Iterator[Problem]:
    """Yield calls that contradict each other, floors that some part of the map cannot show, and missing handshakes."""
    yield from _kinds_of_call(source)
    yield from _sides(source)
    yield from _floors(source)
    yield from _occupancy(source)
    yield from _same_floor(source)


def _kinds_of_call(source: RegisterMap) -> Iterator[Problem]:
    has = source.commands.keys() & set(CALLS)
    for name in (name for name in source.commands if name in _SIDED and "go_to" in has):
        message = "a call either names the door or does not, and the map has go_to as well; remove one of the two"
        yield Problem(("commands", name), message)
    plain = sorted(name for name in has if name.startswith("go_to"))
    for name in (name for name in source.commands if name in ("call", "go") and plain):
        message = f"{name} distinguishes an empty car from an occupied one, and {plain[0]} does not; keep call and go, or {plain[0]}"
        yield Problem(("commands", name), message)
    if "go" in has and "call" not in has:
        message = "go is for a robot aboard, and no command calls the car to it; declare `call`, or name this go_to"
        yield Problem(("commands", "go"), message)
    if "call" in has and "go" not in has and not _level_in_place(source):
        message = (
            "call is for the empty car, and no command sends the occupied one on; declare `go`, or name this go_to; "
            "if robot_in_place itself sends it on, declare it with `action: hold`"
        )
        yield Problem(("commands", "call"), message)


def _sides(source: RegisterMap) -> Iterator[Problem]:
    """Yield calls of one door whose action or end differs from those of the other door."""
    sides = [name for name in _SIDED if name in source.commands]
    for first, second in itertools.pairwise(sides):
        for key in ("action", "until"):
            one, other = (getattr(source.commands[name], key) for name in (first, second))
            if one != other:
                given = f"no `{key}`" if one is None else f"`{key}: {one}`"
                message = f"{first} has {given}, and all calls of one lift have the same; use the same in both"
                yield Problem(("commands", second, key), message)
                break


def _level_in_place(source: RegisterMap) -> bool:
    """Whether "in place" is an output that is on while the robot is aboard: its release reports that the robot has left."""
    in_place = source.commands.get("robot_in_place")
    return in_place is not None and in_place.action == "hold"


def _occupancy(source: RegisterMap) -> Iterator[Problem]:
    if not source.needs_occupancy:
        return
    needed = ["call", "robot_in_place"] if _level_in_place(source) else ["call", "go", "robot_in_place", "robot_left"]
    if missing := [name for name in needed if name not in source.commands]:
        message = (
            f"a car that waits for its robot needs {', '.join(missing)}; declare what is missing, or remove this line"
        )
        yield Problem(("needs_occupancy",), message)


def _same_floor(source: RegisterMap) -> Iterator[Problem]:
    opens = any(name.startswith("hold_door.") for name in source.commands)
    if source.commands.keys() & set(CALLS) and source.at_same_floor == "open_button" and not opens:
        message = "the map has no hold_door command to open the door where the car stands; use `at_same_floor: call`"
        yield Problem(("at_same_floor",), message)


def _floors(source: RegisterMap) -> Iterator[Problem]:
    """Yield lists of floors that do not match the floors of car_floor."""
    shown = source.signals.get("car_floor")
    if shown is None:
        return
    codes = _codes(source, shown)
    for name, command in source.commands.items():
        if command.one_of is None:
            continue
        path = ("commands", name, "one_of" if command.codes is None else "codes")
        if (message := _never_shown(codes, command.floor_codes, "outputs")) is not None:
            yield Problem(path, message)
        else:
            yield from _useless(path, command, shown)
    for name, signal in source.signals.items():
        key = next((key for key, kind in _LISTS.items() if getattr(signal, key) and SIGNALS.get(name) is kind), None)
        if key is not None and name != "car_floor":
            yield from _list(("signals", name), key, signal, shown, codes)


def _list(
    path: tuple[str, str], key: str, signal: Signal, shown: Signal, codes: Collection[int] | None
) -> Iterator[Problem]:
    """Yield what is wrong with a signal of one bit per floor, compared with car_floor."""
    count = len(getattr(signal, key))
    if (message := _never_shown(codes, signal.floor_codes, "bits")) is not None:
        yield Problem((*path, key if signal.codes is None else "codes"), message)
    elif key == "open_limits" and shown.one_of is not None and count < len(shown.one_of):
        floors = f"has {count} limits, and car_floor shows {len(shown.one_of)} floors"
        yield Problem((*path, key), f"{floors}; list one limit for each floor, in the same order")


def _useless(path: tuple[str, ...], command: Command, shown: Signal) -> Iterator[Problem]:
    """Yield outputs of floors whose codes have another meaning in car_floor."""
    given = command.codes is not None
    cure = "correct it" if given else "give the codes of the outputs, such as `codes: [1, 2, 3]`"
    for code, output in zip(command.floor_codes, command.one_of or (), strict=False):
        if code in (*shown.unknown, *shown.none):
            message = f"{output} calls the floor with code {code}, and car_floor never reports {code}; {cure}"
            yield Problem(path, message, warning=not given)


def _codes(source: RegisterMap, shown: Signal) -> Collection[int] | None:
    """Return the floor codes that car_floor can report; None if a whole register sets no limit."""
    if shown.one_of is not None:
        return shown.floor_codes
    if shown.positions is not None:
        return shown.positions
    if shown.code_of is not None:
        return _in_bits(shown, len(shown.code_of))
    if shown.at is None:
        return None
    place = source.place(shown.at)
    if place.table in BIT_TABLES or place.bit is not None:
        return range(2)
    return None if shown.bits is None else _in_bits(shown, shown.bits[1] - shown.bits[0] + 1)


def _in_bits(shown: Signal, width: int) -> Collection[int]:
    if shown.code == "bcd":
        return [code for raw in range(1 << width) if (code := from_bcd(raw)) is not None]
    return range(1 << width)


def _never_shown(codes: Collection[int] | None, codes_used: tuple[int, ...], sort: str) -> str | None:
    never = [] if codes is None else [code for code in codes_used if code not in codes]
    if codes is None or not never:
        return None
    return (
        f"has {len(codes_used)} {sort}, one per floor, and car_floor only reports codes {listed_codes(codes)}; a floor is never shown: "
        f"{listed_codes(never)}; correct one of the two, or give their codes with `codes`"
    )
