"""Read a journal, while a manager may be writing it: one row, the newest rows, all rows, and those that come.

Every read transaction is a batch of rows and ends at once, so nothing here keeps the writer from tidying up its file.
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
from lift_manager.store.database import COLUMNS, VERSION, Head, check_version, text_of
from lift_manager.store.errors import JournalBusy, JournalUnreadable, RowUnreadable, StoreDamaged

BATCH = 2000
"""Rows of one read transaction. Measured on a server of 2.5 GHz: it takes 6 ms."""

BUSY_S = 5.0
"""How long to wait where the file is locked. Chosen: that is so only while a journal that was not closed is recovered."""

_Raw = tuple[int, object, object, object, object, object, object, object]
"""SQLite keeps nothing but whole numbers in an INTEGER PRIMARY KEY, and anything in the other columns."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_TEXTS = ("kind", "lift", "caller", "text", "data")


@dataclass(frozen=True, slots=True)
class RowFilter:
    """Which rows. All of it must be so; what is left out is no condition."""

    lift: str | None = None
    kinds: frozenset[str] = frozenset()
    caller: str | None = None
    """`<face>:<name>`, or a face: all its callers."""
    since: int | None = None
    """Microseconds since 1970; this and later."""
    until: int | None = None
    """Microseconds since 1970; before this."""
    find: str | None = None
    """The text holds this, in capitals or not."""
    event: str | None = None
    """The id of an event."""

    def fits(self, row: StoredRow) -> bool:
        """Whether this row is one of them."""
        return (
            (self.lift is None or row.lift == self.lift)
            and (not self.kinds or row.kind in self.kinds)
            and (self.caller is None or row.caller == self.caller or row.caller.startswith(f"{self.caller}:"))
            and (self.since is None or row.at >= self.since)
            and (self.until is None or row.at < self.until)
            and (self.find is None or self.find.casefold() in row.text.casefold())
            and (self.event is None or event_of(row) == self.event)
        )


ALL = RowFilter()


