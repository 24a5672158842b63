"""Opens the store of one site for this process, and refuses one that cannot be trusted."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection, Iterator, Mapping
from datetime import UTC
from pathlib import Path
from weakref import finalize

from drivers.own_files import is_shared
from lift_manager.runtime.recorder import Clock, SavedLift, wall_clock
from lift_manager.store.committer import ANSWER_S, MAX_QUEUED_ROWS, Committer
from lift_manager.store.database import Connect, connect
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.place import SHARED_FOLDER, claim, unshare_advice
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore, read_other_store, read_records, store_unusable

_log = logging.getLogger(__name__)


def open_store(  # noqa: PLR0913  every argument after the site is a setting with a default
    path: Path,
    site: str,
    lifts: Collection[str],
    limits: Limits,
    *,
    clock: Clock | None = None,
    connect: Connect = connect,
    max_queued_rows: int = MAX_QUEUED_ROWS,
    answer_s: float = ANSWER_S,
) -> Committer:
    """Read the records of a site, and return the Committer that writes to its store. Raises StoreUnusable.

    A file that does not exist yet holds no records. A disk that cannot be written and a damaged journal do not raise: `run` reports
    them, because a manager has to start anyway, to release what it held. No other process may open the store while the Committer lives.
    """
    _require_own_folder(path)
    lock, store = claim(path), SqliteStore(path, site, limits, connect)
    try:
        records = _require_no_orphans(path, store.load(), lifts)
    except StoreUnusable:
        if lock is not None:
            os.close(lock)
        raise
    if not path.exists():
        _warn_of_other_stores(path)
    clock = clock or wall_clock(UTC)
    committer = Committer(store, str(path), records, clock=clock, max_queued_rows=max_queued_rows, answer_s=answer_s)
    if lock is not None:
        finalize(committer, os.close, lock)
    return committer


def open_copy(path: Path, site: str, limits: Limits) -> SqliteStore:
    """Open the copy of a store that two machines share, for as long as it lives. Raises StoreUnusable."""
    _require_own_folder(path)
    lock, store = claim(path), SqliteStore(path, site, limits)
    try:
        store.load()
    except StoreUnusable:
        if lock is not None:
            os.close(lock)
        raise
    if lock is not None:
        finalize(store, os.close, lock)
    return store


def read_records_of_site(path: Path, site: str, lifts: Collection[str]) -> Mapping[str, SavedLift]:
    """Return the records of a site without changing anything. Raises StoreUnusable."""
    _require_own_folder(path)
    return _require_no_orphans(path, read_records(path, site), lifts)


def _require_no_orphans(
    path: Path, records: Mapping[str, SavedLift], lifts: Collection[str]
) -> Mapping[str, SavedLift]:
    """Return the records. Raises StoreUnusable if one of them, or of a renamed site, keeps robots off a lift without a successor."""
    if not path.exists():
        for other, name, lift in _blocking_stores(path, lifts):
            what = f"does not exist, and {other} in the same folder keeps robots off lift {lift!r} of the site {name!r}"
            advice = (
                "if that is the former name of this site, use that name again until people have ended that, and rename it then;"
                " if it is another building, move it to a folder of its own"
            )
            raise store_unusable(path, what, advice)
    return require_known_lifts(path, records, lifts)


def require_known_lifts(
    path: Path, records: Mapping[str, SavedLift], lifts: Collection[str]
) -> Mapping[str, SavedLift]:
    """Return the records of a store. Raises StoreUnusable if one of them keeps robots off a lift that is not in the site file."""
    for lift, record in records.items():
        if lift not in lifts and record.keeps_robots_out:
            what = f"keeps robots off lift {lift!r}, which is not in the site file"
            advice = (
                "put it back under that name until a person has ended that, and rename or remove it then. The lifts are"
                f" {', '.join(lifts)}"
            )
            raise store_unusable(path, what, advice)
    return records


def _require_own_folder(path: Path) -> None:
    if is_shared(path.parent):
        raise store_unusable(path, SHARED_FOLDER, unshare_advice(path.parent))


def _blocking_stores(path: Path, lifts: Collection[str]) -> Iterator[tuple[Path, str, str]]:
    """Yield the stores of other sites in the folder that keep robots off a lift of the same name, with site and lift."""
    for other in _other_stores(path):
        if (found := read_other_store(other)) is not None:
            site, records = found
            yield from (
                (other, site, lift) for lift in sorted(records) if lift in lifts and records[lift].keeps_robots_out
            )


def _warn_of_other_stores(path: Path) -> None:
    """Warn of other stores in the folder of a new one: the site may have been renamed."""
    if others := ", ".join(str(other) for other in _other_stores(path) if read_other_store(other) is not None):
        text = "%s is a new store; there are others in its folder: %s; `lift-manager audit --journal FILE` reads their journals"
        _log.warning(text, path, others)


def _other_stores(path: Path) -> list[Path]:
    return [other for other in sorted(path.parent.glob("*.db")) if other != path]
