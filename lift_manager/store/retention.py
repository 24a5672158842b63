"""What a journal lets go of: the oldest rows, by age and by size, in steps that no press has to wait long for."""

from __future__ import annotations

import math
import sqlite3
from dataclasses import dataclass
from typing import NamedTuple

from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.store.errors import CommitFailed

STEP_ROWS = 500
"""Rows that go at once, each time with an anchor of their own."""
STEP_PAGES = 50
"""Pages of 4 KiB that go back to the disk at once. Both chosen by measurement: such a step takes a few milliseconds."""

BITE_DAYS = 3
"""So much goes by age at once. Chosen: a clock that is wrong takes little, and a shorter `keep_days` is reached within weeks."""

_DAY_US = 86_400_000_000
_BITE_EVERY_US = 20 * _DAY_US // 24
"""From one cut by age to the next. Chosen: one each day, though checks are an hour apart and starts shift them."""
_NOTHING = -(2**63)
_TOO_OLD = "they are too old"
_TOO_LARGE = "the journal is too large"
_BELOW = 0.98
"""To this part of the limit a journal is cut that has grown too large, so that it is not cut for a handful of rows."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How much of the past is kept."""

    keep_days: int
    max_mb: int
    """Of 1,000,000 bytes, without the log beside the file."""


class RetentionTarget(NamedTuple):
    """What has to go before a check is over."""

    older_than_us: int
    above_bytes: int


def aim(connection: sqlite3.Connection, limits: Limits, now_us: int) -> RetentionTarget:
    """Return what has to go now. Raises CommitFailed for a row that says nothing of its age.

    By age only a bite goes, and none soon after another: a clock that is wrong for an hour must not wipe out a year, however
    often the manager starts in that hour.
    """
    older_than_us = _NOTHING
    oldest = connection.execute("SELECT seq, at FROM rows ORDER BY seq LIMIT 1").fetchone()
    if oldest is not None and _may_age(connection, now_us):
        older_than_us = min(now_us - limits.keep_days * _DAY_US, _time(*oldest) + BITE_DAYS * _DAY_US)
    most = limits.max_mb * 1_000_000
    return RetentionTarget(older_than_us, round(_BELOW * most) if _used_bytes(connection) > most else most)


class Cut(NamedTuple):
    """The oldest rows, which go."""

    through: int
    anchor: Row
    """Says so, and has the hash of the last one, from which the others are verified."""


def next_cut(connection: sqlite3.Connection, aim: RetentionTarget) -> Cut | None:
    """Return what goes next, or None if nothing has to go. Raises CommitFailed for rows that say nothing of their age or their hash."""
    found = connection.execute("SELECT seq, at FROM rows ORDER BY seq LIMIT ?", (STEP_ROWS,)).fetchall()
    oldest = [(seq, _time(seq, at)) for seq, at in found]
    # of the first rows those before the first that is young enough
    old = next((index for index, (_, at) in enumerate(oldest) if at >= aim.older_than_us), len(oldest))
    count = max(old, min(len(oldest), _too_many(connection, aim)))
    (newest,) = connection.execute("SELECT max(seq) FROM rows").fetchone()
    if count == 0 or oldest[count - 1][0] == newest:
        return None
    first, through = oldest[0][0], oldest[count - 1][0]
    (hash_,) = connection.execute("SELECT hash FROM rows WHERE seq = ?", (through,)).fetchone()
    if not isinstance(hash_, bytes):
        raise _damaged(through)
    text = f"rows {first} to {through} go: {_TOO_OLD if count == old else _TOO_LARGE}"
    data: dict[str, Json] = {"through": through, "hash": hash_.hex(), "rows": count, "from": first}
    return Cut(through, Row(RowKind.ANCHOR, text, data=data))


def shrink_step(connection: sqlite3.Connection) -> bool:
    """Give some free pages back to the disk; returns whether there were any."""
    (free,) = connection.execute("PRAGMA freelist_count").fetchone()
    if free == 0:
        return False
    # not `execute`: a page goes with each step of the statement, and that takes one step
    connection.executescript(f"PRAGMA incremental_vacuum({STEP_PAGES})")
    return True


def _may_age(connection: sqlite3.Connection, now_us: int) -> bool:
    """Whether the clock of this computer is believed, and the last cut by age is long enough ago."""
    newest = connection.execute("SELECT at FROM rows ORDER BY seq DESC LIMIT 1").fetchone()
    if newest is None or not isinstance(newest[0], int) or newest[0] > now_us:
        return False
    last = "SELECT seq FROM rows WHERE kind = 'anchor' AND text LIKE ? ORDER BY seq DESC LIMIT 1"
    anchor = connection.execute(last, (f"%{_TOO_OLD}",)).fetchone()
    if anchor is None:
        return True
    # the anchor's own time, or, if the clock was set back after it, the time when that was seen first
    since = "SELECT at FROM rows WHERE seq >= ? AND at <= ? ORDER BY seq LIMIT 1"
    (cut_us,) = connection.execute(since, (*anchor, now_us)).fetchone()
    return isinstance(cut_us, int) and now_us - cut_us >= _BITE_EVERY_US


def _time(seq: int, at: object) -> int:
    if not isinstance(at, int):
        raise _damaged(seq)
    return at


def _damaged(seq: int) -> CommitFailed:
    what = f"row {seq} holds what no manager writes"
    return CommitFailed(what, "see what `lift-manager audit --verify` says of it")


def _too_many(connection: sqlite3.Connection, aim: RetentionTarget) -> int:
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
