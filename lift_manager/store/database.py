"""Creates, opens and migrates the database of a site; a file that cannot be used is refused with a message."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from drivers.own_files import NOT_FOLLOWED, make_own, put_in_place
from lift_manager.store.chain import StoredRow, follows, seed
from lift_manager.store.errors import StoreDamaged, StoreForeign

APPLICATION_ID = 0x4C494654
"""LIFT, in the header of the file."""

BUSY_S = 1.0
"""How long a commit waits for another program that writes. Chosen: below the time limit of a press; there should be no such
program."""

WAL_KEPT_BYTES = 4_000_000
"""Size to which the write-ahead log is truncated after a burst. Chosen: about what SQLite lets it grow to by default."""

Connect = Callable[[str], sqlite3.Connection]
"""Opens a database by its URI, in autocommit."""

Migration = Callable[[sqlite3.Connection], object]
"""Migrates a database from one version to the next, inside a transaction. It must not change `rows`, which are chained."""


class Head(NamedTuple):
    """The head of the store, as the newest commit left it."""

    seq: int
    """The newest row; 0 if there is none."""
    hash: bytes
    """The hash of that row, to which the next one is chained."""
    records: int
    """How many lifts have a record."""


def connect(uri: str) -> sqlite3.Connection:
    """Open a database on this computer's disk."""
    return sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None)


def _first_version(connection: sqlite3.Connection) -> None:
    connection.execute(
        "CREATE TABLE rows (seq INTEGER PRIMARY KEY, at INTEGER NOT NULL, kind TEXT NOT NULL, lift TEXT NOT NULL,"
        " caller TEXT NOT NULL, text TEXT NOT NULL, data TEXT NOT NULL, hash BLOB NOT NULL)"
    )
    # finds the newest anchor without reading the whole table
    connection.execute("CREATE INDEX anchors ON rows (seq) WHERE kind = 'anchor'")
    connection.execute("CREATE TABLE records (lift TEXT PRIMARY KEY, record TEXT NOT NULL, hash BLOB NOT NULL)")
    connection.execute(
        "CREATE TABLE head (id INTEGER PRIMARY KEY CHECK (id = 1), seq INTEGER NOT NULL, hash BLOB NOT NULL,"
        " records INTEGER NOT NULL)"
    )
    connection.execute("CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL)")


MIGRATIONS: tuple[Migration, ...] = (_first_version,)
"""Migration n turns version n into version n + 1; version 0 is an empty file."""

VERSION = len(MIGRATIONS)
"""The version of the schema that this program writes and reads."""

COLUMNS = ", ".join(StoredRow._fields)


