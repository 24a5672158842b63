"""The Journal of a site on disk: what is noted is written by one thread, everything that waits in one commit."""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from asyncio import Future
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TypeVar

from drivers.thread import Worker
from lift_manager.core.journal import Hears
from lift_manager.core.memory import Clock, wall_clock
from lift_manager.domain.journal import Json, Row, RowKind
from lift_manager.store.errors import JournalOfAnother, StoreError
from lift_manager.store.journal.chain import canonical, clean
from lift_manager.store.journal.database import Connect, connect
from lift_manager.store.journal.file import LOG_PAGES_WORTH_TELLING, Entry, JournalFile
from lift_manager.store.journal.retention import Limits
from lift_manager.store.journal.spell import CALM_COMMITS, MOST_COMMITS, RELAPSE_S, Spell
from lift_manager.store.journal.words import crowded, in_words, late, silent, uncut

_log = logging.getLogger(__name__)

ANSWER_S = 2.0
"""Within this `before` is answered, and after it a disk that has not answered is told as one that fails. Chosen: a busy card takes a
second or two, and what a press was decided on counts no more after it (`max_age_s`, 1 s when not said)."""

RETRY_S = (1.0, 30.0)
"""First and longest pause after a commit that failed. Chosen: presses are back within half a minute after room was made."""

CHECK_S = 3600.0
"""From one look at age and size to the next."""

END_S = 0.5
"""How long the end waits for the file to be closed, the time included that the commit under way has taken already. Chosen: it is part
of the 5 s in which the process must be out, and a file that is not closed loses nothing."""

