"""Decodes the outputs of a controller from its raw cells, without the codec that driver and simulator share.

An error in that codec would put a command where the simulator obeys it and no real controller does. This module reads the text of
the map itself, so that the two can contradict each other.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from register_maps.command_schema import Command
from register_maps.schema import RegisterMap
from register_maps.words import Table

Cells = Mapping[str, Sequence[int]]
"""Raw cells by `table` or `endpoint/table`, by their address on the wire."""
Raw = tuple[int, ...]
_Place = tuple[str, int, int | None]
"""Space, address on the wire, and the bit within a register."""

_PRINTED = re.compile(r"(?:([a-z0-9-]+)/)?(coil|discrete|holding|input):(0[xX][0-9a-fA-F]+|\d+)(?:\.(\d+))?")
_MODICON = re.compile(r"(?:([a-z0-9-]+)/)?([04])(\d{4,5})(?:\.(\d+))?")
_MODICON_TABLES = {"0": "coil", "4": "holding"}
_CALLS = ("go_to", "call", "go")
_NEGATIVE = 0x8000


class Outputs:
    """The outputs of one lift."""

    def __init__(self, source: RegisterMap, codes: Sequence[int], offset: Mapping[Table, int]) -> None:
        """`codes` are the floor codes, lowest first; `offset` is how far the site moves each table of the controller."""
        self._codes = tuple(codes)
        self._commands = [
            (name, spec, tuple(_place(source, text, offset) for text in spec.addresses))
            for name, spec in source.commands.items()
            if name != "heartbeat"
        ]
        self._places = tuple(dict.fromkeys(place[:2] for _, _, places in self._commands for place in places))
        self._known: dict[Raw, dict[str, int]] = {}
        """Decoded commands by raw cells."""

    def raw(self, cells: Cells) -> Raw:
        """Return the cells that hold outputs, in a fixed order."""
        return tuple(cells[space][address] for space, address in self._places)

    def decode(self, raw: Raw) -> Mapping[str, int]:
        """Return the commands that are present: the index of the floor for a call, 1 for others."""
        known = self._known.get(raw)
        if known is None:
            at = dict(zip(self._places, raw, strict=True))
            values = {name: self._value(name, spec, places, at) for name, spec, places in self._commands}
            known = self._known[raw] = {name: value for name, value in values.items() if value is not None}
        return known

    def _value(
        self, name: str, spec: Command, places: Sequence[_Place], cells: Mapping[tuple[str, int], int]
    ) -> int | None:
        found = [
            cells[space, address] if bit is None else cells[space, address] >> bit & 1 for space, address, bit in places
        ]
        if spec.one_of is not None:
            active = [index for index, value in enumerate(found) if value]
            code = active[0] if len(active) == 1 else None
            return self._floor(code)
        value = found[0]
        if spec.type == "int16" and value >= _NEGATIVE:
            value -= 2 * _NEGATIVE
        if value == spec.rest:
            return None
        if name.partition(".")[0] in _CALLS:
            return self._floor(value)
        return 1 if spec.payload is not None or value == spec.on else None

    def _floor(self, code: int | None) -> int | None:
        return self._codes.index(code) if code in self._codes else None


def _place(source: RegisterMap, text: str, offset: Mapping[Table, int]) -> _Place:
    endpoint, table, address, bit = _read(source, text)
    if not endpoint:
        address += offset.get(Table(table), 0)
    return (f"{endpoint}/{table}" if endpoint else table), address, bit


def _read(source: RegisterMap, text: str) -> tuple[str, str, int, int | None]:
    """Return endpoint, table, address on the wire and bit. The map itself resolves the letters of a PLC family."""
    endpoint = text.partition("/")[0] if "/" in text else ""
    own = source.endpoints[endpoint].addressing if endpoint else None
    addressing = own or source.addressing
    number: Callable[[str | None], int | None] = lambda digits: None if digits is None else int(digits)  # noqa: E731
    if (match := _PRINTED.fullmatch(text)) is not None:
        base = addressing.base or 0 if addressing.notation is None else 0
        return endpoint, match[2], int(match[3], 16 if match[3][:2] in ("0x", "0X") else 10) - base, number(match[4])
    if (match := _MODICON.fullmatch(text)) is not None:
        return endpoint, _MODICON_TABLES[match[2]], int(match[3]) - 1, number(match[4])
    place = source.place(text)
    return endpoint, place.table, place.number, place.bit
