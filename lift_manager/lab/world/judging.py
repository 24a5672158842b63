"""What a judge must know of the lifts of a site."""

from __future__ import annotations

from drivers.modbus.plan import plan_poll
from lift_manager.commissioning.detection import detections
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.lab.world.judged import Judged, Read
from lift_manager.lab.world.oracle import Oracle
from register_maps.codec import Codec, compile_map

ARRIVES_WITHIN_S = 120.0
"""How long a trip may take where the map has no call that says so. Chosen: the default of the map schema's `arrive_within_s`."""


def judge_of(loaded: LoadedSite) -> Oracle:
    """Return a judge who knows what the map of each lift can and cannot show."""
    return Oracle({name: _judged(loaded, name) for name in loaded.site.lifts})


def _judged(loaded: LoadedSite, name: str) -> Judged:
    spec, source = loaded.site.lifts[name], loaded.maps[name].map
    codec = compile_map(source, offset=spec.offset)
    max_age_s = spec.max_age_s or source.link.max_age_s
    calls = [command.spec.arrive_within_s for command in codec.commands.values() if command.is_call]
    return Judged(
        controllers=(spec.controller, *(place.controller for place in spec.endpoints.values())),
        floors=tuple(spec.floors),
        max_age_s=max_age_s,
        max_session_hold_s=spec.max_session_hold_s,
        arrive_within_s=max(calls, default=ARRIVES_WITHIN_S),
        detections={one.fault: one for one in detections(codec, max_age_s=max_age_s)},
        told_by_doors=codec.map.at_floor_evidence.kind == "door_limit",
        blocks=_blocks(loaded, name, codec),
        poll_s=loaded.poll_s(name),
        between_sessions_s=spec.between_sessions_s,
        holds=frozenset(command for command in codec.commands if command.startswith("hold_door.")),
        tells_robot_mode="robot_mode_on" in codec.signals,
        tells_motion=not codec.signals.keys().isdisjoint({"motion", "level"}),
        repeated=frozenset(n for n, command in codec.commands.items() if command.spec.repeat_pulse_s is not None),
        fleeting=frozenset(command for command, its in codec.commands.items() if its.spec.ends_itself),
    )


def _blocks(loaded: LoadedSite, name: str, codec: Codec) -> frozenset[Read]:
    """Return what a poll of this lift reads, where and from whom."""
    placed = devices(loaded.site, loaded.site.lifts[name], codec.map)
    needs = [loaded.links[device.controller] for device in placed.values()]
    blocks = plan_poll(
        codec,
        max_registers=min(need.max_registers_per_read for need in needs),
        max_bits=min(need.max_bits_per_read for need in needs),
    )
    return frozenset(
        (placed[block.endpoint].controller, placed[block.endpoint].unit_id, block.table, block.start, block.count)
        for block in blocks
    )
