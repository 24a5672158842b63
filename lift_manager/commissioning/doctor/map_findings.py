"""Judges whether a map fits its controller at all: one cause behind everything, a controller without a program, or another lift. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from lift_manager.commissioning.doctor.evidence import Probe, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.picture import (
    AS_MAPPED,
    Assumption,
    Misfit,
    Oddity,
    is_all_zero,
    misfits,
    pictures,
)
from lift_manager.commissioning.doctor.subjects import SIBLING
from lift_manager.commissioning.wording import TABLE_NAMES

MOST_NAMED = 4
"""Signals that one line names."""
LEAST_SIGNALS = 3
"""Fewer signals than this show no pattern. Chosen."""


def explanation(facts: LiftFacts) -> Finding | None:
    """Return the one assumption under which the lift makes sense, if as mapped it does not."""
    if len(facts.misfits) < 2 and facts.pictures and not is_dead(facts):
        return None
    candidates: list[tuple[float, Assumption]] = []
    for assumption, purposes in (
        (Assumption(offset=1), [Purpose.OFFSET]),
        (Assumption(offset=-1), [Purpose.OFFSET]),
        (Assumption(bytes_swapped=True), []),
        (Assumption(other_table=True), [Purpose.TABLE]),
    ):
        if (share := _odd_share(facts, assumption, purposes)) is not None:
            candidates.append((share, assumption))
    now = _odd_share(facts, AS_MAPPED, [])
    share, best = min(candidates, key=lambda candidate: candidate[0], default=(1.0, AS_MAPPED))
    return None if share > (1.0 if now is None else now) / 4 else _explained(facts, best)


def _odd_share(facts: LiftFacts, assumption: Assumption, purposes: Sequence[Purpose]) -> float | None:
    """Return which part of the signals makes no sense under an assumption; None if too little was read to tell."""
    found = facts.pictures if assumption == AS_MAPPED else pictures(facts.lift, facts.evidence, assumption, purposes)
    known = {name for picture in found for name in picture.raw}
    enough = max(min(LEAST_SIGNALS, len(facts.lift.codec.signals)), 0.6 * len(facts.lift.codec.signals))
    if len(known) < enough or is_all_zero(found):
        return None
    odd = {misfit.signal for misfit in misfits(facts.lift, found)}
    return len(odd) / len(known)


def _explained(facts: LiftFacts, best: Assumption) -> Finding:
    if best.offset:
        return _off_by_one(facts, best.offset)
    if best.other_table:
        tables = sorted({point.table for point in facts.lift.codec.signal_points})
        others = " and ".join(f"{TABLE_NAMES[SIBLING[table]]} for {TABLE_NAMES[table]}" for table in tables)
        return Finding(
            Severity.ERROR,
            "wrong-table",
            facts.lift.name,
            "all addresses of the map",
            f"everything makes sense with {others}, and not as the map has it ({_odd_text(facts)})",
            "Correct the table of each address in the map",
        )
    return Finding(
        Severity.ERROR,
        "bytes-swapped",
        facts.lift.name,
        "all registers of the map",
        f"everything makes sense with the two bytes of each register exchanged ({_odd_text(facts)})",
        "Switch the byte order in the controller or the gateway, or write `byte_order` for each signal and command in the map",
    )


def _off_by_one(facts: LiftFacts, shift: int) -> Finding:
    codec = facts.lift.codec
    written = (point.table for command in codec.commands.values() for point in command.points)
    tables = sorted({*(point.table for point in codec.signal_points), *written})
    offset = ", ".join(f"{table}: {shift + codec.offset.get(table, 0)}" for table in tables)
    base = (codec.map.addressing.base or 0) - shift
    in_map = (
        f"write `addressing: {{base: {base}}}` in the map" if base in (0, 1) else "correct the addresses in the map"
    )
    return Finding(
        Severity.ERROR,
        "off-by-one",
        facts.lift.name,
        "all addresses of the map",
        f"everything makes sense one address {'higher' if shift > 0 else 'lower'}, and not where the map has it ({_odd_text(facts)})",
        f"The vendor's table probably counts from another number: compare one address with it, then {in_map}, or write"
        f" `offset: {{{offset}}}` for the lift",
    )


def _odd_text(facts: LiftFacts) -> str:
    """Name some signals that make no sense, with what they read."""
    named = [
        f"{misfit.signal} at {facts.lift.printed(misfit.signal)} {_reads(misfit)}"
        for misfit in facts.misfits[:MOST_NAMED]
    ]
    more = len(facts.misfits) - MOST_NAMED
    if not named:
        return "as mapped every address is refused or reads 0"
    return ", ".join(named) + (f" and {more} more" if more > 0 else "")


def _reads(misfit: Misfit) -> str:
    match misfit.oddity:
        case Oddity.STILL:
            return f"stands at {misfit.raw}"
        case Oddity.RESTLESS:
            return "jumps about"
        case Oddity.ASSERTED:
            return "is on"
        case _:
            return f"reads {misfit.raw}"


def is_dead(facts: LiftFacts) -> bool:
    """Whether everything reads 0, and that is no state of rest: of a few contacts it may be."""
    cells = {point.cell for point in facts.lift.codec.signal_points}
    return is_all_zero(facts.pictures) and (bool(facts.misfits) or len(cells) > LEAST_SIGNALS)


def all_zero(facts: LiftFacts) -> Finding:
    """Say that nothing was read but 0."""
    cells = {point.cell for point in facts.lift.codec.signal_points}
    return facts.finding(
        Severity.ERROR,
        "all-zero",
        "",
        f"all {len(cells)} addresses of the map read 0, all the time",
        "Look whether the controller's program runs, and whether unit id, table and first address are those of the vendor's table"
        f"{facts.suggested(Probe.UNIT, Probe.TABLE, Probe.OFFSET)}",
    )


def is_wrong_map(facts: LiftFacts) -> bool:
    """Whether so little makes sense that these are not the registers of this lift."""
    senseless = [misfit for misfit in facts.misfits if misfit.oddity is not Oddity.ASSERTED]
    known = {name for picture in facts.pictures for name in picture.raw}
    return len(senseless) >= LEAST_SIGNALS and 2 * len(senseless) >= len(known)


def wrong_map(facts: LiftFacts) -> Finding:
    """Say that this is another controller than the map's."""
    known = {name for picture in facts.pictures for name in picture.raw}
    return facts.finding(
        Severity.ERROR,
        "wrong-map",
        "",
        f"{len(facts.misfits)} of {len(known)} signals make no sense ({_odd_text(facts)}): this is not the controller that the map"
        f" {facts.lift.codec.map.name} describes, or its addresses start elsewhere",
        "Compare the model with the map's source (`lift-manager maps show`), and the first address with the vendor's table"
        f"{facts.suggested(Probe.OFFSET, Probe.TABLE)}",
    )
