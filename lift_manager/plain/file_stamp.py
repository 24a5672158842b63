"""Notices that files have changed without reading them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FileStamp = tuple[tuple[int, int, int], ...]


def file_stamp(paths: Iterable[Path]) -> FileStamp:
    """Return a value that changes when one of the files does. Blocks as long as the disk does."""
    return tuple(_stamp(path) for path in paths)


def _stamp(path: Path) -> tuple[int, int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0, 0
    return status.st_mtime_ns, status.st_size, status.st_ino
