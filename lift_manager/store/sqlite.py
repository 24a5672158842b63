"""Stores a site in one SQLite database; one thread at a time uses it."""

from __future__ import annotations

import errno
import json
import os
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from drivers.own_files import NOT_FOLLOWED, make_own
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.chain import StoredRow, canonical, clean, row_hash
from lift_manager.store.database import (
    BUSY_S,
    COLUMNS,
    VERSION,
    Connect,
    Head,
    check_site,
    check_version,
    connect,
    create_database,
    decode_text,
    migrate,
    open_database,
    raising_damage,
    read_head,
    transaction,
)
from lift_manager.store.errors import MOVE_AWAY, CommitFailed, StoreDamaged, StoreForeign, StoreUnusable
from lift_manager.store.outage import commit_failed
from lift_manager.store.record import RecordDamaged, decode, digest, encode
from lift_manager.store.retention import Cut, Limits, RetentionTarget, next_cut, retention_target, shrink_step
from lift_manager.store.store import PendingRow, UpkeepStep

CHECKPOINT_ROWS = 200
"""Rows after which the write-ahead log is copied into the file. Chosen: often enough for that to take milliseconds."""

_INSERT = f"INSERT INTO rows ({COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"  # noqa: S608  constants


class _Attempt(NamedTuple):
    head: Head
    """The head that it would have left."""
    rows: int
    """How many of its rows the next commit begins with."""


