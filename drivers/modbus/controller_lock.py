"""Ensures one manager per controller with a lock file, which also stops tools that would occupy the only slot."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.errors import ControllerTaken, LockUnusable
from drivers.own_files import is_shared, open_own

_LONGEST_PID = 32
"""In bytes; what else may be in the file is not shown."""


@contextmanager
def controller_lock(host: str, port: int, *, temporary: Path | None = None) -> Iterator[None]:
    """Hold the lock of one controller. Raises ControllerTaken if another process on this machine has it, and LockUnusable.

    The system releases the lock when the process ends, however it ends. `temporary` is the folder for temporary files, by default the system's.
    """
    descriptor = _lock(host, port, temporary or Path(tempfile.gettempdir()))
    try:
        yield
    finally:
        os.close(descriptor)


def _lock(host: str, port: int, temporary: Path) -> int:
    """Lock the file of one controller. Returns its descriptor: a file object with its buffers would take 5 KB."""
    folder = temporary / f"lift-manager-{os.getuid()}"
    path = folder / f"{re.sub(r'[^0-9A-Za-z.-]', '_', host)}_{port}.lock"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.is_symlink() or is_shared(folder):
            raise LockUnusable(f"{host}:{port}", f"{folder} can be written by others, or is a link; remove it")
        descriptor = open_own(path, os.O_RDWR | os.O_APPEND)
    except OSError as error:
        raise LockUnusable(f"{host}:{port}", f"{path}: {error.strerror or error}") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(descriptor, _LONGEST_PID, 0).decode("ascii", "replace").strip()
            raise ControllerTaken(f"{host}:{port}", holder or "unknown") from error
        os.ftruncate(descriptor, 0)
        os.write(descriptor, str(os.getpid()).encode())
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
