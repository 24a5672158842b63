"""Commits to the disk: what they take with them, what happens when the disk refuses, and that nothing is lost or told twice."""

import asyncio
import json
import shutil
import sqlite3
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import closing
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.committer import END_S, Committer
from lift_manager.store.site import read_records_of_site
from tests.lift_manager.store.journal_disk import (
    LIFTS,
    SITE,
    Disk,
    Hanging,
    full,
    journal,
    numbers,
    opened_raw,
    press,
    read_only,
    stored,
    usual,
    write_presses,
    writing,
    written,
)
from tests.lift_manager.store.test_recall_contract import EVERYTHING
from tests.lift_manager.store.test_site_store import FIRE
from tests.support.programs import HANGS_S, eventually, soon

LARGE = "x" * 20_000
"""More than the two pages that a full disk still has."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file in a folder that is not there yet."""
    return tmp_path / "var" / "lib" / "site.db"


async def trouble(kept: Committer, words: str) -> None:
    """Wait until it says so."""
    await asyncio.to_thread(eventually, lambda: words in kept.trouble)


def kept_of(path: Path) -> Mapping[str, SavedLift]:
    return read_records_of_site(path, SITE, LIFTS)


@pytest.fixture
def hanging() -> Iterator[Hanging]:
    disk = Hanging()
    disk.through.set()
    yield disk
    disk.through.set()


def test_the_files_are_for_their_user_alone(path: Path) -> None:
    async def main() -> None:
        kept = journal(path)
        async with writing(kept):
            assert await kept.commit_now(press(1)) is None
            seen = {file.name: file.stat().st_mode & 0o777 for file in path.parent.iterdir()}
            assert seen == {path.name + end: 0o600 for end in ("", "-wal", "-shm", ".lock")}
        assert sorted(path.parent.iterdir()) == [path, path.with_name(f"{path.name}.lock")]

    asyncio.run(main())
    assert path.parent.stat().st_mode & 0o777 == 0o700


def test_a_row_holds_what_was_said_and_when_it_was_noted(path: Path) -> None:
    at = datetime(2026, 3, 2, 21, 30, 5, 250_001, tzinfo=UTC)

    async def main() -> None:
        times = iter([at, at.replace(year=1999)])  # a clock may be set back
        kept = journal(path, clock=lambda: next(times, at))
        kept.note(Row(RowKind.REQUEST, "L3, door open", "east", "rmf:robot1", {"floor": "L3", "door": None}))
        kept.note(Row(RowKind.MANAGER, "ends"))
        await written(kept)

    asyncio.run(main())
    first, second = stored(path)
    assert first[:7] == (
        1,
        1_772_487_005_250_001,
        "request",
        "east",
        "rmf:robot1",
        "L3, door open",
        '{"door":null,"floor":"L3"}',
    )
    assert second.at < first.at


def test_numbers_go_on_after_a_restart(path: Path) -> None:
    for begin in (0, 5, 10):
        write_presses(path, begin + 5, begin=begin)
    assert [row.seq for row in stored(path)] == list(range(1, 16))
    assert numbers(path) == list(range(15))