class Reader:
    """An open journal. Close it, or use it in a `with`."""

    def __init__(self, path: Path, connection: sqlite3.Connection, *, immutable: bool) -> None:
        """Take over a connection; `open_journal` makes one."""
        self.path = path
        self.immutable = immutable
        """What others write to the file is not seen."""
        self._connection = connection
        with self._in_words():
            about = dict(connection.execute("SELECT key, value FROM about").fetchall())
        self.site = str(about.get("site", ""))
        """The name of the site that the journal says it is of; not part of the chain."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def first(self) -> int | None:
        """Return the number of the oldest row, None where there is no row."""
        return self._one("SELECT min(seq) FROM rows")

    def last(self) -> int | None:
        """Return the number of the newest row, None where there is no row."""
        return self._one("SELECT max(seq) FROM rows")

    def head(self) -> Head:
        """Return what the newest commit left. Raises JournalUnreadable."""
        found = self._batch("SELECT seq, hash, records FROM head")
        if not found or [type(value) for value in found[0]] != [int, bytes, int]:
            raise JournalUnreadable(f"{self.path} is damaged: it does not say which row is the newest")
        return Head(*found[0])

    def changes(self) -> int:
        """Return a number that differs from the one before whenever somebody has written."""
        return self._one("PRAGMA data_version") or 0

    def row(self, seq: int) -> StoredRow | None:
        """Return one row. Raises RowUnreadable."""
        raw = self._batch(f"SELECT {COLUMNS} FROM rows WHERE seq = ?", seq)  # noqa: S608  constants
        return self._stored(raw[0]) if raw else None

    def rows(self, wanted: RowFilter = ALL, after: int | None = None) -> Iterator[StoredRow]:
        """Yield rows, oldest first, up to the one that is the newest when this begins. Raises JournalUnreadable."""
        last = self.last()
        if last is None:
            return
        query = f"SELECT {COLUMNS} FROM rows WHERE seq > ? AND seq <= ? ORDER BY seq LIMIT ?"  # noqa: S608  constants
        seen = -(2**63) if after is None else after
        while batch := self._batch(query, seen, last, BATCH):
            for raw in batch:
                row = self._stored(raw)
                if wanted.fits(row):
                    yield row
                seen = row.seq

    def newest(self, wanted: RowFilter, count: int, upto: int | None = None) -> Sequence[StoredRow]:
        """Return the newest rows, oldest of them first, none of them newer than row `upto`. Raises JournalUnreadable."""
        found: list[StoredRow] = []
        last = self.last()
        if last is None:
            return found
        query = f"SELECT {COLUMNS} FROM rows WHERE seq <= ? ORDER BY seq DESC LIMIT ?"  # noqa: S608  constants
        upto = last if upto is None else upto
        while len(found) < count and (batch := self._batch(query, upto, BATCH)):
            for raw in batch:
                row = self._stored(raw)
                if wanted.fits(row) and len(found) < count:
                    found.append(row)
                upto = row.seq - 1
        return found[::-1]

    def newest_of(self, kind: RowKind) -> int | None:
        """Return the number of the newest row of a kind."""
        upto = self.last()
        query = "SELECT seq, kind FROM rows WHERE seq <= ? ORDER BY seq DESC LIMIT ?"
        while upto is not None and (batch := self._batch(query, upto, BATCH)):
            for seq, found in batch:
                if found == kind:
                    return int(seq)
            upto = int(batch[-1][0]) - 1
        return None

    def _one(self, query: str) -> int | None:
        value: int | None = self._batch(query)[0][0]
        return value

    def _batch(self, query: str, *values: int) -> list[Any]:  # of whatever somebody has put into the file
        # all of it: a statement that is left open keeps its read transaction
        with self._in_words():
            return self._connection.execute(query, values).fetchall()

    def _stored(self, raw: _Raw) -> StoredRow:
        seq, at, *texts, digest = raw
        if not isinstance(at, int) or _moment(at) is None:
            raise RowUnreadable(self.path, seq, f"has {at!r} for its time")
        for name, text in zip(_TEXTS, texts, strict=True):
            if not isinstance(text, str):
                raise RowUnreadable(self.path, seq, f"has no text for its {name}")
        if not isinstance(digest, bytes):
            raise RowUnreadable(self.path, seq, "has no bytes for its hash")
        kind, lift, caller, text, data = map(str, texts)
        return StoredRow(seq, at, kind, lift, caller, text, data, digest)

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as error:
            _tell(self.path, error)


def open_journal(path: Path, *, copy: bool = False, busy_s: float = BUSY_S) -> Reader:
    """Open a journal to read it. Raises JournalUnreadable.

    Of a copy that is one file no other files are made beside it, and nobody may be writing to it.
    """
    _look(path, copy=copy)
    log = _log_bytes(path)
    if copy and log is None:
        return _opened(path, immutable=True, busy_s=busy_s)
    try:
        return _opened(path, immutable=False, busy_s=busy_s)
    except _Closed as error:
        # SQLite wants to make files beside it, in a folder where it cannot
        if not log:
            return _opened(path, immutable=True, busy_s=busy_s)
        text = (
            f"{path} cannot be opened: its newest rows are in {path.name}-wal, which can be read only in a folder that can be"
            " written; copy both files to a folder of yours, and give the copy with --journal"
        )
        raise JournalUnreadable(text) from error


@dataclass(frozen=True, slots=True)
class NewRows:
    """What has come since the last look."""

    rows: tuple[StoredRow, ...] = ()
    cut: tuple[int, int] | None = None
    """These rows were written and cut before they could be read."""
    replaced: bool = False
    """Another file is in the place of the one that was read; `rows` are of that one."""


class Follower:
    """Tells what comes after a row, over cuts, restarts of the manager and a journal that is put back."""

    def __init__(
        self, path: Path, wanted: RowFilter, after: StoredRow | None, *, copy: bool = False, busy_s: float = BUSY_S
    ) -> None:
        """Tell what comes after this row; None is before the first."""
        self._path, self._wanted = path, wanted
        self._open = partial(open_journal, copy=copy, busy_s=busy_s)
        self._after = after
        self._reader: Reader | None = None
        self._file: tuple[int, int] | None = None
        self._changes: int | None = None

    def close(self) -> None:
        """Let go of the file."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def news(self) -> NewRows:
        """Look once. Raises JournalUnreadable."""
        try:
            return self._read()
        except JournalBusy:
            return NewRows()

    def _read(self) -> NewRows:
        file = _identity(self._path)
        replaced = False
        if self._reader is None or self._reader.immutable or file != self._file:
            self.close()
            self._reader = self._open(self._path)
            replaced = self._file is not None and file != self._file and not self._knows(self._reader)
            self._changes = None
        changes = self._reader.changes()
        if changes == self._changes:
            return NewRows()
        after = None if replaced or self._after is None else self._after.seq
        rows = list(self._reader.rows(after=after))
        if replaced and self._after is not None:
            # a copy that was put back begins with rows that were shown long ago
            rows = [row for row in rows if row.at > self._after.at]
        cut = (after + 1, rows[0].seq - 1) if after is not None and rows and rows[0].seq > after + 1 else None
        self._after = rows[-1] if rows else self._reader.row(self._reader.last() or 0) if replaced else self._after
        self._file, self._changes = file, changes
        return NewRows(tuple(row for row in rows if self._wanted.fits(row)), cut, replaced)

    def _knows(self, reader: Reader) -> bool:
        """Whether the journal goes on from the row that was told last."""
        return self._after is None or reader.row(self._after.seq) == self._after


