"""Commits records and journal rows: one commit at a time, each with everything that is queued. Nothing else waits for the disk."""

from __future__ import annotations

import asyncio
import logging
from asyncio import Future
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Protocol, TypeVar

from drivers.thread import Worker
from lift_manager.lift.journal import Json, Row, RowKind
from lift_manager.plain.text import counted
from lift_manager.runtime.recorder import Clock, SavedLift, wall_clock
from lift_manager.store.errors import CommitFailed
from lift_manager.store.outage import (
    COMMITS_TO_RECOVER,
    MAX_COMMITS_TO_RECOVER,
    RELAPSE_S,
    DiskOutage,
    disk_silent,
    no_thread,
    queue_full,
    row_late,
    trouble_text,
)
from lift_manager.store.store import PendingRow, Store

_log = logging.getLogger(__name__)

ANSWER_S = 2.0
"""`commit_now` replies within this time, and a disk that has not answered by then is reported as failing. Chosen: a busy memory card takes
a second or two, and the reading behind a press is too old after it (`max_age_s`, 1 s by default)."""

LINGER_S = 0.005
"""How long to hold back rows and records that no press waits for. Chosen: the press that follows a request is ready 1 to 3 ms after it
on an idle computer, and then shares one flush with its session and the rows of the request (benchmarks/README.md)."""

RETRY_S = (1.0, 30.0)
"""First and longest pause after a commit that failed. Chosen: presses resume within half a minute after space is freed."""

CHECK_S = 3600.0
"""Between two checks of the age and size of the journal."""

END_S = 0.5
"""How long shutdown waits for the file to close, counting the time that the commit under way has already taken. Chosen: it is part of
the 5 s in which the process must exit, and a file that is not closed loses nothing."""

MAX_QUEUED_ROWS = 10_000
"""Rows that may wait in memory. Chosen: several minutes of a busy site, and at most about 20 MB."""

LOG_PAGES_WARNING = 16_000
"""64 MB: more than any burst; something keeps SQLite from reusing the log."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Result = TypeVar("Result")


class Jobs(Protocol):
    """Runs jobs one after another, as `drivers.thread.Worker` does in a thread."""

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Queue a job. Raises OSError if it cannot be started."""
        ...

    def stop(self) -> None:
        """Stop after the queued jobs."""
        ...


@dataclass(frozen=True, slots=True)
class _QueuedRow:
    pending: PendingRow
    answer: Future[str | None] | None = None

    def resolve(self, trouble: str | None) -> None:
        if self.answer is not None and not self.answer.done():
            self.answer.set_result(trouble)