class SqliteStore:
    """Implements Store. A failure closes the file, and the next call opens it again."""

    def __init__(self, path: Path, site: str, limits: Limits, connect: Connect = connect) -> None:
        """Use this file; the first commit opens it, and creates it if it does not exist."""
        self.path = path
        self._site = site
        self._limits = limits
        self._connect = connect
        self._connection: sqlite3.Connection | None = None
        self._records: dict[str, SavedLift] = {}
        """The record of every lift, as loaded and committed."""
        self._is_new = False
        """The file was just created, so its first commit has all records."""
        self._damaged = False
        """The file was found damaged, and a person may move it away."""
        self._head: Head | None = None
        """The head that this object left in the file; None until the file was opened once."""
        self._attempt: _Attempt | None = None
        """The newest transaction that failed; it may have reached the disk."""
        self._already_stored = 0
        """How many rows of the next commit are in the file already, because the failed one had reached the disk."""
        self._own_file_ids: tuple[tuple[int, int], ...] = ()
        self._target: RetentionTarget | None = None
        self._rows_since_checkpoint = CHECKPOINT_ROWS  # copy soon what a crash left in the log

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed. Raises StoreUnusable."""
        self._records = read_records(self.path, self._site)
        return dict(self._records)

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Return once these are on the disk; the result is whether the file needs upkeep. Raises CommitFailed."""
        with self._translating_errors():
            self._open()
            self._commit({**self._records, **records} if self._is_new else records, rows[self._already_stored :])
        self._records |= records
        self._is_new = False
        return self._rows_since_checkpoint >= CHECKPOINT_ROWS

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first. Raises CommitFailed."""
        with self._translating_errors():
            self._open()
            query = f"SELECT {COLUMNS} FROM rows ORDER BY seq DESC LIMIT ?"  # noqa: S608  constants
            return [to_pending(StoredRow(*row)) for row in self._require_connection().execute(query, (count,))][::-1]

    def do_upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        """Run one short step of upkeep; `check` looks for rows to remove. Raises CommitFailed."""
        try:
            with self._translating_errors():
                self._open()
                return self._upkeep(now, check=check)
        except CommitFailed:
            self._rows_since_checkpoint, self._target = 0, None  # not again at once: presses would wait for it
            raise

    def close(self) -> None:
        """Close the file and ignore errors."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(sqlite3.DatabaseError):
                connection.close()

    def _open(self) -> None:
        """Open the file if it is not open, and check that it is as this object left it."""
        if self._connection is not None:
            return
        self._require_own_log()
        if (self._head is None or self._damaged) and not self.path.exists():
            # otherwise the file is missing: this may be the empty mount point of a disk that is not mounted
            create_database(self.path, self._site, self._connect)
            self._is_new, self._damaged = True, False
            self._head = self._attempt = None
        connection = self._connection = open_database(self.path, self._site, connect=self._connect)
        head, attempt = read_head(connection, self.path), self._attempt
        if attempt is not None and head == attempt.head:
            self._already_stored = attempt.rows
        elif self._head not in (None, head):
            what = f"is not as this manager left it: its newest row is {head.seq}, and row {self._head.seq} was written"
            raise StoreDamaged(
                self.path, what, "put the right file back, or restart the manager to continue with this one"
            )
        self._head, self._attempt = head, None
        self._own_file_ids = self._file_ids()

    def _require_own_log(self) -> None:
        """Raise StoreDamaged for another file next to the log of this one: SQLite would apply the log to it, and ruin both."""
        with suppress(FileNotFoundError):
            file, log = self._file_ids()
            if self._own_file_ids and log == self._own_file_ids[1] and file != self._own_file_ids[0]:
                what = f"is another file than the one that this manager wrote to, and {self.path.name}-wal belongs to that one"
                raise StoreDamaged(
                    self.path, what, "put that file back; to continue with this one, move both away first"
                )

    def _commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> None:
        stored = self._chained(to_stored(one) for one in rows)
        with self._advancing_head(stored, records, repeated=self._already_stored + len(stored)) as connection:
            connection.executemany(_INSERT, stored)
            for lift, record in records.items():
                text = encode(record)
                connection.execute("REPLACE INTO records VALUES (?, ?, ?)", (lift, text, digest(lift, text)))
            if not rows and not records:
                # the value does not change; the page is written anyway
                connection.execute(f"PRAGMA user_version = {VERSION}")
        self._already_stored = 0
        self._rows_since_checkpoint += max(len(rows), 1)

    def _cut(self, cut: Cut, now: int) -> None:
        """Remove the oldest rows and write the anchor row that records it, in one transaction."""
        stored = self._chained([to_stored(PendingRow(now, cut.anchor))])
        with self._advancing_head(stored, (), repeated=self._already_stored) as connection:
            connection.executemany(_INSERT, stored)
            connection.execute("DELETE FROM rows WHERE seq <= ?", (cut.through,))
        self._rows_since_checkpoint += CHECKPOINT_ROWS // 4

    @contextmanager
    def _advancing_head(
        self, stored: Sequence[StoredRow], records: Iterable[str], *, repeated: int
    ) -> Iterator[sqlite3.Connection]:
        """Commit the body of the `with` together with the new head; after a failure the caller repeats `repeated` rows."""
        connection, head = self._require_connection(), self._require_head()
        query = "SELECT count(*) FROM records WHERE lift = ?"
        new = sum(connection.execute(query, (lift,)).fetchone() == (0,) for lift in records)
        newest = (stored[-1].seq, stored[-1].hash) if stored else (head.seq, head.hash)
        after = Head(*newest, head.records + new)
        self._attempt = _Attempt(after, repeated)
        with transaction(connection):
            yield connection
            if after != head:
                connection.execute("UPDATE head SET seq = ?, hash = ?, records = ?", after)
        if self._file_ids() != self._own_file_ids:
            what = "was moved, deleted or replaced while the manager had it open"
            raise StoreDamaged(self.path, what, "put it back, together with the file of the same name and `-wal`")
        self._head, self._attempt = after, None

    def _upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        connection = self._require_connection()
        if check and self._target is None:
            self._target = retention_target(connection, self._limits, now)
        if self._rows_since_checkpoint >= CHECKPOINT_ROWS:
            _, log_pages, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
            self._rows_since_checkpoint = 0
            return UpkeepStep(more=True, log_pages=log_pages)
        cut = None if self._target is None else next_cut(connection, self._target)
        if cut is not None:
            self._cut(cut, now)
            return UpkeepStep(more=True)
        self._target = None
        if shrink_step(connection):
            self._rows_since_checkpoint += CHECKPOINT_ROWS // 4
            return UpkeepStep(more=True)
        return UpkeepStep(more=False)

    def _chained(self, rows: Iterable[StoredRow]) -> list[StoredRow]:
        """Return the rows with the numbers and hashes that continue the chain."""
        newest, hash_, _ = self._require_head()
        chained = []
        for seq, row in enumerate(rows, newest + 1):
            numbered = row._replace(seq=seq)
            hash_ = row_hash(hash_, numbered)
            chained.append(numbered._replace(hash=hash_))
        return chained

    @contextmanager
    def _translating_errors(self) -> Iterator[None]:
        """Raise CommitFailed for errors of the disk; any exception closes the file."""
        try:
            yield
        except sqlite3.ProgrammingError:
            self.close()
            raise  # a bug
        except StoreDamaged as error:
            self._damaged |= error.advice == MOVE_AWAY
            self.close()
            raise
        except (sqlite3.DatabaseError, OSError) as error:
            self.close()
            raise commit_failed(self.path, error) from error
        except BaseException:
            self.close()
            raise

    def _require_connection(self) -> sqlite3.Connection:
        if self._connection is None:
            raise sqlite3.ProgrammingError("the store is closed")
        return self._connection

    def _require_head(self) -> Head:
        if self._head is None:
            raise sqlite3.ProgrammingError("the store was never opened")
        return self._head

    def _file_ids(self) -> tuple[tuple[int, int], ...]:
        """Return the device and inode of the file and its log, which tell them from others of the same name."""
        found = [os.stat(path) for path in (self.path, f"{self.path}-wal")]  # noqa: PTH116  a third of the time
        return tuple((stat.st_dev, stat.st_ino) for stat in found)