def create_database(path: Path, site: str, connect: Connect = connect) -> None:
    """Create the database of a site, whole or not at all. Raises StoreDamaged, OSError and sqlite3.OperationalError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    log = _log_of(path)
    if log.exists():
        raise StoreDamaged(path, f"is not there, and {log.name} is", f"put both back, or move {log.name} away as well")
    temporary = path.with_name(f"{path.name}.new")
    os.close(make_own(temporary))
    with closing(connect(f"{temporary.absolute().as_uri()}?mode=rw")) as connection:
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")  # has no effect after the first table
        connection.execute("PRAGMA synchronous = FULL")
        with transaction(connection):
            for migrate in MIGRATIONS:
                migrate(connection)
            about = {"site": site, "made_at": datetime.now(UTC).isoformat(timespec="seconds")}
            connection.executemany("INSERT INTO about VALUES (?, ?)", about.items())
            connection.execute("INSERT INTO head VALUES (1, 0, ?, 0)", (seed(site),))
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {VERSION}")
    put_in_place(temporary, path)


def open_database(
    path: Path, site: str, *, connect: Connect = connect, migrations: tuple[Migration, ...] = MIGRATIONS
) -> sqlite3.Connection:
    """Open the database of a site for writing, and migrate it.

    Raises StoreForeign, StoreDamaged, and OSError and sqlite3.OperationalError for errors of the disk.
    """
    if path.is_symlink():
        raise OSError(errno.ELOOP, NOT_FOLLOWED, str(path))
    connection = connect(f"{path.absolute().as_uri()}?mode=rw")
    connection.text_factory = decode_text
    try:
        with raising_damage(path):
            _prepare(connection, path, site, migrations)
    except BaseException:
        connection.close()
        raise
    return connection


def read_head(connection: sqlite3.Connection, path: Path) -> Head:
    """Return the head. Raises StoreDamaged if the newest row is a different one, or does not follow from the one before."""
    with raising_damage(path):
        found = connection.execute("SELECT seq, hash, records FROM head").fetchone()
        rows = connection.execute(f"SELECT {COLUMNS} FROM rows ORDER BY seq DESC LIMIT 2").fetchall()  # noqa: S608  constants
    if found is None or [type(value) for value in found] != [int, bytes, int]:
        raise StoreDamaged(path, "is damaged (it does not say which row is the newest)")
    head = Head(*found)
    newest = StoredRow(*rows[0]) if rows else None
    if newest is None:
        if head.seq:
            raise StoreDamaged(path, f"was changed: row {head.seq} was the newest, and there are no rows")
        return head
    if (newest.seq, newest.hash) != (head.seq, head.hash):
        raise StoreDamaged(
            path, f"was changed: row {head.seq} was the newest, and row {newest.seq} is; {_VERIFY_ADVICE}"
        )
    # a row that is alone, because the others were removed, cannot be checked
    before = rows[1][-1] if len(rows) > 1 else None
    if before is not None and not follows(before, newest):
        raise StoreDamaged(
            path, f"was changed: row {newest.seq} does not follow from the row before it; {_VERIFY_ADVICE}"
        )
    return head


_VERIFY_ADVICE = "run `lift-manager audit --verify` for details"


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Commit everything that the body of the `with` does, or nothing."""
    connection.execute("BEGIN IMMEDIATE")  # raises here if the file cannot be written
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def check_version(connection: sqlite3.Connection, path: Path, newest: int = VERSION) -> int:
    """Return the version of a database of this program. Raises StoreForeign and StoreDamaged."""
    (kind,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if path.stat().st_size == 0:
        raise StoreDamaged(path, "is empty")
    if kind != APPLICATION_ID:
        raise StoreForeign(path, "is not a store of a lift manager", "give this site another folder with `state:`")
    if version > newest:
        what = f"is version {version} of a store, and this program reads versions up to {newest}"
        raise StoreForeign(path, what, "start the newer program that wrote it")
    if version < 1:
        raise StoreDamaged(path, "is damaged (it has no version)")
    return int(version)


def check_site(connection: sqlite3.Connection, path: Path, site: str) -> None:
    """Raise StoreForeign for the database of another site, and StoreDamaged for one without the name of a site."""
    named = connection.execute("SELECT value FROM about WHERE key = 'site'").fetchone()
    if named is None or not isinstance(named[0], str):
        raise StoreDamaged(path, "is damaged (it does not name its site)")
    if named[0] != site:
        advice = (
            f"if {site!r} is another building, name another folder with `state:` in its site file; if {named[0]!r} is the former name of"
            " this one, use that name again until people have ended what keeps robots off its lifts, and rename it then"
        )
        raise StoreForeign(path, f"belongs to the site {named[0]!r}", advice)


def decode_text(raw: bytes) -> str:
    """Decode invalid UTF-8, which no manager writes, as U+FFFD: the hash of the row then no longer matches."""
    return raw.decode("utf-8", "replace")


def _prepare(connection: sqlite3.Connection, path: Path, site: str, migrations: tuple[Migration, ...]) -> None:
    version = check_version(connection, path, len(migrations))
    check_site(connection, path, site)
    connection.execute("PRAGMA journal_mode = WAL").fetchone()
    connection.execute("PRAGMA synchronous = FULL")
    # upkeep copies the log into the file between commits, so that no press waits for it: see SqliteStore.do_upkeep
    connection.execute("PRAGMA wal_autocheckpoint = 0").fetchone()
    connection.execute(f"PRAGMA journal_size_limit = {WAL_KEPT_BYTES}").fetchone()
    with transaction(connection):
        migrate(connection, version, migrations)


def migrate(connection: sqlite3.Connection, version: int, migrations: tuple[Migration, ...] = MIGRATIONS) -> None:
    """Migrate a database from a version to the newest, inside a transaction."""
    for step in migrations[version:]:
        step(connection)
    if version < len(migrations):
        connection.execute(f"PRAGMA user_version = {len(migrations)}")


def _log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


@contextmanager
def raising_damage(path: Path) -> Iterator[None]:
    """Raise StoreDamaged where SQLite finds that a file is not a database, or is damaged."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_OK) & 0xFF
        if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR):
            raise StoreDamaged(path, f"is not a store of a lift manager, or is damaged ({error})") from error
        raise
