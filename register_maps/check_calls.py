"""Whether the calls of a map fit together: with each other, with the floors it can show, and with a robot's handshake."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from register_maps.errors import Problem
from register_maps.schema import CALLS, SIGNALS, Kind, RegisterMap, Signal
from register_maps.words import BIT_TABLES, Side

_LISTS = {"one_of": Kind.FLOOR, "each_of": Kind.FLOORS, "open_limits": Kind.DOOR}
"""Keys with one bit per floor, and the kind of signal each is for."""

_SIDED = tuple(f"go_to.{side}" for side in Side)


def check_calls(source: RegisterMap) -> Iterator[Problem]:
    """Yield calls that contradict each other, floors that one part has and another cannot say, and missing handshakes."""
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
        message = (
            f"{name} tells an empty car from an occupied one, and {plain[0]} does not; keep call and go, or {plain[0]}"
        )
        yield Problem(("commands", name), message)
    if "go" in has and "call" not in has:
        message = "go is for a robot aboard, and nothing brings the car to it; declare `call`, or name this go_to"
        yield Problem(("commands", "go"), message)
    if "call" in has and "go" not in has and not _level_in_place(source):
        message = (
            "call is for the empty car, and nothing sends the occupied one on; declare `go`, or name this go_to; "
            "where robot_in_place itself sends it on, say that with `action: hold`"
        )
        yield Problem(("commands", "call"), message)


def _sides(source: RegisterMap) -> Iterator[Problem]:
    """Yield calls of one door that are given, or end, in another way than those of the other."""
    sides = [name for name in _SIDED if name in source.commands]
    for first, second in itertools.pairwise(sides):
        for key in ("action", "until"):
            one, other = (getattr(source.commands[name], key) for name in (first, second))
            if one != other:
                said = f"no `{key}`" if one is None else f"`{key}: {one}`"
                message = f"{first} says {said}, and the calls of one lift are all given and ended alike; say the same in both"
                yield Problem(("commands", second, key), message)
                break


def _level_in_place(source: RegisterMap) -> bool:
    """Whether "in place" is an output that is on while the robot is aboard: its release says that the robot has left."""
    in_place = source.commands.get("robot_in_place")
    return in_place is not None and in_place.action == "hold"


def _occupancy(source: RegisterMap) -> Iterator[Problem]:
    if not source.needs_occupancy:
        return
    wanted = ["call", "robot_in_place"] if _level_in_place(source) else ["call", "go", "robot_in_place", "robot_left"]
    if missing := [name for name in wanted if name not in source.commands]:
        message = (
            f"a car that waits for its robot needs {', '.join(missing)}; declare what is missing, or remove this line"
        )
        yield Problem(("needs_occupancy",), message)


def _same_floor(source: RegisterMap) -> Iterator[Problem]:
    opens = any(name.startswith("hold_door.") for name in source.commands)
    if source.commands.keys() & set(CALLS) and source.at_same_floor == "open_button" and not opens:
        message = "the map has no hold_door command to open the door where the car stands; say `at_same_floor: call`"
        yield Problem(("at_same_floor",), message)


def _floors(source: RegisterMap) -> Iterator[Problem]:
    """Yield lists of floors that are longer or shorter than what car_floor can say."""
    shown = source.signals.get("car_floor")
    if shown is None:
        return
    codes = _codes(source, shown)
    for name, command in source.commands.items():
        if command.one_of is None:
            continue
        path = ("commands", name, "one_of")
        if (message := _too_many(codes, len(command.one_of), "outputs")) is not None:
            yield Problem(path, message)
        elif 0 in (*shown.unknown, *shown.none):
            first = f"the first output, {command.one_of[0]}, calls the floor with code 0, and car_floor never says 0"
            yield Problem(path, f"{first}; let the codes start at 0, or it is never used", warning=True)
    for name, signal in source.signals.items():
        key = next((key for key, kind in _LISTS.items() if getattr(signal, key) and SIGNALS.get(name) is kind), None)
        if key is None or name == "car_floor":
            continue
        count = len(getattr(signal, key))
        if (message := _too_many(codes, count, "bits")) is not None:
            yield Problem(("signals", name, key), message)
        elif key == "open_limits" and shown.one_of is not None and count < len(shown.one_of):
            floors = f"has {count} limits, and car_floor shows {len(shown.one_of)} floors"
            yield Problem(("signals", name, key), f"{floors}; list one limit for each floor, in the same order")


def _codes(source: RegisterMap, shown: Signal) -> int | None:
    """Count the floor codes, from 0, that car_floor can say; None where a whole register bounds nothing."""
    if shown.one_of is not None:
        return len(shown.one_of)
    if shown.code_of is not None:
        return 1 << len(shown.code_of)
    if shown.at is None:
        return None
    place = source.place(shown.at)
    if place.table in BIT_TABLES or place.bit is not None:
        return 2
    return None if shown.bits is None else 1 << shown.bits[1] - shown.bits[0] + 1


def _too_many(codes: int | None, count: int, sort: str) -> str | None:
    if codes is None or count <= codes:
        return None
    return f"has {count} {sort}, one per floor, and car_floor only says codes 0 to {codes - 1}; a floor is never shown; correct one of the two"
