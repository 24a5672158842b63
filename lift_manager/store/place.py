"""Where a site's file is, and how it is replaced so that no crash leaves half of one."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
from collections.abc import Mapping
from pathlib import Path

from drivers.own_files import make_own, open_own
from lift_manager.store.errors import StoreUnusable


def store_path(site: str, said: str | None, site_file: Path, environ: Mapping[str, str]) -> Path:
    """Return the file of a site; `said` is the folder that its site file names.

    In this order: the folder that systemd gives (`StateDirectory=`), the one of the site file, the user's own for states. The
    end of the name tells apart sites whose names differ only in signs that a file name cannot have. Raises StoreUnusable.
    """
    words = re.sub(r"[^0-9A-Za-z.]+", "-", site).strip("-.").lower()
    digest = hashlib.sha256(site.encode()).hexdigest()[:8]
    return _folder(said, site_file, environ) / f"{words or 'site'}-{digest}.db"


def _folder(said: str | None, site_file: Path, environ: Mapping[str, str]) -> Path:
    if given := environ.get("STATE_DIRECTORY", "").split(":")[0]:
        return Path(given)
    if said is not None:
        return (site_file.parent / Path(said).expanduser()).resolve()
    if home := environ.get("XDG_STATE_HOME", ""):
        return Path(home) / "lift-manager"
    try:
        return Path.home() / ".local" / "state" / "lift-manager"
    except RuntimeError as error:
        text = "this user has no home folder to keep the state of the lifts in; name a folder with `state:` in the site file"
        raise StoreUnusable(text) from error


def claim(path: Path) -> int | None:
    """Keep other managers off a file until the descriptor that is returned is closed, or this process ends.

    None where there can be no lock: whoever writes the file hears of such a folder. Raises StoreUnusable if another process
    on this machine has it.
    """
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        lock = open_own(path.with_name(f"{path.name}.lock"))
    except OSError:
        return None
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        os.close(lock)
        raise StoreUnusable(
            f"another manager that runs on this computer serves a site of this name: stop that one first, for each would wipe out what people"
            f" said to the other in {path}; another site, with controllers of its own, needs another `name`"
        ) from error
    except OSError:
        os.close(lock)
        return None
    return lock


SHARED = "is in a folder that other users can write to, who could replace it"


def unshared(folder: Path) -> str:
    """Return what makes a folder one of this user alone, in words."""
    return f"`chmod go-w {folder}`, or name another folder with `state:` in the site file, which is then made for this user alone"


def replace_file(path: Path, data: bytes) -> None:
    """Put new content in the place of a file: on the disk, or not at all. Raises OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    beside = path.with_name(f"{path.name}.new")
    with open(make_own(beside), "wb") as file:  # noqa: PTH123  of a descriptor
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    put_in_place(beside, path)


def put_in_place(beside: Path, path: Path) -> None:
    """Give a file that was written beside its place that name, and have the name on the disk. Raises OSError."""
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
