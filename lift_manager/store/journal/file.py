"""The journal as its writing thread has it: one connection, and the row that the next one is chained to."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from lift_manager.domain.journal import Row
from lift_manager.store.journal.chain import Stored, row_hash, seed
from lift_manager.store.journal.database import VERSION, Connect, Tail, connect, open_database, tail, unusable
from lift_manager.store.journal.retention import Aim, Limits, aim, cut_step, overdue, shrink_step

CARRY_OVER_ROWS = 200
"""After so many rows the log beside the file is carried over into it. Chosen: often enough for that to take milliseconds."""

LOG_PAGES_WORTH_TELLING = 16_000
"""64 MB: more than any burst; something keeps the log from being used again."""

_INSERT = "INSERT INTO rows (seq, at, kind, lift, caller, text, data, hash) VALUES (?, ?, ?, ?, ?, ?, ?, ?)"


class Entry(NamedTuple):
    """A row that has its time and waits for its number; in the order of the columns."""

    at: int
    kind: str
    lift: str
    caller: str
    text: str
    data: str


class Tended(NamedTuple):
    """What one step of care has left to do."""

    more: bool
    anchor: Row | None = None
    """Has to be written before rows may go."""
    log_pages: int = 0
    """How long the log beside the file has grown."""
    refusal: str = ""
    """Why nothing is cut on the word of the newest anchor."""


class JournalFile:
    """Everything here may block, and is called by one thread at a time; what fails closes the file, and the next call opens it."""

    def __init__(self, path: Path, site: str, limits: Limits, connect: Connect = connect) -> None:
        """Name the file; it is opened, and made if it is not there, by the first call."""
        self.path = path
        self._site = site
        self._limits = limits
        self._connect = connect
        self._connection: sqlite3.Connection | None = None
        self._tail: Tail | None = None
        """Unknown until it was opened once."""
        self._found: Tail | None = None
        """What the file had at its newest when it was opened."""
        self._identity: tuple[tuple[int, int], ...] = ()
        self._aim: Aim | None = None
        self._since_carried_over = CARRY_OVER_ROWS  # what a crash left in the log is carried over soon

    def open(self) -> None:
        """Open it if it is not open. Raises JournalUnusable, sqlite3.DatabaseError and OSError."""
        if self._connection is not None:
            return
        self._look_for_mixture()
        # made only once: in the place of a journal that has gone there may be the empty folder of a disk that is not mounted
        connection = open_database(self.path, self._site, create=self._tail is None, connect=self._connect)
        self._connection = connection
        try:
            self._found = tail(connection, self.path, self._site)
            self._identity = self._seen()
        except BaseException:
            self.close()
            raise

    def write(self, entries: Sequence[Entry]) -> bool:
        """Return once these rows are on the disk; says whether the file wants to be tended. Raises what `open` raises.

        Without rows it is a trial, for which the disk has to take as much as for a row.
        After a failure it must be called with the same entries first: a commit that failed may have reached the disk.
        """
        self.open()
        try:
            self._commit(self._missing(entries))
        except BaseException:
            self.close()
            raise
        return self._since_carried_over >= CARRY_OVER_ROWS

    def tend(self, now_us: int, *, check: bool) -> Tended:
        """Do one short piece of care; with `check` begin to see whether rows have to go. Raises what `open` raises."""
        self.open()
        try:
            return self._tend(now_us, check=check)
        except BaseException:
            self._since_carried_over, self._aim = 0, None  # not again at once: presses would wait for it
            self.close()
            raise

    def close(self) -> None:
        """Close it, whatever the disk says to that."""
        connection, self._connection, self._found = self._connection, None, None
        if connection is not None:
            with suppress(sqlite3.DatabaseError):
                connection.close()

    def _look_for_mixture(self) -> None:
        """Raise JournalUnusable for another file beside the log of this one: SQLite would lay that log over it, and spoil both."""
        with suppress(FileNotFoundError):
            file, log = self._seen()
            if self._identity and log == self._identity[1] and file != self._identity[0]:
                what = f"is another file than the one that this manager wrote to, and {self.path.name}-wal belongs to that one"
                raise unusable(self.path, what, "put that one back; to go on with this one, take both away first")

    def _missing(self, entries: Sequence[Entry]) -> Sequence[Entry]:
        """Return the entries that are not in the file yet. Raises JournalUnusable if it is not as this object left it."""
        found, known = self._found, self._tail
        if found is None or known is None:
            self._tail = self._tail or found
            self._found = None
            return entries
        count = found.seq - known.seq
        there = chained(known, entries[: max(count, 0)])
        if found != (Tail(there[-1].seq, there[-1].hash) if there else known):
            what = f"is not as this manager left it: its newest row is {found.seq}, and row {known.seq} was written"
            raise unusable(self.path, what, "put the right file back, or restart the manager to go on with this one")
        self._tail, self._found = found, None
        return entries[len(there) :]

    def _commit(self, entries: Sequence[Entry]) -> None:
        connection, last = self._opened(), self._tail or Tail(0, seed(self._site))
        rows = chained(last, entries)
        connection.execute("BEGIN IMMEDIATE")
        connection.executemany(_INSERT, rows)
        if not rows:
            connection.execute(
                f"PRAGMA user_version = {VERSION}"
            )  # what it is already; the page is written all the same
        connection.execute("COMMIT")
        if self._seen() != self._identity:
            what = "was moved, deleted or replaced while the manager had it open"
            raise unusable(self.path, what, "put it back, with the file of its name and `-wal` that was beside it")
        if rows:
            self._tail = Tail(rows[-1].seq, rows[-1].hash)
        self._since_carried_over += max(len(rows), 1)

    def _tend(self, now_us: int, *, check: bool) -> Tended:
        connection = self._opened()
        if check and self._aim is None:
            self._aim = aim(connection, self._limits, now_us)
        if self._since_carried_over >= CARRY_OVER_ROWS:
            _, log_pages, _ = connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
            self._since_carried_over = 0
            return Tended(more=True, log_pages=log_pages)
        step = cut_step(connection)
        if step.cut or shrink_step(connection):
            self._since_carried_over += CARRY_OVER_ROWS // 4
            return Tended(more=True)
        anchor = None if self._aim is None else overdue(connection, self._aim)
        if anchor is None:
            self._aim = None
        return Tended(more=anchor is not None, anchor=anchor, refusal=step.refusal)

    def _opened(self) -> sqlite3.Connection:
        if self._connection is None:
            raise sqlite3.ProgrammingError("the journal is closed")
        return self._connection

    def _seen(self) -> tuple[tuple[int, int], ...]:
        """Return what tells this file and its log from others of the same name."""
        seen = [os.stat(path) for path in (self.path, f"{self.path}-wal")]  # noqa: PTH116  a third of the time
        return tuple((stat.st_dev, stat.st_ino) for stat in seen)


def chained(last: Tail, entries: Sequence[Entry]) -> list[Stored]:
    """Return the entries as rows that follow a row."""
    rows: list[Stored] = []
    hash_ = last.hash
    for seq, entry in enumerate(entries, last.seq + 1):
        row = Stored(seq, *entry, hash=b"")
        hash_ = row_hash(hash_, row)
        rows.append(row._replace(hash=hash_))
    return rows
