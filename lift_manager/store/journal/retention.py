"""What a journal lets go of: the oldest rows, by age and by size, in steps that no press has to wait long for."""

from __future__ import annotations

import json
import math
import sqlite3
from dataclasses import dataclass
from typing import NamedTuple

from lift_manager.domain.journal import Row, RowKind

STEP_ROWS = 500
"""Rows that go at once, each time with an anchor of their own."""
STEP_PAGES = 50
"""Pages of 4 KiB that go back to the disk at once. Both chosen by measurement: such a step takes a few milliseconds."""

_DAY_US = 86_400_000_000
_BELOW = 0.98
"""To this part of the limit a journal is cut that has grown too large, so that it is not cut for a handful of rows."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How much of the past is kept."""

    keep_days: int
    max_mb: int
    """Of 1,000,000 bytes, without the log beside the file."""


class Aim(NamedTuple):
    """What has to go before a check is over."""

    older_than_us: int
    above_bytes: int


def aim(connection: sqlite3.Connection, limits: Limits, now_us: int) -> Aim:
    """Return what has to go now.

    By age no more than a day's worth goes in one check: a clock that is wrong for an hour must not wipe out a year.
    """
    oldest = connection.execute("SELECT at FROM rows ORDER BY seq LIMIT 1").fetchone()
    older_than_us = now_us - limits.keep_days * _DAY_US
    if oldest is not None:
        older_than_us = min(older_than_us, oldest[0] + _DAY_US)
    most = limits.max_mb * 1_000_000
    return Aim(older_than_us, round(_BELOW * most) if _used_bytes(connection) > most else most)


def overdue(connection: sqlite3.Connection, aim: Aim) -> Row | None:
    """Return the anchor that has to be written before the oldest rows may go, or None if nothing has to go."""
    oldest = connection.execute("SELECT seq, at FROM rows ORDER BY seq LIMIT ?", (STEP_ROWS,)).fetchall()
    # of the first rows those before the first that is young enough
    old = next((index for index, (_, at) in enumerate(oldest) if at >= aim.older_than_us), len(oldest))
    count = max(old, min(len(oldest), _too_many(connection, aim)))
    (newest,) = connection.execute("SELECT max(seq) FROM rows").fetchone()
    if count == 0 or oldest[count - 1][0] == newest:  # the newest row is what the next one is chained to
        return None
    first, through = oldest[0][0], oldest[count - 1][0]
    (hash_,) = connection.execute("SELECT hash FROM rows WHERE seq = ?", (through,)).fetchone()
    why = "they are too old" if count == old else "the journal is too large"
    return Row(
        RowKind.ANCHOR,
        f"rows {first} to {through} go: {why}",
        data={"through": through, "hash": hash_.hex(), "rows": count, "from": first},
    )


def cut_step(connection: sqlite3.Connection) -> bool:
    """Delete some of the rows that the newest anchor lets go; returns whether there were any."""
    found = connection.execute("SELECT data FROM rows WHERE kind = 'anchor' ORDER BY seq DESC LIMIT 1").fetchone()
    if found is None:
        return False
    through = json.loads(found[0])["through"]
    (first,) = connection.execute("SELECT min(seq) FROM rows").fetchone()
    if first > through:
        return False
    connection.execute("DELETE FROM rows WHERE seq <= ?", (min(first + STEP_ROWS - 1, through),))
    return True


def shrink_step(connection: sqlite3.Connection) -> bool:
    """Give some free pages back to the disk; returns whether there were any."""
    (free,) = connection.execute("PRAGMA freelist_count").fetchone()
    if free == 0:
        return False
    # not `execute`: a page goes with each step of the statement, and that takes one step
    connection.executescript(f"PRAGMA incremental_vacuum({STEP_PAGES})")
    return True


def _too_many(connection: sqlite3.Connection, aim: Aim) -> int:
    """Return about how many rows have to go because of the size."""
    used = _used_bytes(connection)
    if used <= aim.above_bytes:
        return 0
    first, newest = connection.execute("SELECT min(seq), max(seq) FROM rows").fetchone()
    return math.ceil(int(newest - first + 1) * (1 - aim.above_bytes / used))


def _used_bytes(connection: sqlite3.Connection) -> int:
    (page_bytes,) = connection.execute("PRAGMA page_size").fetchone()
    (pages,) = connection.execute("PRAGMA page_count").fetchone()
    (free,) = connection.execute("PRAGMA freelist_count").fetchone()
    return int((pages - free) * page_bytes)
