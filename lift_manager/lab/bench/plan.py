"""Reads and checks the marker `lift` of a test before anything starts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from lift_manager.config.site import AnyFloor, Floor, Lift
from lift_manager.lab.bench.errors import BenchError
from lift_manager.lab.bench.naming import device_fault
from lift_manager.lab.plant import default_floors
from register_maps.codec import Codec, compile_map
from register_maps.error_texts import closest
from register_maps.errors import MapFileError
from register_maps.load import LoadedMap, MapChanges, load
from register_maps.words import Side
from simulator.faults import Fault

NAME = "lift"
MAP = "generic-registers"
SPEED = 20.0
"""Mechanical seconds per real second. Chosen: robot mode and pulses, which do not scale, then dominate a ride over one floor."""
POLL_S = 0.05
"""Chosen: the scan time of the simulated controller."""
CLEAR_S = 0.5
"""The default `clear_s` of a lift of the bench. Chosen: leases and limits of two seconds are usual in tests."""

ACCEPTED = "the controller is simulated and ends with the test"

_OWN_KEYS = ("name", "map", "floors", "speed", "faults")
_FIXED_KEYS = frozenset({"controller", "endpoints", "offset", "unit_id", "floors"})
"""Keys of a lift in a site file that the bench sets itself."""
_SITE_KEYS = tuple(name for name in Lift.model_fields if name not in _FIXED_KEYS)


_FLOOR: TypeAdapter[Floor] = TypeAdapter(AnyFloor)


@dataclass(frozen=True, slots=True)
class LiftPlan:
    """One lift of a test."""

    name: str
    map: LoadedMap
    codec: Codec
    floors: Mapping[str, int]
    doors: Mapping[str, frozenset[Side]]
    """Of the floors that name theirs; the others are served by every door of the map."""
    speed: float
    faults: tuple[Fault, ...]
    """The faults with which it begins."""
    keys: Mapping[str, Any]
    """Further keys of this lift in the site file, besides its controller and floors."""


def plan_lifts(markers: Sequence[Mapping[str, Any]], near: Path) -> tuple[LiftPlan, ...]:
    """Return the lifts of a test: one for each marker, or a default one without markers.

    `near` is the folder for maps that are given by a path. Raises BenchError.
    """
    plans = tuple(_plan(marker, near) for marker in markers or ({},))
    names = [plan.name for plan in plans]
    for name in names:
        if names.count(name) > 1:
            raise BenchError(f"two lifts have the name {name!r}; write @pytest.mark.lift('another-name', ...)")
    return plans


def read_marker(args: Sequence[object], kwargs: Mapping[str, object]) -> dict[str, object]:
    """Return the keys of one marker by name. Raises BenchError for an unknown key."""
    allowed = (*_OWN_KEYS, *_SITE_KEYS)
    if len(args) > 1:
        raise BenchError(f"@pytest.mark.lift takes one name and then keys, not {', '.join(map(repr, args))}")
    for key in kwargs:
        if key not in allowed:
            hint = closest(key, allowed) or f"; there is {', '.join(allowed)}"
            fixed = "; the bench sets that itself" if key in _FIXED_KEYS else hint
            raise BenchError(f"@pytest.mark.lift has no {key!r}{fixed}")
    if args and "name" in kwargs:
        raise BenchError(f"@pytest.mark.lift names its lift twice: {args[0]!r} and {kwargs['name']!r}")
    return {**({"name": args[0]} if args else {}), **kwargs}


def _plan(marker: Mapping[str, Any], near: Path) -> LiftPlan:
    name, map_name, speed = marker.get("name", NAME), marker.get("map", MAP), marker.get("speed", SPEED)
    if not isinstance(name, str) or not name:
        raise BenchError(f"the name of a lift is text, not {name!r}")
    if isinstance(speed, bool) or not isinstance(speed, int | float) or not speed > 0:
        raise BenchError(f"{name}: speed must be a number above 0, such as 20, not {speed!r}")
    if not isinstance(map_name, str | Path):
        raise BenchError(f"{name}: map must be the name of a shipped map or a path, not {map_name!r}")
    keys = {key: marker[key] for key in _SITE_KEYS if key in marker}
    changes = MapChanges(keys.get("parameters", {}), keys.get("override", {}))
    try:
        loaded = load(map_name, near=near, changes=changes)
    except (MapFileError, OSError) as error:
        raise BenchError(f"{name}: map {map_name!s} cannot be used: {error}") from error
    codec = compile_map(loaded.map)
    floors, doors = _floors(name, marker.get("floors"), codec)
    least_s = max(POLL_S, loaded.map.link.min_poll_s)
    usual = {
        "access": "control",
        "poll_s": least_s,
        "between_sessions_s": 0,
        "clear_s": CLEAR_S,
        "accept_latching": ACCEPTED,
    }
    return LiftPlan(
        name,
        loaded,
        codec,
        floors,
        doors,
        float(speed),
        _faults(name, marker.get("faults", ()), tuple(floors)),
        usual | keys,
    )


def _floors(name: str, given: object, codec: Codec) -> tuple[dict[str, int], dict[str, frozenset[Side]]]:
    """Return the code of each floor, and the doors of those that name theirs."""
    if given is None:
        try:
            return default_floors(codec.map), {}
        except ValueError as error:
            raise BenchError(f"{name}: {error}") from error
    if not isinstance(given, Mapping) or len(given) < 2:
        raise BenchError(
            f'{name}: floors must be two or more, lowest first, such as {{"L1": 1, "L2": 2}}, not {given!r}'
        )
    codes, doors = {}, {}
    for floor, value in given.items():
        try:
            known = _FLOOR.validate_json(json.dumps(value), strict=True)
        except (ValidationError, TypeError):
            known = None
        if not isinstance(floor, str) or known is None:
            form = '{"L1": 1}, or {"L1": {"code": 1, "doors": ["rear"]}}'
            raise BenchError(f"{name}: floors are names with codes, such as {form}, not {{{floor!r}: {value!r}}}")
        codes[floor] = known.code
        if known.doors is not None:
            doors[floor] = frozenset(known.doors)
    return codes, doors


def _faults(name: str, given: Any, floors: tuple[str, ...]) -> tuple[Fault, ...]:
    listed = given if isinstance(given, list | tuple | set | frozenset) else [given]
    try:
        return tuple(device_fault(fault, {}, floors) for fault in listed)
    except BenchError as error:
        raise BenchError(f"{name}: {error}") from error
