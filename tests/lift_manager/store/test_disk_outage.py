"""A disk that is slow rather than broken: one trouble, told once, and one row of it when it is over."""

import asyncio
import json
import sqlite3
from asyncio import Future
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import pytest

from lift_manager.lift.events import Alarm
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.bus import Event
from lift_manager.runtime.recorder import MemoryRecorder
from lift_manager.store.committer import ANSWER_S, Committer
from lift_manager.store.outage import COMMITS_TO_RECOVER
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from tests.lift_manager.runtime.scripted import Bench, on_bench
from tests.lift_manager.store.journal_disk import SITE, Disk, journal, press, read_only, stored, usual, writing
from tests.support.virtual_time import run_virtual

Result = TypeVar("Result")

SLOW_S, QUICK_S = ANSWER_S + 0.5, 0.0


class SlowDisk:
    """Carries out the calls of a real store, and says when it has taken as long as its commits should have."""

    def __init__(self) -> None:
        self.then_s = QUICK_S
        """What commits take once the given ones are used up."""
        self.commits: list[float] = []
        self.count = 0
        self._takes_s = 0.0

    def slow(self, *commits: float, then_s: float = QUICK_S) -> None:
        """Take so long for the commits that follow, and then `then_s` for every other."""
        self.commits, self.then_s, self.count = list(commits), then_s, 0

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        loop = asyncio.get_running_loop()
        done: Future[Result] = loop.create_future()
        self._takes_s = 0.0
        result = work()
        loop.call_later(self._takes_s, lambda: None if done.done() else done.set_result(result))
        return done

    def stop(self) -> None:
        pass

    def committing(self, connection: sqlite3.Connection, sql: str) -> None:
        """See each statement before it is executed."""
        if sql == "COMMIT":
            self.count += 1
            self._takes_s += self.commits.pop(0) if self.commits else self.then_s


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.db"


def kept_on(path: Path, disk: SlowDisk) -> Committer:
    """Keep a journal there, on virtual time."""
    store = SqliteStore(path, SITE, Limits(400, 500), Disk(disk.committing))
    return Committer(store, str(path), store.load(), jobs=lambda: disk)


async def busy_until_over(kept: Committer) -> None:
    """Note a row for each commit, so that nobody waits for a trial."""
    while kept.trouble:
        kept.note(press(100))
        await kept.settled()


def told_by(path: Path, commits: Sequence[float]) -> list[str]:
    """Note one row on a disk that takes so long for its commits; returns what is told until it is over."""

    async def main() -> list[str]:
        disk = SlowDisk()
        kept = kept_on(path, disk)
        heard: list[str] = []
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.slow(*commits)
            kept.note(press(1))
            heard.append(await told.get())
            await busy_until_over(kept)
            while not told.empty():
                heard.append(told.get_nowait())
        return heard

    return run_virtual(main)


def test_a_commit_that_ended_too_late_is_no_recovery_and_nobody_has_to_hear_of_it_again(path: Path) -> None:
    async def main() -> None:
        disk = SlowDisk()
        kept = kept_on(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.slow(then_s=SLOW_S)
            kept.note(press(1))
            assert "the disk has not answered for" in await told.get()
            for number in range(4):
                kept.note(press(2 + number))
                await kept.settled()
            assert disk.count >= 3
            assert kept.commit_now(press(2)).result() == kept.trouble != ""
            assert told.empty()

    run_virtual(main)
    assert {row.kind for row in stored(path)} == {"press"}


def test_a_disk_that_is_slow_every_other_time_does_not_flicker(path: Path) -> None:
    quick = [QUICK_S] * (COMMITS_TO_RECOVER - 1)
    why, end = told_by(path, [SLOW_S, *quick, SLOW_S, *quick, QUICK_S])
    assert ("the disk has not answered" in why, end) == (True, "")


def test_a_disk_that_is_silent_again_soon_has_to_be_in_time_twice_as_often(path: Path) -> None:
    async def main() -> list[int]:
        disk = SlowDisk()
        kept = kept_on(path, disk)
        needed = []
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            for number in range(2):
                disk.slow(SLOW_S)
                kept.note(press(number + 1))
                assert await told.get()
                await busy_until_over(kept)
                assert await told.get() == ""
                needed.append(disk.count - 1)
                await kept.settled()
        return needed

    assert run_virtual(main) == [COMMITS_TO_RECOVER, 2 * COMMITS_TO_RECOVER]


def test_a_trouble_that_is_over_is_one_row_for_the_site_and_says_from_when_to_when_and_why(path: Path) -> None:
    async def main() -> None:
        disk = Disk()
        kept = journal(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.hook = read_only
            kept.note(press(1))
            assert "may only read it" in await told.get()
            disk.hook = usual
            assert await told.get() == ""
            await kept.settled()

    asyncio.run(main())
    rows = stored(path)
    assert [(row.kind, row.lift) for row in rows] == [("press", "east"), ("press", "east"), ("alarm", "")]
    assert rows[-1].text.startswith("no row could be written for ")
    assert "this user may only read it" in rows[-1].text
    data = json.loads(rows[-1].data)
    assert rows[1].at <= data["from"] <= data["to"] <= rows[-1].at


def test_while_nothing_waits_it_is_tried_with_a_real_write(path: Path) -> None:
    """A commit of nothing never reaches the disk, and would say that a slow one has recovered."""
    log = path.with_name(f"{path.name}-wal")

    async def main() -> None:
        disk = SlowDisk()
        kept = kept_on(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            before = log.stat().st_size
            disk.slow(SLOW_S)
            kept.note(press(1))
            assert await told.get()
            assert await told.get() == ""
            page_and_head = 4096 + 24
            assert log.stat().st_size >= before + (1 + COMMITS_TO_RECOVER) * page_and_head

    run_virtual(main)


class Troubled(MemoryRecorder):
    """Reports trouble and its end as soon as it runs."""

    async def run(self, report: Callable[[str], None]) -> None:
        report("the disk is full")
        report("")


def test_listeners_hear_of_each_lift_and_the_journal_does_not_write_of_itself() -> None:
    events: list[Event] = []
    recorder = Troubled()

    async def check(made: Bench) -> None:
        noted = len(recorder.rows)
        with made.bus.listen() as subscription:
            await recorder.run(made.site.report_disk)
            events.extend([await subscription.next(), await subscription.next()])
        assert recorder.rows[noted:] == []
        made.actor.publish(Alarm("lift", "the door is blocked"))
        assert recorder.rows[noted:] == [Row(RowKind.ALARM, "the door is blocked", "lift")]

    on_bench(check, recorder=recorder)
    assert [event.text for event in events if isinstance(event, Alarm)] == [
        "the disk is full",
        "journal: rows are written again; robots are taken as before",
    ]
