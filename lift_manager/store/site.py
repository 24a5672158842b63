"""The store of one site: claimed for this process, read, and refused in words where it cannot be relied on."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection, Iterator, Mapping
from datetime import UTC
from pathlib import Path
from weakref import finalize

from drivers.own_files import is_shared
from lift_manager.runtime.recorder import Clock, SavedLift, wall_clock
from lift_manager.store.committer import ANSWER_S, KEPT_ROWS, Committer
from lift_manager.store.database import Connect, connect
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.place import SHARED, claim, unshared
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore, kept_of_another, read_records, unusable

_log = logging.getLogger(__name__)


def opened(  # noqa: PLR0913  every argument after the site is a setting with a default
    path: Path,
    site: str,
    lifts: Collection[str],
    limits: Limits,
    *,
    clock: Clock | None = None,
    connect: Connect = connect,
    kept_rows: int = KEPT_ROWS,
    answer_s: float = ANSWER_S,
) -> Committer:
    """Read what is kept of a site, and make what writes to it. A file that is not there yet holds nothing. Raises StoreUnusable.

    A disk that takes nothing, and a journal that is damaged, are no error here but trouble, told by `run`: a manager has to start
    for all that, to let go of what it held. No other process may open it for as long as the Committer lives.
    """
    _require_own_folder(path)
    lock, store = claim(path), SqliteStore(path, site, limits, connect)
    try:
        records = _checked(path, store.load(), lifts)
    except StoreUnusable:
        if lock is not None:
            os.close(lock)
        raise
    if not path.exists():
        _tell_others(path)
    clock = clock or wall_clock(UTC)
    committer = Committer(store, str(path), records, clock=clock, kept_rows=kept_rows, answer_s=answer_s)
    if lock is not None:
        finalize(committer, os.close, lock)
    return committer


def read_site(path: Path, site: str, lifts: Collection[str]) -> Mapping[str, SavedLift]:
    """Return the records of a site, and change nothing. Raises StoreUnusable."""
    _require_own_folder(path)
    return _checked(path, read_records(path, site), lifts)


def _checked(path: Path, records: Mapping[str, SavedLift], lifts: Collection[str]) -> Mapping[str, SavedLift]:
    """Return the records if none of them, nor the store of another site in the folder, keeps robots off a lift of another name."""
    if not path.exists():
        for other, name, lift in _keeping_out(path, lifts):
            what = f"is not there, and {other} beside it keeps robots off lift {lift!r} of the site {name!r}"
            advice = (
                "if that is the former name of this site, give it that name again until people have ended that, and rename it then;"
                " if it is another building, move it to a folder of its own"
            )
            raise unusable(path, what, advice)
    for lift, record in records.items():
        if lift not in lifts and record.keeps_robots_out:
            what = f"keeps robots off lift {lift!r}, which the site file does not have"
            advice = (
                "put it back under that name until a person has ended that, and rename it or take it out then. The lifts are"
                f" {', '.join(lifts)}"
            )
            raise unusable(path, what, advice)
    return records


def _require_own_folder(path: Path) -> None:
    if is_shared(path.parent):
        raise unusable(path, SHARED, unshared(path.parent))


def _keeping_out(path: Path, lifts: Collection[str]) -> Iterator[tuple[Path, str, str]]:
    """Yield the stores of other sites in the folder that keep robots off a lift of such a name, with site and lift."""
    for other in _others(path):
        if (found := kept_of_another(other)) is not None:
            site, records = found
            yield from (
                (other, site, lift) for lift in sorted(records) if lift in lifts and records[lift].keeps_robots_out
            )


def _tell_others(path: Path) -> None:
    """Say which stores lie beside one that begins: it may be of a site that has another name since."""
    if others := ", ".join(str(other) for other in _others(path) if kept_of_another(other) is not None):
        text = "the store %s begins; another lies beside it: %s; `lift-manager audit --journal FILE` reads its journal"
        _log.warning(text, path, others)


def _others(path: Path) -> list[Path]:
    return [other for other in sorted(path.parent.glob("*.db")) if other != path]