def read_records(path: Path, site: str) -> dict[str, SavedLift]:
    """Return the record of every lift of a site, and change nothing; none where there is no file yet. Raises StoreUnusable."""
    if not path.exists() and not path.is_symlink():
        if (log := path.with_name(f"{path.name}-wal")).exists():
            raise store_unusable(
                path, f"is not there, and {log.name} is", f"put back the file that belongs to {log.name}"
            )
        return {}
    with _reading(path, site) as connection:
        return _read_records(connection, path)


def copy_store(path: Path, site: str, target: Path) -> None:
    """Copy a store to a new file, as one commit left it; a manager may be writing. Raises StoreUnusable and OSError."""
    os.close(make_own(target))
    with _reading(path, site) as connection, closing(sqlite3.connect(target, isolation_level=None)) as copy:
        try:
            connection.backup(copy)
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_FULL:
                raise
            raise StoreUnusable(f"{target} cannot be written ({error}); nothing else was changed") from error
        copy.execute("PRAGMA journal_mode = DELETE").fetchone()  # one file, without a log


@contextmanager
def _reading(path: Path, site: str) -> Iterator[sqlite3.Connection]:
    """Open the store of a site for reading. Raises StoreUnusable, also for what the body of the `with` finds in it."""
    try:
        with _read_only(path) as connection, raising_damage(path):
            check_site(connection, path, site)
            yield connection
    except StoreForeign as error:
        raise store_unusable(path, error.problem, error.advice) from error
    except StoreDamaged as error:
        raise store_unusable(path, error.problem, _CURE if error.advice == MOVE_AWAY else error.advice) from error
    except (OSError, sqlite3.DatabaseError) as error:
        why = getattr(error, "strerror", None) or error
        raise store_unusable(path, f"cannot be read ({why})", "make it readable for this user") from error


def read_other_store(path: Path) -> tuple[str, dict[str, SavedLift]] | None:
    """Return the site of a store and its records; None for a file that is not a readable store."""
    try:
        with _read_only(path) as connection, raising_damage(path):
            (site,) = connection.execute("SELECT value FROM about WHERE key = 'site'").fetchone()
            return str(site), _read_records(connection, path)
    except (CommitFailed, OSError, sqlite3.DatabaseError, TypeError):
        return None  # it cannot be a store of this site


