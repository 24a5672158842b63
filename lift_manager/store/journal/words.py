"""Why rows cannot be written, in words with what to do."""

from __future__ import annotations

import errno
import sqlite3
from pathlib import Path

from lift_manager.store.errors import StoreError
from lift_manager.store.journal.database import MOVE_AWAY

_FULL = ("has no room: the disk is full", "make room on it")
_READ_ONLY = ("cannot be written: this user may only read it, or the disk is read-only", "let this user write to it")
_BROKEN = (
    "cannot be written: the disk reports an error",
    "see whether the disk is worn out or loose, and copy what is on it",
)
_NOT_THERE = ("cannot be opened", "see to it that its folder is there and that this user may write in it")
_DAMAGED = ("is damaged", MOVE_AWAY)
_BUSY = ("is locked by another program", "end the program that has it open")

_BY_SQLITE = {
    sqlite3.SQLITE_FULL: _FULL,
    sqlite3.SQLITE_READONLY: _READ_ONLY,
    sqlite3.SQLITE_PERM: _READ_ONLY,
    sqlite3.SQLITE_IOERR: _BROKEN,
    sqlite3.SQLITE_CORRUPT: _DAMAGED,
    sqlite3.SQLITE_NOTADB: _DAMAGED,
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


def silent(path: Path, after_s: float) -> str:
    """Say that a disk has not answered."""
    return _sentence(
        f"the journal {path} cannot be written: the disk has not answered for {after_s:g} s",
        "see whether it is loose, worn out or on a network that is down",
    )


def late(path: Path, after_s: float) -> str:
    """Say that one row was not written in time."""
    return _sentence(
        f"a row did not reach the journal {path} within {after_s:g} s", "see what else keeps that disk busy"
    )


def crowded(path: Path, rows: int) -> str:
    """Say that there are more rows than a disk takes."""
    return _sentence(f"the journal {path} is too slow: {rows} rows wait for the disk", "use a faster disk")


def in_words(path: Path, error: sqlite3.DatabaseError | OSError | StoreError) -> str:
    """Say why no row can be written and what to do about it."""
    return _sentence(*_reason(path, error))


def uncut(path: Path, error: sqlite3.DatabaseError | OSError | StoreError) -> str:
    """Say why old rows are still there and what to do about it."""
    return f"{path}: the oldest rows were not cut off: {'; '.join(_reason(path, error))}"


def _reason(path: Path, error: sqlite3.DatabaseError | OSError | StoreError) -> tuple[str, str]:
    """Return what is wrong, and what to do."""
    if isinstance(error, StoreError):
        what, _, cure = str(error).partition("; ")
        return what, cure
    if isinstance(error, OSError):
        what, cure = _BY_ERRNO.get(error.errno or 0, _NOT_THERE)
        why = error.strerror or str(error)
    else:
        what, cure = _BY_SQLITE.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, _BROKEN)
        why = f"{error}, {getattr(error, 'sqlite_errorname', 'without a number')}"
    return f"the journal {path} {what} ({why})", cure


def _sentence(what: str, cure: str) -> str:
    return (
        f"{what}; until it can be written nothing is pressed, while releases and states go on; {cure}; it is tried again"
        " by itself"
    )
