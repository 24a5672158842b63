"""Whether two lifts, or two endpoints of one, would write the same register."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lift_manager.config.devices import Device, devices
from lift_manager.config.problem import Problem
from lift_manager.config.site import Site
from register_maps.codec import Codec, compile_map
from register_maps.load import LoadedMap
from register_maps.words import Table

_Cell = tuple[Device, Table, int]
_WHOLE = 0xFFFF


@dataclass(frozen=True, slots=True)
class _Claim:
    """What one command writes of one register or coil."""

    lift: str
    endpoint: str
    command: str
    bits: int
    shared_word: str | None
    """How it leaves the other bits alone; None where it writes all of them."""
    owned: bool

    def clashes(self, other: _Claim) -> bool:
        if (self.lift, self.endpoint) == (other.lift, other.endpoint):
            return False  # within one device, the map's own check has looked
        return bool(self.bits & other.bits) or self.shared_word != other.shared_word


def check_outputs(site: Site, maps: Mapping[str, LoadedMap]) -> Iterator[Problem]:
    """Yield lifts that would write where another one writes. `maps` are by lift; one with parameters unset has no addresses yet."""
    taken: dict[_Cell, list[_Claim]] = {}
    for name, loaded in maps.items():
        lift = site.lifts[name]
        if lift.access != "control" or loaded.unset:
            continue
        at = devices(site, lift, loaded.map)
        clashes: list[tuple[_Claim, _Claim]] = []
        for cell, claim in _claims(name, at, compile_map(loaded.map, offset=lift.offset)):
            here = taken.setdefault(cell, [])
            clashes += [(claim, other) for other in here if claim.clashes(other)]
            here.append(claim)
        if clashes:
            yield Problem(("lifts", name), _message(name, clashes))


def _claims(lift: str, at: Mapping[str, Device], codec: Codec) -> Iterator[tuple[_Cell, _Claim]]:
    for name, command in codec.commands.items():
        for block in command.blocks:
            if block.endpoint not in at:
                continue  # it has no place yet, which is a mistake of its own
            for cell in block.cells:
                bits = sum(point.mask << point.low for point in command.points if point.cell == cell)
                word = command.spec.shared_word if command.is_shared else None
                claim = _Claim(
                    *(lift, block.endpoint, name, bits if word else _WHOLE, word),
                    owned=command.spec.shared_word == "owned",
                )
                yield (at[block.endpoint], block.table, cell[2]), claim


def _message(name: str, clashes: list[tuple[_Claim, _Claim]]) -> str:
    claim, other = clashes[0]
    if other.lift == name:
        return (
            f"{claim.command} and {other.command} write to the same place, for two of its endpoints are one device; "
            "place them apart, or write the addresses of one device under one name"
        )
    lifts = ", ".join(sorted({other.lift for _, other in clashes}))
    commands = f"{claim.command} writes where {other.command} of {other.lift} does"
    cure = "give it an `offset` or a `unit_id` of its own"
    if claim.endpoint:
        cure = f"place the endpoint {claim.endpoint} elsewhere, or move the address under `override`"
    if all(one.bits & two.bits == 0 for one, two in clashes):
        cure += "; who writes in a word that is shared says the same `shared_word`"
    elif any(one.owned or two.owned for one, two in clashes):
        cure += "; bits of one word go to two lifts only where their map says `shared_word: mask_write` or `accepted`"
    return f"writes the same registers as {lifts} ({commands}); {cure}"
