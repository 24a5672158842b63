"""The store of one site: a record per lift and the rows of the journal, committed together."""

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
    """What remains after one step of upkeep."""

    more: bool
    log_pages: int = 0
    """Length of the log next to the file."""


class Store(Protocol):
    """Records and rows that outlive the manager. Every method may block; one thread at a time calls them.

    `commit` is all or nothing and returns once everything is on the disk. A commit that raised `CommitFailed` may have reached the
    disk anyway: the next one must begin with the same rows, and none of them is stored twice.
    """

    def load(self) -> Mapping[str, SavedLift]:
        """Return the record of every lift that was ever committed. Raises StoreUnusable or CommitFailed."""
        ...

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        """Store these records and append these rows; returns whether the store needs upkeep. Raises CommitFailed.

        Without records and rows it is a trial that costs the disk as much as one row.
        """
        ...

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first. Raises CommitFailed."""
        ...

    def do_upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        """Run one short step of upkeep; `check` looks for rows to remove. Raises CommitFailed and StoreDamaged."""
        ...

    def close(self) -> None:
        """Close the file and ignore errors; the next call opens it again."""
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
        """Store these records and append these rows; no upkeep is needed."""
        self.records |= records
        self.rows += rows
        if len(self.rows) > 2 * self._keep:
            del self.rows[: -self._keep]
        return False

    def tail(self, count: int) -> Sequence[PendingRow]:
        """Return the newest rows, the oldest of them first."""
        return self.rows[len(self.rows) - count :] if count < len(self.rows) else tuple(self.rows)

    def do_upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        """Report that there is nothing to do."""
        return UpkeepStep(more=False)

    def close(self) -> None:
        """Do nothing: there is no file."""
