"""Locates the files of a site."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
from collections.abc import Mapping
from pathlib import Path

from drivers.own_files import open_own
from lift_manager.store.errors import StoreUnusable


def store_path(site: str, folder: str | None, site_file: Path, environ: Mapping[str, str]) -> Path:
    """Return the file of a site; `folder` is the one that its site file names.

    In this order: the folder from systemd (`StateDirectory=`), the one of the site file, the user's own state folder. The hash in
    the name separates sites whose names differ only in characters that a file name cannot have. Raises StoreUnusable.
    """
    words = re.sub(r"[^0-9A-Za-z.]+", "-", site).strip("-.").lower()
    digest = hashlib.sha256(site.encode()).hexdigest()[:8]
    return _state_folder(folder, site_file, environ) / f"{words or 'site'}-{digest}.db"


def _state_folder(folder: str | None, site_file: Path, environ: Mapping[str, str]) -> Path:
    if given := environ.get("STATE_DIRECTORY", "").split(":")[0]:
        return Path(given)
    if folder is not None:
        return (site_file.parent / Path(folder).expanduser()).resolve()
    if home := environ.get("XDG_STATE_HOME", ""):
        return Path(home) / "lift-manager"
    try:
        return Path.home() / ".local" / "state" / "lift-manager"
    except RuntimeError as error:
        text = "this user has no home folder for the state of the lifts; name a folder with `state:` in the site file"
        raise StoreUnusable(text) from error


def claim(path: Path) -> int | None:
    """Lock a file against other managers until the returned descriptor is closed, or this process ends.

    None if the folder does not allow a lock; the first commit then reports why. Raises StoreUnusable if another process on this
    machine has the lock.
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
            f"another manager on this computer already serves a site of this name: stop that one first, because each would overwrite in {path}"
            " what people decided in the other; another site, with controllers of its own, needs another `name`"
        ) from error
    except OSError:
        os.close(lock)
        return None
    return lock


SHARED_FOLDER = "is in a folder that other users can write to, who could replace it"


def unshare_advice(folder: Path) -> str:
    """Return the advice on how to make a folder private to this user."""
    return f"`chmod go-w {folder}`, or name another folder with `state:` in the site file, which is then created for this user only"
