"""An outage of the disk: its reasons as messages with a remedy, when the disk is trusted again, and its row in the journal."""

from __future__ import annotations

import errno
import sqlite3
from pathlib import Path

from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.errors import CommitFailed

COMMITS_TO_RECOVER = 3
"""Commits in a row that must finish in time before a disk that was silent is trusted again. Chosen: a disk that is slow every other
time must not allow presses for a second each."""

RELAPSE_S = 600.0
"""An outage that begins this soon after another needs twice as many commits to end, up to MAX_COMMITS_TO_RECOVER. Chosen: presses
that come and go all day help no robot, and a failing disk is reported only a few times an hour."""
MAX_COMMITS_TO_RECOVER = 96

MAX_REASONS = 10
"""Reasons kept per outage. Chosen: more than a disk has ways to fail."""


class DiskOutage:
    """The time from the first commit that fails or is late to the commit after which the disk is trusted again."""

    def __init__(self, since_us: int, why: str, commits_to_recover: int = COMMITS_TO_RECOVER) -> None:
        """Begin an outage for a reason; `commits_to_recover` commits in time end it if the disk was silent."""
        self.commits_to_recover = commits_to_recover
        self.is_only_slow = False
        """Whether the last commit reached the disk, only too late."""
        self._since_us = since_us
        self._reasons = [why]
        self._required = 1
        self._in_time = 0

    def is_news(self, why: str) -> bool:
        """Whether this reason is new; it counts as known from now on."""
        if why in self._reasons or len(self._reasons) >= MAX_REASONS:
            return False
        self._reasons.append(why)
        return True

    def record_late(self) -> None:
        """Record that the disk is silent: a single commit in time no longer ends the outage."""
        self._required, self._in_time = self.commits_to_recover, 0

    def record_failure(self) -> None:
        """Record that a commit has failed."""
        self.is_only_slow, self._in_time = False, 0

    def record_commit(self, *, in_time: bool) -> bool:
        """Record that a commit has reached the disk; returns whether the outage is over."""
        self.is_only_slow = True
        self._in_time = self._in_time + 1 if in_time else 0
        return self._in_time >= self._required

    def journal_row(self, now_us: int) -> Row:
        """Return the row that reports this outage in the journal."""
        why = self._reasons[0].split("; ", maxsplit=1)[0]
        text = f"no row could be written for {max(now_us - self._since_us, 0) / 1e6:.0f} s: {why}"
        return Row(RowKind.ALARM, text, data={"from": self._since_us, "to": now_us, "why": self._reasons})


_FULL = ("has no space: the disk is full", "free some space")
_READ_ONLY = ("cannot be written: this user may only read it, or the disk is read-only", "let this user write to it")
_BROKEN = (
    "cannot be written: the disk reports an error",
    "check whether the disk is worn out or loose, and copy its contents",
)
_NOT_THERE = ("cannot be opened", "check that its folder exists and that this user may write to it")
_BUSY = ("is locked by another program", "stop the program that has it open")

_BY_SQLITE = {
    sqlite3.SQLITE_FULL: _FULL,
    sqlite3.SQLITE_READONLY: _READ_ONLY,
    sqlite3.SQLITE_PERM: _READ_ONLY,
    sqlite3.SQLITE_IOERR: _BROKEN,
    sqlite3.SQLITE_CANTOPEN: _NOT_THERE,
    sqlite3.SQLITE_BUSY: _BUSY,
    sqlite3.SQLITE_LOCKED: _BUSY,
}
_BY_ERRNO = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EROFS: _READ_ONLY,
    errno.EACCES: _READ_ONLY,
    errno.EPERM: _READ_ONLY,
    errno.EIO: _BROKEN,
    errno.EAGAIN: ("is not written: this computer has no thread to spare", "check what keeps it so busy"),
}


def no_thread(where: str, error: OSError) -> CommitFailed:
    """Return the error for a computer that cannot start a thread."""
    what, cure = _BY_ERRNO[errno.EAGAIN]
    return CommitFailed(f"the store {where} {what} ({error.strerror or error})", cure)


def commit_failed(path: Path, error: sqlite3.DatabaseError | OSError) -> CommitFailed:
    """Return the error for a file that cannot be written, with the remedy."""
    if isinstance(error, OSError):
        what, cure = _BY_ERRNO.get(error.errno or 0, _NOT_THERE)
        why = error.strerror or str(error)
    else:
        what, cure = _BY_SQLITE.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, _BROKEN)
        why = f"{error}, {getattr(error, 'sqlite_errorname', 'without a number')}"
    return CommitFailed(f"the store {path} {what} ({why})", cure)


def disk_silent(where: str, after_s: float) -> CommitFailed:
    """Return the error for a disk that has not answered."""
    what = f"the store {where} cannot be written: the disk has not answered for {after_s:g} s"
    return CommitFailed(what, "check whether it is loose, worn out or on a network that is down")


def row_late(where: str, after_s: float) -> CommitFailed:
    """Return the error for a row that was not written in time."""
    return CommitFailed(
        f"a row did not reach the store {where} within {after_s:g} s", "check what else keeps that disk busy"
    )


def queue_full(where: str, rows: int) -> CommitFailed:
    """Return the error for a queue that grows faster than the disk can write."""
    return CommitFailed(f"the store {where} is too slow: {rows} rows wait for the disk", "use a faster disk")


def trouble_text(failed: CommitFailed) -> str:
    """Return the message for people: the error, its consequences, and the remedy."""
    return (
        f"{failed.what}; until it can be written nothing is pressed, while releases and states continue, and decisions of people are"
        f" in force but do not survive a restart; {failed.advice}; the manager retries by itself"
    )
