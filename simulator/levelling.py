"""A car that stands open sinks under its load where a fault has it, and creeps back level with its doors open. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from simulator import shaft
from simulator.faults import Relevelling
from simulator.shaft import NEGLIGIBLE_M, NEGLIGIBLE_S


@dataclass(frozen=True, slots=True)
class Levelling:
    """How level the open car is."""

    stood_s: float = 0.0
    """Mechanical seconds for which it stood open and level, while it is to sink."""
    drives: bool = False
    """It is out of level, and creeps back."""


NOT_SINKING = Levelling()


def landing(car: shaft.State, parameters: shaft.Parameters) -> int | None:
    """Floor at which the car stands level, or is open, a little out of level at most."""
    if car.doors_closed:
        return shaft.level_floor(car, parameters)
    return shaft.zone_floor(car, parameters)


def sinks_m(levelling: Levelling, fault: Relevelling | None) -> float:
    """How far below its floor the car is to sink; 0 while it is not."""
    return fault.sinks_m if fault is not None and levelling.stood_s >= fault.every_s - NEGLIGIBLE_S else 0.0


def step(
    levelling: Levelling, fault: Relevelling | None, car: shaft.State, dt: float, parameters: shaft.Parameters
) -> Levelling:
    """`dt` mechanical seconds further, with the car as it is by then."""
    floor = None if car.doors_closed else shaft.zone_floor(car, parameters)
    if floor is None:
        return NOT_SINKING  # closed, and so brought level as after any stop between floors
    below_m = parameters.heights_m[floor] - car.position_m
    if levelling.drives:
        return NOT_SINKING if car.standing and below_m == 0.0 else levelling
    if fault is None:
        return NOT_SINKING if shaft.level_floor(car, parameters) is not None else Levelling(drives=True)
    if levelling.stood_s < fault.every_s - NEGLIGIBLE_S:
        return Levelling(stood_s=levelling.stood_s + dt)
    sunk = below_m >= shaft.sinks_by(fault.sinks_m, parameters) - NEGLIGIBLE_M
    return Levelling(drives=True) if sunk else levelling
