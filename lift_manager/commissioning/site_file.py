"""Writes the site file of a first lift, with comments for its next reader. Pure."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from lift_manager.config.site import MODBUS_PORT
from register_maps.expand import ParameterValue

_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*( [A-Za-z0-9_./-]+)*")
_NOT_TEXT = frozenset({"true", "false", "yes", "no", "on", "off", "null", "y", "n"})
"""What YAML does not take for text."""


@dataclass(frozen=True, slots=True)
class FirstLift:
    """What a person has said about a first lift and its controller."""

    site: str
    host: str
    port: int
    map: str
    """As written in the file: a shipped map by name, or a path relative to the file."""
    title: str
    lift: str
    floors: Mapping[str, int]
    """Name to code, lowest first."""
    unit: int | None = None
    """If it differs from that of the map."""
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)


def site_file(first: FirstLift, *, day: str) -> str:
    """Return the text of the file; `day` is when it was written."""
    port = f"    port: {first.port}\n" if first.port != MODBUS_PORT else f"    # port: {MODBUS_PORT}\n"
    unit = "    # unit_id: 1                # by default that of the map\n"
    if first.unit is not None:
        unit = f"    unit_id: {first.unit}\n"
    parameters = ""
    if first.parameters:
        values = "".join(f"      {name}: {_scalar(value)}\n" for name, value in first.parameters.items())
        parameters = f"    # What differs from site to site, as `lift-manager maps show {first.map}` explains it.\n    parameters:\n{values}"
    floors = "".join(f"      {_scalar(name)}: {code}\n" for name, code in first.floors.items())
    return f"""\
# Written by `lift-manager init` on {day}. docs/reference/site-file.md explains every key.
schema: 1
name: {_scalar(first.site)}

controllers:
  plc:
    host: {_scalar(first.host)}
{port}    # {first.title}
    map: {_scalar(first.map)}
{unit}
lifts:
  {_scalar(first.lift)}:
    controller: plc
    # `monitor` writes not one byte to the lift. Write `control` here once the lift is checked out.
    access: monitor
{parameters}    # Lowest first: the name that robots use, and the code by which the controller knows the floor.
    floors:
{floors}"""


def _scalar(value: ParameterValue) -> str:
    """Write a value so that YAML reads the same one."""
    if not isinstance(value, str):
        return str(value)
    is_plain = _PLAIN.fullmatch(value) is not None and value.lower() not in _NOT_TEXT
    return value if is_plain or re.fullmatch(r"[0-9]+(\.[0-9]+){3}", value) else json.dumps(value, ensure_ascii=False)
