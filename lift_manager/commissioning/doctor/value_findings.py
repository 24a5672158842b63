"""Judges numbers that mean nothing: bytes or words exchanged, a sign that was not read, a floor or a code that nobody lists. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.picture import HIGHEST_FLOOR, LOWEST_FLOOR, Misfit, Oddity, is_floor
from lift_manager.commissioning.doctor.subjects import ExaminedLift
from register_maps.codec import UNLISTED
from register_maps.schema import Kind
from register_maps.signal_codec import swap_bytes
from register_maps.words import BIT_TABLES

LOW_WORD = 1 << 16
"""What does not fit into one register any more."""


def unknown_value(facts: LiftFacts, misfit: Misfit) -> Finding:
    """Explain a value that is in no table: bytes exchanged, a negative number, or nothing known."""
    lift, name, raw = facts.lift, misfit.signal, misfit.raw
    signal, spec = lift.codec.signals[name], lift.codec.map.signals[name]
    is_word = signal.points[0].table not in BIT_TABLES and len(signal.points) == 1 and signal.width == 16
    swapped = swap_bytes(raw)
    if is_word and swapped != raw and _is_known(lift, name, swapped):
        high, low = (swapped, "0") if raw & 0xFF == 0 else (raw >> 8, str(raw & 0xFF))
        order = "high_first" if spec.byte_order == "low_first" else "low_first"
        return facts.finding(
            Severity.ERROR,
            "bytes-swapped",
            name,
            f"reads {raw}, which is {high} x 256{f' + {low}' if low != '0' else ''}: with its two bytes exchanged it is {swapped},"
            f" {_meaning(lift, name, swapped)}",
            f"Write `byte_order: {order}` for this signal in the map, or switch the byte order in the controller",
        )
    negative = raw - 0x10000
    is_named = negative in lift.floors or (not lift.floors and negative >= LOWEST_FLOOR)
    if is_word and is_named and misfit.oddity is Oddity.NO_SUCH_FLOOR and spec.type == "uint16":
        named = f", floor {lift.floors[negative]}" if negative in lift.floors else ""
        return facts.finding(
            Severity.ERROR,
            "negative-floor",
            name,
            f"reads {raw}, which is {negative} as a signed number{named}",
            "Write `type: int16` for this signal in the map, and for the commands that carry a floor",
        )
    if misfit.oddity is Oddity.NO_SUCH_FLOOR:
        value = facts.last_value(name)
        floors = (
            ", ".join(f"{floor} = {code}" for code, floor in lift.floors.items())
            or f"codes from {LOWEST_FLOOR} to {HIGHEST_FLOOR}"
        )
        return facts.finding(
            Severity.ERROR,
            "no-such-floor",
            name,
            f"reads floor code {value}, and the site has {floors}",
            "Look at which floor the car stands and give that floor this code; if every code is off by the same number, shift them all",
        )
    known = ", ".join(f"{code} = {word}" for code, word in (spec.values or {}).items())
    table = f"; its table has {known}" if known else ""
    often = "" if misfit.is_constant else " at times"
    return facts.finding(
        Severity.ERROR,
        "unlisted",
        name,
        f"reads {raw}{often}, which the map does not list{table}",
        "Look at what the lift does right now, and compare address and values with the vendor's table",
    )


def _is_known(lift: ExaminedLift, name: str, raw: int) -> bool:
    """Whether a raw number would mean something for a signal."""
    signal = lift.codec.signals[name]
    value = signal.decode(raw)
    if value is UNLISTED or (signal.kind is Kind.FLOOR and not isinstance(value, int)):
        return False
    return is_floor(lift, signal, value)


def _meaning(lift: ExaminedLift, name: str, raw: int) -> str:
    value = lift.codec.signals[name].decode(raw)
    if isinstance(value, int) and value in lift.floors:
        return f"floor {lift.floors[value]}"
    return f"floor code {value}" if isinstance(value, int) else str(value)


def exchanged_words(facts: LiftFacts) -> Iterator[Finding]:
    """Find 32-bit numbers whose words are exchanged: huge as mapped, and plausible the other way round."""
    source = facts.lift.codec.map
    for name, spec in source.signals.items():
        if not spec.is_wide or name in source.derived or name not in facts.lift.codec.signals:
            continue
        raws = [picture.raw[name] for picture in facts.pictures if name in picture.raw]
        swapped = [raw >> 16 | (raw & 0xFFFF) << 16 for raw in raws]
        positions = (spec.positions or {}).values()
        top = max(positions, default=LOW_WORD) * 2
        if raws and any(raws) and min(raws) > top and max(swapped) <= max(top, LOW_WORD):
            order = "low_first" if spec.word_order == "high_first" else "high_first"
            yield facts.finding(
                Severity.ERROR,
                "words-swapped",
                name,
                f"reads {raws[-1]}, which is {swapped[-1]} with its two words exchanged",
                f"Write `word_order: {order}` for this signal in the map",
            )
