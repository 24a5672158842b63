"""One lift as text: how it is, the car in its shaft, and the last minute. Every state has a form of its own, with or without colour."""

from __future__ import annotations

import re
from collections.abc import Sequence

from lift_manager.api.lifts import Lift
from lift_manager.commissioning.watch.history import WINDOW_S, Change, History, Row, Sample, SignalQuality, SignalValue
from register_maps.words import Door, Motion

DOORS = {
    Door.CLOSED: "[||]",
    Door.OPENING: "[<>]",
    Door.OPEN: "[  ]",
    Door.CLOSING: "[><]",
    Door.MOVING: "[~~]",
    Door.FAULT: "[!!]",
    Door.UNKNOWN: "[??]",
}
"""The door of a car."""
DOOR_MARKS = {
    Door.CLOSED: "|",
    Door.OPENING: "<",
    Door.OPEN: "_",
    Door.CLOSING: ">",
    Door.MOVING: "~",
    Door.FAULT: "!",
    Door.UNKNOWN: "?",
}
MOTIONS = {Motion.UP: "^", Motion.DOWN: "v", Motion.STOPPED: ".", Motion.MOVING: "~", Motion.UNKNOWN: "?"}
OFFLINE_MARK = "x"
LEGEND = "| closed  < opening  _ open  > closing  ~ moving  ? unknown  x not read"
_LEVELS = "▁▂▃▄▅▆▇█"
_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
_TABLE = re.compile(r".*[: ]|")
_BITS = re.compile(r" bits? (\d+)(?: to (\d+))?")


def headline(history: History, now_s: float) -> str:
    """Return the lift on one line; in capitals where it must not be believed."""
    lift = history.lift
    if lift is None:
        return f"NOT READ YET: {history.trouble}" if history.trouble else "not read yet"
    age_s = history.age_s(now_s)
    age = "never read" if age_s is None else f"{age_s:.1f} s old"
    if history.trouble:
        silent_s = history.since_read_s(now_s)
        return f"!!! {lift.name}: THE MANAGER DOES NOT ANSWER for {silent_s:.0f} s, so the values are OLD: {history.trouble}"
    if not history.is_live(now_s):
        why = f": {lift.reason}" if lift.reason else ""
        return f"!!! {lift.name}: OFFLINE, the values are OLD ({age}){why}"
    parts = [f"{lift.name}: live ({age})", f"mode {lift.mode}", _whereabouts(lift), str(lift.motion)]
    parts += [f"{side} door {door}" for side, door in lift.doors.items()]
    parts += [] if lift.session is None else [f"held by {lift.session.name}"]
    return ", ".join(parts)


def shaft(history: History, now_s: float, *, rows: int | None = None) -> list[str]:
    """Return the shaft, highest floor first: the car with its doors, its direction, and `>` at its destination.

    Of a tall shaft at most `rows` lines around the car are shown.
    """
    lift = history.lift
    if lift is None:
        return []
    is_live = history.is_live(now_s)
    width = max(len(floor) for floor in lift.floors)
    lines = []
    for floor in reversed(lift.floors):
        mark = ">" if is_live and floor == lift.destination != lift.floor else " "
        lines.append(f"{mark} {floor:<{width}}  {_car(lift) if is_live and floor == lift.floor else '.'}")
    where = len(lift.floors) - 1 - lift.floors.index(lift.floor) if is_live and lift.floor in lift.floors else None
    if not is_live:
        lines.append(f"  {'?':<{width}}  [??] nobody knows where the car is: there is no current reading")
    elif where is None:
        lines.append(f"  {'?':<{width}}  {_car(lift)}; its floor is not known")
    return _window(lines, len(lines) - 1 if where is None else where, rows)


def trace(history: History, now_s: float, *, columns: int, is_unicode: bool = True) -> list[str]:
    """Return the last minute of floor, doors and motion, one character for each part of it."""
    lift = history.lift
    if lift is None:
        return []
    found = history.trace(now_s, columns)
    levels = _LEVELS if is_unicode else _DIGITS
    marks = {"floor": [_floor_mark(one, lift.floors, levels) for one in found]}
    for place, side in enumerate(history.sides):
        marks[f"{side} door"] = [_door_mark(one, place) for one in found]
    marks["motion"] = [_motion_mark(one) for one in found]
    width = max(map(len, marks))
    lines = [f"{name:<{width}}  {''.join(row)}" for name, row in marks.items()]
    began = f"{WINDOW_S:.0f} s ago"
    return [*lines, f"{'':<{width}}  {began:<{columns - 3}}now", LEGEND]


