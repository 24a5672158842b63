"""The faults that a panel can begin, by the names and fields of scenario files and pytest fixtures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields
from enum import StrEnum, unique
from inspect import cleandoc
from typing import get_args

from pydantic import BaseModel, ConfigDict, Field, JsonValue
from pydantic_core import to_jsonable_python

from drivers.model import FloorName
from lift_manager.lab.bench.naming import device_fault, wire_fault
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE, model_of
from lift_manager.lab.world.fault_names import kind_name
from simulator.faults import Fault, ForeignWriter, InMode, MachineFault, NetworkFault, RegisterFault
from simulator.wire_faults import WireFault


@unique
class FaultGroup(StrEnum):
    """What a fault is a fault of."""

    MACHINE = "machine"
    """Car, doors and the program that moves them."""
    REGISTERS = "registers"
    """What is read, and what becomes of what is written."""
    NETWORK = "network"
    """The controller on its network."""
    WIRE = "wire"
    """The connection between a client and the controller."""


class FaultKind(BaseModel):
    """A kind of fault, with the values that it takes."""

    model_config = ConfigDict(frozen=True)

    name: str
    group: FaultGroup
    about: str = Field(description="what happens, in English")
    values: dict[str, JsonValue] = Field(description="each value as JSON Schema, with its default")
    needs: tuple[str, ...] = Field(description="values without a default")


class FaultWithValues(BaseModel):
    """A fault as it is begun and ended."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(
        description="as in `GET /faults`, or with a value in it, such as `in_mode.fire`", examples=["stuck_door"]
    )
    values: dict[str, JsonValue] = Field(
        default_factory=dict,
        description="any fault of the wire also takes `times`, `probability` (the share of requests that it strikes) and `on`",
        examples=[{"side": "front"}],
    )


class PresentFault(FaultWithValues):
    """A fault that is present. Its name and values end it."""

    group: FaultGroup
    struck: int | None = Field(None, description="how often a fault of the wire has struck; null for any other")


_GROUPS = {
    kind: group
    for group, kinds in (
        (FaultGroup.MACHINE, MachineFault),
        (FaultGroup.REGISTERS, RegisterFault),
        (FaultGroup.NETWORK, NetworkFault),
    )
    for kind in get_args(kinds)
}


def fault_kinds() -> list[FaultKind]:
    """Return every kind of fault that a lift, its controller and the wire can have."""
    return [_kind(name, kind) for name, kind in (*DEVICE_FAULTS.items(), *WIRE.items())]


def read_fault(given: FaultWithValues, floors: Sequence[FloorName]) -> Fault | WireFault:
    """Return a fault as a value. Raises BenchError."""
    if given.name in WIRE:
        return wire_fault(given.name, given.values)
    return device_fault(given.name, given.values, floors)


def present_fault(fault: Fault | WireFault, floors: Sequence[FloorName], struck: int | None = None) -> PresentFault:
    """Return a fault by its name, with the values in which it differs from its defaults."""
    kind = type(fault)
    values = {field.name: getattr(fault, field.name) for field in fields(fault) if field.init}
    given = {
        field.name: values[field.name]
        for field in fields(fault)
        if field.init and (field.default is MISSING or values[field.name] != field.default)
    }
    if isinstance(fault, ForeignWriter) and fault.floor is not None:
        given["floor"] = floors[fault.floor]
    return PresentFault(
        name=kind_name(kind),
        values=to_jsonable_python(given),
        group=_GROUPS.get(kind, FaultGroup.WIRE),
        struck=struck,
    )


def _kind(name: str, kind: type) -> FaultKind:
    schema = model_of(kind).model_json_schema()
    choices = {key: value["enum"] for key, value in schema.get("$defs", {}).items()}
    if kind is InMode:
        choices["Mode"] = [fault.mode for fault in READY.values() if isinstance(fault, InMode)]
    values: dict[str, JsonValue] = {}
    for key, value in schema.get("properties", {}).items():
        choice = value.pop("$ref", "").rpartition("/")[2]
        values[key] = value | ({"enum": choices[choice]} if choice else {})
    return FaultKind(
        name=name,
        group=_GROUPS.get(kind, FaultGroup.WIRE),
        about=cleandoc(kind.__doc__ or ""),
        values=values,
        needs=tuple(schema.get("required", ())),
    )
