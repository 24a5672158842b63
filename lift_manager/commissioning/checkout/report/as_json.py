"""Writes a report as JSON, for other programs: the record, and what follows from it."""

from __future__ import annotations

import json
from dataclasses import asdict

from lift_manager.commissioning.checkout.record import Record, verdict
from lift_manager.commissioning.checkout.report.difference import compare
from lift_manager.commissioning.checkout.report.figures import CLOSES, OPENS, Times, door_times, travel_times


def render(record: Record, against: Record | None = None) -> bytes:
    """Return the report as UTF-8."""
    found = verdict(record)
    report = {
        "record_sha256": record.sha256,
        "verdict": {**asdict(found), "complete": found.complete, "text": found.text},
        "results": {number: result.model_dump(mode="json") for number, result in record.newest.items()},
        "times_s": {
            "door_opens": _times(door_times(record, OPENS)),
            "door_closes": _times(door_times(record, CLOSES)),
            "travel": _times(travel_times(record)),
        },
        "difference": None if against is None else _difference(against, record),
        "record": record.model_dump(mode="json", by_alias=True),
    }
    return json.dumps(report, indent=2, ensure_ascii=False).encode() + b"\n"


def _times(found: tuple[Times, ...]) -> dict[str, dict[str, object]]:
    return {times.label: {"median": times.median, "all": list(times.seconds)} for times in found}


def _difference(before: Record, after: Record) -> dict[str, object]:
    found = compare(before, after)
    return {
        "before": {"stage": before.stage.value, "started_at": before.started_at.isoformat(), "sha256": before.sha256},
        "general": [dict(zip(("what", "before", "after"), row, strict=True)) for row in found.general],
        "items": [asdict(item) for item in found.items],
        "same_items": found.same,
        "figures": [asdict(figure) for figure in found.figures],
    }
