"""The store of a site as one SQLite database, as its writing thread has it."""

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

from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.chain import StoredRow, canonical, clean, row_hash
from lift_manager.store.database import (
    BUSY_S,
    COLUMNS,
    NOT_FOLLOWED,
    VERSION,
    Connect,
    Head,
    check_site,
    check_version,
    connect,
    create_database,
    migrate,
    open_database,
    read_head,
    telling_damage,
    text_of,
    transaction,
)
from lift_manager.store.errors import MOVE_AWAY, CommitFailed, StoreDamaged, StoreForeign, StoreUnusable
from lift_manager.store.outage import commit_failed
from lift_manager.store.record import RecordDamaged, decode, digest, encode
from lift_manager.store.retention import Cut, Limits, RetentionTarget, aim, next_cut, shrink_step
from lift_manager.store.store import PendingRow, UpkeepStep

CARRY_OVER_ROWS = 200
"""After so many rows the log beside the file is carried over into it. Chosen: often enough for that to take milliseconds."""

_INSERT = f"INSERT INTO rows ({COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"  # noqa: S608  constants


class _Attempt(NamedTuple):
    head: Head
    """What it would have left."""
    rows: int
    """So many of its rows the next commit begins with."""


class SqliteStore:
    """Implements Store. A failure closes the file, and the next call opens it again."""

    def __init__(self, path: Path, site: str, limits: Limits, connect: Connect = connect) -> None:
        """Name the file; it is opened, and made if it is not there, by the first commit."""
        self.path = path
        self._site = site
        self._limits = limits
        self._connect = connect
        self._connection: sqlite3.Connection | None = None
        self._records: dict[str, SavedLift] = {}
        """Of every lift, as loaded and committed."""
        self._begins = False
        """The file was just made, so its first commit has all records."""
        self._damaged = False
        """The file was found damaged, and may be moved away."""
        self._head: Head | None = None
        """What this object left in the file; unknown until it was opened once."""
        self._attempt: _Attempt | None = None
        """The newest transaction that failed: it may have reached the disk."""
        self._already = 0
        """So many rows with which the next commit begins are in the file: the one that failed had reached the disk."""
        self._identity: tuple[tuple[int, int], ...] = ()
        self._aim: RetentionTarget | None = None
        self._since_carried_over = CARRY_OVER_ROWS  # what a crash left in the log is carried over soon

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed. Raises StoreUnusable."""
        self._records = read_records(self.path, self._site)
        return dict(self._records)

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Return once these are on the disk; says whether the file wants to be tended. Raises CommitFailed."""
        with self._failing():
            self._open()
            self._commit({**self._records, **records} if self._begins else records, rows[self._already :])
        self._records |= records
        self._begins = False
        return self._since_carried_over >= CARRY_OVER_ROWS

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first. Raises CommitFailed."""
        with self._failing():
            self._open()
            query = f"SELECT {COLUMNS} FROM rows ORDER BY seq DESC LIMIT ?"  # noqa: S608  constants
            return [_noted(StoredRow(*row)) for row in self._opened().execute(query, (count,))][::-1]

    def tend(self, now: int, *, check: bool) -> UpkeepStep:
        """Do one short step of upkeep; with `check` begin to see whether rows have to go. Raises CommitFailed."""
        try:
            with self._failing():
                self._open()
                return self._tend(now, check=check)
        except CommitFailed:
            self._since_carried_over, self._aim = 0, None  # not again at once: presses would wait for it
            raise

    def close(self) -> None:
        """Close it, whatever the disk says to that."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(sqlite3.DatabaseError):
                connection.close()

    def _open(self) -> None:
        """Open it if it is not open, and see that it is as this object left it."""
        if self._connection is not None:
            return
        self._require_own_log()
        if (self._head is None or self._damaged) and not self.path.exists():
            # otherwise it is missed: there may be the empty folder of a disk that is not mounted
            create_database(self.path, self._site, self._connect)
            self._begins, self._damaged = True, False
            self._head = self._attempt = None
        connection = self._connection = open_database(self.path, self._site, connect=self._connect)
        head, attempt = read_head(connection, self.path), self._attempt
        if attempt is not None and head == attempt.head:
            self._already = attempt.rows
        elif self._head not in (None, head):
            what = f"is not as this manager left it: its newest row is {head.seq}, and row {self._head.seq} was written"
            raise StoreDamaged(
                self.path, what, "put the right file back, or restart the manager to go on with this one"
            )
        self._head, self._attempt = head, None
        self._identity = self._seen()

    def _require_own_log(self) -> None:
        """Raise StoreDamaged for another file beside the log of this one: SQLite would lay that log over it, and spoil both."""
        with suppress(FileNotFoundError):
            file, log = self._seen()
            if self._identity and log == self._identity[1] and file != self._identity[0]:
                what = f"is another file than the one that this manager wrote to, and {self.path.name}-wal belongs to that one"
                raise StoreDamaged(self.path, what, "put that one back; to go on with this one, take both away first")

    def _commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> None:
        stored = self._chained(_stored(one) for one in rows)
        with self._leading_to(stored, records, repeated=self._already + len(stored)) as connection:
            connection.executemany(_INSERT, stored)
            for lift, record in records.items():
                text = encode(record)
                connection.execute("REPLACE INTO records VALUES (?, ?, ?)", (lift, text, digest(lift, text)))
            if not rows and not records:
                # what it is already; the page is written all the same
                connection.execute(f"PRAGMA user_version = {VERSION}")
        self._already = 0
        self._since_carried_over += max(len(rows), 1)

    def _cut(self, cut: Cut, now: int) -> None:
        """Let the oldest rows go, and write the anchor that says so: both or neither."""
        stored = self._chained([_stored(PendingRow(now, cut.anchor))])
        with self._leading_to(stored, (), repeated=self._already) as connection:
            connection.executemany(_INSERT, stored)
            connection.execute("DELETE FROM rows WHERE seq <= ?", (cut.through,))
        self._since_carried_over += CARRY_OVER_ROWS // 4

    @contextmanager
    def _leading_to(
        self, stored: Sequence[StoredRow], records: Iterable[str], *, repeated: int
    ) -> Iterator[sqlite3.Connection]:
        """Commit what is done within, with the head that follows from it; after a failure the caller repeats so many of the rows."""
        connection, head = self._opened(), self._known()
        query = "SELECT count(*) FROM records WHERE lift = ?"
        new = sum(connection.execute(query, (lift,)).fetchone() == (0,) for lift in records)
        newest = (stored[-1].seq, stored[-1].hash) if stored else (head.seq, head.hash)
        after = Head(*newest, head.records + new)
        self._attempt = _Attempt(after, repeated)
        with transaction(connection):
            yield connection
            if after != head:
                connection.execute("UPDATE head SET seq = ?, hash = ?, records = ?", after)
        if self._seen() != self._identity:
            what = "was moved, deleted or replaced while the manager had it open"
            raise StoreDamaged(self.path, what, "put it back, with the file of its name and `-wal` that was beside it")
        self._head, self._attempt = after, None

    def _tend(self, now: int, *, check: bool) -> UpkeepStep:
        connection = self._opened()
        if check and self._aim is None:
            self._aim = aim(connection, self._limits, now)
        if self._since_carried_over >= CARRY_OVER_ROWS:
            _, log_pages, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
            self._since_carried_over = 0
            return UpkeepStep(more=True, log_pages=log_pages)
        cut = None if self._aim is None else next_cut(connection, self._aim)
        if cut is not None:
            self._cut(cut, now)
            return UpkeepStep(more=True)
        self._aim = None
        if shrink_step(connection):
            self._since_carried_over += CARRY_OVER_ROWS // 4
            return UpkeepStep(more=True)
        return UpkeepStep(more=False)

    def _chained(self, rows: Iterable[StoredRow]) -> list[StoredRow]:
        """Return the rows with their numbers and hashes, as they follow the newest one."""
        newest, hash_, _ = self._known()
        chained = []
        for seq, row in enumerate(rows, newest + 1):
            numbered = row._replace(seq=seq)
            hash_ = row_hash(hash_, numbered)
            chained.append(numbered._replace(hash=hash_))
        return chained

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Raise CommitFailed for what the disk refuses; whatever is raised closes the file."""
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

    def _opened(self) -> sqlite3.Connection:
        if self._connection is None:
            raise sqlite3.ProgrammingError("the store is closed")
        return self._connection

    def _known(self) -> Head:
        if self._head is None:
            raise sqlite3.ProgrammingError("the store was never opened")
        return self._head

    def _seen(self) -> tuple[tuple[int, int], ...]:
        """Return what tells this file and its log from others of the same name."""
        seen = [os.stat(path) for path in (self.path, f"{self.path}-wal")]  # noqa: PTH116  a third of the time
        return tuple((stat.st_dev, stat.st_ino) for stat in seen)


def read_records(path: Path, site: str) -> dict[str, SavedLift]:
    """Return the record of every lift of a site, and change nothing; none where there is no file yet. Raises StoreUnusable."""
    if not path.exists() and not path.is_symlink():
        if (log := path.with_name(f"{path.name}-wal")).exists():
            raise unusable(path, f"is not there, and {log.name} is", f"put back the file that belongs to {log.name}")
        return {}
    try:
        with _read_only(path) as connection, telling_damage(path):
            check_site(connection, path, site)
            return _records(connection, path)
    except StoreForeign as error:
        raise unusable(path, error.of_file, error.advice) from error
    except StoreDamaged as error:
        raise unusable(path, error.of_file, _CURE if error.advice == MOVE_AWAY else error.advice) from error
    except (OSError, sqlite3.DatabaseError) as error:
        why = getattr(error, "strerror", None) or error
        raise unusable(path, f"cannot be read ({why})", "make it readable for this user") from error


def kept_of_another(path: Path) -> tuple[str, dict[str, SavedLift]] | None:
    """Return the site of a store and its records; None for a file that is no store, or none that can be read."""
    try:
        with _read_only(path) as connection, telling_damage(path):
            (site,) = connection.execute("SELECT value FROM about WHERE key = 'site'").fetchone()
            return str(site), _records(connection, path)
    except (CommitFailed, OSError, sqlite3.DatabaseError, TypeError):
        return None  # whose ever it is, it is no store that could be ours


def unusable(path: Path, what: str, advice: str) -> StoreUnusable:
    """Return the error of a store that cannot be relied on; `what` follows the name of the file."""
    return StoreUnusable(
        f"{path} {what}; it says which lifts were locked out or had a fire, so nothing starts without it: {advice}"
    )


_CURE = (
    "put back a copy of it; if there is none, let a person check every lift for a fire, a lockout and a robot in its car, and"
    " then move the file away, with what is beside it under the same name and `-wal`"
)


@contextmanager
def _read_only(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a store of this version or an older one, brought up to date in memory. Raises StoreDamaged, OSError and DatabaseError."""
    if path.is_symlink():
        raise OSError(errno.ELOOP, NOT_FOLLOWED, str(path))
    with ExitStack() as ends:
        connection = ends.enter_context(closing(_connected(path, ends)))
        connection.text_factory = text_of
        with telling_damage(path):
            if (version := check_version(connection, path)) < VERSION:
                newest = ends.enter_context(closing(sqlite3.connect(":memory:", isolation_level=None)))
                connection.backup(newest)
                migrate(newest, version)
                connection = newest
            yield connection


