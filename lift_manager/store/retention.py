"""Removes the oldest rows of a journal, by age and by size, in steps short enough for presses to wait."""

from __future__ import annotations

import math
import sqlite3
from dataclasses import dataclass
from typing import NamedTuple

from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.store.errors import CommitFailed

STEP_ROWS = 500
"""Rows removed in one step, with one anchor row for the step."""
STEP_PAGES = 50
"""Pages of 4 KiB returned to the disk in one step. Both chosen by measurement: such a step takes a few milliseconds."""

MAX_DAYS_PER_CUT = 3
"""Days that one cut by age removes at most. Chosen: a wrong clock removes little, and a shorter `keep_days` is reached within weeks."""

_DAY_US = 86_400_000_000
_CUT_BY_AGE_EVERY_US = 20 * _DAY_US // 24
"""Least time between two cuts by age. Chosen: one cut a day, although checks are an hour apart and restarts shift them."""
_BEFORE_ALL = -(2**63)
_TOO_OLD = "they are too old"
_TOO_LARGE = "the journal is too large"
_TARGET_FRACTION = 0.98
"""A journal that is too large is cut to this fraction of the limit, so that it is not cut for a handful of rows."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How much of the journal is kept."""

    keep_days: int
    max_mb: int
    """In units of 1,000,000 bytes, without the write-ahead log."""


class RetentionTarget(NamedTuple):
    """What a check has to remove."""

    older_than_us: int
    above_bytes: int


def retention_target(connection: sqlite3.Connection, limits: Limits, now_us: int) -> RetentionTarget:
    """Return what has to be removed now. Raises CommitFailed for a row without a valid time.

    A cut by age is small, and the next one is not soon: a clock that is wrong for an hour must not remove a year of rows, however
    often the manager restarts in that hour.
    """
    older_than_us = _BEFORE_ALL
    oldest = connection.execute("SELECT seq, at FROM rows ORDER BY seq LIMIT 1").fetchone()
    if oldest is not None and _may_cut_by_age(connection, now_us):
        older_than_us = min(now_us - limits.keep_days * _DAY_US, _time(*oldest) + MAX_DAYS_PER_CUT * _DAY_US)
    most = limits.max_mb * 1_000_000
    return RetentionTarget(older_than_us, round(_TARGET_FRACTION * most) if _used_bytes(connection) > most else most)


class Cut(NamedTuple):
    """The oldest rows, which are removed next."""

    through: int
    anchor: Row
    """Records the cut, with the hash of the last removed row, from which the remaining rows are verified."""


def next_cut(connection: sqlite3.Connection, target: RetentionTarget) -> Cut | None:
    """Return the next cut, or None if nothing has to be removed. Raises CommitFailed for rows without a valid time or hash."""
    found = connection.execute("SELECT seq, at FROM rows ORDER BY seq LIMIT ?", (STEP_ROWS,)).fetchall()
    oldest = [(seq, _time(seq, at)) for seq, at in found]
    # the rows before the first one that is recent enough
    old = next((index for index, (_, at) in enumerate(oldest) if at >= target.older_than_us), len(oldest))
    count = max(old, min(len(oldest), _rows_over_size(connection, target)))
    (newest,) = connection.execute("SELECT max(seq) FROM rows").fetchone()
    if count == 0 or oldest[count - 1][0] == newest:
        return None
    first, through = oldest[0][0], oldest[count - 1][0]
    (hash_,) = connection.execute("SELECT hash FROM rows WHERE seq = ?", (through,)).fetchone()
    if not isinstance(hash_, bytes):
        raise _damaged(through)
    text = f"rows {first} to {through} removed: {_TOO_OLD if count == old else _TOO_LARGE}"
    data: dict[str, Json] = {"through": through, "hash": hash_.hex(), "rows": count, "from": first}
    return Cut(through, Row(RowKind.ANCHOR, text, data=data))


def shrink_step(connection: sqlite3.Connection) -> bool:
    """Return some free pages to the disk; the result is whether there were any."""
    (free,) = connection.execute("PRAGMA freelist_count").fetchone()
    if free == 0:
        return False
    # not `execute`: it takes one step of the statement, which frees one page only
    connection.executescript(f"PRAGMA incremental_vacuum({STEP_PAGES})")
    return True


def _may_cut_by_age(connection: sqlite3.Connection, now_us: int) -> bool:
    """Whether the clock of this computer is plausible, and the last cut by age is long enough ago."""
    newest = connection.execute("SELECT at FROM rows ORDER BY seq DESC LIMIT 1").fetchone()
    if newest is None or not isinstance(newest[0], int) or newest[0] > now_us:
        return False
    last = "SELECT seq FROM rows WHERE kind = 'anchor' AND text LIKE ? ORDER BY seq DESC LIMIT 1"
    anchor = connection.execute(last, (f"%{_TOO_OLD}",)).fetchone()
    if anchor is None:
        return True
    # the time of the anchor, or of the first later row if the clock was set back after it
    since = "SELECT at FROM rows WHERE seq >= ? AND at <= ? ORDER BY seq LIMIT 1"
    (cut_us,) = connection.execute(since, (*anchor, now_us)).fetchone()
    return isinstance(cut_us, int) and now_us - cut_us >= _CUT_BY_AGE_EVERY_US


def _time(seq: int, at: object) -> int:
    if not isinstance(at, int):
        raise _damaged(seq)
    return at


def _damaged(seq: int) -> CommitFailed:
    what = f"row {seq} has a value that no manager writes"
    return CommitFailed(what, "run `lift-manager audit --verify` for details")


def _rows_over_size(connection: sqlite3.Connection, target: RetentionTarget) -> int:
    """Return about how many rows have to be removed because of the size."""
    used = _used_bytes(connection)
    if used <= target.above_bytes:
        return 0
    first, newest = connection.execute("SELECT min(seq), max(seq) FROM rows").fetchone()
    return math.ceil(int(newest - first + 1) * (1 - target.above_bytes / used))


def _used_bytes(connection: sqlite3.Connection) -> int:
    (page_bytes,) = connection.execute("PRAGMA page_size").fetchone()
    (pages,) = connection.execute("PRAGMA page_count").fetchone()
    (free,) = connection.execute("PRAGMA freelist_count").fetchone()
    return int((pages - free) * page_bytes)