KEPT_ROWS = 10_000
"""Rows that wait in memory. Chosen: minutes of a busy site, and at most some 20 MB."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class _Waiting:
    entry: Entry
    answer: Future[str | None] | None = None

    def tell(self, why: str | None) -> None:
        if self.answer is not None and not self.answer.done():
            self.answer.set_result(why)


class SqliteJournal:
    """Keeps every row until it is on the disk, or says how many were lost. Only `run` waits for the disk, and only in a thread."""

    def __init__(self, file: JournalFile, clock: Clock, kept_rows: int = KEPT_ROWS, answer_s: float = ANSWER_S) -> None:
        """Write to this file; `kept_rows` is how many rows may wait in memory, `answer_s` how long a commit may take."""
        self.path = file.path
        self.trouble = ""
        """Why no row can be written now, in words with what to do; empty while rows can be written."""
        self._file = file
        self._clock = clock
        self._kept_rows = kept_rows
        self._answer_s = answer_s
        self._queue: list[_Waiting] = []
        """Everything that is not known to be on the disk, the commit under way included."""
        self._lost: Counter[str] = Counter()
        self._lost_since = 0
        self._news = asyncio.Event()
        self._accepted = 0
        self._written = 0
        self._settling: list[tuple[int, Future[None]]] = []
        self._pause_s = RETRY_S[0]
        self._hears: Hears = _nobody
        self._spell: Spell | None = None
        """The trouble that there is."""
        self._last: tuple[Spell, float] | None = None
        """The one before it, and when that ended."""
        self._under_way_since: float | None = None
        """Since when the disk has a job that it has not done."""
        self._log_told = False
        self._refusal = ""
        """What was told last of an anchor that is not believed."""

    def note(self, row: Row) -> None:
        """Write this down soon, or count it as lost where too many wait."""
        if not self._accept(row, None):
            self._lost_since = self._lost_since or _micros(self._clock())
            self._lost[row.kind.value] += 1

    def before(self, row: Row) -> Future[str | None]:
        """Write this down, and tell within ANSWER_S whether it is on the disk. It is not kept where there is trouble already."""
        loop = asyncio.get_running_loop()
        answer: Future[str | None] = loop.create_future()
        if self.trouble:
            answer.set_result(self.trouble)
        elif not self._accept(row, answer):
            answer.set_result(crowded(self.path, len(self._queue)))
        else:
            late = loop.call_later(self._answer_s, self._too_late, answer)
            answer.add_done_callback(lambda _: late.cancel())
        return answer

    async def run(self, hears: Hears) -> None:
        """Write what is noted until cancelled."""
        self._hears = hears
        worker = Worker("lift-manager-journal")
        _log.info("what is done with the lifts is written to the journal %s", self.path)
        try:
            await self._work(worker)
        finally:
            with suppress(OSError):  # without a thread there is nothing to close
                await asyncio.wait([worker.do(self._file.close)], timeout=self._end_s())
            worker.stop()
            self._refuse("the manager ends")
            if self._queue:
                _log.error("%d row(s) did not reach the journal %s", len(self._queue), self.path)

    async def settled(self) -> None:
        """Return once everything noted so far is on the disk, and told is what was lost."""
        upto = self._accepted + bool(self._lost)
        if self._written < upto:
            settled: Future[None] = asyncio.get_running_loop().create_future()
            self._settling.append((upto, settled))
            await settled

    def _accept(self, row: Row, answer: Future[str | None] | None) -> bool:
        if len(self._queue) >= self._kept_rows:
            return False
        self._tell_lost()
        self._queue.append(_Waiting(self._entry(row), answer))
        self._accepted += 1
        self._news.set()
        return True

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
        self._queue.append(_Waiting(self._entry(Row(RowKind.GAP, text, data=data))))
        self._accepted += 1
        self._lost.clear()
        self._lost_since = 0

    def _entry(self, row: Row) -> Entry:
        at = _micros(self._clock())
        return Entry(at, row.kind.value, clean(row.lift), clean(row.caller), clean(row.text), canonical(row.told))

    async def _work(self, worker: Worker) -> None:
        loop = asyncio.get_running_loop()
        check_at = loop.time()
        tending = await self._write(worker)  # a disk that takes no row is known before the first press
        while True:
            self._news.clear()
            if self._queue or self.trouble:
                tending |= await self._write(worker)
            check = loop.time() >= check_at
            if self._spell is not None:
                await self._pause(self._spell)
            elif tending or check:
                tending = await self._tend(worker, check=check)
                check_at = loop.time() + CHECK_S if check else check_at
            elif not self._queue:
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(check_at):
                        await self._news.wait()

    async def _pause(self, spell: Spell) -> None:
        """Wait before the next trial; a disk that is only slow is tried with every row that comes."""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._pause_s):
                await (self._news.wait() if spell.taken else asyncio.Event().wait())
        self._pause_s = min(2 * self._pause_s, RETRY_S[1])

    async def _write(self, worker: Worker) -> bool:
        """Write what waits; returns whether the file wants to be tended."""
        batch = list(self._queue)
        try:
            job = worker.do(partial(self._file.write, [waiting.entry for waiting in batch]))
            job.add_done_callback(partial(self._committed, batch, asyncio.get_running_loop().time()))
            return await self._result(job)
        except _DISK as error:
            _raise_if_bug(error)
            self._fail(in_words(self.path, error)).failed()
            return False

    async def _tend(self, worker: Worker, *, check: bool) -> bool:
        """Do one short piece of care for the file; returns whether there is more to do."""
        try:
            tended = await self._result(worker.do(partial(self._file.tend, _micros(self._clock()), check=check)))
        except _DISK as error:
            _raise_if_bug(error)
            # rows may still be written; if not, the next one tells
            _log.warning("%s", uncut(self.path, error))
            return False
        if tended.anchor is not None:
            self.note(tended.anchor)
        if tended.refusal not in ("", self._refusal):
            self._refusal = tended.refusal
            _log.error("%s: %s", self.path, tended.refusal)
        if tended.log_pages > LOG_PAGES_WORTH_TELLING and not self._log_told:
            self._log_told = True
            _log.warning("%s-wal grows because another program reads the journal all the time; end that one", self.path)
        return tended.more

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
        self._fail(silent(self.path, self._answer_s)).late()

    def _end_s(self) -> float:
        """Return how long to wait for the file to be closed: not anew for a disk that is silent already."""
        if self._under_way_since is None:
            return END_S
        return max(0.0, END_S - (asyncio.get_running_loop().time() - self._under_way_since))

    def _committed(self, batch: list[_Waiting], begun: float, job: Future[bool]) -> None:
        if job.cancelled() or job.exception() is not None:
            return
        del self._queue[: len(batch)]
        self._written += len(batch)
        for waiting in batch:
            waiting.tell(None)
        if self._lost:
            self._tell_lost()
        for upto, settled in self._settling:
            if upto <= self._written and not settled.done():
                settled.set_result(None)
        self._settling = [entry for entry in self._settling if not entry[1].done()]
        in_time = asyncio.get_running_loop().time() - begun < self._answer_s
        if in_time:
            self._pause_s = RETRY_S[0]
        if self._spell is not None and self._spell.over(in_time=in_time):
            self._recover(self._spell)

    def _fail(self, why: str) -> Spell:
        """Take it that rows cannot be written; told is only the first reason of a spell, logged each."""
        self.trouble = why
        spell = self._spell
        if spell is None:
            spell = self._spell = Spell(_micros(self._clock()), why, self._calm_commits())
            _log.error("%s", why)
            self._hears(why)
        elif spell.is_news(why):
            _log.error("%s", why)
        self._refuse(why)
        return spell

    def _calm_commits(self) -> int:
        if self._last is None:
            return CALM_COMMITS
        spell, ended_at = self._last
        soon = asyncio.get_running_loop().time() - ended_at < RELAPSE_S
        return min(2 * spell.calm_commits, MOST_COMMITS) if soon else CALM_COMMITS

    def _recover(self, spell: Spell) -> None:
        self._spell, self.trouble = None, ""
        self._last = spell, asyncio.get_running_loop().time()
        _log.warning("the journal %s is written again", self.path)
        self.note(spell.row(_micros(self._clock())))
        self._hears("")

    def _refuse(self, why: str) -> None:
        for waiting in self._queue:
            waiting.tell(why)

    def _too_late(self, answer: Future[str | None]) -> None:
        if not answer.done():
            answer.set_result(late(self.path, self._answer_s))


_DISK = (sqlite3.DatabaseError, OSError, StoreError)


def opened_journal(
    path: Path,
    site: str,
    *,
    keep_days: int,
    max_mb: int,
    clock: Clock | None = None,
    connect: Connect = connect,
    kept_rows: int = KEPT_ROWS,
) -> SqliteJournal:
    """Make the journal of a site, or see that it can be written to. Raises JournalOfAnother.

    A disk that is full, read-only or broken, and a journal that is damaged, are no error here but trouble, told by `run`: a
    manager has to start for all that, to let go of what it held. No other process may write to it for as long as the
    SqliteJournal lives.
    """
    file = JournalFile(path, site, Limits(keep_days, max_mb), connect)
    begins = not path.exists()
    try:
        file.open()
    except JournalOfAnother:
        raise
    except _DISK as error:
        _raise_if_bug(error)
    finally:
        file.close()
    if begins:
        _tell_others(path)
    return SqliteJournal(file, clock or wall_clock(UTC), kept_rows)


def _tell_others(path: Path) -> None:
    """Say which journals lie beside one that begins: it may be of a site that has another name since."""
    others = [str(other) for other in sorted(path.parent.glob("*.journal.db")) if other != path]
    if others:
        text = "the journal %s begins; another journal lies beside it: %s; `lift-manager audit --journal FILE` reads it"
        _log.warning(text, path, ", ".join(others))


def _micros(at: datetime) -> int:
    return (at - _EPOCH) // timedelta(microseconds=1)


def _nobody(why: str) -> None:
    """Hear nothing: `run` has not begun."""


def _raise_if_bug(error: Exception) -> None:
    if isinstance(error, sqlite3.ProgrammingError):
        raise error