def change_line(change: Change, lift: str) -> str:
    """Return a change on one line."""
    signal, before = change.signal, change.before
    text = f"{change.at.astimezone():%H:%M:%S}.{change.at.microsecond // 1000:03} {lift} {signal.name} {value_text(signal.value)}"
    if before is not None:
        text += f", was {value_text(before.value)}"
    raw = "" if signal.raw is None else f" raw {signal.raw}"
    return f"{text} ({', '.join(signal.addresses)} = {', '.join(map(short_wire, signal.wire))} on the wire{raw and ','}{raw})"


def cells(row: Row) -> tuple[str, ...]:
    """Return a row of the table: signal, value, raw, printed, wire, age, quality, changed. A value that is old is in brackets."""
    signal = row.signal
    value = value_text(signal.value)
    return (
        signal.name,
        value if row.quality is SignalQuality.OK else f"({value})",
        "-" if signal.raw is None else str(signal.raw),
        places(signal.addresses),
        places(tuple(map(short_wire, signal.wire))),
        "-" if row.age_s is None else f"{row.age_s:.1f}",
        str(row.quality),
        "-" if row.changed is None else f"{row.changed.astimezone():%H:%M:%S}",
    )


def value_text(value: SignalValue) -> str:
    """Return a value for people."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def short_wire(wire: str) -> str:
    """Shorten `holding 11 bits 4 to 5` to `holding 11.4-5`."""
    return _BITS.sub(lambda found: f".{found[1]}" + (f"-{found[2]}" if found[2] else ""), wire)


def places(addresses: Sequence[str]) -> str:
    """Return addresses on one line: `discrete:0,1` of two in a table, `discrete:0...7` of many."""
    if len(addresses) < 2:
        return ", ".join(addresses)
    tables = {_TABLE.match(address)[0] for address in addresses}  # type: ignore[index]  # it matches every text
    if len(tables) > 1:
        return f"{addresses[0]} ... {addresses[-1]}"
    (table,) = tables
    numbers = [address.removeprefix(table) for address in addresses]
    return table + (",".join(numbers) if len(numbers) <= 2 else f"{numbers[0]}...{numbers[-1]}")


def _whereabouts(lift: Lift) -> str:
    if lift.floor is None:
        return "floor not known"
    return f"at {lift.floor}" if lift.standing else f"near {lift.floor}"


def _car(lift: Lift) -> str:
    doors = "".join(DOORS[door] for door in lift.doors.values()) or "[  ?]"
    words = [f"{side} {door}" for side, door in lift.doors.items()]
    direction = {Motion.UP: "^ ", Motion.DOWN: "v "}.get(lift.motion, "")
    return f"{doors} {direction}{', '.join([*words, str(lift.motion)])}"


def _window(lines: list[str], centre: int, rows: int | None) -> list[str]:
    """Return at most so many lines around one, and what is left out."""
    if rows is None or len(lines) <= rows:
        return lines
    kept = max(1, rows - 2)
    first = min(max(0, centre - kept // 2), len(lines) - kept)
    above, below = first, len(lines) - first - kept
    return [
        *([f"  ... {above} more above"] if above else []),
        *lines[first : first + kept],
        *([f"  ... {below} more below"] if below else []),
    ]


def _floor_mark(sample: Sample | None, floors: Sequence[str], levels: str) -> str:
    if sample is None:
        return " "
    if not sample.is_live:
        return OFFLINE_MARK
    if sample.floor not in floors:
        return "?"
    place = floors.index(sample.floor)
    if levels is _DIGITS and len(floors) <= len(levels):
        return levels[place]
    return levels[place * (len(levels) - 1) // max(1, len(floors) - 1)]


def _door_mark(sample: Sample | None, place: int) -> str:
    if sample is None:
        return " "
    if not sample.is_live:
        return OFFLINE_MARK
    return DOOR_MARKS[sample.doors[place]] if place < len(sample.doors) else "?"


def _motion_mark(sample: Sample | None) -> str:
    if sample is None:
        return " "
    return MOTIONS[sample.motion] if sample.is_live else OFFLINE_MARK
