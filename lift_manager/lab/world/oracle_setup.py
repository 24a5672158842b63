"""Sets up the judge for the lifts of a site."""

from __future__ import annotations

from drivers.modbus.read_plan import plan_poll
from lift_manager.config.devices import devices
from lift_manager.config.load import LoadedSite
from lift_manager.lab.world.lift_under_test import LiftUnderTest, PolledBlock
from lift_manager.lab.world.oracle import Oracle
from lift_manager.lab.world.reviewed import evidence_of, excuses
from register_maps.codec import Codec

DEFAULT_ARRIVAL_S = 120.0
"""How long a trip may take if the map has no call that limits it. Chosen: the default of `arrive_within_s` in the map schema."""
HANDSHAKE = frozenset({"robot_in_place", "robot_left"})


def oracle_of(loaded: LoadedSite) -> Oracle:
    """Return a judge that knows what the map of each lift can and cannot show."""
    return Oracle({name: _judged(loaded, name) for name in loaded.site.lifts})


def _judged(loaded: LoadedSite, name: str) -> LiftUnderTest:
    spec, source = loaded.site.lifts[name], loaded.maps[name].map
    codec = loaded.codecs[name]
    shows, _ = evidence_of(source)
    max_age_s = spec.max_age_s or shows.max_age_s
    commands = source.commands
    arrive_within_s = max(
        (one.arrive_within_s for kind, one in commands.items() if kind.partition(".")[0] in ("go_to", "call", "go")),
        default=DEFAULT_ARRIVAL_S,
    )
    controllers = (spec.controller, *(place.controller for place in spec.endpoints.values()))
    return LiftUnderTest(
        controllers=controllers,
        floors=tuple(spec.floors),
        shows=shows,
        max_age_s=max_age_s,
        timeout_s={controller: loaded.links[controller].timeout_s for controller in controllers},
        max_session_hold_s=min(
            [spec.max_session_hold_s]
            + [one.released_after_s for one in commands.values() if one.released_after_s is not None]
        ),
        arrive_within_s=arrive_within_s,
        excuses=excuses(shows, max_age_s=max_age_s, arrive_within_s=arrive_within_s),
        blocks=_blocks(loaded, name, codec),
        poll_s=loaded.poll_s(name),
        between_sessions_s=spec.between_sessions_s,
        holds=frozenset(command for command in commands if command.startswith("hold_door.")),
        pulses_s={n: one.width_s for n, one in commands.items() if one.action == "pulse" and one.width_s is not None},
        handshake=not commands.keys().isdisjoint(HANDSHAKE),
        repeated=frozenset(n for n, one in commands.items() if one.repeat_pulse_s is not None),
        fleeting=frozenset(n for n, one in commands.items() if one.ends_itself),
        refreshes=_refreshes(loaded, name, codec),
        clear_s=spec.clear_s,
    )


def _refreshes(loaded: LoadedSite, name: str, codec: Codec) -> dict[PolledBlock, int | None]:
    """Return the cells of robot mode, of door holds and of the heartbeat, and what is written there while they are on."""
    placed = devices(loaded.site, loaded.site.lifts[name], codec.map)
    return {
        (placed[point.endpoint].controller, placed[point.endpoint].unit_id, point.table, point.address, 1): (
            None if command.spec.is_heartbeat else command.spec.on
        )
        for which, command in codec.commands.items()
        if (which == "robot_mode" or which.startswith("hold_door.") or command.spec.is_heartbeat)
        and not command.is_shared
        for point in command.points
    }


def _blocks(loaded: LoadedSite, name: str, codec: Codec) -> frozenset[PolledBlock]:
    """Return the blocks that a poll of this lift reads."""
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