def _connected(path: Path, ends: ExitStack) -> sqlite3.Connection:
    """Open a file to read it, also where SQLite may not make the files that it wants beside it."""
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
        # the newest commits are in the log, which needs a third file beside it to be read: the disk may be read-only or full
        folder = Path(ends.enter_context(TemporaryDirectory()))
        for file in (path, log):
            shutil.copy(file, folder)
        connection = sqlite3.connect(folder / path.name, isolation_level=None)
    return connection


def _records(connection: sqlite3.Connection, path: Path) -> dict[str, SavedLift]:
    connection.execute("BEGIN")  # head and records of the same commit
    head = connection.execute("SELECT records FROM head").fetchone()
    found = connection.execute("SELECT lift, record, hash FROM records").fetchall()
    if head is None or head[0] != len(found):
        written = "nobody knows how many" if head is None else head[0]
        raise StoreDamaged(
            path, f"is damaged (the records of {len(found)} lifts are there, and {written} were written)"
        )
    return {lift: _record(path, lift, text, hash_) for lift, text, hash_ in found}


def _record(path: Path, lift: object, text: object, hash_: object) -> SavedLift:
    if not isinstance(lift, str) or not isinstance(text, str) or digest(lift, text) != hash_:
        raise StoreDamaged(path, f"was changed (the record of lift {lift!r} is not the one that was written)")
    try:
        return decode(text)
    except RecordDamaged as error:
        raise StoreDamaged(path, f"is damaged (the record of lift {lift!r}, {error})") from error


def _stored(noted: PendingRow) -> StoredRow:
    """Return a row as the table has it, without its number and hash."""
    at, row = noted
    told = canonical(row.told)
    return StoredRow(0, at, row.kind.value, clean(row.lift), clean(row.caller), clean(row.text), told, b"")


def _noted(row: StoredRow) -> PendingRow:
    return PendingRow(row.at, Row(RowKind(row.kind), row.text, row.lift, row.caller, json.loads(row.data)))
