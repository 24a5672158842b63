"""What a map's commands ask of the controller, and what the map says about how the controller takes them. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

from register_maps.codec import Codec, Image
from simulator import handshake
from simulator.state import Parameters

WATCHDOG_REFRESHES = 3
"""A hold that is not written again for so many of its refresh times falls, and so do all when a heartbeat stands still for so
many of its beats. Chosen: one lost write must not open a grip, and people wait no longer than that for their lift."""


def present_commands(codec: Codec, written: Image, codes: Sequence[int]) -> dict[str, int]:
    """Return the commands that are present: the index of the floor for a call, 1 for others; unknown floors are no call."""
    found: dict[str, int] = {}
    for name, command in codec.commands.items():
        value = None if command.spec.is_heartbeat else command.decode(written)
        if value is not None and not command.is_call:
            found[name] = 1
        elif value in codes:
            found[name] = codes.index(value)
    return found


def heartbeat_count(codec: Codec, written: Image) -> int | None:
    """Return what the client's heartbeat stands at; None where the map has none."""
    command = codec.commands.get("heartbeat")
    return None if command is None else command.decode(written)


def watchdog_s(codec: Codec) -> float | None:
    """Return when watched commands fall without a sign of life; None where the map says that all of them last."""
    watched = [codec.commands[name].spec for name in _watched(codec)]
    if not watched:
        return None
    heartbeat = codec.map.commands.get("heartbeat")
    if heartbeat is not None:
        return (heartbeat.every_s or 1.0) * WATCHDOG_REFRESHES
    return max(spec.refresh_s or 1.0 for spec in watched) * WATCHDOG_REFRESHES


def apply_map(parameters: Parameters, codec: Codec) -> Parameters:
    """Set a controller to what its map says of watchdog, robot mode and handshake.

    A `hold_watchdog_s` that is given goes before that of the map, and infinity is no watchdog at all. What is given as
    `watched` is watched beside what the map says.
    """
    limit_s = watchdog_s(codec) if parameters.hold_watchdog_s is None else parameters.hold_watchdog_s
    commands = codec.map.commands
    rules = None
    if handshake.IN_PLACE in commands:
        rules = handshake.Rules(
            lasting=frozenset(
                name for name in (handshake.CALL, handshake.GO) if name in commands and commands[name].action == "hold"
            ),
            in_place_sends_on=handshake.CALL in commands and handshake.GO not in commands and "go_to" not in commands,
            in_place_is_occupied=commands[handshake.IN_PLACE].action == "hold" and handshake.LEFT not in commands,
        )
    return replace(
        parameters,
        hold_watchdog_s=None if limit_s == inf else limit_s,
        watched=_watched(codec) | parameters.watched,
        robot_mode_only=frozenset(name for name, spec in commands.items() if "robot_mode_on" in spec.requires),
        handshake=rules,
    )


def _watched(codec: Codec) -> frozenset[str]:
    return frozenset(name for name, command in codec.commands.items() if command.spec.on_link_loss == "device_watchdog")
