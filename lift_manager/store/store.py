"""What a store keeps of one site: a record per lift and the rows of the journal, committed together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from lift_manager.lift.journal import Row
from lift_manager.runtime.recorder import SavedLift


class PendingRow(NamedTuple):
    """A row of the journal and when it was noted."""

    at: int
    """Microseconds since 1970, UTC."""
    row: Row


class UpkeepStep(NamedTuple):
    """What one step of upkeep leaves to do."""

    more: bool
    log_pages: int = 0
    """How long the log beside the file has grown."""


class Store(Protocol):
    """Records and rows that outlive the manager. Every method may block; one thread at a time calls them.

    `commit` is all or nothing and returns once everything is on the disk. After a `CommitFailed` it may have reached the disk all
    the same: the next commit must begin with the same rows, and none of them is stored twice.
    """

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed. Raises StoreUnusable or CommitFailed."""
        ...

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Store these records and append these rows; returns whether the store wants to be tended. Raises CommitFailed.

        Without records and rows it is a trial, for which the disk does as much as for a row.
        """
        ...

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first. Raises CommitFailed."""
        ...

    def tend(self, now: int, *, check: bool) -> UpkeepStep:
        """Do one short step of upkeep; with `check` look whether rows have to go. Raises CommitFailed and StoreDamaged."""
        ...

    def close(self) -> None:
        """Close it, whatever the disk does; the next call opens it again."""
        ...


class MemoryStore:
    """A store that lasts as long as the process: for tests and simulated worlds."""

    def __init__(self, keep: int = 10_000) -> None:
        """Keep the newest `keep` rows."""
        self.records: dict[str, SavedLift] = {}
        self.rows: list[PendingRow] = []
        self._keep = keep

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed."""
        return dict(self.records)

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Store these records and append these rows; nothing has to be tended."""
        self.records |= records
        self.rows += rows
        if len(self.rows) > 2 * self._keep:
            del self.rows[: -self._keep]
        return False

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first."""
        return self.rows[len(self.rows) - count :] if count < len(self.rows) else tuple(self.rows)

    def tend(self, now: int, *, check: bool) -> UpkeepStep:
        """Have nothing to do."""
        return UpkeepStep(more=False)

    def close(self) -> None:
        """Have nothing to close."""
