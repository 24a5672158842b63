"""A simulated disk whose commits take time, fail and hang, and the recorder of a manager on it. The clock is that of the loop.

On a virtual loop nothing waits in real time. The duration of a commit depends only on the seed and on the time at which it begins: one
commit more or less does not change the later ones.
"""

from __future__ import annotations

import asyncio
import errno
import math
import os
from asyncio import Future
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum, unique
from functools import partial
from pathlib import Path
from random import Random
from typing import TypeVar

from lift_manager.lift.journal import Row
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.committer import Committer
from lift_manager.store.outage import commit_failed
from lift_manager.store.store import MemoryStore, PendingRow, UpkeepStep

SLOT_S = 0.25
"""Commits that begin within the same slot of this length take the same time. Chosen: about as long as a burst of commits."""

_WHERE = "of the simulated disk"

Result = TypeVar("Result")


@unique
class DiskFault(StrEnum):
    """What may be wrong with a disk, until the fault is ended."""

    FULL = "full"
    """Every commit fails."""
    HANGS = "hangs"
    """No commit ends."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long commits take: most hardly longer than `least_s`, none longer than `most_s`."""

    least_s: float
    most_s: float


class SimulatedDisk:
    """Holds what was committed, and outlives every manager. Without a pace, commits take no time and cannot fail."""

    def __init__(self, pace: Pace | None = None, *, seed: int = 0, keep: int = 10_000) -> None:
        """Keep the newest `keep` rows."""
        self.store = MemoryStore(keep)
        """The committed records and rows."""
        self.on_recorded: list[Callable[[Row], None]] = []
        """Called with every row as soon as the manager records it."""
        self.on_committed: list[Callable[[Sequence[Row]], None]] = []
        """Called with the rows of each commit once they are on the disk."""
        self.on_recovered: list[Callable[[], None]] = []
        """Called once, at the end of the next fault."""
        self._pace = pace
        self._seed = seed
        self._faults: list[DiskFault] = []

    @property
    def instant(self) -> bool:
        """Whether commits take no time."""
        return self._pace is None

    @property
    def rows(self) -> list[Row]:
        """The rows that were committed."""
        return [pending.row for pending in self.store.rows]

    def begin(self, fault: DiskFault) -> None:
        """Begin a fault. Raises ValueError for a disk without a pace."""
        if self._pace is None:
            raise ValueError("a disk whose commits take no time cannot fail; give it a pace")
        self._faults.append(fault)

    def end(self, fault: DiskFault) -> None:
        """End one fault of this kind."""
        self._faults.remove(fault)
        callbacks, self.on_recovered = self.on_recovered, []
        for callback in callbacks:
            callback()

    @property
    def fails(self) -> bool:
        """Whether the disk has any fault now."""
        return bool(self._faults)

    def has(self, fault: DiskFault) -> bool:
        """Whether the disk has this fault now."""
        return fault in self._faults

    def draw(self, now: float) -> tuple[float, float]:
        """Return how long a job that begins now takes, and which share of that must pass for the job to survive a kill of the manager."""
        if self._pace is None:
            return 0.0, 0.0
        chance = Random(f"{self._seed} {math.floor(now / SLOT_S)}")  # noqa: S311 - seeded so that a run can be repeated
        least_s, most_s = self._pace.least_s, self._pace.most_s
        return least_s * (most_s / least_s) ** (chance.random() ** 2), chance.random()


class _ManagerStore:
    """Implements Store on a simulated disk, until its manager is killed."""

    def __init__(self, disk: SimulatedDisk) -> None:
        self.dropped = False
        self._disk = disk

    def load(self) -> Mapping[str, SavedLift]:
        return self._disk.store.load()

    def commit(self, records: Mapping[str, SavedLift], rows: Sequence[PendingRow]) -> bool:
        if self.dropped:
            return False
        do_upkeep = self._disk.store.commit(records, rows)
        for callback in self._disk.on_committed:
            callback([pending.row for pending in rows])
        return do_upkeep

    def tail(self, count: int) -> Sequence[PendingRow]:
        return self._disk.store.tail(count)

    def do_upkeep(self, now: int, *, check: bool) -> UpkeepStep:
        return self._disk.store.do_upkeep(now, check=check)

    def close(self) -> None:
        pass


