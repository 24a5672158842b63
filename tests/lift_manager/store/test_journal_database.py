"""The database of a journal: made whole or not at all, brought up to date, and never mistaken for another."""

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from lift_manager.store.errors import JournalUnusable
from lift_manager.store.journal.database import APPLICATION_ID, STEPS, VERSION, Step, open_database
from lift_manager.store.journal.file import JournalFile
from lift_manager.store.journal.retention import Limits
from lift_manager.store.place import journal_path, state_path
from tests.lift_manager.store.journal_disk import SITE, journal, opened_raw, stored, write_presses, written


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.journal.db"


def refused(path: Path) -> str:
    with pytest.raises(JournalUnusable) as found:
        JournalFile(path, SITE, Limits(400, 500)).open()
    assert f"the journal {path} " in str(found.value)
    return str(found.value)


def test_the_journal_is_beside_the_state_under_the_same_name() -> None:
    state = state_path("St. Mary's 2.0", "kept", Path("/etc/lifts/site.yaml"), {})
    assert journal_path(state).parent == state.parent
    assert journal_path(state).name == state.name.removesuffix(".json") + ".journal.db"


def test_a_journal_says_what_it_is(path: Path) -> None:
    write_presses(path, 1)
    with opened_raw(path) as connection:

        def pragma(name: str) -> object:
            return connection.execute(f"PRAGMA {name}").fetchone()[0]

        assert pragma("application_id") == APPLICATION_ID == int.from_bytes(b"LJRN", "big")
        assert pragma("user_version") == VERSION == len(STEPS) == 1
        assert (pragma("journal_mode"), pragma("auto_vacuum")) == ("wal", 2)
        about = dict(connection.execute("SELECT key, value FROM about"))
        assert about["site"] == SITE
        assert about["made_at"].endswith("+00:00")


def test_a_commit_is_flushed_to_the_disk_before_it_is_answered(path: Path) -> None:
    with closing(open_database(path, SITE, create=True)) as connection:
        assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
        assert connection.execute("PRAGMA wal_autocheckpoint").fetchone() == (0,)


def make_foreign(path: Path) -> None:
    with opened_raw(path) as connection:
        connection.execute("CREATE TABLE invoices (id INTEGER)")


def pragma(statement: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        write_presses(path, 3)
        with opened_raw(path) as connection:
            connection.execute(statement)

    return spoil


def other_site(path: Path) -> None:
    open_database(path, "Harbour office", create=True).close()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (make_foreign, "is the database of another program; give this site another folder with `state:`"),
        (
            lambda path: path.write_bytes(b"a letter, and not a database " * 50),
            "is no journal of a lift manager, or is",
        ),
        (
            pragma("PRAGMA user_version = 2"),
            "is version 2 of such a file, and this program writes version 1; start the",
        ),
        (pragma("PRAGMA user_version = 0"), "is damaged (it does not say of which site it is)"),
        (pragma("DROP TABLE about"), "is no journal of a lift manager, or is damaged (no such table: about)"),
        (pragma("DROP TABLE rows"), "is no journal of a lift manager, or is damaged (no such table: rows)"),
        (pragma("DELETE FROM about"), "is damaged (it does not say of which site it is)"),
        (pragma("UPDATE rows SET text = 'nothing' WHERE seq = 3"), "was changed: row 3 does not follow from the row"),
        (pragma("DELETE FROM rows WHERE seq = 2"), "was changed: row 3 does not follow from the row"),
        (
            other_site,
            "belongs to the site 'Harbour office'; if 'Main hospital' is another building, name another folder with `state:`",
        ),
    ],
)
def test_what_is_no_journal_of_this_site_is_refused_in_words_and_left_as_it_is(
    path: Path, spoil: Callable[[Path], None], words: str
) -> None:
    spoil(path)
    before = path.read_bytes()
    assert words in refused(path)
    assert path.read_bytes() == before


def test_a_renamed_site_is_told_how_its_former_journal_is_read(path: Path) -> None:
    other_site(path)
    words = refused(path)
    assert (
        "if that is the former name of this one, no journal goes on under another name: move it to another folder"
        in words
    )
    assert "`lift-manager audit --journal FILE` reads this one" in words


def test_a_journal_that_begins_beside_another_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    first, second = tmp_path / "old-name.journal.db", tmp_path / "site.journal.db"
    journal(first)
    assert caplog.messages == []
    journal(second)
    (line,) = caplog.messages
    assert line.startswith(f"the journal {second} begins; another journal lies beside it: {first}; ")
    journal(second)
    assert len(caplog.messages) == 1


def test_a_folder_in_the_place_of_the_journal_is_trouble_and_no_journal(path: Path) -> None:
    path.mkdir()

    async def main() -> None:
        told = asyncio.Queue[str]()
        kept = journal(path)
        running = asyncio.ensure_future(kept.run(told.put_nowait))
        assert "cannot be opened" in await told.get()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(main())


def test_a_journal_torn_at_any_sector_is_refused_or_goes_on_after_its_newest_row(path: Path) -> None:
    """Never is it taken for an empty one; damage in the middle is found by `audit --verify`, which reads everything."""
    write_presses(path, 60)
    whole = path.read_bytes()
    damaged = 0
    for length in range(512, len(whole), 512):
        path.write_bytes(whole[:length])
        file = JournalFile(path, SITE, Limits(400, 500))
        try:
            file.open()
        except JournalUnusable as error:
            assert "damaged" in str(error)  # noqa: PT017  either is right
            damaged += 1
        else:
            file.close()
            with opened_raw(path) as connection:
                assert connection.execute("SELECT max(seq) FROM rows").fetchone() == (60,)
    assert damaged >= len(whole) // 512 // 2


def test_a_file_that_a_crash_left_empty_is_made_a_journal(path: Path) -> None:
    path.touch()
    write_presses(path, 2)
    assert len(stored(path)) == 2


def test_a_file_that_a_crash_left_without_tables_is_made_a_journal(path: Path) -> None:
    with opened_raw(path) as connection:
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        connection.execute("PRAGMA journal_mode = WAL")
    assert path.stat().st_size > 0
    write_presses(path, 2)
    assert len(stored(path)) == 2
    with opened_raw(path) as connection:
        assert connection.execute("PRAGMA auto_vacuum").fetchone() == (2,)


def add_shift(connection: sqlite3.Connection) -> None:
    connection.execute("CREATE TABLE shifts (name TEXT)")


def fail(connection: sqlite3.Connection) -> None:
    connection.execute("DELETE FROM rows")
    raise sqlite3.OperationalError("disk I/O error")


def test_a_journal_of_an_older_version_is_brought_up_to_date_with_all_its_rows(path: Path) -> None:
    write_presses(path, 3)
    rows = stored(path)
    steps: tuple[Step, ...] = (*STEPS, add_shift)
    for _ in range(2):
        with closing(open_database(path, SITE, create=False, steps=steps)) as connection:
            assert connection.execute("PRAGMA user_version").fetchone() == (2,)
            assert connection.execute("SELECT * FROM shifts").fetchall() == []
    assert stored(path) == rows
    assert "is version 2 of such a file" in refused(path)


def test_a_step_that_fails_leaves_the_older_version(path: Path) -> None:
    write_presses(path, 3)
    rows = stored(path)
    with pytest.raises(sqlite3.OperationalError):
        open_database(path, SITE, create=False, steps=(*STEPS, add_shift, fail))
    assert stored(path) == rows
    asyncio.run(written(journal(path)))
    with opened_raw(path) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (1,)
