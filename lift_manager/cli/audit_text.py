"""Formats rows of the journal: for people, for spreadsheets, for other programs."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date, datetime, tzinfo
from typing import BinaryIO

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lift_manager.lift.journal import Json, RowKind
from lift_manager.store.chain import StoredRow, canonical
from lift_manager.store.read import event_of, time_of

_JOINERS = "\u200c\u200d"
"""Invisible, but Persian and Indian scripts cannot be written without them."""
# also after a separator of some countries, in quotes, and in the wide form of Japanese keyboards
_FORMULA = re.compile('(^|;)(?="*[=+\\-@\uff1d\uff0b\uff0d\uff20])')
_STYLES: Mapping[str, str] = {
    RowKind.ALARM: "red",
    RowKind.GAP: "red",
    RowKind.ANCHOR: "yellow",
    RowKind.PERSON: "bold",
    RowKind.PRESS: "bold",
}


class RowTable:
    """Prints rows for people: a table on a terminal, otherwise a line for each row."""

    def __init__(self, console: Console, zone: tzinfo | None, rows: Sequence[StoredRow], lifts: Iterable[str]) -> None:
        """Derive the column widths from these rows and the names of lifts."""
        self._console, self._zone = console, zone
        wide = console.width >= 100 or not console.is_terminal
        names = [*lifts, *(row.lift for row in rows)]
        self._lift = _width(names, minimum=4, maximum=20 if wide else 10)
        self._caller = _width([row.caller for row in rows], minimum=12, maximum=28 if wide else 18)
        self._number = max(len(str(rows[-1].seq)) if rows else 0, 6) if wide else 0
        self._event = _width([event_of(row) for row in rows], minimum=15, maximum=24) if console.width >= 140 else 0
        self._day: date | None = None

    def show(self, rows: Sequence[StoredRow]) -> None:
        """Print rows below those printed earlier."""
        if not self._console.is_terminal:
            for row in rows:
                self._console.print(self._line(row), markup=False, highlight=False, soft_wrap=True)
            return
        table: Table | None = None
        for row in rows:
            at = time_of(row).astimezone(self._zone)
            if table is None or at.date() != self._day:
                self._print(table)
                table = self._table(at)
            cells = [
                f"{at:%H:%M:%S}",
                escape_unprintable(row.lift),
                row.kind,
                escape_unprintable(row.caller),
                escape_unprintable(row.text),
            ]
            style = _STYLES.get(row.kind, "")
            numbers, events = [str(row.seq)] if self._number else [], [event_of(row)] if self._event else []
            table.add_row(*numbers, *(Text(cell, style) for cell in cells), *map(escape_unprintable, events))
        self._print(table)

    def _print(self, table: Table | None) -> None:
        if table is not None:
            self._console.print(table)

    def _table(self, at: datetime) -> Table:
        first = self._day is None
        if at.date() != self._day:
            self._console.print(Text(f"{'' if first else chr(10)}{at:%A %Y-%m-%d}, {at:%Z}", "bold"))
            self._day = at.date()
        table = Table(
            box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=first, header_style="dim", expand=True
        )
        if self._number:
            table.add_column("row", width=self._number, justify="right", style="dim")
        table.add_column("time", width=8, style="dim")
        for name, width in (("lift", self._lift), ("kind", 7), ("caller", self._caller)):
            table.add_column(name, width=width, overflow="fold")
        table.add_column("text", ratio=1, overflow="fold")
        if self._event:
            table.add_column("event", width=self._event, style="dim", overflow="fold")
        return table

    def _line(self, row: StoredRow) -> str:
        at = time_of(row).astimezone(self._zone)
        cells = (
            f"{row.seq:>{self._number}}",
            f"{at:%Y-%m-%d %H:%M:%S}",
            f"{escape_unprintable(row.lift):{self._lift}}",
            f"{escape_unprintable(row.kind):7}",
            f"{escape_unprintable(row.caller):{self._caller}}",
            escape_unprintable(row.text),
            f"[{escape_unprintable(event)}]" if (event := event_of(row)) else "",
        )
        return "  ".join(cells).rstrip()


def escape_unprintable(text: str) -> str:
    r"""Return the text with what cannot be seen, or could command a terminal, as `\u001b`."""
    if text.isprintable():
        return text
    return "".join(char if _is_printable(char) else _escaped(char) for char in text)


def write_csv(rows: Iterable[StoredRow], file: BinaryIO) -> int:
    """Write every column, for people and spreadsheets; returns how many rows."""
    count = 0
    with _utf8(file) as text:
        writer = csv.writer(text, lineterminator="\r\n")
        writer.writerow(StoredRow._fields)
        for row in rows:
            texts = (row.kind, row.lift, row.caller, row.text, row.data)
            writer.writerow([row.seq, _utc(row), *(_cell(cell) for cell in texts), row.hash.hex()])
            count += 1
    return count


def write_jsonl(rows: Iterable[StoredRow], file: BinaryIO) -> int:
    """Write every column as it is, an object per line; returns how many rows."""
    count = 0
    with _utf8(file) as text:
        for row in rows:
            text.write(_as_json(_columns(row)) + "\n")
            count += 1
    return count


def _columns(row: StoredRow) -> dict[str, Json]:
    return row._asdict() | {"at": _utc(row), "data": _read_data(row.data), "hash": row.hash.hex()}


def _utc(row: StoredRow) -> str:
    return f"{time_of(row).replace(tzinfo=None).isoformat(timespec='microseconds')}Z"


def _read_data(text: str) -> Json:
    """Parse JSON; return the text itself if the manager would write it differently, so that its hash stays reproducible."""
    try:
        data: Json = json.loads(text)
        return data if canonical(data) == text else text
    except (ValueError, RecursionError):
        return text


def _as_json(value: Json) -> str:
    return escape_unprintable(json.dumps(value, ensure_ascii=False))


def _cell(text: str) -> str:
    """Prefix an apostrophe, so that a spreadsheet does not take a text for a formula."""
    return _FORMULA.sub(r"\1'", escape_unprintable(text))


@contextmanager
def _utf8(file: BinaryIO) -> Iterator[io.TextIOWrapper]:
    text = io.TextIOWrapper(file, "utf-8", newline="")
    try:
        yield text
    finally:
        text.detach()  # writes out what is left, and leaves the file open


def _is_printable(char: str) -> bool:
    return char.isprintable() or char in _JOINERS or unicodedata.category(char) == "Zs"


def _escaped(char: str) -> str:
    # as in JSON, where signs of more than 16 bits are two
    units = char.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))


def _width(names: Sequence[str], minimum: int, maximum: int) -> int:
    return min(max((cell_len(escape_unprintable(name)) for name in names), default=minimum), maximum)
