"""What a report says in every form: headings, labels and times. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import groupby
from typing import Final

from lift_manager.commissioning.checkout.record import (
    WRITTEN,
    Outcome,
    Precondition,
    Record,
    Result,
    Stage,
    Topic,
    Verdict,
)

STAGES: Final = {
    Stage.FAT: "Factory acceptance test (FAT)",
    Stage.SAT: "Site acceptance test (SAT)",
    Stage.PROOF: "Proof test",
}

OUTCOMES: Final = {
    Outcome.PASSED: "Pass",
    Outcome.FAILED: "FAIL",
    Outcome.NOT_APPLICABLE: "Not applicable",
    Outcome.DOCUMENT: "Proved by document",
    Outcome.SKIPPED: "Skipped",
}
OPEN: Final = "Open"
"""Stands where an item has no result that counts."""

TOPICS: Final = {
    Topic.IO_LIST: "Approved I/O list",
    Topic.PERMIT: "Permit to work",
    Topic.INSTRUMENTS: "Instruments",
    Topic.CAR_EMPTY: "Car empty",
    Topic.LANDINGS: "Landings barricaded",
    Topic.FIRE_PANEL: "Fire panel isolated",
    Topic.BACKUP_BEFORE: "PLC program backed up before",
    Topic.BACKUP_AFTER: "PLC program backed up after",
    Topic.LATCHING: "Technician at the panel",
}

LOOP_KINDS: Final = frozenset({"signal", "command"})
INTEGRATION_KINDS: Final = frozenset({"trips", "question"})

STANDARDS: Final = "Structure after IEC 62381 (FAT, SAT, SIT) and IEC 62382 (loop check)."
NO_EXAMINATION: Final = (
    "This report is no examination under EN 81-20 and replaces none: it shows what the lift manager was found to read from this lift and to "
    "command on it. The lift company and the examining body remain responsible for the lift and its safety."
)


def phase(kind: str, stage: Stage) -> str:
    """Return to which test of the standards the items of a kind belong."""
    if kind in LOOP_KINDS:
        return "Loop check after IEC 62382"
    if kind in INTEGRATION_KINDS and stage is Stage.SAT:
        return "Site integration test (SIT) after IEC 62381"
    return "Proof test" if stage is Stage.PROOF else f"{STAGES[stage]} after IEC 62381"


def headline(found: Verdict) -> str:
    """Return the verdict in two or three words."""
    if not found.complete:
        return "NOT COMPLETE"
    if not found.passed:
        return "NOT PASSED"
    return "PASSED UNDER CONDITIONS" if found.conditionally else "PASSED"


def when(at: datetime | None) -> str:
    """Return a moment in UTC, to the minute; empty for none."""
    return "" if at is None else f"{at.astimezone(UTC):%Y-%m-%d %H:%M}"


def confirmed_by(record: Record, result: Result) -> str:
    """Return who saw how a result came about besides the person who ran the test; empty for nobody."""
    by_phone = (f"{one.name} by {one.by}, {when(one.at)}" for one in record.confirmations_of(result))
    return "; ".join(filter(None, (result.confirmed_by, *by_phone)))


def title(record: Record) -> str:
    """Return the title of a report."""
    return f"{STAGES[record.stage]}: {record.site}, lift {record.lift}"


def current(preconditions: tuple[Precondition, ...]) -> tuple[Precondition, ...]:
    """Return the newest answer about each topic and item, in the order in which they were first given."""
    return tuple({(one.topic, one.item): one for one in preconditions}.values())


def without_repetitions(evidence: tuple[str, ...]) -> Iterator[str]:
    """Yield lines of evidence; writes that follow one another are listed once each, with their number."""
    for is_written, lines in groupby(evidence, key=lambda line: line.startswith(WRITTEN)):
        if not is_written:
            yield from lines
        else:
            for line, times in Counter(lines).items():
                yield line if times == 1 else f"{line} ({times} times)"
