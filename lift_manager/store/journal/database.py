"""The database of a journal: made, opened and brought up to date, or refused in words."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from drivers.own_files import open_own
from lift_manager.store.errors import JournalOfAnother, JournalUnusable
from lift_manager.store.journal.chain import Stored, follows, seed

APPLICATION_ID = 0x4C4A524E
"""LJRN, in the header of the file."""

BUSY_S = 1.0
"""How long a commit waits for another program that writes. Chosen: below the bound within which a press is answered; there should be
no such program."""

WAL_KEPT_BYTES = 4_000_000
"""To this the log beside the file is cut after a burst. Chosen: about what SQLite's own default lets gather."""

Connect = Callable[[str], sqlite3.Connection]
"""Opens a database by its URI, in autocommit."""

Step = Callable[[sqlite3.Connection], object]
"""Takes a journal from one version to the next, inside a transaction. What is in `rows` stays as it is: it is chained."""


class Tail(NamedTuple):
    """Where the next row is chained to."""

    seq: int
    hash: bytes


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
    connection.execute("CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL)")


STEPS: tuple[Step, ...] = (_first_version,)
"""Step n makes version n + 1 of version n; version 0 is an empty file."""

VERSION = len(STEPS)
"""Of a journal, as this program writes and reads it."""

COLUMNS = ", ".join(Stored._fields)


def open_database(
    path: Path, site: str, *, create: bool, connect: Connect = connect, steps: tuple[Step, ...] = STEPS
) -> sqlite3.Connection:
    """Open a journal for writing; it is made if it is not there and `create` says so.

    Raises JournalOfAnother, JournalUnusable for what is no journal or is damaged, and OSError and sqlite3.OperationalError for
    what the disk refuses.
    """
    if create:
        _make_file(path)
    connection = connect(f"{path.absolute().as_uri()}?mode=rw")
    connection.text_factory = text_of
    try:
        with _telling_damage(path):
            _prepare(connection, path, site, steps)
    except BaseException:
        connection.close()
        raise
    return connection


def tail(connection: sqlite3.Connection, path: Path, site: str) -> Tail:
    """Return the newest row, or what stands before row 1. Raises JournalUnusable if it does not follow the row before it."""
    with _telling_damage(path):
        found = connection.execute(f"SELECT {COLUMNS} FROM rows ORDER BY seq DESC LIMIT 2").fetchall()  # noqa: S608  constants
    if not found:
        return Tail(0, seed(site))
    newest, *others = (Stored(*row) for row in found)
    if not all(isinstance(row.hash, bytes) for row in (newest, *others)):
        raise unusable(path, "is damaged (a row is without its hash)", MOVE_AWAY)
    # of a row that is alone because the others went nothing can be said
    hash_before = others[0].hash if others else seed(site) if newest.seq == 1 else None
    if hash_before is not None and not follows(hash_before, newest):
        what = f"was changed: row {newest.seq} does not follow from the row before it"
        raise unusable(path, what, f"see what `lift-manager audit --verify` says of it, then {MOVE_AWAY}")
    return Tail(newest.seq, newest.hash)


MOVE_AWAY = (
    "move it to another folder, with what is beside it under the same name and `-wal`, and keep it; then restart the manager,"
    " which begins another journal"
)


def text_of(raw: bytes) -> str:
    """Read what is no UTF-8, which no manager writes, as U+FFFD: the row then has another hash."""
    return raw.decode("utf-8", "replace")


def unusable(path: Path, what: str, advice: str) -> JournalUnusable:
    """Return the error that says what is wrong with a journal and what to do."""
    return JournalUnusable(f"the journal {path} {what}; {advice}")


def _make_file(path: Path) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    # SQLite gives the files that it makes beside it the same rights
    os.close(open_own(path))
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _prepare(connection: sqlite3.Connection, path: Path, site: str, steps: tuple[Step, ...]) -> None:
    version = _version(connection, path, site, len(steps))
    if version == 0:
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")  # has to be there before the first table
    connection.execute("PRAGMA journal_mode = WAL").fetchone()
    connection.execute("PRAGMA synchronous = FULL")
    # what the log holds is carried over between commits, so that no press waits for it: see JournalFile.tend
    connection.execute("PRAGMA wal_autocheckpoint = 0").fetchone()
    connection.execute(f"PRAGMA journal_size_limit = {WAL_KEPT_BYTES}").fetchone()
    connection.execute("BEGIN IMMEDIATE")  # a file that cannot be written is known here
    try:
        for step in steps[version:]:
            step(connection)
        if version == 0:
            about = {"site": site, "made_at": datetime.now(UTC).isoformat(timespec="seconds")}
            connection.executemany("INSERT INTO about VALUES (?, ?)", about.items())
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        if version < len(steps):
            connection.execute(f"PRAGMA user_version = {len(steps)}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _version(connection: sqlite3.Connection, path: Path, site: str, newest: int) -> int:
    """Return the version of a journal of this site; 0 for a file that nothing is in yet. Raises JournalUnusable."""
    (kind,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if (kind, version, tables) == (0, 0, 0):
        return 0
    if kind != APPLICATION_ID:
        raise unusable(path, "is the database of another program", "give this site another folder with `state:`")
    if version > newest:
        what = f"is version {version} of such a file, and this program writes version {newest}"
        raise JournalOfAnother(f"the journal {path} {what}; start the newer program that wrote it, or {MOVE_AWAY}")
    named = connection.execute("SELECT value FROM about WHERE key = 'site'").fetchone()
    if version < 1 or named is None or not isinstance(named[0], str):
        raise unusable(path, "is damaged (it does not say of which site it is)", MOVE_AWAY)
    if named[0] != site:
        advice = (
            f"if {site!r} is another building, name another folder with `state:` in its site file; if that is the former name of"
            f" this one, no journal goes on under another name: {MOVE_AWAY}, and `lift-manager audit --journal FILE` reads this one"
        )
        raise JournalOfAnother(f"the journal {path} belongs to the site {named[0]!r}; {advice}")
    return int(version)


@contextmanager
def _telling_damage(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.DatabaseError as error:
        if _is_damage(error):
            raise unusable(path, f"is no journal of a lift manager, or is damaged ({error})", MOVE_AWAY) from error
        raise


def _is_damage(error: sqlite3.DatabaseError) -> bool:
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_OK) & 0xFF
    return code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)
