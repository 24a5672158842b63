"""Opens and replaces files that belong to this program alone, in places where other users may be able to write.

A crash never leaves half a file.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

NOT_FOLLOWED = "it is a symbolic link, and links are not followed; put the file itself there"


def open_own(path: Path, flags: int = os.O_RDWR) -> int:
    """Return a descriptor of a file; create it for this user alone if it is missing. Raises OSError, also for a link."""
    return _open(path, flags | os.O_CREAT)


def make_own(path: Path) -> int:
    """Return a descriptor for writing to a new file of this user alone; one left by a crash is removed. Raises OSError."""
    path.unlink(missing_ok=True)
    return _open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)


def read_own(path: Path) -> tuple[bytes, os.stat_result]:
    """Return the content and the status of a file. Raises OSError, also for a link."""
    with open(_open(path, os.O_RDONLY), "rb") as file:
        return file.read(), os.fstat(file.fileno())


def is_shared(folder: Path) -> bool:
    """Whether other users can add or replace files in a folder. A missing folder is not shared, nor is one of root's.

    For root, the folders of other users are not shared: it runs services on their behalf.
    """
    try:
        status = folder.stat()
    except OSError:
        return False
    me = os.geteuid()
    return bool(status.st_mode & 0o022) or (me != 0 and status.st_uid not in (0, me))


def replace_file(path: Path, data: bytes) -> None:
    """Replace the content of a file durably, or not at all. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.new")
    write_own(temporary, data)
    put_in_place(temporary, path)


def write_own(path: Path, data: bytes) -> None:
    """Make a file of this user alone, with its content on the disk, but not yet its name. Raises OSError."""
    with open(make_own(path), "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def put_in_place(temporary: Path, path: Path) -> None:
    """Rename a temporary file to its final name, and flush the name to the disk. Raises OSError."""
    temporary.replace(path)
    flush_names(path.parent)


def flush_names(folder: Path) -> None:
    """Flush the names in a folder to the disk. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _open(path: Path, flags: int) -> int:
    try:
        return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(error.errno, NOT_FOLLOWED, str(path)) from error
        raise