def test_everything_that_waits_when_a_commit_begins_is_one_commit(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        disk = Disk(hanging)
        kept = journal(path, disk)
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            first = kept.commit_now(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            disk.statements.clear()
            others = [kept.commit_now(press(number)) for number in range(2, 102)]
            hanging.through.set()
            assert set(await asyncio.gather(first, *others)) == {None}
            assert disk.statements.count("BEGIN IMMEDIATE") == 1

    asyncio.run(main())
    assert numbers(path) == list(range(102))


def test_a_press_its_record_and_the_rows_before_it_are_one_commit(path: Path) -> None:
    disk = Disk()

    async def main() -> None:
        kept = journal(path, disk)
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            disk.statements.clear()
            kept.keep("east", FIRE)
            kept.note(Row(RowKind.REQUEST, "L3", "east"))
            session = kept.written("east")
            assert await kept.commit_now(press(1)) is None
            assert session is not None
            assert session.done()
            assert disk.statements.count("COMMIT") == 1

    asyncio.run(main())
    assert [row.kind for row in stored(path)] == ["press", "request", "press"]
    assert kept_of(path) == {"east": FIRE}


def test_the_presses_of_several_lifts_at_once_are_one_commit_with_the_newest_record_of_each(
    path: Path, hanging: Hanging
) -> None:
    async def main() -> None:
        disk = Disk(hanging)
        kept = journal(path, disk)
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            under_way = kept.commit_now(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            disk.statements.clear()
            answers = []
            for number, lift in enumerate(LIFTS):
                kept.keep(lift, SavedLift())
                kept.keep(lift, EVERYTHING)
                answers.append(kept.commit_now(press(2 + number)))
            kept.keep(LIFTS[0], FIRE)
            hanging.through.set()
            assert set(await asyncio.gather(under_way, *answers)) == {None}
            assert disk.statements.count("BEGIN IMMEDIATE") == 1

    asyncio.run(main())
    assert kept_of(path) == {LIFTS[0]: FIRE, LIFTS[1]: EVERYTHING}


def test_what_is_kept_during_a_commit_is_waited_for_until_the_next_one(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        kept = journal(path, Disk(hanging))
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            kept.keep("east", EVERYTHING)
            first = kept.written("east")
            await asyncio.to_thread(hanging.hung.wait)
            kept.keep("east", FIRE)
            second = kept.written("east")
            assert kept.written(LIFTS[1]) is None
            assert first is not None
            assert second is not None
            begun, hanging.through, gate = hanging.through, threading.Event(), hanging.hung
            gate.clear()
            begun.set()
            await first
            assert not second.done()
            assert kept_of(path) == {"east": EVERYTHING}
            hanging.through.set()
            await second
            assert kept_of(path) == {"east": FIRE}

    asyncio.run(main())


def test_what_nobody_waits_for_is_committed_soon_all_the_same(path: Path) -> None:
    async def main() -> None:
        kept = journal(path)
        async with writing(kept):
            kept.keep("east", FIRE)
            kept.note(press(1))
            await asyncio.to_thread(eventually, lambda: path.exists() and numbers(path) == [1])
        assert kept.unwritten == {}

    asyncio.run(main())
    assert kept_of(path) == {"east": FIRE}


def test_a_disk_that_takes_nothing_leaves_what_is_kept_in_force_and_takes_the_newest_in_the_end(path: Path) -> None:
    disk = Disk()

    async def main() -> None:
        kept = journal(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.hook = read_only
            kept.keep("east", EVERYTHING)
            waiting = kept.written("east")
            assert "decisions of people are in force but do not survive a restart" in await told.get()
            assert kept.recall("east") == EVERYTHING
            assert waiting is not None
            assert not waiting.done()
            kept.keep("east", FIRE)
            disk.hook = usual
            assert await told.get() == ""
            await waiting
            await kept.settled()

    asyncio.run(main())
    assert kept_of(path) == {"east": FIRE}


def test_a_press_is_answered_only_after_its_commit(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        kept = journal(path, Disk(hanging))
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            answer = kept.commit_now(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            assert not answer.done()
            assert numbers(path) == [0]
            hanging.through.set()
            assert await answer is None

    asyncio.run(main())


@pytest.mark.parametrize(
    ("refuse", "words"),
    [
        (full, "has no space: the disk is full (database or disk is full, SQLITE_FULL)"),
        (read_only, "cannot be written: this user may only read it, or the disk is read-only"),
    ],
)
def test_a_disk_that_refuses_is_told_once_and_everything_is_written_when_it_takes_rows_again(
    path: Path, refuse: Any, words: str
) -> None:
    disk = Disk()

    async def main() -> None:
        kept = journal(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.hook = refuse
            refused = await kept.commit_now(press(1, LARGE))
            why = await told.get()
            assert refused == why == kept.trouble
            assert f"the store {path} {words}" in why
            assert "until it can be written nothing is pressed, while releases and states continue" in why
            assert "the manager retries by itself" in why
            assert kept.commit_now(press(2)).result() == why
            kept.note(Row(RowKind.OUTCOME, "not pressed"))
            disk.opened.clear()
            await asyncio.to_thread(disk.opened.wait)  # tried again, which is not told
            assert told.empty()
            disk.hook = usual
            assert await told.get() == ""
            await kept.settled()
            assert kept.trouble == ""
            assert await kept.commit_now(press(3)) is None
            assert told.empty()

    asyncio.run(main())
    rows = stored(path)
    assert [row.kind for row in rows] == ["press", "press", "outcome", "alarm", "press"]
    assert numbers(path) == [0, 1, 3]


def test_a_disk_that_is_full_at_the_start_keeps_nobody_from_starting(path: Path) -> None:
    disk = Disk(full)

    async def main() -> None:
        kept = journal(path, disk)
        async with writing(kept) as told:
            assert "the disk is full" in await told.get()
            kept.note(Row(RowKind.MANAGER, "started"))
            disk.hook = usual
            assert await told.get() == ""
            assert await kept.commit_now(press(1)) is None

    asyncio.run(main())
    assert [row.kind for row in stored(path)] == ["manager", "alarm", "press"]


def test_a_disk_that_is_read_only_is_known_before_the_first_press(path: Path) -> None:
    write_presses(path, 1)

    async def main() -> None:
        kept = journal(path, Disk(read_only))
        async with writing(kept) as told:
            assert "may only read it" in await told.get()

    asyncio.run(main())


def test_a_folder_that_cannot_be_made_is_trouble_until_it_can(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    path = tmp_path / "file" / "site.db"

    async def main() -> None:
        kept = journal(path)
        async with writing(kept) as told:
            assert "check that its folder exists" in await told.get()
            (tmp_path / "file").unlink()
            assert await told.get() == ""
            assert await kept.commit_now(press(1)) is None

    asyncio.run(main())
    assert numbers(path) == [1]


def test_a_disk_that_hangs_is_told_in_time_and_what_it_writes_in_the_end_is_there_once(
    path: Path, hanging: Hanging
) -> None:
    async def main() -> None:
        kept = journal(path, Disk(hanging))
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            refused = await kept.commit_now(press(1))
            assert refused is not None
            assert f"did not reach the store {path} within 2 s" in refused
            assert "the disk has not answered for 2 s" in await told.get()
            assert kept.commit_now(press(2)).result() == kept.trouble
            kept.note(Row(RowKind.OUTCOME, "not pressed"))
            assert told.empty()
            hanging.through.set()
            assert await told.get() == ""
            assert await kept.commit_now(press(3)) is None

    asyncio.run(main())
    assert numbers(path) == [0, 1, 3]
    assert [row.kind for row in stored(path)] == ["press", "press", "outcome", "alarm", "press"]


def test_a_disk_that_hangs_holds_up_neither_the_loop_nor_the_end(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        kept = journal(path, Disk(hanging))
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            answer = kept.commit_now(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            kept.note(press(2))
        assert "the manager is stopping" in str(answer.result())

    asyncio.run(main())  # it would wait for ever otherwise: nobody lets the disk through


def test_a_disk_that_was_waited_for_already_is_not_waited_for_again_at_the_end(path: Path, hanging: Hanging) -> None:
    async def main(path: Path) -> float:
        kept = journal(path, Disk(hanging))
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            kept.note(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(kept.settled(), END_S)
            ends = time.monotonic()
        return time.monotonic() - ends

    files = count()

    def attempt() -> float:
        hanging.through.set()
        hanging.hung.clear()
        return asyncio.run(main(path.with_name(f"{next(files)}.db")))

    soon(attempt, END_S / 2)


def test_a_commit_that_is_under_way_at_the_end_is_waited_for_and_answered(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        kept = journal(path, Disk(hanging))
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            answer = kept.commit_now(press(1))
            await asyncio.to_thread(hanging.hung.wait)
            asyncio.get_running_loop().call_later(0.05, hanging.through.set)
        assert answer.result() is None
        async with writing(kept):  # and it can go on
            assert await kept.commit_now(press(2)) is None

    asyncio.run(main())
    assert numbers(path) == [0, 1, 2]


def test_a_row_whose_commit_failed_after_it_had_reached_the_disk_is_there_once(path: Path) -> None:
    def lies(connection: sqlite3.Connection, sql: str) -> None:
        if sql == "COMMIT":
            sqlite3.Connection.execute(connection, sql)
            disk.hook = usual
            raise sqlite3.OperationalError("disk I/O error")

    disk = Disk()

    async def main() -> None:
        kept = journal(path, disk)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            disk.hook = lies
            kept.note(press(1))
            answer = kept.commit_now(press(2))
            assert "the disk reports an error (disk I/O error" in await told.get()
            kept.note(press(3))
            assert await told.get() == ""
            await kept.settled()
            assert "disk I/O error" in str(answer.result())

    asyncio.run(main())
    stored(path)
    assert numbers(path) == [0, 1, 2, 3]


def test_a_journal_that_is_moved_away_is_missed_and_nothing_is_lost_when_it_is_back(path: Path) -> None:
    away = path.with_name("away.db")

    async def main() -> None:
        kept = journal(path)
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            await asyncio.to_thread(path.rename, away)
            refused = await kept.commit_now(press(1))
            assert refused == await told.get()
            assert "cannot be opened" in str(refused)
            await asyncio.to_thread(away.rename, path)
            assert await told.get() == ""
            assert await kept.commit_now(press(2)) is None

    asyncio.run(main())
    stored(path)
    assert numbers(path) == [0, 1, 2]


def test_another_file_in_the_place_of_the_journal_is_not_mixed_with_its_log(path: Path) -> None:
    copy, right = path.with_name("copy.db"), path.with_name("right.db")
    write_presses(path, 2)
    shutil.copy(path, copy)
    before = copy.read_bytes()

    async def main() -> None:
        kept = journal(path)
        async with writing(kept) as told:
            assert await kept.commit_now(press(2)) is None
            await asyncio.to_thread(path.replace, right)
            await asyncio.to_thread(copy.replace, path)
            assert "was moved, deleted or replaced while the manager had it open" in str(
                await kept.commit_now(press(3))
            )
            await told.get()
            await trouble(kept, "is another file than the one that this manager wrote to")
            assert await asyncio.to_thread(path.read_bytes) == before
            await asyncio.to_thread(right.replace, path)
            assert await told.get() == ""

    asyncio.run(main())
    stored(path)
    assert numbers(path) == [0, 1, 2, 3]


def test_an_older_copy_without_a_log_is_not_gone_on_with(path: Path) -> None:
    copy = path.with_name("copy.db")
    write_presses(path, 2)
    shutil.copy(path, copy)

    async def main() -> None:
        kept = journal(path)
        async with writing(kept) as told:
            assert await kept.commit_now(press(2)) is None
            for old in await asyncio.to_thread(lambda: list(path.parent.glob(f"{path.name}*"))):
                await asyncio.to_thread(old.unlink)
            await asyncio.to_thread(copy.replace, path)
            refused = await kept.commit_now(press(3))
            assert refused == await told.get()
            await trouble(kept, "is not as this manager left it: its newest row is 2, and row 3 was written")
            assert "put the right file back, or restart the manager to continue with this one" in kept.trouble
            assert told.empty(), "it is the same trouble in other words"

    asyncio.run(main())
    assert numbers(path) == [0, 1]


def test_a_journal_that_another_program_writes_to_is_trouble_while_it_does(path: Path) -> None:
    async def main() -> None:
        kept = journal(path, Disk())
        async with writing(kept) as told:
            assert await kept.commit_now(press(0)) is None
            with opened_raw(path) as other:
                other.execute("BEGIN IMMEDIATE")
                assert "is locked by another program (database is locked" in str(await kept.commit_now(press(1)))
                assert "stop the program that has it open" in await told.get()
                other.execute("ROLLBACK")
                assert await told.get() == ""

    asyncio.run(main())
    assert numbers(path) == [0, 1]


def test_rows_that_too_many_wait_before_are_counted_by_kind_in_their_place(path: Path, hanging: Hanging) -> None:
    async def main() -> None:
        seconds = count()
        kept = journal(
            path, Disk(hanging), max_queued_rows=10, clock=lambda: datetime.fromtimestamp(next(seconds), UTC)
        )
        async with writing(kept):
            assert await kept.commit_now(press(0)) is None
            hanging.through.clear()
            for number in range(1, 11):
                kept.note(press(number))
            await asyncio.to_thread(hanging.hung.wait)
            for _ in range(3):
                kept.note(Row(RowKind.WRITE, "let go"))
            kept.note(Row(RowKind.LINK, "lost"))
            assert "10 rows wait for the disk" in str(kept.commit_now(press(11)).result())
            settled = asyncio.ensure_future(kept.settled())
            hanging.through.set()
            await settled
            kept.note(press(12))
            await kept.settled()

    asyncio.run(main())
    rows = stored(path)
    assert [row.kind for row in rows] == ["press"] * 11 + ["gap", "press"]
    gap = rows[11]
    assert gap.text == "4 rows could not be written and are lost"
    assert json.loads(gap.data) == {
        "rows": 4,
        "kinds": {"write": 3, "link": 1},
        "from": 11_000_000,
        "to": 12_000_000,
    }
    assert numbers(path) == [*range(11), 12]


def test_a_computer_without_a_thread_to_spare_is_taken_for_a_bad_disk(path: Path) -> None:
    async def main() -> None:
        kept = journal(path)
        usual_size = threading.stack_size(1 << 46)  # no computer has that much, so no thread starts
        try:
            async with writing(kept) as told:
                assert "this computer has no thread to spare" in await told.get()
                threading.stack_size(usual_size)
                assert await told.get() == ""
                assert await kept.commit_now(press(1)) is None
        finally:
            threading.stack_size(usual_size)

    asyncio.run(main())


@pytest.mark.parametrize("bug", [ZeroDivisionError, sqlite3.ProgrammingError])
def test_a_bug_in_writing_is_not_taken_for_a_bad_disk(path: Path, bug: type[Exception]) -> None:
    def wrong(connection: sqlite3.Connection, sql: str) -> None:
        raise bug

    disk = Disk()
    kept = journal(path, disk)
    disk.hook = wrong
    with pytest.raises(bug):
        asyncio.run(asyncio.wait_for(kept.run(lambda _: None), HANGS_S))


def test_the_log_beside_the_file_is_carried_over_and_stays_small(path: Path) -> None:
    async def main() -> None:
        kept = journal(path)
        async with writing(kept):
            assert await kept.commit_now(press(800)) is None
            with closing(sqlite3.connect(path)) as reader:
                for number in range(800):
                    assert await kept.commit_now(press(number, "x" * 500)) is None
                    if number % 100 == 0:  # one who looks now and then does not keep it from that
                        reader.execute("SELECT count(*) FROM rows").fetchone()
            log = await asyncio.to_thread(path.with_name(f"{path.name}-wal").stat)
            assert log.st_size < 5_000_000

    asyncio.run(main())
    assert numbers(path) == [800, *range(800)]