class DiskJobs:
    """Carries out the calls of a store at the pace of a simulated disk, one after the other."""

    def __init__(self, disk: SimulatedDisk) -> None:
        self._disk = disk
        self._waiting: list[Callable[[], None]] = []
        """Functions that begin the waiting jobs."""
        self._abort: Callable[[], None] | None = None
        """Aborts the job under way."""
        self._killed = False

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Queue a job. The future gets its result after the time that the disk takes, or CommitFailed if the disk is full."""
        done: Future[Result] = asyncio.get_running_loop().create_future()
        if self._killed:
            done.cancel()
            return done
        self._waiting.append(partial(self._begin, work, done))
        if self._abort is None:
            self._begin_next()
        return done

    def stop(self) -> None:
        """Do nothing: jobs that are waiting are still carried out."""

    def kill(self) -> None:
        """Drop all waiting jobs. The job under way has reached the disk or not."""
        self._killed = True
        self._waiting.clear()
        if self._abort is not None:
            self._abort()

    def _begin_next(self) -> None:
        self._abort = None
        if self._waiting:
            self._waiting.pop(0)()

    def _begin(self, work: Callable[[], Result], done: Future[Result]) -> None:
        begun = _now()
        takes_s, luck = self._disk.draw(begun)
        timer = asyncio.get_running_loop().call_later(takes_s, self._finish, work, done)

        def abort() -> None:
            timer.cancel()
            if not self._disk.fails and _now() - begun > luck * takes_s:
                work()
            done.cancel()

        self._abort = abort

    def _finish(self, work: Callable[[], Result], done: Future[Result]) -> None:
        if done.done():
            return  # the job was aborted
        if self._disk.has(DiskFault.HANGS):
            self._disk.on_recovered.append(partial(self._finish, work, done))
            return
        if self._disk.has(DiskFault.FULL):
            done.set_exception(commit_failed(Path(_WHERE), OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
            done.exception()  # retrieved here: a manager that ends no longer does
        else:
            done.set_result(work())
        self._begin_next()


class DiskRecorder:
    """The Recorder of one manager on a simulated disk; each manager needs its own."""

    def __init__(self, disk: SimulatedDisk) -> None:
        self._disk = disk
        self._killed = False
        self._store = _ManagerStore(disk)
        self._jobs = DiskJobs(disk)
        jobs = None if disk.instant else lambda: self._jobs
        self._committer = Committer(self._store, _WHERE, self._store.load(), jobs=jobs)

    @property
    def trouble(self) -> str:
        """Why nothing can be written now; empty while it can."""
        return self._committer.trouble

    @property
    def unwritten(self) -> Mapping[str, SavedLift]:
        """The records that a restart would forget, by lift."""
        there, newest = self._disk.store.records, self._committer.unwritten
        return {lift: saved for lift, saved in newest.items() if saved != there.get(lift, SavedLift())}

    def drop(self) -> None:
        """Stop writing: the manager is killed."""
        if self._disk.instant:
            self._store.dropped = True
        self._jobs.kill()
        self._killed = True

    def recall(self, lift: str) -> SavedLift | None:
        """Return the last record of a lift."""
        return self._committer.recall(lift)

    def keep(self, lift: str, saved: SavedLift) -> None:
        """Commit a record soon."""
        self._committer.keep(lift, saved)

    def note(self, row: Row) -> None:
        """Commit a row soon."""
        self._report_recorded(row)
        self._committer.note(row)

    def commit_now(self, row: Row) -> Future[str | None]:
        """Commit a row now; the future has its result within a bounded time."""
        if not self.trouble:
            self._report_recorded(row)
        return self._committer.commit_now(row)

    def written(self, lift: str) -> Future[None] | None:
        """Return a future that is done once all records of a lift so far are committed."""
        return self._committer.written(lift)

    async def run(self, report: Callable[[str], None]) -> None:
        """Commit until cancelled."""
        await self._committer.run(report)

    async def settled(self) -> None:
        """Wait until everything so far is committed."""
        await self._committer.settled()

    def _report_recorded(self, row: Row) -> None:
        if not self._killed:
            for callback in self._disk.on_recorded:
                callback(row)


def _now() -> float:
    return asyncio.get_running_loop().time()
