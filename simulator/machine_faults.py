"""What the faults of a machine come to, put together once per change of them: values the controller acts on. Pure."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from register_maps.words import Mode
from simulator.doors import NO_TROUBLE, DoorFaults
from simulator.faults import (
    CallsCancelled,
    Homing,
    InMode,
    MachineFault,
    NudgingDoor,
    Overload,
    Relevelling,
    ReopeningDoor,
    RobotModeWithdrawn,
    StuckDoor,
    WrongFloor,
)
from simulator.modes import KEYS_BY_RANK, Key

if TYPE_CHECKING:
    from simulator.state import Inputs

_KEYS = {
    Mode.INSPECTION: Key.INSPECTION,
    Mode.INDEPENDENT: Key.INDEPENDENT,
    Mode.OUT_OF_SERVICE: Key.OUT_OF_SERVICE,
}


@dataclass(frozen=True, slots=True)
class ActiveFaults:
    """What all faults that are present come to."""

    trouble: DoorFaults = NO_TROUBLE
    relevelling: Relevelling | None = None
    """Of several the one that comes most often."""
    floors_off: int = 0
    """How many floors too high the car is sent."""
    homes: bool = False
    cancels_calls: bool = False
    withdraws_robot_mode: bool = False
    modes: frozenset[Mode] = frozenset()
    overload: bool = False


NOTHING = ActiveFaults()


def combine_faults(faults: AbstractSet[MachineFault]) -> ActiveFaults:
    """Put faults together; the order in which they are given never matters."""
    if not faults:
        return NOTHING
    sinking = [fault for fault in faults if isinstance(fault, Relevelling)]
    return ActiveFaults(
        trouble=DoorFaults(
            stuck=frozenset(fault.side for fault in faults if isinstance(fault, StuckDoor)),
            jammed=frozenset(fault.side for fault in faults if isinstance(fault, ReopeningDoor)),
            nudging=_has(faults, NudgingDoor),
        ),
        relevelling=min(sinking, key=lambda fault: (fault.every_s, -fault.sinks_m), default=None),
        floors_off=sum(fault.by for fault in faults if isinstance(fault, WrongFloor)),
        homes=_has(faults, Homing),
        cancels_calls=_has(faults, CallsCancelled),
        withdraws_robot_mode=_has(faults, RobotModeWithdrawn),
        modes=frozenset(fault.mode for fault in faults if isinstance(fault, InMode)),
        overload=_has(faults, Overload),
    )


def _has(faults: AbstractSet[MachineFault], kind: type) -> bool:
    return any(isinstance(fault, kind) for fault in faults)


def apply_to_inputs(image: Inputs, active: ActiveFaults) -> Inputs:
    """Put alarms, keys and load on top of what people set."""
    keys = {image.key, *(_KEYS[mode] for mode in active.modes if mode in _KEYS)}
    return replace(
        image,
        key=max(keys, key=KEYS_BY_RANK.index),
        fire=image.fire or Mode.FIRE in active.modes,
        emergency=image.emergency or Mode.EMERGENCY in active.modes,
        overload=image.overload or active.overload,
    )


def sent_to(call: int, floors_off: int, floors: int) -> int:
    """Floor to which a call sends the car, of so many; off by as much as there is room for where it is off."""
    if not floors_off:
        return call
    top = floors - 1
    reach = [call + floors_off, call - floors_off]
    reach += [min(max(floor, 0), top) for floor in reach]
    return next(floor for floor in reach if 0 <= floor <= top and floor != call)
