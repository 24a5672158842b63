"""Checks that no two lifts, or endpoints of one, write the same register."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lift_manager.config.devices import Device, devices
from lift_manager.config.maps import compile_maps
from lift_manager.config.problem import Problem
from lift_manager.config.site import Site
from register_maps.codec import Codec
from register_maps.load import LoadedMap
from register_maps.words import Table

_Cell = tuple[Device, Table, int]
_WHOLE = 0xFFFF


@dataclass(frozen=True, slots=True)
class _Write:
    """What one command writes to one register or coil."""

    lift: str
    endpoint: str
    command: str
    bits: int
    shared_word: str | None
    """How it keeps the other bits; None if it writes all of them."""
    owned: bool

    def conflicts_with(self, other: _Write) -> bool:
        if (self.lift, self.endpoint) == (other.lift, other.endpoint):
            return False  # the check of the map covers a single device
        return bool(self.bits & other.bits) or self.shared_word != other.shared_word


def check_outputs(site: Site, maps: Mapping[str, LoadedMap]) -> Iterator[Problem]:
    """Yield lifts that write where another one writes. `maps` are by lift; one with unset parameters has no addresses yet."""
    writes_at: dict[_Cell, list[_Write]] = {}
    commanded = {
        name: loaded.map for name, loaded in maps.items() if site.lifts[name].access == "control" and not loaded.unset
    }
    for name, codec in compile_maps(site, commanded).items():
        placed = devices(site, site.lifts[name], codec.map)
        clashes: list[tuple[_Write, _Write]] = []
        for cell, write in _claims(name, placed, codec):
            writes = writes_at.setdefault(cell, [])
            clashes += [(write, other) for other in writes if write.conflicts_with(other)]
            writes.append(write)
        if clashes:
            yield Problem(("lifts", name), _message(name, clashes))


def _claims(lift: str, placed: Mapping[str, Device], codec: Codec) -> Iterator[tuple[_Cell, _Write]]:
    for name, command in codec.commands.items():
        for block in command.blocks:
            if block.endpoint not in placed:
                continue  # an endpoint without a controller is another problem
            for cell in block.cells:
                bits = sum(point.mask << point.low for point in command.points if point.cell == cell)
                word = command.spec.shared_word if command.is_shared else None
                write = _Write(
                    *(lift, block.endpoint, name, bits if word else _WHOLE, word),
                    owned=command.spec.shared_word == "owned",
                )
                yield (placed[block.endpoint], block.table, cell[2]), write


def _message(name: str, clashes: list[tuple[_Write, _Write]]) -> str:
    write, other = clashes[0]
    if other.lift == name:
        return (
            f"{write.command} and {other.command} write to the same place, for two of its endpoints are one device; "
            "place them apart, or write the addresses of one device under one name"
        )
    lifts = ", ".join(sorted({other.lift for _, other in clashes}))
    commands = f"{write.command} writes where {other.command} of {other.lift} does"
    cure = "give it an `offset` or a `unit_id` of its own"
    if write.endpoint:
        cure = f"place the endpoint {write.endpoint} elsewhere, or move the address under `override`"
    if all(one.bits & two.bits == 0 for one, two in clashes):
        cure += "; who writes in a word that is shared says the same `shared_word`"
    elif any(one.owned or two.owned for one, two in clashes):
        cure += "; bits of one word go to two lifts only where their map says `shared_word: mask_write` or `accepted`"
    return f"writes the same registers as {lifts} ({commands}); {cure}"