class Committer:
    """Holds every row and the newest record of each lift until they are on the disk, and reports what was lost.

    Implements Recorder. Memory leads the disk: a record is recalled as soon as it is kept, and never rolled back.
    """

    def __init__(
        self,
        store: Store,
        where: str,
        records: Mapping[str, SavedLift],
        *,
        jobs: Callable[[], Jobs] | None = lambda: Worker("lift-manager-store"),
        clock: Clock | None = None,
        max_queued_rows: int = MAX_QUEUED_ROWS,
        answer_s: float = ANSWER_S,
    ) -> None:
        """Commit to a store that holds these records; `where` names it in messages.

        `jobs` makes the worker that calls the store; without it, every call is made at once and takes no time. `max_queued_rows` is
        how many rows may wait in memory, `answer_s` how long a commit may take.
        """
        self.where = where
        self.trouble = ""
        """Why nothing can be written now, in words with what to do; empty while it can."""
        self._store = store
        self._jobs = jobs
        self._clock = clock or wall_clock(UTC)
        self._max_queued_rows = max_queued_rows
        self._answer_s = answer_s
        self._records = dict(records)
        self._changed: dict[str, int] = {}
        """The number of the newest change, for each lift whose record is not on the disk."""
        self._queue: list[_QueuedRow] = []
        """Every row that is not known to be on the disk, including those of the commit under way."""
        self._number = 0
        """Of the newest row or record."""
        self._committed_upto = 0
        """Everything up to this number is on the disk."""
        self._waiters: list[tuple[int, Future[None]]] = []
        """Futures, and the number that each waits for."""
        self._lost: Counter[str] = Counter()
        self._lost_since = 0
        self._has_work = asyncio.Event()
        """There is something to commit."""
        self._urgent = asyncio.Event()
        """A press waits for the commit, or the manager is stopping."""
        self._pause_s = RETRY_S[0]
        self._report: Callable[[str], None] = _ignore_report
        self._outage: DiskOutage | None = None
        self._last_outage: tuple[DiskOutage, float] | None = None
        """The previous outage, and when it ended."""
        self._under_way_since: float | None = None
        """When the job that the disk is doing began."""
        self._log_warned = False

    @property
    def unwritten(self) -> Mapping[str, SavedLift]:
        """Records that a restart would lose, by lift."""
        return {lift: self._records[lift] for lift in self._changed}

    def recall(self, lift: str) -> SavedLift | None:
        """Return the newest record of a lift; None for a lift without a record."""
        return self._records.get(lift)

    def keep(self, lift: str, record: SavedLift) -> None:
        """Replace the record of a lift, and commit it soon."""
        self._records[lift] = record
        self._number += 1
        self._changed[lift] = self._number
        self._schedule_commit()

    def written(self, lift: str) -> Future[None] | None:
        """Return a future that completes once the newest record of a lift is on the disk; None if it already is."""
        return self._future_at(self._changed[lift]) if lift in self._changed else None

    def note(self, row: Row) -> None:
        """Commit a row soon, or count it as lost if the queue is full."""
        if not self._enqueue(row, None):
            self._lost_since = self._lost_since or _micros(self._clock())
            self._lost[row.kind.value] += 1

    def commit_now(self, row: Row) -> Future[str | None]:
        """Commit a row at once, with everything kept and noted before it; the result is None, or within ANSWER_S why it failed.

        A row is not queued while the store is already in trouble.
        """
        loop = asyncio.get_running_loop()
        answer: Future[str | None] = loop.create_future()
        if self.trouble:
            answer.set_result(self.trouble)
        elif not self._enqueue(row, answer):
            answer.set_result(trouble_text(queue_full(self.where, len(self._queue))))
        elif not answer.done():
            self._urgent.set()
            timer = loop.call_later(self._answer_s, self._time_out, answer)
            answer.add_done_callback(lambda _: timer.cancel())
        return answer

    async def settled(self) -> None:
        """Return once everything so far is on the disk, including the row that reports lost rows."""
        reached = self._future_at(self._number + bool(self._lost))
        if reached is not None:
            self._urgent.set()
            await reached

    async def run(self, report: Callable[[str], None]) -> None:
        """Commit until cancelled."""
        self._report = report
        if self._jobs is None:
            await asyncio.Event().wait()
            return
        jobs = self._jobs()
        _log.info("records of the lifts and the journal are stored in %s", self.where)
        try:
            await self._work(jobs)
        finally:
            with suppress(OSError):  # without a thread there is nothing to close
                await asyncio.wait([jobs.submit(self._store.close)], timeout=self._close_timeout_s())
            jobs.stop()
            self._refuse_presses("the manager is stopping")
            if self._queue or self._changed:
                lost = f"{counted(len(self._queue), 'row')} and {counted(len(self._changed), 'record')}"
                _log.error("%s did not reach the store %s", lost, self.where)

    def _enqueue(self, row: Row, answer: Future[str | None] | None) -> bool:
        if len(self._queue) >= self._max_queued_rows:
            return False
        self._queue_gap_row()
        self._append(row, answer)
        self._schedule_commit()
        return True

    def _append(self, row: Row, answer: Future[str | None] | None = None) -> None:
        self._queue.append(_QueuedRow(PendingRow(_micros(self._clock()), row), answer))
        self._number += 1

    def _queue_gap_row(self) -> None:
        """Queue one row that reports how many rows were lost here."""
        if not self._lost:
            return
        count = self._lost.total()
        text = f"{count} rows could not be written and are lost"
        data: dict[str, Json] = {
            "rows": count,
            "kinds": dict(self._lost),
            "from": self._lost_since,
            "to": _micros(self._clock()),
        }
        self._lost.clear()
        self._lost_since = 0
        self._append(Row(RowKind.GAP, text, data=data))

    def _schedule_commit(self) -> None:
        if self._jobs is not None:
            self._has_work.set()
            return
        batch = self._take_batch()
        self._store.commit(batch.records, [waiting.pending for waiting in batch.rows])
        self._mark_committed(batch)

    def _future_at(self, number: int) -> Future[None] | None:
        """Return a future that completes once everything up to this number is on the disk; None if it already is."""
        if number <= self._committed_upto:
            return None
        future: Future[None] = asyncio.get_running_loop().create_future()
        self._waiters.append((number, future))
        return future

    async def _work(self, jobs: Jobs) -> None:
        loop = asyncio.get_running_loop()
        check_at = loop.time()
        needs_upkeep = await self._commit(jobs)  # find out before the first press whether the disk can be written
        while True:
            if self._has_work.is_set() or self.trouble:
                await self._linger()
                needs_upkeep |= await self._commit(jobs)
            check = loop.time() >= check_at
            if self._outage is not None:
                await self._pause(self._outage)
            elif needs_upkeep or check:
                needs_upkeep = await self._do_upkeep(jobs, check=check)
                check_at = loop.time() + CHECK_S if check else check_at
            else:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(check_at):
                        await self._has_work.wait()

    async def _linger(self) -> None:
        """Wait a moment for more to commit, unless a press waits."""
        if not self.trouble and not self._urgent.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(LINGER_S):
                    await self._urgent.wait()

    async def _pause(self, outage: DiskOutage) -> None:
        """Wait before the next attempt; if the disk is only slow, new work ends the wait."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._pause_s):
                await (self._has_work.wait() if outage.is_only_slow else asyncio.Event().wait())
        self._pause_s = min(2 * self._pause_s, RETRY_S[1])

    def _take_batch(self) -> _Batch:
        """Take everything that is queued: the newest record of every changed lift, and all rows."""
        self._has_work.clear()
        self._urgent.clear()
        return _Batch(self.unwritten, list(self._queue), self._number)

    async def _commit(self, jobs: Jobs) -> bool:
        """Commit what is queued; returns whether the store needs upkeep."""
        batch = self._take_batch()
        rows = [waiting.pending for waiting in batch.rows]
        try:
            job = self._start_job(jobs, partial(self._store.commit, batch.records, rows))
            job.add_done_callback(partial(self._finish_commit, batch, asyncio.get_running_loop().time()))
            return await self._await_job(job)
        except CommitFailed as error:
            self._fail(error).record_failure()
            return False

    async def _do_upkeep(self, jobs: Jobs, *, check: bool) -> bool:
        """Run one short step of upkeep; returns whether there is more to do."""
        try:
            job = self._start_job(jobs, partial(self._store.do_upkeep, _micros(self._clock()), check=check))
            step = await self._await_job(job)
        except CommitFailed as error:
            # rows may still be written; if not, the next commit reports it
            _log.warning("%s: the oldest rows could not be removed: %s", self.where, error)
            return False
        if step.log_pages > LOG_PAGES_WARNING and not self._log_warned:
            self._log_warned = True
            _log.warning(
                "%s-wal keeps growing because another program reads the file all the time; stop that program",
                self.where,
            )
        return step.more

    def _start_job(self, jobs: Jobs, work: Callable[[], Result]) -> Future[Result]:
        try:
            return jobs.submit(work)
        except OSError as error:
            raise no_thread(self.where, error) from error

    async def _await_job(self, job: Future[Result]) -> Result:
        """Wait for a job; report a silent disk after ANSWER_S. Cancelling the wait does not cancel the job."""
        loop = asyncio.get_running_loop()
        silence = loop.call_later(self._answer_s, self._report_silence)
        self._under_way_since = loop.time()
        try:
            await asyncio.wait([job])
        finally:
            silence.cancel()
            if job.done():
                self._under_way_since = None
        return job.result()

    def _report_silence(self) -> None:
        self._fail(disk_silent(self.where, self._answer_s)).record_late()

    def _close_timeout_s(self) -> float:
        """Return how long to wait for the file to close, less the time for which the disk has been silent already."""
        if self._under_way_since is None:
            return END_S
        return max(0.0, END_S - (asyncio.get_running_loop().time() - self._under_way_since))

    def _finish_commit(self, batch: _Batch, begun: float, job: Future[bool]) -> None:
        if job.cancelled() or job.exception() is not None:
            return
        self._mark_committed(batch)
        if self._lost:
            self._queue_gap_row()
            self._has_work.set()
        in_time = asyncio.get_running_loop().time() - begun < self._answer_s
        if in_time:
            self._pause_s = RETRY_S[0]
        if self._outage is not None and self._outage.record_commit(in_time=in_time):
            self._recover(self._outage)

    def _mark_committed(self, batch: _Batch) -> None:
        """Mark a batch as being on the disk."""
        self._committed_upto = batch.upto
        del self._queue[: len(batch.rows)]
        self._changed = {lift: number for lift, number in self._changed.items() if number > batch.upto}
        for waiting in batch.rows:
            waiting.resolve(None)
        for number, future in self._waiters:
            if number <= batch.upto and not future.done():
                future.set_result(None)
        self._waiters = [entry for entry in self._waiters if not entry[1].done()]

    def _fail(self, failed: CommitFailed) -> DiskOutage:
        """Start or continue an outage; the first reason is reported, every new reason is logged."""
        why = trouble_text(failed)
        self.trouble = why
        outage = self._outage
        if outage is None:
            outage = self._outage = DiskOutage(_micros(self._clock()), why, self._commits_to_recover())
            _log.error("%s", why)
            self._report(why)
        elif outage.is_news(why):
            _log.error("%s", why)
        self._refuse_presses(why)
        return outage

    def _commits_to_recover(self) -> int:
        if self._last_outage is None:
            return COMMITS_TO_RECOVER
        outage, ended_at = self._last_outage
        soon = asyncio.get_running_loop().time() - ended_at < RELAPSE_S
        return min(2 * outage.commits_to_recover, MAX_COMMITS_TO_RECOVER) if soon else COMMITS_TO_RECOVER

    def _recover(self, outage: DiskOutage) -> None:
        self._outage, self.trouble = None, ""
        self._last_outage = outage, asyncio.get_running_loop().time()
        _log.warning("the store %s can be written again", self.where)
        self.note(outage.journal_row(_micros(self._clock())))
        self._report("")

    def _refuse_presses(self, why: str) -> None:
        for waiting in self._queue:
            waiting.resolve(why)

    def _time_out(self, answer: Future[str | None]) -> None:
        if not answer.done():
            answer.set_result(trouble_text(row_late(self.where, self._answer_s)))


@dataclass(frozen=True, slots=True)
class _Batch:
    records: Mapping[str, SavedLift]
    rows: list[_QueuedRow]
    upto: int
    """The number of the newest of them."""


def _micros(at: datetime) -> int:
    return (at - _EPOCH) // timedelta(microseconds=1)


def _ignore_report(why: str) -> None:
    """Ignore the report: `run` has not begun."""
