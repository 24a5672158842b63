"""A journal that is read while its manager writes, cuts and starts again."""

import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from lift_manager.lift.journal import RowKind
from lift_manager.store.chain import StoredRow
from lift_manager.store.errors import JournalBusy, JournalUnreadable, RowUnreadable
from lift_manager.store.read import (
    ALL_ROWS,
    BATCH,
    Follower,
    NewRows,
    RowFilter,
    microseconds,
    open_journal,
    time_of,
)
from tests.support.journal import SITE, T0, Journal


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Journal]:
    manager = Journal(tmp_path / "x.db")
    yield manager
    manager.end()


def texts(rows: NewRows | Iterable[StoredRow]) -> list[str]:
    return [row.text for row in (rows.rows if isinstance(rows, NewRows) else rows)]


def all_texts(path: Path, wanted: RowFilter = ALL_ROWS) -> list[str]:
    with open_journal(path) as reader:
        found = texts(reader.rows(wanted))
        assert texts(reader.newest(wanted, 10**6)) == found
        return found


def test_rows_are_chosen_by_lift_kind_caller_time_and_text(manager: Journal) -> None:
    manager.write("a", "b", lift="east")
    manager.write("c", lift="west", kind="alarm", caller="")
    manager.write("Door BLOCKED", caller="rmf:fleet/robot")
    manager.write("straße", caller="rmf")
    manager.write("f", caller="rmfx:fleet")
    path = manager.path
    assert all_texts(path) == ["a", "b", "c", "Door BLOCKED", "straße", "f"]
    assert all_texts(path, RowFilter(lift="west")) == ["c"]
    assert all_texts(path, RowFilter(lift="wes")) == []
    assert all_texts(path, RowFilter(kinds=frozenset({RowKind.ALARM, RowKind.LINK}))) == ["c"]
    assert all_texts(path, RowFilter(caller="rmf:fleet/robot")) == ["Door BLOCKED"]
    assert all_texts(path, RowFilter(caller="rmf")) == ["Door BLOCKED", "straße"]
    assert all_texts(path, RowFilter(find="blocked")) == ["Door BLOCKED"]
    assert all_texts(path, RowFilter(find="STRASSE")) == ["straße"]
    assert all_texts(path, RowFilter(since=T0 + 4_000_000)) == ["straße", "f"]
    assert all_texts(path, RowFilter(until=T0 + 1_000_000)) == ["a"]
    assert all_texts(path, RowFilter(lift="east", since=T0 + 1_000_000, until=T0 + 4_000_000)) == ["b", "Door BLOCKED"]


def test_the_newest_rows_come_with_the_oldest_of_them_first_also_over_several_batches(manager: Journal) -> None:
    count = 2 * BATCH + 5
    manager.write(*(f"{n}" for n in range(1, count + 1)))
    with open_journal(manager.path) as reader:
        assert texts(reader.newest(ALL_ROWS, 3)) == [f"{count - 2}", f"{count - 1}", f"{count}"]
        assert texts(reader.newest(ALL_ROWS, 2, upto=7)) == ["6", "7"]
        assert texts(reader.newest(RowFilter(until=T0 + 2_000_000), 9)) == ["1", "2"]
        assert list(reader.newest(ALL_ROWS, 0)) == []
        assert len(list(reader.rows())) == count
        assert texts(reader.rows(after=count - 1)) == [f"{count}"]
        assert (reader.first(), reader.last(), reader.row(count + 1)) == (1, count, None)


def test_a_journal_without_rows_has_none(manager: Journal) -> None:
    manager.write()
    with open_journal(manager.path) as reader:
        assert (list(reader.rows()), list(reader.newest(ALL_ROWS, 5)), reader.first(), reader.last()) == (
            [],
            [],
            None,
            None,
        )
        assert reader.newest_seq_of(RowKind.ANCHOR) is None
        assert reader.site == SITE


def test_the_newest_row_of_a_kind_is_found_in_any_batch(manager: Journal) -> None:
    manager.write("old", "x", kind="anchor")
    manager.write(*(f"{n}" for n in range(BATCH + 3)))
    with open_journal(manager.path) as reader:
        assert reader.newest_seq_of(RowKind.ANCHOR) == 2


