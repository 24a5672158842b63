"""What a judge must know of the lifts of a site."""

from __future__ import annotations

from lift_manager.commissioning.detection import detections
from lift_manager.config.load import LoadedSite
from lift_manager.lab.world.oracle import Judged, Oracle
from register_maps.codec import compile_map

ARRIVES_WITHIN_S = 120.0
"""How long a trip may take where the map has no call that says so. Chosen: the default of the map schema's `arrive_within_s`."""


def judge_of(loaded: LoadedSite) -> Oracle:
    """Return a judge who knows what the map of each lift can and cannot show."""
    lifts = {}
    for name, spec in loaded.site.lifts.items():
        source = loaded.maps[name].map
        codec = compile_map(source, offset=spec.offset)
        max_age_s = spec.max_age_s or source.link.max_age_s
        calls = [command.spec.arrive_within_s for command in codec.commands.values() if command.is_call]
        lifts[name] = Judged(
            controllers=(spec.controller, *(place.controller for place in spec.endpoints.values())),
            max_age_s=max_age_s,
            max_session_hold_s=spec.max_session_hold_s,
            arrive_within_s=max(calls, default=ARRIVES_WITHIN_S),
            detections={one.fault: one for one in detections(codec, max_age_s=max_age_s)},
            levels=frozenset(command for command, its in codec.commands.items() if its.spec.action == "hold"),
            fleeting=frozenset(command for command, its in codec.commands.items() if its.spec.ends_itself),
        )
    return Oracle(lifts)