def store_unusable(path: Path, what: str, advice: str) -> StoreUnusable:
    """Return the error for a store that cannot be trusted; `what` follows the name of the file."""
    return StoreUnusable(
        f"{path} {what}; it records which lifts were locked out or had a fire, so nothing starts without it: {advice}"
    )


_CURE = (
    "restore a copy of it; if there is none, let a person check every lift for a fire, a lockout and a robot in its car, and"
    " then move the file away, together with the file of the same name and `-wal`"
)


@contextmanager
def _read_only(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a store of this or an older version, migrated in memory. Raises StoreDamaged, OSError and DatabaseError."""
    if path.is_symlink():
        raise OSError(errno.ELOOP, NOT_FOLLOWED, str(path))
    with ExitStack() as ends:
        connection = ends.enter_context(closing(_connect_read_only(path, ends)))
        connection.text_factory = decode_text
        with raising_damage(path):
            if (version := check_version(connection, path)) < VERSION:
                newest = ends.enter_context(closing(sqlite3.connect(":memory:", isolation_level=None)))
                connection.backup(newest)
                migrate(newest, version)
                connection = newest
            yield connection


def _connect_read_only(path: Path, ends: ExitStack) -> sqlite3.Connection:
    """Open a file for reading, even where SQLite may not create its auxiliary files."""
    log, uri = path.with_name(f"{path.name}-wal"), f"{path.absolute().as_uri()}?mode=ro"
    if not log.exists():
        return sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=BUSY_S)
    try:
        connection.execute("PRAGMA user_version").fetchone()
    except sqlite3.OperationalError as error:
        connection.close()
        if error.sqlite_errorcode & 0xFF not in (
            sqlite3.SQLITE_CANTOPEN,
            sqlite3.SQLITE_READONLY,
            sqlite3.SQLITE_IOERR,
        ):
            raise
        # the newest commits are in the log, and reading it needs a third file: the disk may be read-only or full
        folder = Path(ends.enter_context(TemporaryDirectory()))
        for file in (path, log):
            shutil.copy(file, folder)
        connection = sqlite3.connect(folder / path.name, isolation_level=None)
    return connection


def _read_records(connection: sqlite3.Connection, path: Path) -> dict[str, SavedLift]:
    connection.execute("BEGIN")  # head and records of the same commit
    head = connection.execute("SELECT records FROM head").fetchone()
    found = connection.execute("SELECT lift, record, hash FROM records").fetchall()
    if head is None or head[0] != len(found):
        written = "an unknown number" if head is None else head[0]
        raise StoreDamaged(path, f"is damaged (it has the records of {len(found)} lifts, and {written} were written)")
    return {lift: _decode_record(path, lift, text, hash_) for lift, text, hash_ in found}


def _decode_record(path: Path, lift: object, text: object, hash_: object) -> SavedLift:
    if not isinstance(lift, str) or not isinstance(text, str) or digest(lift, text) != hash_:
        raise StoreDamaged(path, f"was changed (the record of lift {lift!r} is not the one that was written)")
    try:
        return decode(text)
    except RecordDamaged as error:
        raise StoreDamaged(path, f"is damaged (the record of lift {lift!r}, {error})") from error


def to_stored(pending: PendingRow) -> StoredRow:
    """Return a row as it is stored, without its number and hash."""
    at, row = pending
    written_data = canonical(row.written_data)
    return StoredRow(0, at, row.kind.value, clean(row.lift), clean(row.caller), clean(row.text), written_data, b"")


def to_pending(row: StoredRow) -> PendingRow:
    """Return a stored row as it was noted."""
    return PendingRow(row.at, Row(RowKind(row.kind), row.text, row.lift, row.caller, json.loads(row.data)))