def test_a_reader_in_the_middle_of_its_rows_does_not_keep_the_writer_from_carrying_its_log_over(
    manager: Journal,
) -> None:
    manager.write(*(f"{n}" for n in range(BATCH + 10)))
    with open_journal(manager.path) as reader:
        rows = reader.rows()
        next(rows)
        manager.write("more")
        with closing(sqlite3.connect(manager.path, timeout=0)) as other:
            busy, in_log, carried_over = other.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        assert (busy, in_log, carried_over) == (0, 0, 0)
        # and the rows end with the one that was the newest at the beginning
        assert len(list(rows)) == BATCH + 9


def test_nothing_is_written_by_a_reader(manager: Journal) -> None:
    manager.write("a")
    with open_journal(manager.path) as reader, pytest.raises(sqlite3.OperationalError, match="readonly"):
        reader._connection.execute("DELETE FROM rows")  # noqa: SLF001  there is no way to write through what it offers


def test_a_copy_that_is_one_file_gets_no_files_beside_it(manager: Journal, tmp_path: Path) -> None:
    manager.write("a")
    manager.end()
    copy = tmp_path / "elsewhere" / "copy #1?.db"
    copy.parent.mkdir()
    shutil.copy(manager.path, copy)
    with open_journal(copy, copy=True) as reader:
        assert texts(reader.rows()) == ["a"]
        assert reader.immutable
    assert list(copy.parent.iterdir()) == [copy]


def test_a_copy_with_its_log_is_read_to_its_newest_row(manager: Journal, tmp_path: Path) -> None:
    manager.write("a")
    manager.write("b")
    copy = tmp_path / "copy.db"
    shutil.copy(manager.path, copy)
    shutil.copy(f"{manager.path}-wal", f"{copy}-wal")
    with open_journal(copy, copy=True) as reader:
        assert texts(reader.rows()) == ["a", "b"]


@contextmanager
def following(manager: Journal, wanted: RowFilter = ALL_ROWS) -> Iterator[Follower]:
    with open_journal(manager.path) as reader:
        newest = next(iter(reader.newest(ALL_ROWS, 1)), None)
    follower = Follower(manager.path, wanted, newest)
    try:
        yield follower
    finally:
        follower.close()


def test_a_follower_tells_each_new_row_once(manager: Journal) -> None:
    manager.write("a")
    with following(manager, RowFilter(lift="east")) as follower:
        assert follower.poll() == NewRows()
        manager.write("b", "c")
        manager.write("d", lift="west")
        assert texts(follower.poll()) == ["b", "c"]
        assert follower.poll() == NewRows()
        manager.write("e")
        assert texts(follower.poll()) == ["e"]


def test_a_follower_of_a_journal_without_rows_tells_the_first(manager: Journal) -> None:
    manager.write()
    with following(manager) as follower:
        assert follower.poll() == NewRows()
        manager.write("a")
        assert texts(follower.poll()) == ["a"]


def test_a_follower_goes_on_over_a_cut_and_over_a_restart_of_the_manager(manager: Journal) -> None:
    manager.write("a", "b", "c")
    with following(manager) as follower:
        assert follower.poll() == NewRows()
        manager.cut_through(2)
        assert follower.poll().cut is None
        manager.end()
        assert follower.poll() == NewRows()
        again = Journal(manager.path)
        again.write("d")
        assert texts(follower.poll()) == ["d"]
        again.end()


def test_a_follower_tells_which_rows_were_cut_before_it_could_read_them(manager: Journal) -> None:
    manager.write("a")
    with following(manager) as follower:
        manager.write("b", "c", "d")
        manager.cut_through(3)
        news = follower.poll()
        assert (texts(news), news.cut) == (["d", "rows 1 to 3 removed: they are too old"], (2, 3))


def test_a_follower_tells_that_another_journal_is_in_the_place(manager: Journal, tmp_path: Path) -> None:
    manager.write("a", "b")
    with following(manager) as follower:
        assert follower.poll() == NewRows()
        manager.end()
        for file in tmp_path.glob("x.db*"):
            file.rename(tmp_path / f"old-{file.name}")
        other = Journal(manager.path)
        other.write("as old as the last that was told", "x", "y")
        news = follower.poll()
        assert (texts(news), news.replaced) == (["y"], True)
        other.write("z")
        news = follower.poll()
        assert (texts(news), news.replaced) == (["z"], False)
        other.end()


