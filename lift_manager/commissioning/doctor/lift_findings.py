"""Judges one lift: which findings there can be, in which order, and which of them explain all others away. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from lift_manager.commissioning.doctor.car_findings import (
    doors_against_the_car,
    neither_open_nor_shut,
    open_under_way,
    standing_nowhere,
)
from lift_manager.commissioning.doctor.change_findings import (
    drifting,
    never_changed,
    restless_floor,
    slow_heartbeat,
    still_heartbeat,
    stuck,
)
from lift_manager.commissioning.doctor.contact_findings import asserted, contradiction, never_at_rest
from lift_manager.commissioning.doctor.evidence import Evidence
from lift_manager.commissioning.doctor.finding import Finding
from lift_manager.commissioning.doctor.lift_facts import LiftFacts
from lift_manager.commissioning.doctor.map_findings import all_zero, explanation, is_dead, is_wrong_map, wrong_map
from lift_manager.commissioning.doctor.output_findings import foreign_outputs
from lift_manager.commissioning.doctor.picture import Misfit, Oddity
from lift_manager.commissioning.doctor.refusal_findings import refusals
from lift_manager.commissioning.doctor.subjects import ExaminedLift
from lift_manager.commissioning.doctor.value_findings import exchanged_words, unknown_value

EXPLAIN: Mapping[Oddity, Callable[[LiftFacts, Misfit], Finding]] = {
    Oddity.UNLISTED: unknown_value,
    Oddity.NO_SUCH_FLOOR: unknown_value,
    Oddity.RESTLESS: restless_floor,
    Oddity.CONTRADICTION: contradiction,
    Oddity.UNDER_WAY: lambda facts, misfit: open_under_way(facts, misfit.signal),
    Oddity.BETWEEN: neither_open_nor_shut,
    Oddity.STILL: still_heartbeat,
    Oddity.ASSERTED: asserted,
}
"""What makes a finding of a signal that makes no sense."""


def lift_findings(lift: ExaminedLift, evidence: Evidence) -> Iterator[Finding]:
    """Judge the points of one lift, as its map reads them."""
    facts = LiftFacts.of(lift, evidence)
    if (explained := explanation(facts)) is not None:
        yield explained
        return
    yield from refusals(facts)
    if not facts.pictures:
        yield from foreign_outputs(facts)
        return
    if is_dead(facts):
        yield all_zero(facts)
        return
    if is_wrong_map(facts):
        yield wrong_map(facts)
        return
    for misfit in facts.misfits:
        yield EXPLAIN[misfit.oddity](facts, misfit)
    yield from never_at_rest(facts)
    yield from slow_heartbeat(facts)
    yield from exchanged_words(facts)
    yield from doors_against_the_car(facts)
    yield from standing_nowhere(facts)
    yield from stuck(facts)
    yield from drifting(facts)
    yield from foreign_outputs(facts)
    yield from never_changed(facts)
