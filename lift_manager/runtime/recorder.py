"""What an actor needs in order to have its record, and rows of the journal, on the disk."""

from __future__ import annotations

import asyncio
from asyncio import Future
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, tzinfo
from typing import Protocol

from lift_manager.lift.journal import Row
from lift_manager.lift.record import DurableRecord
from lift_manager.rides.record import SavedRide

Clock = Callable[[], datetime]
"""The time of day in the building, with its zone. Ages, leases and holds use it only across a restart."""


def wall_clock(zone: tzinfo | None = None) -> Clock:
    """Return the clock of this machine in a zone; None is the machine's own."""
    return lambda: datetime.now(UTC).astimezone(zone)


@dataclass(frozen=True, slots=True)
class SavedLift:
    """What of one lift outlives the manager."""

    record: DurableRecord = field(default_factory=DurableRecord)
    rides: tuple[SavedRide, ...] = ()
    """Rides on it that are under way, and those of the last hour that may still be requested; the oldest first."""

    @property
    def keeps_robots_out(self) -> bool:
        """Whether some robot is refused, or not let through the door, because of it."""
        return self.record.keeps_robots_out


class Recorder(Protocol):
    """Commits records and rows in the order of the calls, many at once.

    Nothing here waits, so releases never wait for a disk. `store.committer.Committer` is one.
    """

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, in words with what to do; empty while it can."""
        ...

    def recall(self, lift: str) -> SavedLift | None:
        """Return the newest record of a lift; None if nothing was ever stored of it."""
        ...

    def keep(self, lift: str, saved: SavedLift) -> None:
        """Store this for a lift from now on, and commit it soon."""
        ...

    def note(self, row: Row) -> None:
        """Commit this row soon."""
        ...

    def commit_now(self, row: Row) -> Future[str | None]:
        """Commit this row at once, with everything stored and noted before it.

        The result is None once that is on the disk, or, within 2 s, whatever the disk does, why it is not. A row that was refused
        may still be written later.
        """
        ...

    def written(self, lift: str) -> Future[None] | None:
        """Return a future that is done once everything stored of a lift so far is on the disk; None if it is already.

        It stays open for as long as nothing can be written: bound it with a timeout.
        """
        ...

    async def run(self, report: Callable[[str], None]) -> None:
        """Write until cancelled; a failed write is retried.

        `report` gets why nothing can be written, once, and an empty text once that is over.
        """
        ...

    async def settled(self) -> None:
        """Return once everything noted and stored so far is on the disk; bound it with a timeout."""
        ...


class MemoryRecorder:
    """Remembers for as long as the process lives: for tests and virtual worlds."""

    def __init__(self, records: Mapping[str, SavedLift] | None = None, *, newest: int = 10_000) -> None:
        """Begin with what an earlier manager left; remember the newest rows."""
        self.records = dict(records or {})
        self._newest = newest
        self.rows: list[Row] = []
        self.trouble = ""
        """May be set, as if the disk took nothing any more."""

    def recall(self, lift: str) -> SavedLift | None:
        """Return what was kept last."""
        return self.records.get(lift)

    def keep(self, lift: str, saved: SavedLift) -> None:
        """Keep this."""
        self.records[lift] = saved

    def note(self, row: Row) -> None:
        """Keep this."""
        self.rows.append(row)
        if len(self.rows) > 2 * self._newest:
            del self.rows[: -self._newest]

    def commit_now(self, row: Row) -> Future[str | None]:
        """Keep this, and answer at once."""
        if not self.trouble:
            self.note(row)
        done: Future[str | None] = asyncio.get_running_loop().create_future()
        done.set_result(self.trouble or None)
        return done

    def written(self, lift: str) -> Future[None] | None:
        """Have nothing to wait for."""
        return None

    async def run(self, report: Callable[[str], None]) -> None:
        """Have nothing to write."""
        await asyncio.Event().wait()

    async def settled(self) -> None:
        """Have nothing to wait for."""
