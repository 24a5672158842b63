"""Reads the commands of a map from the registers, and applies the map's rules to the controller. Pure."""

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
    """Return the count of the client's heartbeat; None if the map has none."""
    command = codec.commands.get("heartbeat")
    return None if command is None else command.decode(written)


def watchdog_s(codec: Codec) -> float | None:
    """Return after how long without a sign of life watched commands end; None if no command of the map is watched."""
    watched = [codec.commands[name].spec for name in _watched(codec)]
    if not watched:
        return None
    if codec.map.watchdog_s is not None:
        return codec.map.watchdog_s
    heartbeat = codec.map.commands.get("heartbeat")
    if heartbeat is not None:
        return (heartbeat.every_s or 1.0) * WATCHDOG_REFRESHES
    return max(spec.refresh_s or 1.0 for spec in watched) * WATCHDOG_REFRESHES


def apply_map(parameters: Parameters, codec: Codec) -> Parameters:
    """Apply the map's watchdog, time limits of holds, robot mode and handshake to a controller.

    A given `hold_watchdog_s` overrides that of the map; infinity is no watchdog at all. Commands given as `watched` are
    watched in addition to those of the map.
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
        released_after_s={
            name: spec.released_after_s for name, spec in commands.items() if spec.released_after_s is not None
        },
        pauses_s={name: spec.repeat_pulse_s for name, spec in commands.items() if spec.repeat_pulse_s is not None},
        robot_mode_only=frozenset(name for name, spec in commands.items() if "robot_mode_on" in spec.requires),
        handshake=rules,
    )


def _watched(codec: Codec) -> frozenset[str]:
    return frozenset(name for name, command in codec.commands.items() if command.spec.on_link_loss == "device_watchdog")
