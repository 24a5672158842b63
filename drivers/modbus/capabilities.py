"""What the site says about one lift, and what it and the map together let the lift say and do. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.model import Capabilities, FloorName
from register_maps.codec import Block, Codec, Point
from register_maps.words import Side


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftSettings:
    """What the site says about one lift."""

    name: str
    floors: Mapping[FloorName, int]
    """Floor codes by name, lowest floor first."""
    unit_id: int = 1
    control: bool = False
    """Whether anything may be written at all."""
    max_age_s: float = 1.0
    max_registers_per_read: int = 125
    max_bits_per_read: int = 2000


def capabilities(codec: Codec, blocks: tuple[Block, ...], settings: LiftSettings) -> Capabilities:
    """Return what this lift can say and be told, polled in these blocks."""
    evidence = codec.map.at_floor_evidence
    deciding: set[Point] = set()
    for name, signal in codec.signals.items():
        if name in ("car_floor", "motion", "level") or name.startswith("door."):
            deciding.update(signal.points)
    call = codec.map.commands.get("go_to")
    mode = codec.map.commands.get("robot_mode")
    return Capabilities(
        commands=frozenset(codec.commands) if settings.control else frozenset(),
        signals=frozenset(codec.signals),
        doors=tuple(side for side in Side if f"door.{side}" in codec.signals),
        one_block=any(all(block.holds(point) for point in deciding) for block in blocks),
        evidence=evidence.kind,
        evidence_for_s=evidence.for_s or 0.0,
        max_age_s=settings.max_age_s,
        call_requires=frozenset(call.requires) if call is not None else frozenset(),
        granted_within_s=mode.granted_within_s if mode is not None else 600.0,
        arrive_within_s=call.arrive_within_s if call is not None else 120.0,
        call_is_held=call is not None and call.action == "hold",
        same_floor_call=codec.map.at_same_floor == "call",
        not_visible={str(signal): reason for signal, reason in codec.map.not_visible.items()},
        map_name=codec.map.name,
        trust=codec.map.provenance.trust,
    )
