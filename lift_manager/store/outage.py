"""A disk that takes no commit: why, in words with what to do, when it is trusted again, and the row that the journal has of it."""

from __future__ import annotations

import errno
import sqlite3
from pathlib import Path

from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.errors import CommitFailed

CALM_COMMITS = 3
"""So many commits in a row have to end in time before a disk that was silent is trusted again. Chosen: a disk that is slow every
other time must not give presses back for a second each."""

RELAPSE_S = 600.0
"""An outage that begins so soon after another needs twice as many of them to end, up to MOST_COMMITS. Chosen: presses that come and go
all day help no robot, and a disk on the brink is not told of more than a few times an hour."""
MOST_COMMITS = 96

REASONS = 10
"""Kept of one outage. Chosen: more than a disk has ways to fail."""


class DiskOutage:
    """From the first commit that fails or is late to the one after which rows are written again."""

    def __init__(self, since_us: int, why: str, calm_commits: int = CALM_COMMITS) -> None:
        """Begin one, for a reason that ends with what to do; `calm_commits` end it if the disk was silent."""
        self.calm_commits = calm_commits
        self.taken = False
        """Whether the disk took the last commit: it is slow, no more."""
        self._since_us = since_us
        self._reasons = [why]
        self._wanted = 1
        self._calm = 0

    def is_news(self, why: str) -> bool:
        """Whether nobody was told of this reason yet."""
        if why in self._reasons or len(self._reasons) >= REASONS:
            return False
        self._reasons.append(why)
        return True

    def late(self) -> None:
        """Take it that the disk is silent: one commit in time is not enough then."""
        self._wanted, self._calm = self.calm_commits, 0

    def failed(self) -> None:
        """Take it that a commit has failed."""
        self.taken, self._calm = False, 0

    def over(self, *, in_time: bool) -> bool:
        """Take it that a commit has reached the disk, and say whether that is the end."""
        self.taken = True
        self._calm = self._calm + 1 if in_time else 0
        return self._calm >= self._wanted

    def row(self, now_us: int) -> Row:
        """Return the one row that the journal has of it."""
        why = self._reasons[0].split("; ", maxsplit=1)[0]
        text = f"no row could be written for {max(now_us - self._since_us, 0) / 1e6:.0f} s: {why}"
        return Row(RowKind.ALARM, text, data={"from": self._since_us, "to": now_us, "why": self._reasons})


_FULL = ("has no room: the disk is full", "make room on it")
_READ_ONLY = ("cannot be written: this user may only read it, or the disk is read-only", "let this user write to it")
_BROKEN = (
    "cannot be written: the disk reports an error",
    "see whether the disk is worn out or loose, and copy what is on it",
)
_NOT_THERE = ("cannot be opened", "see to it that its folder is there and that this user may write in it")
_BUSY = ("is locked by another program", "end the program that has it open")

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
    errno.EAGAIN: ("is not written: this computer has no thread to spare", "see what keeps it so busy"),
}


def no_thread(where: str, error: OSError) -> CommitFailed:
    """Say that this computer has no thread that could write."""
    what, cure = _BY_ERRNO[errno.EAGAIN]
    return CommitFailed(f"the store {where} {what} ({error.strerror or error})", cure)


def commit_failed(path: Path, error: sqlite3.DatabaseError | OSError) -> CommitFailed:
    """Say why nothing can be written to a file, and what to do."""
    if isinstance(error, OSError):
        what, cure = _BY_ERRNO.get(error.errno or 0, _NOT_THERE)
        why = error.strerror or str(error)
    else:
        what, cure = _BY_SQLITE.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, _BROKEN)
        why = f"{error}, {getattr(error, 'sqlite_errorname', 'without a number')}"
    return CommitFailed(f"the store {path} {what} ({why})", cure)


def silent(where: str, after_s: float) -> CommitFailed:
    """Say that a disk has not answered."""
    what = f"the store {where} cannot be written: the disk has not answered for {after_s:g} s"
    return CommitFailed(what, "see whether it is loose, worn out or on a network that is down")


def late(where: str, after_s: float) -> CommitFailed:
    """Say that one row was not written in time."""
    return CommitFailed(
        f"a row did not reach the store {where} within {after_s:g} s", "see what else keeps that disk busy"
    )


def crowded(where: str, rows: int) -> CommitFailed:
    """Say that there are more rows than a disk takes."""
    return CommitFailed(f"the store {where} is too slow: {rows} rows wait for the disk", "use a faster disk")


def consequence(failed: CommitFailed) -> str:
    """Return the sentence for people: what is wrong, what follows from it, and what to do."""
    return (
        f"{failed.what}; until it can be written nothing is pressed, while releases and states go on, and what people say is in"
        f" force but not kept over a restart; {failed.advice}; it is tried again by itself"
    )
