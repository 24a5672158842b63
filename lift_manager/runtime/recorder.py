"""What an actor needs in order to have its record, and rows of the journal, on the disk."""

from __future__ import annotations

import asyncio
from asyncio import Future
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, tzinfo
from typing import Protocol

from lift_manager.domain.journal import Row
from lift_manager.lift.record import DurableRecord

Clock = Callable[[], datetime]
"""The time of day in the building, with its zone. Ages, leases and holds use it only across a restart."""


def wall_clock(zone: tzinfo | None = None) -> Clock:
    """Return the clock of this machine in a zone; None is the machine's own."""
    return lambda: datetime.now(UTC).astimezone(zone)


class Recorder(Protocol):
    """Commits records and rows in the order of the calls, many at once. Nothing here waits, so releases never wait for a disk.

    `store.committer.Committer` is one.
    """

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, in words with what to do; empty while it can."""
        ...

    def recall(self, lift: str) -> DurableRecord | None:
        """Return the newest record of a lift; None for a lift that nothing was ever kept of."""
        ...

    def keep(self, lift: str, record: DurableRecord) -> None:
        """Have this record of a lift from now on, and commit it soon."""
        ...

    def note(self, row: Row) -> None:
        """Commit this row soon."""
        ...

    def before(self, row: Row) -> Future[str | None]:
        """Commit this row at once, with all that was kept and noted before it.

        The result is None once that is on the disk, and within 2 s, whatever the disk does, why it is not. A row that was
        refused may still be written later.
        """
        ...

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once everything kept of a lift so far is on the disk; None where it is already.

        It stays open for as long as nothing can be written: bound it with a timeout.
        """
        ...


class MemoryRecorder:
    """Remembers for as long as the process lives: for tests and virtual worlds."""

    def __init__(self, records: Mapping[str, DurableRecord] | None = None) -> None:
        """Begin with what an earlier manager left."""
        self.records = dict(records or {})
        self.rows: list[Row] = []
        self.trouble = ""
        """May be set, as if a disk took nothing more."""

    def recall(self, lift: str) -> DurableRecord | None:
        """Return what was kept last."""
        return self.records.get(lift)

    def keep(self, lift: str, record: DurableRecord) -> None:
        """Keep this."""
        self.records[lift] = record

    def note(self, row: Row) -> None:
        """Keep this."""
        self.rows.append(row)

    def before(self, row: Row) -> Future[str | None]:
        """Keep this, and answer at once."""
        if not self.trouble:
            self.note(row)
        done: Future[str | None] = asyncio.get_running_loop().create_future()
        done.set_result(self.trouble or None)
        return done

    def written(self, lift: str) -> Future[None] | None:
        """Have nothing to wait for."""
        return None
