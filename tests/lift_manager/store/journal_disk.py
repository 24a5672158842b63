"""Disks that are full, hang or cannot be written, made of real connections, and a look at what is on them."""

import asyncio
import json
import sqlite3
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import Recorder
from lift_manager.store.chain import StoredRow, row_hash, seed
from lift_manager.store.committer import Committer
from lift_manager.store.database import Connect, connect
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_store
from tests.support.programs import HANGS_S

SITE = "Main hospital"
LIFTS = ("east", "goods")


def journal(path: Path, connect: Connect = connect, **more: Any) -> Committer:
    limits = Limits(more.pop("keep_days", 400), more.pop("max_mb", 500))
    return open_store(path, SITE, LIFTS, limits, connect=connect, **more)


def press(number: int, text: str = "about to press the call to L3") -> Row:
    return Row(RowKind.PRESS, text, "east", "rmf:robot1", {"n": number})


@contextmanager
def opened_raw(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        yield connection


def stored(path: Path) -> list[StoredRow]:
    """Read every row and see that number and hash of each follow from the one before."""
    if not path.exists():
        return []
    with opened_raw(path) as connection:
        rows = [StoredRow(*row) for row in connection.execute("SELECT * FROM rows ORDER BY seq")]
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    before = seed(SITE)
    if rows and rows[0].seq > 1:
        said = json.loads([row for row in rows if row.kind == RowKind.ANCHOR][-1].data)
        before = bytes.fromhex(said["hash"])
        assert rows[0].seq == said["through"] + 1
    for number, row in enumerate(rows, rows[0].seq if rows else 1):
        assert row.seq == number
        assert row.hash == row_hash(before, row)
        before = row.hash
    with opened_raw(path) as connection:
        assert connection.execute("SELECT seq, hash FROM head").fetchone() == (rows[-1].seq if rows else 0, before)
    return rows


def numbers(path: Path) -> list[int]:
    """Return the number of every press, in the order of the journal."""
    with opened_raw(path) as connection:
        found = connection.execute("SELECT json_extract(data, '$.n') FROM rows WHERE kind = 'press' ORDER BY seq")
        return [number for (number,) in found]


Told = asyncio.Queue[str]


@asynccontextmanager
async def writing(journal: Recorder) -> AsyncIterator[Told]:
    """Let it write; gives what it tells about trouble."""
    told = Told()
    async with asyncio.timeout(HANGS_S):
        running = asyncio.ensure_future(journal.run(told.put_nowait))
        try:
            yield told
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


async def written(journal: Recorder) -> None:
    """Let it write everything down."""
    async with writing(journal):
        await journal.settled()


def write_presses(path: Path, upto: int, *, begin: int = 0, **more: Any) -> None:
    async def main() -> None:
        kept = journal(path, **more)
        for number in range(begin, upto):
            kept.note(press(number))
        await written(kept)

    asyncio.run(main())


Hook = Callable[[sqlite3.Connection, str], object]
"""Sees each statement before it is executed, in the thread that writes."""


def usual(connection: sqlite3.Connection, sql: str) -> None:
    """Let everything through."""


@dataclass
class Disk:
    """Connects to real databases; `hook` may be set to another at any time."""

    hook: Hook = usual
    statements: list[str] = field(default_factory=list)
    opened: threading.Event = field(default_factory=threading.Event)

    def __call__(self, uri: str) -> sqlite3.Connection:
        disk = self
        disk.opened.set()

        class Hooked(sqlite3.Connection):
            def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
                disk.statements.append(sql)
                disk.hook(self, sql)
                return super().execute(sql, *parameters)

        return sqlite3.connect(uri, uri=True, isolation_level=None, timeout=0.05, factory=Hooked)


def full(connection: sqlite3.Connection, sql: str) -> None:
    """Let the database grow by two pages at most; then SQLite says that the disk is full."""
    if sql == "BEGIN IMMEDIATE":
        (pages,) = sqlite3.Connection.execute(connection, "PRAGMA page_count").fetchone()
        sqlite3.Connection.execute(connection, f"PRAGMA max_page_count = {pages + 2}").fetchone()


def read_only(connection: sqlite3.Connection, sql: str) -> None:
    sqlite3.Connection.execute(connection, "PRAGMA query_only = ON")


@dataclass
class Hanging:
    """Holds up every commit until it is let through; `hung` is set while one waits."""

    through: threading.Event = field(default_factory=threading.Event)
    hung: threading.Event = field(default_factory=threading.Event)

    def __call__(self, connection: sqlite3.Connection, sql: str) -> None:
        if sql == "COMMIT" and not self.through.is_set():
            self.hung.set()
            self.through.wait()