def event_of(row: StoredRow) -> str:
    """Return the id of the event that a row is of; empty where it is of none, or older than such ids."""
    if '"event":' not in row.data:
        return ""
    try:
        data = json.loads(row.data)
    except (ValueError, RecursionError):
        return ""
    event = data.get("event") if isinstance(data, dict) else None
    return event if isinstance(event, str) else ""


def time_of(row: StoredRow) -> datetime:
    """When a row was written, in UTC."""
    return _EPOCH + timedelta(microseconds=row.at)


def microseconds(at: datetime) -> int:
    """Return a time as the journal has it."""
    return (at - _EPOCH) // timedelta(microseconds=1)


class _Closed(JournalUnreadable):
    pass


def _moment(at: int) -> datetime | None:
    """A time that can be shown in every zone, or None."""
    try:
        moment = _EPOCH + timedelta(microseconds=at)
    except OverflowError:
        return None
    return moment if 1 < moment.year < 9999 else None


def _look(path: Path, *, copy: bool) -> None:
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except FileNotFoundError as error:
        advice = "no manager has run for this site with this folder yet; start one with `lift-manager serve SITE`"
        raise JournalUnreadable(f"{path} is not there: {'look where it is' if copy else advice}") from error
    except IsADirectoryError as error:
        raise JournalUnreadable(f"{path} is a folder, and a journal is a file") from error
    except OSError as error:
        advice = "ask as the user that the manager runs as, or as root"
        raise JournalUnreadable(f"{path} cannot be read ({error.strerror or error}); {advice}") from error
    if empty:
        raise JournalUnreadable(
            f"{path} is empty: it is a journal that a manager has just begun, or a copy that failed"
        )


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None  # opening it says why
    return found.st_dev, found.st_ino


def _log_bytes(path: Path) -> int | None:
    """Return the size of the file beside it that SQLite writes rows to first, None where there is none."""
    try:
        return path.with_name(f"{path.name}-wal").stat().st_size
    except OSError:
        return None


def _opened(path: Path, *, immutable: bool, busy_s: float) -> Reader:
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if immutable else ''}"
    connection = None
    try:
        connection = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=busy_s)
        connection.text_factory = text_of
        _check(path, connection)
        return Reader(path, connection, immutable=immutable)
    except sqlite3.DatabaseError as error:
        if connection is not None:
            connection.close()
        _tell(path, error)
    except JournalUnreadable:
        if connection is not None:
            connection.close()
        raise


def _check(path: Path, connection: sqlite3.Connection) -> None:
    try:
        version = check_version(connection, path)
    except StoreDamaged as error:
        raise JournalUnreadable(f"{path} {error.of_file}") from error
    if version < VERSION:
        text = f"{path} is version {version} of a store: start `lift-manager serve` of this version once, which brings it to {VERSION}"
        raise JournalUnreadable(text)


def _tell(path: Path, error: sqlite3.DatabaseError) -> NoReturn:
    """Raise what SQLite says, in words."""
    match (
        getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    ):  # behind it is more detail than there is advice
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            text = f"{path} is locked by another program ({error}); end that program, or try again"
            raise JournalBusy(text) from error
        case sqlite3.SQLITE_CANTOPEN | sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM:
            advice = "ask as the user that the manager runs as, or as root"
            raise _Closed(f"{path} cannot be opened ({error}); {advice}") from error
        case sqlite3.SQLITE_IOERR:
            text = f"{path}: the disk does not give it ({error}); look at the disk, and copy what can be copied"
            raise JournalUnreadable(text) from error
        case _:
            text = f"{path} is no journal, or is damaged ({error}); keep a copy of it as it is, and put back a copy that is whole"
            raise JournalUnreadable(text) from error
