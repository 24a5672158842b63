"""Copies the store of a site for a backup, and readies a copy from a backup to be served again."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from lift_manager.lift.audit import row_of
from lift_manager.lift.events import Restriction, RestrictionBegun, RestrictionKind
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.read import microseconds, open_journal
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore, copy_store, read_records
from lift_manager.store.store import PendingRow
from lift_manager.store.verify import Chain, verify

REASON = "restored from a backup: look at the lift and into its car, then end this"
"""Of the lockout that each lift gets, without its date."""


@dataclass(frozen=True, slots=True)
class StoreContent:
    """What a store holds."""

    records: Mapping[str, SavedLift]
    chain: Chain


def copy_verified(path: Path, site: str, target: Path) -> StoreContent:
    """Copy the store of a site, while a manager may be writing, and verify the copy.

    Raises StoreUnusable, JournalUnreadable, ChainBroken and OSError.
    """
    copy_store(path, site, target)
    return read_verified(target, site)


def read_verified(path: Path, site: str) -> StoreContent:
    """Read the records of a copy and verify its journal. Raises StoreUnusable, JournalUnreadable and ChainBroken."""
    records = read_records(path, site)
    with open_journal(path, copy=True) as reader:
        return StoreContent(records, verify(reader, site))


def lock_out_all(path: Path, site: str, lifts: Collection[str], limits: Limits, restriction: Restriction) -> None:
    """Lock out every lift in a store that is not served, and end its rides; a store that does not exist is created.

    Nobody knows what became of the lifts since the backup: a lockout, a fire or a robot in a car may be missing in it. The lockout ends
    the sessions of the backup at the next start. A lift that is locked out keeps its older lockout. Raises CommitFailed and StoreUnusable.
    """
    store = SqliteStore(path, site, limits)
    try:
        records = {lift: store.load().get(lift, SavedLift()) for lift in lifts}
        after = {lift: _locked_out(saved, restriction) for lift, saved in records.items()}
        text = f"the site was restored by {restriction.by}; {restriction.reason}"
        rows = [
            Row(RowKind.PERSON, text, caller=restriction.by, data={"said": "restore", "reason": restriction.reason})
        ]
        for lift, saved in after.items():
            if restriction in saved.record.restrictions and (row := row_of(RestrictionBegun(lift, restriction))):
                rows.append(row)
        store.commit(after, [PendingRow(microseconds(restriction.since), row) for row in rows])
    finally:
        store.close()


def restore_lockout(by: str, since: datetime, made_at: datetime) -> Restriction:
    """Return the lockout of a lift that is restored from a backup."""
    return Restriction(RestrictionKind.LOCKOUT, by, f"{REASON} (made {made_at:%Y-%m-%d %H:%M %z})", since)


def _locked_out(saved: SavedLift, restriction: Restriction) -> SavedLift:
    if saved.record.restriction(restriction.kind) is not None:
        return replace(saved, rides=())
    restrictions = (*saved.record.restrictions, restriction)
    return SavedLift(replace(saved.record, restrictions=restrictions), rides=())
