"""Commits what a site has to remember: one commit at a time, each with everything that waits. Nothing else waits for the disk."""

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
    CALM_COMMITS,
    MOST_COMMITS,
    RELAPSE_S,
    DiskOutage,
    consequence,
    crowded,
    late,
    no_thread,
    silent,
)
from lift_manager.store.store import PendingRow, Store

_log = logging.getLogger(__name__)

ANSWER_S = 2.0
"""Within this `before` is answered, and after it a disk that has not answered is told as one that fails. Chosen: a busy card takes a
second or two, and what a press was decided on counts no more after it (`max_age_s`, 1 s when not said)."""

LINGER_S = 0.005
"""How long rows and records that no press waits for wait for company. Chosen: the press that follows a request is ready 1 to 3 ms after it
on an idle computer, and then shares one flush with its session and the rows of the request (benchmarks/README.md)."""

RETRY_S = (1.0, 30.0)
"""First and longest pause after a commit that failed. Chosen: presses are back within half a minute after room was made."""

CHECK_S = 3600.0
"""From one look at age and size to the next."""

END_S = 0.5
"""How long the end waits for the file to be closed, the time included that the commit under way has taken already. Chosen: it is part
of the 5 s in which the process must be out, and a file that is not closed loses nothing."""

KEPT_ROWS = 10_000
"""Rows that wait in memory. Chosen: minutes of a busy site, and at most some 20 MB."""

LOG_PAGES_WORTH_TELLING = 16_000
"""64 MB: more than any burst; something keeps the log from being used again."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Result = TypeVar("Result")


class Jobs(Protocol):
    """Does one job after the other, as `drivers.thread.Worker` does in a thread."""

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Do a job. Raises OSError if that cannot begin."""
        ...

    def stop(self) -> None:
        """End after the jobs that there are."""
        ...


@dataclass(frozen=True, slots=True)
class _Waiting:
    noted: PendingRow
    answer: Future[str | None] | None = None

    def tell(self, why: str | None) -> None:
        if self.answer is not None and not self.answer.done():
            self.answer.set_result(why)


