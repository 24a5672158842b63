"""A simulated disk, and a manager's memory and journal on it: commits take time, fail and hang. Time is the loop's.

On a virtual loop nothing waits in real time, and the time that a commit takes depends on its seed and the moment at which
it begins alone: one commit more or less does not change how long the later ones take.
"""

from __future__ import annotations

import asyncio
import errno
import math
import os
from asyncio import Future
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum, unique
from functools import partial
from random import Random

from lift_manager.core.journal import Hears
from lift_manager.core.memory import Trouble
from lift_manager.domain.journal import Row
from lift_manager.domain.service import Remembered
from lift_manager.store.journal.writer import ANSWER_S
from lift_manager.store.journal.writer import RETRY_S as JOURNAL_RETRY_S
from lift_manager.store.state_file import RETRY_S as STATE_RETRY_S
from lift_manager.store.state_file import SLOW_S

SLOT_S = 0.25
"""Commits of one file that begin within one slot of this length take the same time. Chosen: about as long as the commits of a busy moment."""


@unique
class DiskFault(StrEnum):
    """What may be wrong with a disk; it lasts until it is ended."""

    FULL = "full"
    """Every commit fails."""
    HANGS = "hangs"
    """No commit ends."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long commits take: most of them hardly more than `least_s`, none longer than `most_s`."""

    least_s: float
    most_s: float


class SimulatedDisk:
    """Holds what was committed: it outlives every manager. Without a pace a commit takes no time and cannot fail."""

    def __init__(self, pace: Pace | None = None, *, seed: int = 0, keep: int = 10_000) -> None:
        """Keep the newest `keep` rows."""
        self.states: dict[str, Remembered] = {}
        self.rows: list[Row] = []
        self.on_noted: list[Callable[[Row], None]] = []
        """Called with every row as soon as the manager has noted it."""
        self.on_committed: list[Callable[[Sequence[Row]], None]] = []
        """Called with the rows of each commit once they are on the disk."""
        self._pace = pace
        self._seed = seed
        self._keep = keep
        self._faults: list[DiskFault] = []
        self._mended = asyncio.Event()

    @property
    def instant(self) -> bool:
        """Whether commits take no time."""
        return self._pace is None

    def begin(self, fault: DiskFault) -> None:
        """Let something go wrong. Raises ValueError for a disk without a pace."""
        if self._pace is None:
            raise ValueError("a disk whose commits take no time cannot fail; give it a pace")
        self._faults.append(fault)

    def end(self, fault: DiskFault) -> None:
        """End one fault of this kind."""
        self._faults.remove(fault)
        self._mended.set()

    def put_states(self, states: Mapping[str, Remembered]) -> None:
        """Have these on the disk."""
        self.states |= states

    def put_rows(self, rows: Sequence[Row]) -> None:
        """Have these on the disk, behind the others."""
        self.rows += rows
        if len(self.rows) > 2 * self._keep:
            del self.rows[: -self._keep]
        for hear in self.on_committed:
            hear(rows)

    async def commit(self, file: str, put: Callable[[], None]) -> None:
        """Wait for as long as the disk takes for this file, then `put` everything at once. Raises OSError where the disk fails.

        A commit that is cancelled, as by the death of its process, has reached the disk or not.
        """
        begun = _now()
        takes_s, luck = self._draw(file, begun)
        try:
            await asyncio.sleep(takes_s)
            while DiskFault.HANGS in self._faults:
                self._mended.clear()
                await self._mended.wait()
        except asyncio.CancelledError:
            if not self._faults and _now() - begun > luck * takes_s:
                put()
            raise
        if DiskFault.FULL in self._faults:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put()

    def _draw(self, file: str, now: float) -> tuple[float, float]:
        if self._pace is None:
            return 0.0, 0.0
        chance = Random(f"{self._seed} {file} {math.floor(now / SLOT_S)}")  # noqa: S311 - seeded so that a run can be repeated
        least_s, most_s = self._pace.least_s, self._pace.most_s
        return least_s * (most_s / least_s) ** (chance.random() ** 2), chance.random()