def test_a_follower_goes_on_in_a_copy_that_was_put_back_and_has_its_last_row(manager: Journal, tmp_path: Path) -> None:
    manager.write("a", "b")
    with following(manager) as follower:
        assert follower.poll() == NewRows()
        manager.end()
        with closing(sqlite3.connect(manager.path)) as old, closing(sqlite3.connect(tmp_path / "copy")) as copy:
            old.backup(copy)
        for file in tmp_path.glob("x.db*"):
            file.unlink()
        (tmp_path / "copy").rename(manager.path)
        again = Journal(manager.path)
        again.write("c")
        news = follower.poll()
        assert (texts(news), news.replaced) == (["c"], False)
        again.end()


def test_a_file_that_is_locked_is_told_in_words_and_a_follower_waits_for_it(manager: Journal) -> None:
    manager.write("a", "b")
    with open_journal(manager.path) as reader:
        first = reader.row(1)
    manager.end()
    follower = Follower(manager.path, ALL_ROWS, first, busy_s=0.01)
    with closing(sqlite3.connect(manager.path, isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode = EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(JournalBusy, match="is locked by another program"):
            open_journal(manager.path, busy_s=0.01)
        assert follower.poll() == NewRows()
    assert texts(follower.poll()) == ["b"]
    follower.close()


def test_what_is_no_journal_is_told_in_words(tmp_path: Path) -> None:
    def told(name: str, content: bytes | None = None, *, copy: bool = False) -> str:
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(JournalUnreadable) as error:
            open_journal(path, copy=copy)
        assert str(error.value).startswith(str(path))
        return str(error.value)

    assert "no manager has run for this site" in told("none.db")
    assert "check the path" in told("none.db", copy=True)
    assert "is a folder" in told(".")
    assert "is empty" in told("empty.db", b"")
    assert "is not a journal, or is damaged (file is not a database)" in told("words.db", b"what people said " * 300)
    for name, pragmas, what in (
        ("other.db", "PRAGMA application_id = 7", "is not a store of a lift manager"),
        ("newer.db", "PRAGMA application_id = 0x4C494654; PRAGMA user_version = 2", "reads versions up to 1"),
        ("none.db", "PRAGMA application_id = 0x4C494654; PRAGMA user_version = 0", "it has no version"),
        ("bare.db", "PRAGMA application_id = 0x4C494654; PRAGMA user_version = 1", "damaged (no such table: about)"),
    ):
        with closing(sqlite3.connect(tmp_path / name)) as file:
            file.executescript(f"{pragmas}; CREATE TABLE x (y)")
        assert what in told(name)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("at = 'noon'", "row 2 has 'noon' as its time"),
        ("at = 9223372036854775807", "row 2 has 9223372036854775807 as its time"),
        ("at = -62135596800000000", "row 2 has -62135596800000000 as its time"),
        ("caller = x'00'", "row 2 has no text as its caller"),
        ("hash = 'x'", "row 2 has no bytes as its hash"),
    ],
)
def test_a_row_that_no_manager_has_written_is_named(manager: Journal, change: str, what: str) -> None:
    manager.write("a", "b", "c")
    with closing(sqlite3.connect(manager.path)) as file:
        file.execute(f"UPDATE rows SET {change} WHERE seq = 2")
        file.commit()
    with open_journal(manager.path) as reader:
        rows = reader.rows()
        assert next(rows).text == "a"
        with pytest.raises(RowUnreadable, match=f"{what}; `lift-manager audit --verify`"):
            next(rows)


def test_times_are_kept_to_the_microsecond(manager: Journal) -> None:
    manager.write("a")
    with open_journal(manager.path) as reader:
        row = reader.row(1)
    assert row is not None
    assert microseconds(time_of(row)) == T0
    assert time_of(row._replace(at=T0 + 1)).isoformat() == "2026-11-20T18:40:00.000001+00:00"
