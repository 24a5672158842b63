"""Reads faults and people in scenario files: every name and field of `simulator.faults`, `wire_faults` and `people`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel, ConfigDict, create_model

from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.world.fault_names import every_device_fault, fault_name, kind_name
from register_maps.error_texts import closest
from register_maps.source import KeyPath
from simulator.faults import Fault, ForeignWriter, MachineFault, NetworkFault, RegisterFault
from simulator.people import Traffic
from simulator.wire_faults import WIRE_FAULTS, Target, WireFault
from simulator.wire_faults.bases import ConnectionFault, Limits

DEVICE_FAULTS: Mapping[str, type] = {
    kind_name(kind): kind for group in (MachineFault, RegisterFault, NetworkFault) for kind in get_args(group)
}
READY: Mapping[str, Fault] = {fault_name(fault): fault for fault in every_device_fault()}
"""Faults that are complete with their name, such as `in_mode.fire`."""
WIRE: Mapping[str, type[WireFault]] = {kind_name(kind): kind for kind in WIRE_FAULTS}

WIRE_FAULT_KEYS = ("times", "probability", "only", "controller")
"""Keys that may accompany the name of a fault on the wire. Its step determines when it begins and ends."""
_OF_THE_WIRE = frozenset(field.name for field in fields(Limits)) | {"on"}


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class _WireFaultKeys(_Strict):
    times: int | None = None
    probability: float = 1.0
    controller: str | None = None


@dataclass(frozen=True, slots=True)
class WireFaultSpec:
    """A fault on the wire to one controller, or to every controller of a lift."""

    fault: WireFault
    controller: str | None


@cache
def model_of(kind: type) -> type[BaseModel]:
    """Return a model with the fields of a dataclass, without those that all wire faults share. It refuses any other field.

    A floor is given by its name.
    """
    hints = get_type_hints(kind)
    without = _OF_THE_WIRE if issubclass(kind, Limits) else frozenset()
    given: dict[str, Any] = {}
    for field in fields(kind):
        if field.name not in without and field.init:
            hint = (str | None) if (kind, field.name) == (ForeignWriter, "floor") else hints[field.name]
            given[field.name] = (hint, ... if field.default is MISSING else field.default)
    return create_model(kind.__name__, __base__=_Strict, __doc__=kind.__doc__, **given)


def read_fault(raw: object, path: KeyPath, mistakes: Mistakes, floors: Sequence[str] | None) -> Fault | None:
    """Read a fault of a device: `stuck_door`, `in_mode.fire`, `{in_mode: fire}` or `{wrong_floor: {by: -1}}`."""
    if isinstance(raw, str) and raw in READY:
        return READY[raw]
    named = _named(raw, path, mistakes, _Names("fault", (*READY, *DEVICE_FAULTS), (), DEVICE_FAULTS))
    if named is None:
        return None
    name, given = named
    kind = DEVICE_FAULTS[name]
    values = _values(kind, given, (*path, name) if isinstance(raw, dict) else path, mistakes)
    if values is None:
        return None
    if kind is ForeignWriter and values["floor"] is not None:
        if floors is None:
            return None
        if values["floor"] not in floors:
            mistakes.add((*path, name, "floor"), f"no floor {values['floor']!r}; there is {', '.join(floors)}")
            return None
        values["floor"] = floors.index(values["floor"])
    made: Fault | None = _made(kind, values, path, mistakes)
    return made


def read_wire(raw: object, path: KeyPath, mistakes: Mistakes) -> WireFaultSpec | None:
    """Read a fault on the wire: `half_open`, `{delay: 0.5}` or `{late_answer: {seconds: 0.8}, times: 3, only: {access: reads}}`."""
    if isinstance(raw, dict) and "on" in raw:
        mistakes.add((*path, "on"), "is `only` in a scenario, because YAML reads `on` as yes", replace=True)
        raw = {key: value for key, value in raw.items() if key != "on"}
    given = {key: value for key, value in raw.items() if key not in WIRE_FAULT_KEYS} if isinstance(raw, dict) else raw
    further = {key: raw[key] for key in WIRE_FAULT_KEYS if key in raw} if isinstance(raw, dict) else {}
    named = _named(given, path, mistakes, _Names("fault on the wire", tuple(WIRE), WIRE_FAULT_KEYS, WIRE))
    target = _target(further.pop("only"), (*path, "only"), mistakes) if "only" in further else None
    limits = mistakes.model(further, path, _WireFaultKeys)
    if named is None or limits is None:
        return None
    name, given = named
    kind = WIRE[name]
    values = _values(kind, given, (*path, name) if isinstance(raw, dict) else path, mistakes)
    if values is None:
        return None
    if target is not None and issubclass(kind, ConnectionFault):
        mistakes.add((*path, "only"), f"{name} affects connections, not requests; remove this key")
        return None
    values |= {"times": limits.times, "probability": limits.probability} | ({} if target is None else {"on": target})
    made: WireFault | None = _made(kind, values, path, mistakes)
    return None if made is None else WireFaultSpec(made, limits.controller)


def read_people(raw: object, path: KeyPath, mistakes: Mistakes) -> tuple[int | None, Traffic] | None:
    """Read the seed of people, None for that of the scenario, and their behaviour; `{}` is the usual traffic."""
    if not isinstance(raw, dict):
        mistakes.add(path, "must be a table of keys, such as {per_minute: 6}; {} is the usual traffic")
        return None
    found = mistakes.model(raw, path, people_model())
    if found is None:
        return None
    values = found.model_dump()
    seed = values.pop("seed")
    traffic = _made(Traffic, values, path, mistakes)
    return None if traffic is None else (seed, traffic)


@cache
def people_model() -> type[BaseModel]:
    """Return the model of people in a scenario: their seed and their behaviour."""
    return create_model("People", __base__=model_of(Traffic), seed=(int | None, None))


@dataclass(frozen=True, slots=True)
class _Names:
    what: str
    allowed: tuple[str, ...]
    further_keys: tuple[str, ...]
    kinds: Mapping[str, type]


def _named(raw: object, path: KeyPath, mistakes: Mistakes, names: _Names) -> tuple[str, object] | None:
    """Return the name of a fault, and the values that are given for it."""
    if isinstance(raw, str):
        if raw in names.kinds:
            return raw, {}
        mistakes.add(path, _no_such(raw, names))
        return None
    if not isinstance(raw, dict) or not raw:
        mistakes.add(path, f"must name a {names.what}; there is {', '.join(sorted(set(names.allowed)))}")
        return None
    unknown = [str(key) for key in raw if key not in names.kinds]
    for key in unknown:
        hint = "; name it by itself, as text" if key in READY else ""
        mistakes.add((*path, key), f"{_no_such(key, names)}{hint}")
    known = [str(key) for key in raw if key in names.kinds]
    if len(known) > 1:
        mistakes.add(
            (*path, known[1]), f"a step has one fault, and this one has {known[0]} already; write another step"
        )
    return (known[0], raw[known[0]]) if len(known) == 1 and not unknown else None


def _no_such(word: str, names: _Names) -> str:
    hint = closest(word, (*names.allowed, *names.further_keys)) or f"; there is {', '.join(sorted(set(names.allowed)))}"
    return f"no {names.what} has this name{hint}"


def _values(kind: type, given: object, path: KeyPath, mistakes: Mistakes) -> dict[str, Any] | None:
    """Return the values of its fields. A value that is not a table is that of the first field."""
    model = model_of(kind)
    if not isinstance(given, dict):
        first = next(iter(model.model_fields), None)
        if first is None:
            mistakes.add(path, f"has no values; write {kind_name(kind)}: {{}}")
            return None
        given = {first: given}
    found = mistakes.model(given, path, model)
    return None if found is None else dict(found)


def _target(raw: object, path: KeyPath, mistakes: Mistakes) -> Target | None:
    found = mistakes.model(raw, path, model_of(Target))
    return None if found is None else _made(Target, dict(found), path, mistakes)


def _made(kind: type, values: Mapping[str, Any], path: KeyPath, mistakes: Mistakes) -> Any:
    try:
        return kind(**values)
    except ValueError as error:
        mistakes.add(path, str(error))
        return None
