"""Derives the capabilities of one lift from its map and its site settings. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256

from drivers.modbus.output import LOOK_S
from drivers.model import Capabilities, FloorName
from register_maps.codec import Block, Codec, Point
from register_maps.schema import CALLS
from register_maps.words import Door, Side

OPEN_CONTACT: Mapping[int, str] = {0: Door.CLOSED, 1: Door.OPEN}
"""The meaning of a door at a single point where the map names no values."""

KINDS = 64
"""Kinds of lifts whose capabilities are shared. Chosen: more than a site has maps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftSettings:
    """The site's settings for one lift."""

    name: str
    floors: Mapping[FloorName, int]
    """Floor codes by name, lowest floor first."""
    unit_id: int = 1
    control: bool = False
    """Whether the site lets the manager write at all."""
    max_age_s: float = 1.0
    max_registers_per_read: int = 125
    max_bits_per_read: int = 2000
    look_s: float = LOOK_S
    """How often our outputs are compared with what we wrote, to detect other clients that write them; infinity for never."""


def capabilities(codec: Codec, blocks: tuple[Block, ...], settings: LiftSettings) -> Capabilities:
    """Return the capabilities of a lift that is polled in these blocks. Lifts that are alike share them."""
    return _capabilities(codec, blocks, control=settings.control, max_age_s=settings.max_age_s)


@lru_cache(maxsize=KINDS)
def _capabilities(codec: Codec, blocks: tuple[Block, ...], *, control: bool, max_age_s: float) -> Capabilities:
    source = codec.map
    deciding: set[Point] = set()
    for name, signal in codec.signals.items():
        if name in ("car_floor", "motion", "level") or name.startswith("door."):
            deciding.update(signal.points)
    calls = {name: source.commands[name] for name in CALLS if name in source.commands}
    mode = source.commands.get("robot_mode")
    watching = any(command.on_link_loss == "device_watchdog" for command in source.commands.values())
    return Capabilities(
        commands=frozenset(codec.commands) if control else frozenset(),
        signals=frozenset(codec.signals),
        doors=tuple(side for side in Side if f"door.{side}" in codec.signals),
        one_block=any(all(block.holds(point) for point in deciding) for block in blocks),
        evidence=source.at_floor_evidence.kind,
        evidence_for_s=source.at_floor_evidence.for_s or 0.0,
        max_age_s=max_age_s,
        requires={name: frozenset(command.requires) for name, command in source.commands.items() if command.requires},
        granted_within_s=mode.granted_within_s if mode is not None else 600.0,
        arrive_within_s=max((call.arrive_within_s for call in calls.values()), default=120.0),
        until={name: call.until or "arrived" for name, call in calls.items() if call.action == "hold"},
        held_commands=frozenset(name for name, command in source.commands.items() if command.action == "hold"),
        max_hold_s={name: one.max_hold_s for name, one in source.commands.items() if one.max_hold_s is not None},
        released_after_s={
            name: one.released_after_s for name, one in source.commands.items() if one.released_after_s is not None
        },
        excludes=_excludes({name: command.excludes for name, command in source.commands.items()}),
        needs_occupancy=source.needs_occupancy,
        door_opens_within_s=source.door_opens_within_s,
        door_closes_within_s=source.door_closes_within_s,
        open_contacts=frozenset(side for side in Side if _is_open_contact(codec, f"door.{side}")),
        watched=watching and "watchdog_time" in source.signals,
        same_floor_call=source.at_same_floor == "call",
        not_visible={str(signal): reason for signal, reason in source.not_visible.items()},
        map_name=source.name,
        map_hash=_hash(codec),
        printed={name: part.addresses for parts in (source.signals, source.commands) for name, part in parts.items()},
        trust=source.provenance.trust,
    )


def _excludes(excludes: Mapping[str, Collection[str]]) -> dict[str, frozenset[str]]:
    """Return the commands that may not be on together, whichever of the two excludes the other."""
    pairs = {(name, other) for name, others in excludes.items() for other in others if other in excludes}
    pairs |= {(other, name) for name, other in pairs}
    return {name: frozenset(other for one, other in pairs if one == name) for name, _ in sorted(pairs)}


def _is_open_contact(codec: Codec, name: str) -> bool:
    """Whether a door only reports that it is fully open: by a switch at each floor, or with two values of which 1 is `open`."""
    signal, spec = codec.signals.get(name), codec.map.signals.get(name)
    if signal is None or spec is None:
        return False
    if spec.open_limit is not None or spec.thresholds:
        return False
    return signal.per_floor or (spec.values or OPEN_CONTACT) == OPEN_CONTACT


def _hash(codec: Codec) -> str:
    """Return a hash of the map's content and of this lift's addresses on the wire.

    What a map leaves to its defaults does not count: a key that a later version knows must not make every map another one.
    """
    places = [signal.points for signal in codec.signals.values()]
    return sha256(f"{codec.map.model_dump_json(exclude_defaults=True)}{places}".encode()).hexdigest()
