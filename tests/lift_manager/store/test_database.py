"""The database of a site: made whole or not at all, migrated, and never mistaken for another."""

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from lift_manager.store.database import (
    APPLICATION_ID,
    MIGRATIONS,
    VERSION,
    Migration,
    create_database,
    open_database,
    read_head,
)
from lift_manager.store.errors import StoreDamaged, StoreForeign
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from tests.lift_manager.store.journal_disk import SITE, journal, opened_raw, stored, write_presses, written


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.db"


def refused(path: Path) -> str:
    with pytest.raises(StoreDamaged) as found:
        SqliteStore(path, SITE, Limits(400, 500)).commit({}, [])
    assert f"the store {path} " in str(found.value)
    return str(found.value)


def test_a_store_says_what_it_is(path: Path) -> None:
    write_presses(path, 1)
    with opened_raw(path) as connection:

        def pragma(name: str) -> object:
            return connection.execute(f"PRAGMA {name}").fetchone()[0]

        assert pragma("application_id") == APPLICATION_ID == int.from_bytes(b"LIFT", "big")
        assert pragma("user_version") == VERSION == len(MIGRATIONS) == 1
        assert (pragma("journal_mode"), pragma("auto_vacuum")) == ("wal", 2)
        about = dict(connection.execute("SELECT key, value FROM about"))
        assert about["site"] == SITE
        assert about["made_at"].endswith("+00:00")


def test_a_commit_is_flushed_to_the_disk_before_it_is_answered(path: Path) -> None:
    create_database(path, SITE)
    with closing(open_database(path, SITE)) as connection:
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


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (make_foreign, "is not a store of a lift manager; give this site another folder with `state:`"),
        (
            lambda path: path.write_bytes(b"a letter, and not a database " * 50),
            "is not a store of a lift manager, or is",
        ),
        (lambda path: path.touch(), "is empty; while the manager runs, move it to another folder"),
        (
            pragma("PRAGMA user_version = 2"),
            "is version 2 of a store, and this program reads versions up to 1; start the newer program",
        ),
        (pragma("PRAGMA user_version = 0"), "is damaged (it has no version)"),
        (pragma("DROP TABLE about"), "is not a store of a lift manager, or is damaged (no such table: about)"),
        (pragma("DROP TABLE rows"), "is not a store of a lift manager, or is damaged (no such table: rows)"),
        (pragma("DROP TABLE head"), "is not a store of a lift manager, or is damaged (no such table: head)"),
        (pragma("DELETE FROM head"), "is damaged (it does not say which row is the newest)"),
        (pragma("DELETE FROM about"), "is damaged (it does not name its site)"),
        (pragma("UPDATE rows SET text = 'nothing' WHERE seq = 3"), "was changed: row 3 does not follow from the row"),
        (pragma("DELETE FROM rows WHERE seq = 2"), "was changed: row 3 does not follow from the row"),
        (pragma("DELETE FROM rows WHERE seq = 3"), "was changed: row 3 was the newest, and row 2 is"),
        (pragma("DELETE FROM rows"), "was changed: row 3 was the newest, and there are no rows"),
        (
            lambda path: create_database(path, "Harbour office"),
            "belongs to the site 'Harbour office'; if 'Main hospital' is another building, name another folder with `state:`",
        ),
    ],
)
def test_what_is_no_store_of_this_site_is_refused_in_words_and_left_as_it_is(
    path: Path, spoil: Callable[[Path], None], words: str
) -> None:
    spoil(path)
    before = path.read_bytes()
    assert words in refused(path)
    assert path.read_bytes() == before


def test_a_renamed_site_is_told_what_to_do(path: Path) -> None:
    create_database(path, "Harbour office")
    words = refused(path)
    assert "is the former name of this one, use that name again until people have ended what keeps" in words


def test_a_store_that_begins_beside_another_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    first, second = tmp_path / "old-name.db", tmp_path / "site.db"
    asyncio.run(written(journal(first)))
    write_presses(first, 1)
    caplog.clear()
    write_presses(second, 1)
    (line,) = [line for line in caplog.messages if "begins" in line]
    assert line.startswith(f"{second} is a new store; there are others in its folder: {first}; ")
    write_presses(second, 1)
    assert len([line for line in caplog.messages if "begins" in line]) == 1


def test_a_log_without_its_store_is_not_laid_over_a_new_one(path: Path) -> None:
    path.with_name(f"{path.name}-wal").write_bytes(b"what another one committed")
    assert f"is not there, and {path.name}-wal is; put both back" in refused(path)
    assert not path.exists()


def test_a_store_torn_at_any_sector_is_refused_or_goes_on_after_its_newest_row(path: Path) -> None:
    """Never is it taken for an empty one; damage in the middle is found by `audit --verify`, which reads everything."""
    write_presses(path, 60)
    whole = path.read_bytes()
    damaged = 0
    for length in range(512, len(whole), 512):
        path.write_bytes(whole[:length])
        try:
            with closing(open_database(path, SITE)) as connection:
                assert read_head(connection, path).seq == 60
        except StoreDamaged as error:
            assert "damaged" in str(error) or "was changed" in str(error)  # noqa: PT017  either is right
            damaged += 1
    assert damaged >= len(whole) // 512 // 2


def test_what_a_crash_left_of_a_store_that_was_being_made_is_replaced(path: Path) -> None:
    path.with_name(f"{path.name}.new").write_bytes(b"SQLite format 3")
    write_presses(path, 2)
    assert len(stored(path)) == 2
    assert not path.with_name(f"{path.name}.new").exists()


def add_shift(connection: sqlite3.Connection) -> None:
    connection.execute("CREATE TABLE shifts (name TEXT)")


def fail(connection: sqlite3.Connection) -> None:
    connection.execute("DELETE FROM rows")
    raise sqlite3.OperationalError("disk I/O error")


def test_a_store_of_an_older_version_is_migrated_with_all_its_rows(path: Path) -> None:
    write_presses(path, 3)
    rows = stored(path)
    migrations: tuple[Migration, ...] = (*MIGRATIONS, add_shift)
    for _ in range(2):
        with closing(open_database(path, SITE, migrations=migrations)) as connection:
            assert connection.execute("PRAGMA user_version").fetchone() == (2,)
            assert connection.execute("SELECT * FROM shifts").fetchall() == []
    assert stored(path) == rows
    with pytest.raises(StoreForeign, match="is version 2 of a store"):
        open_database(path, SITE)


def test_a_migration_that_fails_leaves_the_older_version(path: Path) -> None:
    write_presses(path, 3)
    rows = stored(path)
    with pytest.raises(sqlite3.OperationalError):
        open_database(path, SITE, migrations=(*MIGRATIONS, add_shift, fail))
    assert stored(path) == rows
    asyncio.run(written(journal(path)))
    with opened_raw(path) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (1,)