class DiskMemory:
    """The Memory of one manager on a simulated disk; another manager needs another one."""

    def __init__(self, disk: SimulatedDisk) -> None:
        self._disk = disk
        self._kept = dict(disk.states)
        self._versions: dict[str, int] = {}
        """How often something was kept of each lift."""
        self._committed: dict[str, int] = {}
        """Which of these versions is on the disk."""
        self._waiting: list[tuple[str, int, Future[None]]] = []
        self._news = asyncio.Event()
        self._why = ""
        self._reported: set[str] = set()
        self._dropped = False

    @property
    def trouble(self) -> str:
        """Why nothing can be written now; empty while it can."""
        return f"the state cannot be written to the simulated disk ({self._why}); end its fault" if self._why else ""

    @property
    def unwritten(self) -> Mapping[str, Remembered]:
        """What a restart would forget, by lift."""
        return {lift: self._kept[lift] for lift, version in self._versions.items() if version != self._on_disk(lift)}

    def drop(self) -> None:
        """Write nothing any more: its manager was killed."""
        self._dropped = True

    def written(self, lift: str) -> Future[None] | None:
        """Return what is done once everything kept of a lift so far is committed; None where it is already."""
        version = self._versions.get(lift, 0)
        if version == self._on_disk(lift):
            return None
        done: Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.append((lift, version, done))
        return done

    def recall(self, lift: str) -> Remembered:
        """Return what was kept last."""
        return self._kept.get(lift, Remembered())

    def keep(self, lift: str, remembered: Remembered) -> None:
        """Remember this, and have `run` write it."""
        self._kept[lift] = remembered
        self._versions[lift] = self._versions.get(lift, 0) + 1
        if self._dropped:
            return
        if self._disk.instant:
            self._put({lift: self._versions[lift]}, {lift: remembered})
        else:
            self._news.set()

    async def run(self, trouble: Trouble) -> None:
        """Commit what is kept until cancelled; after a failure again after a pause, or with the next news."""
        pause_s = STATE_RETRY_S[0]
        loop = asyncio.get_running_loop()
        while True:
            if not self.unwritten:
                self._news.clear()
                await self._news.wait()
            self._news.clear()
            taken, versions = self.unwritten, dict(self._versions)
            silence = loop.call_later(SLOW_S, self._report, taken, "the disk does not answer", trouble)
            try:
                await self._disk.commit("state", partial(self._put, versions, taken))
            except OSError as error:
                self._report(taken, error.strerror or str(error), trouble)
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause_s):
                        await self._news.wait()
                pause_s = min(2 * pause_s, STATE_RETRY_S[1])
            else:
                pause_s, self._why = STATE_RETRY_S[0], ""
                self._reported.clear()
            finally:
                silence.cancel()

    async def settled(self) -> None:
        """Return once everything kept so far is committed."""
        waiting = [done for lift in self.unwritten if (done := self.written(lift)) is not None]
        if waiting:
            await asyncio.wait(waiting)

    def _on_disk(self, lift: str) -> int:
        return self._committed.get(lift, 0)

    def _put(self, versions: Mapping[str, int], states: Mapping[str, Remembered]) -> None:
        self._disk.put_states(states)
        self._committed |= versions
        for lift, version, done in self._waiting:
            if version <= self._on_disk(lift) and not done.done():
                done.set_result(None)
        self._waiting = [entry for entry in self._waiting if not entry[2].done()]

    def _report(self, lifts: Mapping[str, Remembered], why: str, trouble: Trouble) -> None:
        self._why = why
        for lift in sorted(lifts.keys() - self._reported):
            trouble(lift, f"state: what concerns {lift} cannot be written to the simulated disk ({why})")
            self._reported.add(lift)


class DiskJournal:
    """The Journal of one manager on a simulated disk; another manager needs another one."""

    def __init__(self, disk: SimulatedDisk) -> None:
        self.trouble = ""
        """Why no row can be written now; empty while rows can be written."""
        self._disk = disk
        self._queue: list[tuple[Row, Future[str | None] | None]] = []
        """What is not on the disk, the commit under way included."""
        self._settling: list[tuple[int, Future[None]]] = []
        self._accepted = 0
        self._committed = 0
        self._news = asyncio.Event()
        self._hears: Hears = lambda _: None
        self._dropped = False

    def drop(self) -> None:
        """Write nothing any more: its manager was killed."""
        self._dropped = True
        self._queue.clear()

    def note(self, row: Row) -> None:
        """Have `run` write this down."""
        self._accept(row, None)

    def before(self, row: Row) -> Future[str | None]:
        """Have this written down, and answer within ANSWER_S."""
        loop = asyncio.get_running_loop()
        answer: Future[str | None] = loop.create_future()
        if self.trouble:
            answer.set_result(self.trouble)
            return answer
        self._accept(row, answer)
        if not answer.done():
            late = loop.call_later(ANSWER_S, self._late, answer)
            answer.add_done_callback(lambda _: late.cancel())
        return answer

    async def run(self, hears: Hears) -> None:
        """Commit what is noted until cancelled, all that waits at once."""
        self._hears = hears
        pause_s = JOURNAL_RETRY_S[0]
        first = True
        while True:
            if not (first or self._queue or self.trouble):
                self._news.clear()
                await self._news.wait()
            first = False
            batch = list(self._queue)
            began = _now()
            silence = asyncio.get_running_loop().call_later(ANSWER_S, self._fail, "the disk does not answer")
            try:
                await self._disk.commit("journal", partial(self._put, batch))
            except OSError as error:
                self._fail(error.strerror or str(error))
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, JOURNAL_RETRY_S[1])
                continue
            finally:
                silence.cancel()
            if _now() - began < ANSWER_S:
                pause_s = JOURNAL_RETRY_S[0]
                if self.trouble:
                    self.trouble = ""
                    hears("")

    async def settled(self) -> None:
        """Return once everything noted so far is committed."""
        if self._committed < self._accepted:
            done: Future[None] = asyncio.get_running_loop().create_future()
            self._settling.append((self._accepted, done))
            await done

    def _accept(self, row: Row, answer: Future[str | None] | None) -> None:
        if self._dropped:
            return
        for hear in self._disk.on_noted:
            hear(row)
        self._accepted += 1
        self._queue.append((row, answer))
        if self._disk.instant:
            self._put(list(self._queue))
        else:
            self._news.set()

    def _put(self, batch: Sequence[tuple[Row, Future[str | None] | None]]) -> None:
        self._disk.put_rows([row for row, _ in batch])
        del self._queue[: len(batch)]
        self._committed += len(batch)
        for _, answer in batch:
            if answer is not None and not answer.done():
                answer.set_result(None)
        for upto, done in self._settling:
            if upto <= self._committed and not done.done():
                done.set_result(None)
        self._settling = [entry for entry in self._settling if not entry[1].done()]

    def _fail(self, why: str) -> None:
        text = f"no row can be written to the simulated disk ({why}); end its fault"
        if not self.trouble:
            self._hears(text)
        self.trouble = text
        for _, answer in self._queue:
            if answer is not None and not answer.done():
                answer.set_result(text)

    @staticmethod
    def _late(answer: Future[str | None]) -> None:
        if not answer.done():
            answer.set_result(f"the simulated disk has not answered for {ANSWER_S:g} s")


def _now() -> float:
    return asyncio.get_running_loop().time()
