"""Writes the items of a record as CSV (RFC 4180), a line each, for import into other programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from lift_manager.commissioning.checkout.record import Item, Record
from lift_manager.commissioning.checkout.report.difference import compare, outcome
from lift_manager.commissioning.checkout.report.figures import figure_text
from lift_manager.commissioning.checkout.report.words import confirmed_by, when
from lift_manager.commissioning.iolist.as_csv import safe

HEAD = (
    *("Site", "Lift", "Stage", "Map", "Map (sha256)", "Record (sha256)", "Number", "Group", "Test", "Printed address"),
    *("Address on the wire", "To do", "Expected", "Result", "By", "Confirmed by", "At (UTC)", "Note", "Figures"),
    *("Evidence", "Photos", "Punch list"),
)
DIFFERENCE = ("Earlier result", "Difference")
"""Further columns of a report that compares with an earlier record."""


def render(record: Record, against: Record | None = None) -> bytes:
    """Return the items as UTF-8 with a byte order mark, which spreadsheets need for characters beyond ASCII."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(HEAD if against is None else (*HEAD, *DIFFERENCE))
    found = {} if against is None else {item.item: item for item in compare(against, record).items}
    fixed = record.site, record.lift, record.stage.value, record.map.name, record.map.sha256, record.sha256
    for item in record.items:
        row = [*fixed, *_cells(record, item)]
        if against is not None:
            differs = found.get(item.id)
            earlier = outcome(record, item.id) if differs is None else differs.before
            row += [earlier, "same" if differs is None else "; ".join(differs.changes) or "another result"]
        writer.writerow([safe(cell) for cell in row])
    gone = (differs for number, differs in found.items() if number not in {item.id for item in record.items})
    for differs in gone:
        row = [*fixed, differs.item, "", differs.title, *[""] * (len(HEAD) - len(fixed) - 3)]
        writer.writerow([safe(cell) for cell in (*row, differs.before, differs.after)])
    return text.getvalue().encode("utf-8-sig")


def _cells(record: Record, item: Item) -> Iterator[str]:
    yield from (item.id, item.group, item.title)
    yield "; ".join(point.printed for point in item.points)
    yield "; ".join(point.wire for point in item.points)
    yield from (item.action, item.expected, outcome(record, item.id))
    result = record.newest.get(item.id)
    if result is None:
        yield from ("",) * 7
    else:
        yield from (result.by, confirmed_by(record, result), when(result.at), result.note)
        yield "; ".join(figure_text(name, value) for name, value in result.figures.items())
        yield from ("; ".join(result.evidence), "; ".join(result.photos))
    entries = (entry for entry in record.punch if entry.item == item.id)
    yield "; ".join(
        f"{entry.number} ({entry.severity}, {'open' if entry.is_open else 'closed'}): {entry.text}" for entry in entries
    )
