"""Writes the I/O list as CSV (RFC 4180): every lift in one table, for import into other programs."""

from __future__ import annotations

import csv
import io

from lift_manager.commissioning.iolist.model import COLUMNS, IoList

HEAD = ("Lift", "Controller", "Map", "Fingerprint of the map (sha256)")
"""Columns that precede those of the list."""

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def render(found: IoList) -> bytes:
    """Return the list as UTF-8 with a byte order mark, which spreadsheets need for characters beyond ASCII."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow((*HEAD, *COLUMNS))
    for lift in found.lifts:
        for row in lift.rows:
            writer.writerow([safe(cell) for cell in (lift.name, lift.controller, lift.map, lift.sha256, *row)])
    return text.getvalue().encode("utf-8-sig")


def safe(cell: str) -> str:
    """Return text that a spreadsheet does not take for a formula: an apostrophe in front marks it as text."""
    return f"'{cell}" if cell.startswith(_FORMULA) else cell
