"""Writes the I/O list as one self-contained HTML page for printing on A4 landscape."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from html import escape

from lift_manager.commissioning.iolist.model import COLUMNS, SIGN_OFF, SIGNATURES, IoList, LiftList

_STYLE = """
@page { size: A4 landscape; margin: 10mm; }
body { font: 9pt/1.3 Arial, Helvetica, sans-serif; color: #000; margin: 8mm; }
h1 { font-size: 16pt; margin: 0 0 4mm; }
h2 { font-size: 12pt; margin: 6mm 0 2mm; }
section { break-before: page; }
table { border-collapse: collapse; width: 100%; }
th, td { border: 0.3mm solid #888; padding: 0.8mm 1.2mm; text-align: left; vertical-align: top; overflow-wrap: anywhere; }
th { background: #e4e4e4; }
table.facts { width: auto; margin-bottom: 4mm; }
table.facts th { white-space: nowrap; }
table.points { table-layout: fixed; font-size: 7pt; }
table.points thead { display: table-header-group; }
table.points tr { break-inside: avoid; }
tr.command td { background: #f4f4f4; }
td.sign { background: #fff; }
table.signatures td { min-width: 90mm; height: 8mm; }
@media print { body { margin: 0; } th, tr.command td { print-color-adjust: exact; } }
"""

_SHARES = (2.8, 10, 10, 5.6, 6.5, 4.8, 5, 3, 5.5, 9, 8, 9, 6, 12.5, 4.5, 4, 4.2)
"""The approximate width of each column in per cent."""


def render(found: IoList) -> bytes:
    """Return the page as UTF-8."""
    title = escape(found.title)
    body = "\n".join(_body(found))
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )
    return page.encode()


def _body(found: IoList) -> Iterator[str]:
    yield f"<h1>{escape(found.title)}</h1>"
    yield from _facts(found.facts)
    if found.cautions:
        yield "<h2>To be settled before a robot rides</h2>"
        yield "<ul>"
        yield from (f"<li>{escape(line)}</li>" for line in found.cautions)
        yield "</ul>"
    for lift in found.lifts:
        yield f"<h2>Lift {escape(lift.name)}</h2>"
        yield from _facts(lift.facts)
    yield "<h2>Signatures</h2>"
    yield from _facts(((label, "") for label in SIGNATURES), "facts signatures")
    for lift in found.lifts:
        yield from _lift(lift)


def _facts(facts: Iterable[tuple[str, str]], kind: str = "facts") -> Iterator[str]:
    yield f'<table class="{kind}">'
    yield from (f"<tr><th>{escape(label)}</th><td>{escape(text)}</td></tr>" for label, text in facts)
    yield "</table>"


def _lift(lift: LiftList) -> Iterator[str]:
    yield "<section>"
    yield f"<h2>Lift {escape(lift.name)}: {escape(lift.map)} on {escape(lift.controller)}</h2>"
    yield '<table class="points">'
    whole = sum(_SHARES)
    yield "".join(f'<col style="width:{100 * share / whole:.2f}%">' for share in _SHARES)
    yield "<thead><tr>" + "".join(f"<th>{escape(heading)}</th>" for heading in COLUMNS) + "</tr></thead>"
    yield "<tbody>"
    for point, row in zip(lift.points, lift.rows, strict=True):
        yield f'<tr class="{"command" if point.is_command else "signal"}">{_cells(row)}</tr>'
    yield "</tbody>"
    yield "</table>"
    yield "</section>"


def _cells(row: Sequence[str]) -> str:
    filled, signed = row[:-SIGN_OFF], row[-SIGN_OFF:]
    return "".join(f"<td>{escape(cell)}</td>" for cell in filled) + "".join(
        f'<td class="sign">{cell}</td>' for cell in signed
    )
