"""Reads a journal while a manager may be writing it: one row, the newest rows, all rows, and new rows as they arrive.

Each read transaction is one batch of rows and ends at once, so a reader never blocks the upkeep of the file.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

from lift_manager.lift.journal import RowKind
from lift_manager.store.chain import StoredRow
from lift_manager.store.database import COLUMNS, VERSION, Head, check_version, decode_text
from lift_manager.store.errors import JournalBusy, JournalUnreadable, RowUnreadable, StoreDamaged

BATCH = 2000
"""Rows per read transaction. Measured on a 2.5 GHz server: 6 ms."""

BUSY_S = 5.0
"""How long to wait for a locked file. Chosen: it is locked only while SQLite recovers a journal that was not closed."""

_Raw = tuple[int, object, object, object, object, object, object, object]
"""SQLite stores only integers in an INTEGER PRIMARY KEY, but anything in the other columns."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_TEXTS = ("kind", "lift", "caller", "text", "data")


@dataclass(frozen=True, slots=True)
class RowFilter:
    """Selects rows. All conditions must hold; a field that is not set is no condition."""

    lift: str | None = None
    kinds: frozenset[str] = frozenset()
    caller: str | None = None
    """`<face>:<name>`, or a face for all its callers."""
    since: int | None = None
    """Microseconds since 1970, inclusive."""
    until: int | None = None
    """Microseconds since 1970, exclusive."""
    find: str | None = None
    """The text contains this, ignoring case."""
    event: str | None = None
    """The id of an event."""

    def matches(self, row: StoredRow) -> bool:
        """Whether a row meets all conditions."""
        return (
            (self.lift is None or row.lift == self.lift)
            and (not self.kinds or row.kind in self.kinds)
            and (self.caller is None or row.caller == self.caller or row.caller.startswith(f"{self.caller}:"))
            and (self.since is None or row.at >= self.since)
            and (self.until is None or row.at < self.until)
            and (self.find is None or self.find.casefold() in row.text.casefold())
            and (self.event is None or event_of(row) == self.event)
        )


ALL_ROWS = RowFilter()


