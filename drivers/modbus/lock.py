"""One manager per controller: a lock file that a second one, or a tool that would take the only slot, runs into."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.errors import ControllerTaken


@contextmanager
def controller_lock(host: str, port: int) -> Iterator[None]:
    """Hold the lock of one controller. Raises ControllerTaken when another process on this machine has it.

    The system drops the lock with the process, however it ends.
    """
    folder = Path(tempfile.gettempdir()) / f"lift-manager-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / f"{re.sub(r'[^0-9A-Za-z.-]', '_', host)}_{port}.lock"
    with path.open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            raise ControllerTaken(f"{host}:{port}", file.read().strip() or "unknown") from error
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield
