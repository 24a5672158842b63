"""The names of faults in scenario files, reports and `maps show`."""

from __future__ import annotations

import re

from lift_manager.commissioning.detection import MODES
from simulator import faults
from simulator.faults import Fault

_WORD = re.compile(r"(?<!^)(?=[A-Z])")


def fault_name(fault: object) -> str:
    """Return the name of a fault, such as `frozen_registers`; with a value that makes it a fault of its own, such as `in_mode.fire`."""
    name = kind_name(type(fault))
    match fault:
        case faults.InMode(mode=mode):
            return f"{name}.{mode}"
        case faults.IgnoredWrites(stored=True):
            return f"{name}.stored"
        case faults.PowerLoss(outputs_held=True):
            return f"{name}.outputs_held"
        case _:
            return name


def kind_name(kind: type) -> str:
    """Return the name of a kind of fault without its values, such as `in_mode`."""
    return _WORD.sub("_", kind.__name__).lower()


def every_device_fault() -> tuple[Fault, ...]:
    """Return one of every device fault that needs no values, in the order of `detections`."""
    machine: tuple[Fault, ...] = (
        faults.StuckDoor(),
        faults.ReopeningDoor(),
        faults.NudgingDoor(),
        faults.WrongFloor(),
        faults.Relevelling(),
        faults.Homing(),
        faults.CallsCancelled(),
        faults.RobotModeWithdrawn(),
        faults.Overload(),
        *(faults.InMode(mode) for mode in MODES),
    )
    registers: tuple[Fault, ...] = (
        faults.SaysWrongFloor(),
        faults.FloorAhead(),
        faults.ContradictingLimits(),
        faults.FrozenRegisters(),
        faults.FrozenHeartbeat(),
        faults.Stopped(),
        faults.LostPress(),
        faults.IgnoredWrites(),
        faults.IgnoredWrites(stored=True),
    )
    network: tuple[Fault, ...] = (
        faults.Reboot(),
        faults.PowerLoss(),
        faults.PowerLoss(outputs_held=True),
        faults.SlotKept(),
    )
    return (*machine, *registers, *network)
