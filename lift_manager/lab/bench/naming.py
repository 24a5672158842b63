"""Reads the faults that a test names: a value, or a name with the values of its fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.scenario.faults import DEVICE_FAULTS, READY, WIRE
from register_maps.error_texts import closest
from simulator.faults import Fault, ForeignWriter
from simulator.wire_faults import WireFault

Kind = TypeVar("Kind")


def device_fault(fault: Fault | str, values: Mapping[str, object], floors: Sequence[str]) -> Fault:
    """Return the fault of a lift or its controller. A floor may be given by its name. Raises BenchError."""
    if not isinstance(fault, str):
        return _of(fault, values, tuple(DEVICE_FAULTS.values()), "a lift", DEVICE_FAULTS)
    if fault in READY and not values:
        return READY[fault]
    kind = _kind(fault, "fault of a lift", DEVICE_FAULTS, (*READY, *DEVICE_FAULTS))
    if kind is ForeignWriter and isinstance(floor := values.get("floor"), str):
        if floor not in floors:
            raise BenchError(f"{fault}: no floor {floor!r}; there is {', '.join(floors)}")
        values = {**values, "floor": floors.index(floor)}
    made: Fault = _made(fault, kind, values)
    return made


def wire_fault(fault: WireFault | str, values: Mapping[str, object]) -> WireFault:
    """Return the fault of the connection to a controller. Raises BenchError."""
    if not isinstance(fault, str):
        return _of(fault, values, tuple(WIRE.values()), "the wire", WIRE)
    made: WireFault = _made(fault, _kind(fault, "fault of the wire", WIRE, WIRE), values)
    return made


def _of(fault: Kind, values: Mapping[str, object], kinds: tuple[type, ...], where: str, named: Iterable[str]) -> Kind:
    if not isinstance(fault, kinds):
        raise BenchError(f"{fault!r} is no fault of {where}; there is {', '.join(sorted(named))}")
    if values:
        raise BenchError(f"{fault!r} has its values already; leave out {', '.join(values)}, or give the fault by name")
    return fault


def _kind(name: str, what: str, kinds: Mapping[str, type], allowed: Iterable[str]) -> type:
    if name in kinds:
        return kinds[name]
    listed = sorted(set(allowed))
    raise BenchError(f"no {what} has the name {name!r}{closest(name, listed)}; there is {', '.join(listed)}")


def _made(name: str, kind: type, values: Mapping[str, object]) -> Any:
    known = {field.name: field for field in fields(kind) if field.init}
    for key in values:
        if key not in known:
            raise BenchError(f"{name} has no {key!r}{closest(key, known)}; it has {', '.join(known) or 'no values'}")
    missing = [
        key
        for key, field in known.items()
        if field.default is MISSING and field.default_factory is MISSING and key not in values
    ]
    if missing:
        raise BenchError(f"{name} needs {' and '.join(missing)}, such as {name!r}, {missing[0]}=...")
    try:
        return TypeAdapter(kind).validate_python(dict(values))
    except ValidationError as error:
        raise BenchError(f"{name}: {mistakes_of(error)}") from error


def mistakes_of(error: ValidationError) -> str:
    """Return what is wrong with the given values, on one line."""
    found = error.errors(include_url=False, include_input=False)
    return "; ".join(f"{'.'.join(map(str, one['loc']))} {one['msg']}".strip() for one in found)
