"""Summarizes the shipped maps: the signals and commands of each."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from lift_manager.commissioning.wording import one_line
from register_maps.codec import Codec, compile_map
from register_maps.load import LoadedMap, load, shipped
from register_maps.schema import CALLS, RegisterMap, Signal
from register_maps.words import Side

WIDTH = 100
"""Columns of the terminal that the texts are made for."""

EVIDENCE = {
    "level": "level signal",
    "motion_stopped": "the car does not move",
    "position_stable": "floor unchanged for {for_s:g} s",
    "door_limit": "fully-open limit of that floor",
    "door_open": "an open door",
}
"""What shows that the car stands at the floor it reports."""


@dataclass(frozen=True, slots=True)
class MapSummary:
    """One map in a few words each."""

    name: str
    title: str
    trust: str
    position: str
    at_floor: str
    doors: str
    calls: str
    door_commands: str
    permissions: str
    handshake: str
    robot_mode: str
    fire: str
    needs: tuple[str, ...]
    """Signals that a site has to add from a second device."""
    to_set: tuple[str, ...]
    """Parameters that every site has to set."""
    may_set: tuple[str, ...]
    """Parameters with a default."""


def shipped_maps() -> tuple[MapSummary, ...]:
    """Describe every map that comes with the program, by name."""
    return tuple(summarize_map(load(name)) for name in shipped())


def summarize_map(loaded: LoadedMap) -> MapSummary:
    """Describe one map."""
    source, codec = loaded.map, compile_map(loaded.map)
    to_set = loaded.unset
    return MapSummary(
        name=source.name,
        title=one_line(source.title),
        trust=source.provenance.trust,
        position=_position(codec),
        at_floor=at_floor(source) if "car_floor" in source.signals else "nothing, until a site adds car_floor",
        doors=", ".join(_doors(source)) or "none",
        calls=", ".join(name for name in CALLS if name in source.commands) or "none: the map only looks",
        door_commands=", ".join(name for name in source.commands if "_door." in name) or "none",
        permissions=", ".join(name for name in ("may_enter", "may_leave") if name in source.signals) or "none",
        handshake=_handshake(source),
        robot_mode=_robot_mode(source),
        fire=fire(source),
        needs=tuple(source.needs),
        to_set=to_set,
        may_set=tuple(name for name in source.parameters if name not in to_set),
    )


def at_floor(source: RegisterMap) -> str:
    """Say what shows that the car stands at the floor it reports."""
    evidence = source.at_floor_evidence
    return EVIDENCE[evidence.kind].format(for_s=evidence.for_s or 0.0)


def fire(source: RegisterMap) -> str:
    """Say how a fire is seen, or why it is not."""
    seen: list[str] = [name for name in ("fire", "fireman") if name in source.signals]
    if "mode" in source.signals and "fire" in (source.signals["mode"].values or {}).values():
        seen.append("mode word")
    if seen:
        return f"visible ({', '.join(seen)})"
    return f"NOT VISIBLE: {one_line(source.not_visible.get('fire', 'the map does not say why'))}"


def lines(maps: tuple[MapSummary, ...]) -> Iterator[str]:
    """Yield the list as text, a block of lines per map."""
    for found in maps:
        yield f"{found.name}  [{found.trust}]"
        for text in _signal_text(found):
            yield from textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="        ")
        yield ""
    yield f"{len(maps)} maps. Trust says where a map comes from; none has been approved by a lift company."
    yield "More about one of them: lift-manager maps show NAME"


def _signal_text(found: MapSummary) -> Iterator[str]:
    yield found.title
    yield f"position: {found.position}; at a floor: {found.at_floor}"
    yield f"doors: {found.doors}; door commands: {found.door_commands}"
    yield f"calls: {found.calls}; robot mode: {found.robot_mode}"
    yield f"handshake: {found.handshake}; permissions: {found.permissions}"
    yield f"fire: {found.fire}"
    if found.needs:
        yield f"A SECOND DEVICE must give: {', '.join(found.needs)}"
    if found.to_set:
        yield f"every site must set: {', '.join(found.to_set)}"
    if found.may_set:
        yield f"a site may set: {', '.join(found.may_set)}"


def _position(codec: Codec) -> str:
    if "car_floor" not in codec.signals:
        return "NONE"
    spec, floors = codec.map.signals["car_floor"], len(codec.signals["car_floor"].points)
    if spec.one_of is not None:
        return f"one bit for each of {floors} floors"
    if spec.positions is not None:
        return f"position with a table of {len(spec.positions)} floors"
    if spec.code_of is not None or spec.bits is not None:
        width = codec.signals["car_floor"].width
        return f"{spec.code} code of {width} bits"
    return "number in BCD" if spec.code == "bcd" else "number"


def _doors(source: RegisterMap) -> Iterator[str]:
    for side in Side:
        if (spec := source.signals.get(f"door.{side}")) is not None:
            yield f"{side} ({_door(spec)})"


def _door(spec: Signal) -> str:
    if spec.open_limit is not None:
        return "two limits"
    if spec.open_limits is not None:
        return "open limits, one per floor"
    if spec.thresholds:
        return "its position as a number"
    words = tuple((spec.values or {0: "closed", 1: "open"}).values())
    return " or ".join(words) if len(words) == 2 else ", ".join(words)


def _handshake(source: RegisterMap) -> str:
    told = [name for name in ("robot_in_place", "robot_left") if name in source.commands]
    if not told:
        return "none"
    return ", ".join(told) + (" (the car waits for it)" if source.needs_occupancy else "")


def _robot_mode(source: RegisterMap) -> str:
    asked, shown = "robot_mode" in source.commands, "robot_mode_on" in source.signals
    if asked and shown:
        return "requested and granted"
    if asked:
        return "requested, and nothing shows whether it is granted"
    return "granted by the lift, cannot be requested" if shown else "none"
