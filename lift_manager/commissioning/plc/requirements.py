"""Checks whether a program can be written for a map and its floors. Each refusal is one sentence that names the remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain

from lift_manager.commissioning.plc.errors import ProgramError
from register_maps.codec import Codec, CommandCodec, SignalCodec
from register_maps.schema import Kind, RegisterMap
from register_maps.words import BIT_TABLES

PREFIX = "generic-"

SIGNALS = frozenset(
    {
        *("alive", "car_floor", "destination", "call_accepted", "motion", "mode", "door.front", "obstruction.front"),
        *("fire", "inspection", "independent", "out_of_service", "emergency_power"),
        *("level", "overload", "robot_mode_on", "robots_allowed"),
        *("epoch", "owner"),
    }
)
COMMANDS = ("go_to", "hold_door.front", "close_door.front", "robot_mode")
_NEEDED = ("go_to", "robot_mode")

WATCHDOG_REFRESHES = 3
"""How many refreshes of the manager must be missing before all commands fall. Chosen: one lost write must not end a ride, and people
do not wait longer than that for their lift."""


def check_name(source: RegisterMap) -> None:
    """Raise ProgramError for a map that describes an existing program of a lift company."""
    if not source.name.startswith(PREFIX):
        raise ProgramError(
            f"{source.name} describes what a lift company has programmed already; a program can be written only for "
            f"the maps whose name starts with {PREFIX}, which leave it to the lift company"
        )


def check(codec: Codec, floors: Mapping[str, int]) -> None:
    """Raise ProgramError for the first requirement that is not met."""
    for reason in chain(_check_map(codec), _check_floors(codec, floors)):
        raise ProgramError(f"{codec.map.name}: {reason}")


def watchdog_s(codec: Codec) -> float:
    """Return how long the manager may be silent before all commands fall."""
    return codec.map.watchdog_s or WATCHDOG_REFRESHES * (codec.commands["robot_mode"].spec.refresh_s or 0.0)


def _check_map(codec: Codec) -> Iterator[str]:
    for name in codec.signals.keys() - SIGNALS:
        yield f"the program has no input for {name}; remove that signal from the map"
    for name in codec.commands.keys() - set(COMMANDS):
        yield f"the program has no output for {name}; remove that command from the map"
    for name in _NEEDED:
        if name not in codec.commands:
            yield f"the program needs the command {name}; declare it in the map"
            return
    if any(
        point.endpoint for part in (codec.signals, codec.commands) for found in part.values() for point in found.points
    ):
        yield "the program runs on one controller; put every point on the controller itself"
    for command in codec.commands.values():
        yield from _check_command(command)
    yield from _check_robot_mode(codec)
    hold = codec.commands.get("hold_door.front")
    if hold is not None and codec.arbitration is None:
        yield from _check_hold(hold, watchdog_s(codec))
    fire = codec.signals.get("fire")
    if fire is None or fire.decode(0) is not True:
        yield "zeros must read as fire, or a stopped program would look healthy; declare `fire` with `active: low`"


def _check_command(command: CommandCodec) -> Iterator[str]:
    required = "pulse" if command.name in ("go_to", "close_door.front") else "hold"
    if command.spec.action != required:
        yield f"{command.name} must be a {required} for this program; say `action: {required}`"
    if not all(point.table in BIT_TABLES or point.width == 16 for point in command.points):
        yield f"{command.name} must have a coil or a whole register of its own"


def _check_hold(command: CommandCodec, rest_s: float) -> Iterator[str]:
    limit_s = command.spec.max_hold_s or 0.0
    if limit_s <= rest_s:
        yield f"hold_door.front needs a max_hold_s above the {rest_s:g} s of the watchdog"
    elif command.spec.cleared_after_s is None or command.spec.cleared_after_s > limit_s - rest_s:
        cure = f"say `cleared_after_s: {limit_s - rest_s:g}`, or less"
        yield f"the program takes the door hold out of its cell to see it written again before max_hold_s; {cure}"


def _check_robot_mode(codec: Codec) -> Iterator[str]:
    spec = codec.commands["robot_mode"].spec
    if spec.refresh_s is None or spec.on_link_loss != "device_watchdog":
        cure = "give it `refresh_s` and `on_link_loss: device_watchdog`"
        yield f"the program lives by the refreshes of robot_mode; {cure}"
    if spec.confirm is not None and "readback" in spec.confirm.any_of:
        cure = "`readback` cannot confirm it; use `effect`"
        yield f"the program takes each request for robot mode out of its cell, so {cure}"


def _check_floors(codec: Codec, floors: Mapping[str, int]) -> Iterator[str]:
    if len(floors) < 2:
        yield "a lift has at least two floors; name them all, lowest first"
    codes = list(floors.values())
    for name, code in floors.items():
        if codes.count(code) > 1:
            yield f"code {code} stands for several floors; give each floor a code of its own"
        try:
            codec.commands["go_to"].encode(code)
            read = [signal.name for signal in _floor_signals(codec) if signal.decode(signal.encode(code)) != code]
        except ValueError as error:
            yield f"floor {name}: {error}"
        else:
            yield from (
                f"floor {name}: {code} does not read as a floor in {signal}; give it another code" for signal in read
            )


def _floor_signals(codec: Codec) -> Iterator[SignalCodec]:
    return (signal for signal in codec.signals.values() if signal.kind is Kind.FLOOR)
