"""Simulated lifts for demo and `simulate`: a map, floors and a speed become a controller at a port."""

from __future__ import annotations

from collections.abc import Mapping

from register_maps.codec import Codec, compile_map
from register_maps.schema import RegisterMap
from register_maps.words import Side
from simulator import shaft
from simulator.controller import Parameters
from simulator.modes import Key
from simulator.registers import RegisterFace


def simulated_lift(codec: Codec, floors: Mapping[str, int], *, speed: float = 1.0) -> RegisterFace:
    """Return a lift with these floors (name to code, lowest first), standing at the lowest listed floor that is not a basement.

    A map whose commands need robot mode but cannot ask for it gets a lift whose key switch stands on robot.
    """
    needs_mode = any("robot_mode_on" in command.spec.requires for command in codec.commands.values())
    key = Key.ROBOT if needs_mode and "robot_mode" not in codec.commands else Key.NORMAL
    sides = frozenset(side for side in Side if f"door.{side}" in codec.signals) or frozenset({Side.FRONT})
    building = shaft.Parameters(heights_m=shaft.even_heights(len(floors)), doors_at=(sides,) * len(floors))
    codes = tuple(floors.values())
    start = next((index for index, code in enumerate(codes) if code >= 0), 0)
    return RegisterFace(codec, codes, Parameters(shaft=building, speed=speed), start=start, key=key)


def default_floors(source: RegisterMap) -> dict[str, int]:
    """Return floors that a map can express, for a simulation nobody gave floors to: L1, L2 and so on, four if it may choose."""
    codec = compile_map(source)
    places = [len(signal.points) for name, signal in codec.signals.items() if name == "car_floor"]
    if places and places[0] > 1:
        return {f"L{code + 1}": code for code in range(places[0])}
    return {f"L{code}": code for code in range(1, 5)}