class Reader:
    """An open journal. Close it, or use it in a `with`."""

    def __init__(self, path: Path, connection: sqlite3.Connection, *, immutable: bool) -> None:
        """Use a connection made by `open_journal`."""
        self.path = path
        self.immutable = immutable
        """Whether changes by other programs are invisible."""
        self._connection = connection
        with self._translating_errors():
            about = dict(connection.execute("SELECT key, value FROM about").fetchall())
        self.site = str(about.get("site", ""))
        """The name of the site according to the journal; it is not part of the chain."""
        self.made_at = str(about.get("made_at", ""))
        """When the file was created; a restored copy has that of the original."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def first(self) -> int | None:
        """Return the number of the oldest row; None if there are no rows."""
        return self._read_number("SELECT min(seq) FROM rows")

    def last(self) -> int | None:
        """Return the number of the newest row; None if there are no rows."""
        return self._read_number("SELECT max(seq) FROM rows")

    def head(self) -> Head:
        """Return the head, as the newest commit left it. Raises JournalUnreadable."""
        found = self._fetch("SELECT seq, hash, records FROM head")
        if not found or [type(value) for value in found[0]] != [int, bytes, int]:
            raise JournalUnreadable(f"{self.path} is damaged: it does not record which row is the newest")
        return Head(*found[0])

    def changes(self) -> int:
        """Return a number that changes whenever another program has written to the file."""
        return self._read_number("PRAGMA data_version") or 0

    def row(self, seq: int) -> StoredRow | None:
        """Return one row. Raises RowUnreadable."""
        raw = self._fetch(f"SELECT {COLUMNS} FROM rows WHERE seq = ?", seq)  # noqa: S608  constants
        return self._stored(raw[0]) if raw else None

    def rows(self, row_filter: RowFilter = ALL_ROWS, after: int | None = None) -> Iterator[StoredRow]:
        """Yield rows, oldest first, up to the one that is the newest at the start. Raises JournalUnreadable."""
        last = self.last()
        if last is None:
            return
        query = f"SELECT {COLUMNS} FROM rows WHERE seq > ? AND seq <= ? ORDER BY seq LIMIT ?"  # noqa: S608  constants
        last_seen = -(2**63) if after is None else after
        while batch := self._fetch(query, last_seen, last, BATCH):
            for raw in batch:
                row = self._stored(raw)
                if row_filter.matches(row):
                    yield row
                last_seen = row.seq

    def newest(self, row_filter: RowFilter, count: int, upto: int | None = None) -> Sequence[StoredRow]:
        """Return the newest rows up to row `upto`, the oldest of them first. Raises JournalUnreadable."""
        found: list[StoredRow] = []
        last = self.last()
        if last is None:
            return found
        query = f"SELECT {COLUMNS} FROM rows WHERE seq <= ? ORDER BY seq DESC LIMIT ?"  # noqa: S608  constants
        upto = last if upto is None else upto
        while len(found) < count and (batch := self._fetch(query, upto, BATCH)):
            for raw in batch:
                row = self._stored(raw)
                if row_filter.matches(row) and len(found) < count:
                    found.append(row)
                upto = row.seq - 1
        return found[::-1]

    def newest_seq_of(self, kind: RowKind) -> int | None:
        """Return the number of the newest row of a kind."""
        upto = self.last()
        query = "SELECT seq, kind FROM rows WHERE seq <= ? ORDER BY seq DESC LIMIT ?"
        while upto is not None and (batch := self._fetch(query, upto, BATCH)):
            for seq, found in batch:
                if found == kind:
                    return int(seq)
            upto = int(batch[-1][0]) - 1
        return None

    def _read_number(self, query: str) -> int | None:
        value: int | None = self._fetch(query)[0][0]
        return value

    def _fetch(self, query: str, *values: int) -> list[Any]:  # the file may contain anything
        # fetch everything: an unfinished statement keeps its read transaction open
        with self._translating_errors():
            return self._connection.execute(query, values).fetchall()

    def _stored(self, raw: _Raw) -> StoredRow:
        seq, at, *texts, digest = raw
        if not isinstance(at, int) or _moment(at) is None:
            raise RowUnreadable(self.path, seq, f"has {at!r} as its time")
        for name, text in zip(_TEXTS, texts, strict=True):
            if not isinstance(text, str):
                raise RowUnreadable(self.path, seq, f"has no text as its {name}")
        if not isinstance(digest, bytes):
            raise RowUnreadable(self.path, seq, "has no bytes as its hash")
        kind, lift, caller, text, data = map(str, texts)
        return StoredRow(seq, at, kind, lift, caller, text, data, digest)

    @contextmanager
    def _translating_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as error:
            _raise_unreadable(self.path, error)


def open_journal(path: Path, *, copy: bool = False, busy_s: float = BUSY_S) -> Reader:
    """Open a journal for reading. Raises JournalUnreadable.

    With `copy`, a single file is opened without creating other files next to it; no program may be writing to it.
    """
    _require_file(path, copy=copy)
    log = _log_size(path)
    if copy and log is None:
        return _open_reader(path, immutable=True, busy_s=busy_s)
    try:
        return _open_reader(path, immutable=False, busy_s=busy_s)
    except _CannotOpen as error:
        # SQLite needs to create files next to it, in a folder where it cannot
        if not log:
            return _open_reader(path, immutable=True, busy_s=busy_s)
        text = (
            f"{path} cannot be opened: its newest rows are in {path.name}-wal, which can be read only in a folder that can be"
            " written; copy both files to a folder of yours, and name the copy with --journal"
        )
        raise JournalUnreadable(text) from error


@dataclass(frozen=True, slots=True)
class NewRows:
    """What was added since the previous poll."""

    rows: tuple[StoredRow, ...] = ()
    cut: tuple[int, int] | None = None
    """These rows were written, and removed by retention, before they could be read."""
    replaced: bool = False
    """The file was replaced by another; `rows` are from the new file."""


class Follower:
    """Returns the rows that follow a row, across retention, restarts of the manager and a journal that is restored."""

    def __init__(
        self, path: Path, row_filter: RowFilter, after: StoredRow | None, *, copy: bool = False, busy_s: float = BUSY_S
    ) -> None:
        """Follow the journal after this row; None is before the first row."""
        self._path, self._filter = path, row_filter
        self._open = partial(open_journal, copy=copy, busy_s=busy_s)
        self._after = after
        self._reader: Reader | None = None
        self._file: tuple[int, int] | None = None
        self._changes: int | None = None

    def close(self) -> None:
        """Close the file."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def poll(self) -> NewRows:
        """Return what was added since the previous call. Raises JournalUnreadable."""
        try:
            return self._read()
        except JournalBusy:
            return NewRows()

    def _read(self) -> NewRows:
        file = _file_identity(self._path)
        replaced = False
        if self._reader is None or self._reader.immutable or file != self._file:
            self.close()
            self._reader = self._open(self._path)
            replaced = self._file is not None and file != self._file and not self._continues(self._reader)
            self._changes = None
        changes = self._reader.changes()
        if changes == self._changes:
            return NewRows()
        after = None if replaced or self._after is None else self._after.seq
        rows = list(self._reader.rows(after=after))
        if replaced and self._after is not None:
            # a restored copy begins with rows that were returned long ago
            rows = [row for row in rows if row.at > self._after.at]
        cut = (after + 1, rows[0].seq - 1) if after is not None and rows and rows[0].seq > after + 1 else None
        self._after = rows[-1] if rows else self._reader.row(self._reader.last() or 0) if replaced else self._after
        self._file, self._changes = file, changes
        return NewRows(tuple(row for row in rows if self._filter.matches(row)), cut, replaced)

    def _continues(self, reader: Reader) -> bool:
        """Whether the journal contains the row that was returned last."""
        return self._after is None or reader.row(self._after.seq) == self._after