class Committer:
    """Keeps every row and the newest record of every lift until they are on the disk, or says what was lost.

    Implements Recorder. Memory leads the disk: what is kept is recalled at once, and never rolled back.
    """

    def __init__(
        self,
        store: Store,
        where: str,
        records: Mapping[str, SavedLift],
        *,
        jobs: Callable[[], Jobs] | None = lambda: Worker("lift-manager-store"),
        clock: Clock | None = None,
        kept_rows: int = KEPT_ROWS,
        answer_s: float = ANSWER_S,
    ) -> None:
        """Commit to a store that holds these records; `where` names it in messages.

        `jobs` makes what carries out the calls of the store; without it they take no time and are carried out at once. `kept_rows`
        is how many rows may wait in memory, `answer_s` how long a commit may take.
        """
        self.where = where
        self.trouble = ""
        """Why nothing can be written now, in words with what to do; empty while it can."""
        self._store = store
        self._jobs = jobs
        self._clock = clock or wall_clock(UTC)
        self._kept_rows = kept_rows
        self._answer_s = answer_s
        self._records = dict(records)
        self._changed: dict[str, int] = {}
        """The number of the newest change of each lift whose record is not on the disk."""
        self._queue: list[_Waiting] = []
        """Every row that is not known to be on the disk, the commit under way included."""
        self._number = 0
        """Of the newest row or record."""
        self._covered = 0
        """Up to this number everything is on the disk."""
        self._waiting: list[tuple[int, Future[None]]] = []
        """Futures, and the number that each waits for."""
        self._lost: Counter[str] = Counter()
        self._lost_since = 0
        self._news = asyncio.Event()
        """Something is to be committed."""
        self._urgent = asyncio.Event()
        """A press waits for it, or the end of the manager."""
        self._pause_s = RETRY_S[0]
        self._report: Callable[[str], None] = _nobody
        self._outage: DiskOutage | None = None
        self._last_outage: tuple[DiskOutage, float] | None = None
        """The one before it, and when that ended."""
        self._under_way_since: float | None = None
        """Since when the disk has a job that it has not done."""
        self._log_told = False

    @property
    def unwritten(self) -> Mapping[str, SavedLift]:
        """What a restart would forget, by lift."""
        return {lift: self._records[lift] for lift in self._changed}

    def recall(self, lift: str) -> SavedLift | None:
        """Return the newest record of a lift; None for a lift that nothing was ever kept of."""
        return self._records.get(lift)

    def keep(self, lift: str, record: SavedLift) -> None:
        """Have this record of a lift from now on, and commit it soon."""
        self._records[lift] = record
        self._number += 1
        self._changed[lift] = self._number
        self._begin_soon()

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once the newest record of a lift is on the disk; None where it is already."""
        return self._reached(self._changed[lift]) if lift in self._changed else None

    def note(self, row: Row) -> None:
        """Write this down soon, or count it as lost where too many wait."""
        if not self._accept(row, None):
            self._lost_since = self._lost_since or _micros(self._clock())
            self._lost[row.kind.value] += 1

    def before(self, row: Row) -> Future[str | None]:
        """Write this down, and tell within ANSWER_S whether it is on the disk, with all that was kept and noted before it.

        It is not kept where there is trouble already.
        """
        loop = asyncio.get_running_loop()
        answer: Future[str | None] = loop.create_future()
        if self.trouble:
            answer.set_result(self.trouble)
        elif not self._accept(row, answer):
            answer.set_result(consequence(crowded(self.where, len(self._queue))))
        elif not answer.done():
            self._urgent.set()
            too_late = loop.call_later(self._answer_s, self._too_late, answer)
            answer.add_done_callback(lambda _: too_late.cancel())
        return answer

    async def settled(self) -> None:
        """Return once everything so far is on the disk, and told is what was lost."""
        reached = self._reached(self._number + bool(self._lost))
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
        _log.info("what the lifts must remember, and the journal, are kept in %s", self.where)
        try:
            await self._work(jobs)
        finally:
            with suppress(OSError):  # without a thread there is nothing to close
                await asyncio.wait([jobs.submit(self._store.close)], timeout=self._end_s())
            jobs.stop()
            self._refuse("the manager ends")
            if self._queue or self._changed:
                lost = f"{counted(len(self._queue), 'row')} and {counted(len(self._changed), 'record')}"
                _log.error("%s did not reach the store %s", lost, self.where)

    def _accept(self, row: Row, answer: Future[str | None] | None) -> bool:
        if len(self._queue) >= self._kept_rows:
            return False
        self._tell_lost()
        self._put(row, answer)
        self._begin_soon()
        return True

    def _put(self, row: Row, answer: Future[str | None] | None = None) -> None:
        self._queue.append(_Waiting(PendingRow(_micros(self._clock()), row), answer))
        self._number += 1

    def _tell_lost(self) -> None:
        """Put what was lost in its place between the rows."""
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
        self._put(Row(RowKind.GAP, text, data=data))

    def _begin_soon(self) -> None:
        if self._jobs is not None:
            self._news.set()
            return
        batch = self._batch()
        self._store.commit(batch.records, [waiting.noted for waiting in batch.rows])
        self._reach(batch)

    def _reached(self, number: int) -> Future[None] | None:
        """Return what is done once everything up to this number is on the disk; None where it is already."""
        if number <= self._covered:
            return None
        future: Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((number, future))
        return future

    async def _work(self, jobs: Jobs) -> None:
        loop = asyncio.get_running_loop()
        check_at = loop.time()
        tending = await self._commit(jobs)  # a disk that takes nothing is known before the first press
        while True:
            if self._news.is_set() or self.trouble:
                await self._linger()
                tending |= await self._commit(jobs)
            check = loop.time() >= check_at
            if self._outage is not None:
                await self._pause(self._outage)
            elif tending or check:
                tending = await self._tend(jobs, check=check)
                check_at = loop.time() + CHECK_S if check else check_at
            else:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(check_at):
                        await self._news.wait()

    async def _linger(self) -> None:
        """Wait for company as long as no press waits."""
        if not self.trouble and not self._urgent.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(LINGER_S):
                    await self._urgent.wait()

    async def _pause(self, outage: DiskOutage) -> None:
        """Wait before the next trial; a disk that is only slow is tried with all that comes."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._pause_s):
                await (self._news.wait() if outage.taken else asyncio.Event().wait())
        self._pause_s = min(2 * self._pause_s, RETRY_S[1])

    def _batch(self) -> _Batch:
        """Take everything that waits: the newest record of every changed lift, and all rows."""
        self._news.clear()
        self._urgent.clear()
        return _Batch(self.unwritten, list(self._queue), self._number)

    async def _commit(self, jobs: Jobs) -> bool:
        """Commit what waits; returns whether the store wants to be tended."""
        batch = self._batch()
        rows = [waiting.noted for waiting in batch.rows]
        try:
            job = self._do(jobs, partial(self._store.commit, batch.records, rows))
            job.add_done_callback(partial(self._committed, batch, asyncio.get_running_loop().time()))
            return await self._result(job)
        except CommitFailed as error:
            self._fail(error).failed()
            return False

    async def _tend(self, jobs: Jobs, *, check: bool) -> bool:
        """Do one short step of upkeep; returns whether there is more to do."""
        try:
            job = self._do(jobs, partial(self._store.tend, _micros(self._clock()), check=check))
            tended = await self._result(job)
        except CommitFailed as error:
            # rows may still be written; if not, the next commit tells
            _log.warning("%s: the oldest rows were not cut off: %s", self.where, error)
            return False
        if tended.log_pages > LOG_PAGES_WORTH_TELLING and not self._log_told:
            self._log_told = True
            _log.warning("%s-wal grows because another program reads it all the time; end that one", self.where)
        return tended.more

    def _do(self, jobs: Jobs, work: Callable[[], Result]) -> Future[Result]:
        try:
            return jobs.submit(work)
        except OSError as error:
            raise no_thread(self.where, error) from error

    async def _result(self, job: Future[Result]) -> Result:
        """Wait for the disk; after ANSWER_S its silence is told. A job that is under way is not given up with the wait."""
        loop = asyncio.get_running_loop()
        silence = loop.call_later(self._answer_s, self._silent)
        self._under_way_since = loop.time()
        try:
            await asyncio.wait([job])
        finally:
            silence.cancel()
            if job.done():
                self._under_way_since = None
        return job.result()

    def _silent(self) -> None:
        self._fail(silent(self.where, self._answer_s)).late()

    def _end_s(self) -> float:
        """Return how long to wait for the file to be closed: not anew for a disk that is silent already."""
        if self._under_way_since is None:
            return END_S
        return max(0.0, END_S - (asyncio.get_running_loop().time() - self._under_way_since))

    def _committed(self, batch: _Batch, begun: float, job: Future[bool]) -> None:
        if job.cancelled() or job.exception() is not None:
            return
        self._reach(batch)
        if self._lost:
            self._tell_lost()
            self._news.set()
        in_time = asyncio.get_running_loop().time() - begun < self._answer_s
        if in_time:
            self._pause_s = RETRY_S[0]
        if self._outage is not None and self._outage.over(in_time=in_time):
            self._recover(self._outage)

    def _reach(self, batch: _Batch) -> None:
        """Take it that a batch is on the disk."""
        self._covered = batch.upto
        del self._queue[: len(batch.rows)]
        self._changed = {lift: number for lift, number in self._changed.items() if number > batch.upto}
        for waiting in batch.rows:
            waiting.tell(None)
        for number, future in self._waiting:
            if number <= batch.upto and not future.done():
                future.set_result(None)
        self._waiting = [entry for entry in self._waiting if not entry[1].done()]

    def _fail(self, failed: CommitFailed) -> DiskOutage:
        """Take it that nothing can be written; told is only the first reason of an outage, logged each."""
        why = consequence(failed)
        self.trouble = why
        outage = self._outage
        if outage is None:
            outage = self._outage = DiskOutage(_micros(self._clock()), why, self._calm_commits())
            _log.error("%s", why)
            self._report(why)
        elif outage.is_news(why):
            _log.error("%s", why)
        self._refuse(why)
        return outage

    def _calm_commits(self) -> int:
        if self._last_outage is None:
            return CALM_COMMITS
        outage, ended_at = self._last_outage
        soon = asyncio.get_running_loop().time() - ended_at < RELAPSE_S
        return min(2 * outage.calm_commits, MOST_COMMITS) if soon else CALM_COMMITS

    def _recover(self, outage: DiskOutage) -> None:
        self._outage, self.trouble = None, ""
        self._last_outage = outage, asyncio.get_running_loop().time()
        _log.warning("the store %s is written again", self.where)
        self.note(outage.row(_micros(self._clock())))
        self._report("")

    def _refuse(self, why: str) -> None:
        for waiting in self._queue:
            waiting.tell(why)

    def _too_late(self, answer: Future[str | None]) -> None:
        if not answer.done():
            answer.set_result(consequence(late(self.where, self._answer_s)))


@dataclass(frozen=True, slots=True)
class _Batch:
    records: Mapping[str, SavedLift]
    rows: list[_Waiting]
    upto: int
    """The number of the newest of them."""


def _micros(at: datetime) -> int:
    return (at - _EPOCH) // timedelta(microseconds=1)


def _nobody(why: str) -> None:
    """Hear nothing: `run` has not begun."""
