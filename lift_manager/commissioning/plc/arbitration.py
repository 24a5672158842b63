"""Writes the part of the program that decides which manager of a cluster counts: that of the highest epoch.

A Modbus server takes every write. So the program takes the claim out of its cells in each cycle: where one stands there, something was
written. What it does not obey it replaces by what it has obeyed last.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from lift_manager.commissioning.plc import cells
from lift_manager.commissioning.plc.signals import OBEYED, Part
from register_maps.arbitration import ArbitrationCodec
from register_maps.codec import Codec, Point
from register_maps.words import BIT_TABLES

_CLAIMED: Mapping[str, Sequence[str]] = {"epoch": ("ClaimedLow", "ClaimedHigh"), "owner": ("ClaimedOwner",)}
"""The words of a claim, the lowest first."""


def claim_part(codec: Codec, arbitration: ArbitrationCodec) -> Part:
    """Return the part that takes a write whose manager counts, and undoes every other."""
    places = _places(codec)
    both = list(zip([*_CLAIMED["epoch"], *_CLAIMED["owner"]], [*OBEYED["epoch"], *OBEYED["owner"]], strict=True))
    low, high, owner = ((f"WORD_TO_UINT({claimed})", f"WORD_TO_UINT({obeyed})") for claimed, obeyed in both)
    is_same = f"({low[0]} = {low[1]}) AND ({owner[0]} = {owner[1]}) AND (({high[0]} > 0) OR ({low[0]} > 0))"
    return Part(
        (
            *(f"{claimed} : WORD;" for claimed, _ in both),
            "Obeyed : BOOL;  (* a write that counts has come in this cycle *)",
            *(f"{_kept(point)} : {'BOOL' if point.table in BIT_TABLES else 'WORD'};" for point in places),
        ),
        (
            *_read(arbitration),
            f"Obeyed := ({high[0]} > {high[1]});",
            f"IF {high[0]} = {high[1]} THEN",
            f"  Obeyed := ({low[0]} > {low[1]}) OR ({is_same});",
            "END_IF;",
            "IF Obeyed THEN",
            *(f"  {obeyed} := {claimed};" for claimed, obeyed in both),
            "ELSE",
            *(f"  {cells.cell(point)} := {_kept(point)};" for point in places),
            "END_IF;",
            *cells.assign(dict.fromkeys((*arbitration.epoch, *arbitration.owner), 0)),
        ),
    )


def keep_part(codec: Codec) -> Part:
    """Return the part that keeps what counts until the next write that is obeyed."""
    return Part((), tuple(f"{_kept(point)} := {cells.cell(point)};" for point in _places(codec)))


def retained() -> Iterator[str]:
    """Yield the declarations of what the caller keeps without power."""
    for word in (*OBEYED["epoch"], *OBEYED["owner"]):
        yield f"{word} : WORD;  (* retained by the caller *)"


def _places(codec: Codec) -> list[Point]:
    return [point for command in codec.commands.values() for point in command.points]


def _kept(point: Point) -> str:
    return f"Kept{point.address}"


def _read(arbitration: ArbitrationCodec) -> Iterator[str]:
    for points, words in ((arbitration.epoch, _CLAIMED["epoch"]), (arbitration.owner, _CLAIMED["owner"])):
        if points[0].table not in BIT_TABLES:
            yield from (f"{word} := {cells.cell(point)};" for word, point in zip(words, points, strict=True))
            continue
        yield from (f"{word} := 16#0000;" for word in words)
        for position, point in enumerate(points):
            word, mask = words[position // 16], f"16#{1 << position % 16:04X}"
            yield f"IF {cells.cell(point)} THEN {word} := {word} OR {mask}; END_IF;"