def event_of(row: StoredRow) -> str:
    """Return the id of the event that a row belongs to; empty if there is none, as in rows from before such ids."""
    if '"event":' not in row.data:
        return ""
    try:
        data = json.loads(row.data)
    except (ValueError, RecursionError):
        return ""
    event = data.get("event") if isinstance(data, dict) else None
    return event if isinstance(event, str) else ""


def time_of(row: StoredRow) -> datetime:
    """Return when a row was written, in UTC."""
    return _EPOCH + timedelta(microseconds=row.at)


def microseconds(at: datetime) -> int:
    """Return a time in the unit of the journal, microseconds since 1970."""
    return (at - _EPOCH) // timedelta(microseconds=1)


class _CannotOpen(JournalUnreadable):
    pass


def _moment(at: int) -> datetime | None:
    """Return a time that every zone can represent, or None."""
    try:
        moment = _EPOCH + timedelta(microseconds=at)
    except OverflowError:
        return None
    return moment if 1 < moment.year < 9999 else None


def _require_file(path: Path, *, copy: bool) -> None:
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except FileNotFoundError as error:
        advice = "no manager has run for this site with this folder yet; start one with `lift-manager serve SITE`"
        raise JournalUnreadable(f"{path} does not exist: {'check the path' if copy else advice}") from error
    except IsADirectoryError as error:
        raise JournalUnreadable(f"{path} is a folder, not a journal file") from error
    except OSError as error:
        advice = "run this as the user that the manager runs as, or as root"
        raise JournalUnreadable(f"{path} cannot be read ({error.strerror or error}); {advice}") from error
    if empty:
        raise JournalUnreadable(f"{path} is empty: a manager has just created it, or a copy has failed")


def _file_identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None  # opening it raises the reason
    return found.st_dev, found.st_ino


def _log_size(path: Path) -> int | None:
    """Return the size of the write-ahead log; None if there is none."""
    try:
        return path.with_name(f"{path.name}-wal").stat().st_size
    except OSError:
        return None


def _open_reader(path: Path, *, immutable: bool, busy_s: float) -> Reader:
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if immutable else ''}"
    connection = None
    try:
        connection = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=busy_s)
        connection.text_factory = decode_text
        _require_version(path, connection)
        return Reader(path, connection, immutable=immutable)
    except sqlite3.DatabaseError as error:
        if connection is not None:
            connection.close()
        _raise_unreadable(path, error)
    except JournalUnreadable:
        if connection is not None:
            connection.close()
        raise


def _require_version(path: Path, connection: sqlite3.Connection) -> None:
    try:
        version = check_version(connection, path)
    except StoreDamaged as error:
        raise JournalUnreadable(f"{path} {error.problem}") from error
    if version < VERSION:
        text = f"{path} is version {version} of a store: start `lift-manager serve` of this version once, which migrates it to version {VERSION}"
        raise JournalUnreadable(text)


def _raise_unreadable(path: Path, error: sqlite3.DatabaseError) -> NoReturn:
    """Raise JournalUnreadable for an error of SQLite, with advice."""
    match (
        getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    ):  # the high bits hold more detail than the advice needs
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            text = f"{path} is locked by another program ({error}); stop that program, or try again"
            raise JournalBusy(text) from error
        case sqlite3.SQLITE_CANTOPEN | sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM:
            advice = "run this as the user that the manager runs as, or as root"
            raise _CannotOpen(f"{path} cannot be opened ({error}); {advice}") from error
        case sqlite3.SQLITE_IOERR:
            text = f"{path}: the disk cannot read it ({error}); check the disk, and copy what can be copied"
            raise JournalUnreadable(text) from error
        case _:
            text = f"{path} is not a journal, or is damaged ({error}); keep a copy of it as it is, and restore an intact copy"
            raise JournalUnreadable(text) from error
