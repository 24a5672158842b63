"""The rows of all sites as the hub has read them, in one SQLite database, and how far each journal was read.

A row is known by site, journal and number, whoever delivers it and however often. Rows of a journal arrive in order, so the highest
number tells what is new, and a number that was skipped is a gap, which is an event like any other.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from lift_manager.hub.messages import Position, RowMessage

KEPT_PER_SITE = 100_000
"""Events kept of one site, so that none of them displaces those of another. Chosen: months of a busy site, 50 MB."""
BYTES_PER_SITE = 128 * 1024 * 1024
"""The same in bytes, for a site that makes its rows as long as it can."""
JOURNALS_PER_SITE = 100
"""Journals of one site whose newest row is known. A site gets another one when a backup is restored."""
PAGE = 500
"""Events that are read at once. Chosen: two milliseconds."""

_SCHEMA = """
CREATE TABLE IF NOT EXISTS hub (id TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS events (
    id INTEGER PRIMARY KEY AUTOINCREMENT, site TEXT NOT NULL, name TEXT NOT NULL, event TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS of_site ON events (site, id);
CREATE TABLE IF NOT EXISTS journals (site TEXT NOT NULL, journal TEXT NOT NULL, seq INTEGER NOT NULL, PRIMARY KEY (site, journal));
CREATE TABLE IF NOT EXISTS positions (site TEXT PRIMARY KEY, stream TEXT NOT NULL, at INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS pruned (site TEXT PRIMARY KEY, id INTEGER NOT NULL);
"""


class StoredEvent(NamedTuple):
    """An event as it is stored; the number is that of the event stream."""

    number: int
    name: str
    """`row`, `gap`, `site` or `update`."""
    text: str
    """JSON."""


class RowStore:
    """An open database. Not for several threads at once."""

    def __init__(self, path: Path, *, kept: int = KEPT_PER_SITE, max_bytes: int = BYTES_PER_SITE) -> None:
        """`kept` and `max_bytes` limit the events of each site."""
        self._kept, self._max_bytes = kept, max_bytes
        self._connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        self._connection.execute("PRAGMA journal_mode = WAL").fetchone()
        self._connection.execute("PRAGMA synchronous = NORMAL")
        self._connection.executescript(_SCHEMA)
        self.id = self._own_id()
        """Of this database: the numbers of events mean nothing in another one, be it of another hub or of this one after a loss."""
        self._bytes: dict[str, int] = {}
        """Of the events of each site that has sent any."""

    def _own_id(self) -> str:
        # only the first one writes: an INSERT that adds nothing locks the database all the same, and each reader of events opens it
        read = "SELECT id FROM hub"
        if self._connection.execute(read).fetchone() is None:
            self._connection.execute(f"INSERT INTO hub SELECT lower(hex(randomblob(4))) WHERE NOT EXISTS ({read})")
        return str(self._connection.execute(read).fetchone()[0])

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def positions(self) -> dict[str, Position]:
        """Return how far the stream of each site was read."""
        found = self._connection.execute("SELECT site, stream, at FROM positions").fetchall()
        return {site: Position(stream=stream, at=at) for site, stream, at in found}

    def add_rows(self, site: str, rows: Iterable[RowMessage], position: Position) -> list[StoredEvent]:
        """Store the rows that are new, their gaps, and the position behind them, or nothing; returns what was new."""
        events: list[dict[str, object]] = []
        highest: dict[str, int] = {}
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            for row in rows:
                before = highest.get(row.journal, self._highest(site, row.journal))
                if row.seq <= before:
                    continue
                if row.seq > before + 1:
                    events.append(
                        {"event": "gap", "site": site, "journal": row.journal, "first": before + 1, "last": row.seq - 1}
                    )
                events.append({"event": "row", "site": site, **row.model_dump()})
                highest[row.journal] = row.seq
            stored = [self._insert(site, event) for event in events]
            for journal, seq in highest.items():
                self._connection.execute("INSERT OR REPLACE INTO journals VALUES (?, ?, ?)", (site, journal, seq))
            self._forget_journals(site)
            self._connection.execute(
                "INSERT OR REPLACE INTO positions VALUES (?, ?, ?)", (site, position.stream, position.at)
            )
            self._prune(site)
            self._connection.execute("COMMIT")
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        return stored

    def add_event(self, site: str, event: dict[str, object]) -> StoredEvent:
        """Store an event of the hub itself about a site."""
        stored = self._insert(site, {**event, "site": site})
        self._prune(site)
        return stored

    def after(self, number: int, site: str | None, most: int = PAGE) -> Sequence[StoredEvent]:
        """Return the events that follow one, the oldest first; as many as `most`."""
        which, values = ("", ()) if site is None else ("site = ? AND", (site,))
        query = f"SELECT id, name, event FROM events WHERE {which} id > ? ORDER BY id LIMIT ?"  # noqa: S608  constants
        return [StoredEvent(*row) for row in self._connection.execute(query, (*values, number, most))]

    def pruned(self, site: str | None) -> int:
        """Return the number of the newest event that was removed because a site had too many; 0 if there is none."""
        if site is None:
            return self._read_number("SELECT max(id) FROM pruned")
        return self._read_number("SELECT id FROM pruned WHERE site = ?", site)

    def newest_of(self, site: str, most: int) -> Sequence[StoredEvent]:
        """Return the newest events of a site, the newest first, without the data of rows: a row may have much of it."""
        query = "SELECT id, name, json_remove(event, '$.data') FROM events WHERE site = ? ORDER BY id DESC LIMIT ?"
        return [StoredEvent(*row) for row in self._connection.execute(query, (site, most))]

    def newest(self) -> int:
        """Return the number of the newest event; 0 if there is none."""
        return self._read_number("SELECT max(id) FROM events")

    def _highest(self, site: str, journal: str) -> int:
        found = self._connection.execute("SELECT seq FROM journals WHERE site = ? AND journal = ?", (site, journal))
        return int((found.fetchone() or (0,))[0])

    def _forget_journals(self, site: str) -> None:
        """Forget the journals that have had no rows for the longest time, of a site that has too many."""
        newest = "SELECT rowid FROM journals WHERE site = ? ORDER BY rowid DESC LIMIT ?"
        query = f"DELETE FROM journals WHERE site = ? AND rowid NOT IN ({newest})"  # noqa: S608  constants
        self._connection.execute(query, (site, site, JOURNALS_PER_SITE))

    def _insert(self, site: str, event: dict[str, object]) -> StoredEvent:
        name, text = str(event["event"]), json.dumps(event, ensure_ascii=False, separators=(",", ":"))
        values = (site, name, text)
        inserted = self._connection.execute("INSERT INTO events (site, name, event) VALUES (?, ?, ?)", values)
        self._bytes[site] = self._size(site) + len(text)
        return StoredEvent(inserted.lastrowid or 0, name, text)

    def _size(self, site: str) -> int:
        if site not in self._bytes:
            self._bytes[site] = self._read_number("SELECT sum(length(event)) FROM events WHERE site = ?", site)
        return self._bytes[site]

    def _prune(self, site: str) -> None:
        """Remove the oldest events of a site that has too many: a tenth more than needed, so that this happens rarely."""
        count = self._read_number("SELECT count(*) FROM events WHERE site = ?", site)
        too_long = self._size(site) > self._max_bytes
        if count <= self._kept and not too_long:
            return
        kept = min(self._kept * 9 // 10, count // 2 if too_long else count)
        last = self._read_number("SELECT id FROM events WHERE site = ? ORDER BY id DESC LIMIT 1 OFFSET ?", site, kept)
        self._connection.execute("DELETE FROM events WHERE site = ? AND id <= ?", (site, last))
        self._connection.execute("INSERT OR REPLACE INTO pruned VALUES (?, ?)", (site, last))
        del self._bytes[site]

    def _read_number(self, query: str, *values: object) -> int:
        found = self._connection.execute(query, values).fetchone()
        return int((found or (0,))[0] or 0)
