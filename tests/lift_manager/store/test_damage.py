"""A journal that is damaged: a manager starts on it, presses nothing and says why; and nothing is cut on a damaged row's word."""

import asyncio
import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lift_manager.lift.events import Restriction, RestrictionKind
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.record import DurableRecord
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.committer import Committer
from lift_manager.store.database import create_database
from lift_manager.store.errors import StoreUnusable
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow
from tests.lift_manager.store.journal_disk import (
    SITE,
    journal,
    opened_raw,
    press,
    stored,
    write_presses,
    writing,
)
from tests.support.programs import eventually, run


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.db"


def sql(statement: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with opened_raw(path) as connection:
            connection.execute(statement)

    return spoil


def overwritten(begin: float, end: float) -> Callable[[Path], None]:
    """Spoil a part of the file, as a card does that loses power."""

    def spoil(path: Path) -> None:
        content = bytearray(path.read_bytes())
        low, high = round(begin * len(content)), max(round(end * len(content)), 100)
        content[low:high] = b"\xa5" * (high - low)
        path.write_bytes(content)

    return spoil


TORN = [
    pytest.param(overwritten(0, 0), id="its first 100 bytes"),
    pytest.param(overwritten(0.5, 1), id="its second half"),
    pytest.param(overwritten(0.1, 1), id="all but its first page"),
    pytest.param(lambda path: path.write_bytes(path.read_bytes()[:1000]), id="torn in its first page"),
    pytest.param(lambda path: path.write_bytes(b""), id="emptied"),
    pytest.param(sql("UPDATE about SET value = x'00' WHERE key = 'site'"), id="bytes for the name of the site"),
    pytest.param(sql("DROP TABLE records"), id="a table less"),
    pytest.param(sql("DELETE FROM records"), id="a record less"),
    pytest.param(sql("DELETE FROM head"), id="no head"),
    pytest.param(sql("UPDATE records SET record = replace(record, 'Weber', 'Huber')"), id="another word in a record"),
    pytest.param(sql("UPDATE records SET record = replace(record, 'ropes', 'rope')"), id="a letter less in a record"),
    pytest.param(sql("UPDATE records SET record = x'00'"), id="bytes for a record"),
    pytest.param(sql("UPDATE records SET lift = 'west'"), id="the record of another lift"),
    pytest.param(sql("UPDATE records SET hash = x''"), id="no hash of a record"),
]
JOURNAL_DAMAGED = [
    pytest.param(sql("UPDATE rows SET text = x'00ff' WHERE seq = 60"), id="bytes for a text"),
    pytest.param(sql("UPDATE rows SET text = CAST(x'ff41' AS TEXT) WHERE seq = 60"), id="bytes that are no text"),
    pytest.param(sql("UPDATE rows SET at = 'noon' WHERE seq = 60"), id="a word for a time"),
    pytest.param(sql("UPDATE rows SET hash = 'text' WHERE seq = 59"), id="text for a hash"),
    pytest.param(sql("UPDATE rows SET data = '{' WHERE seq = 60"), id="another text in the newest row"),
    pytest.param(sql("DELETE FROM rows WHERE seq = 60"), id="the newest row less"),
    pytest.param(sql("ALTER TABLE rows DROP COLUMN caller"), id="a column less"),
]
LOCKOUT = Restriction(RestrictionKind.LOCKOUT, "M. Weber", "ropes", datetime(2026, 3, 2, tzinfo=UTC))
LOCKED = SavedLift(DurableRecord(restrictions=(LOCKOUT,)))


@pytest.fixture
def locked_out(path: Path) -> Path:
    """A store of 60 presses and a lift that a person has locked out."""
    store = SqliteStore(path, SITE, Limits(400, 500))
    store.commit({"east": LOCKED}, [PendingRow(1_800_000_000_000_000, press(number)) for number in range(60)])
    store.close()
    return path


@pytest.mark.parametrize("spoil", TORN)
def test_nothing_starts_on_a_store_whose_records_are_not_as_they_were_written(
    locked_out: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(locked_out)
    before = locked_out.read_bytes()
    with pytest.raises(StoreUnusable) as refused:
        journal(locked_out)
    why = str(refused.value)
    assert why.startswith(f"{locked_out} ")
    assert "it records which lifts were locked out or had a fire, so nothing starts without it" in why
    assert "let a person check every lift for a fire, a lockout and a robot in its car" in why
    assert locked_out.read_bytes() == before


def test_a_store_torn_at_any_sector_is_never_taken_for_one_that_holds_nothing(locked_out: Path) -> None:
    whole = locked_out.read_bytes()
    for length in range(0, len(whole), 512):
        locked_out.write_bytes(whole[:length])
        try:
            kept = journal(locked_out)
        except StoreUnusable:
            continue
        assert kept.recall("east") == LOCKED


def moved_away(path: Path, kept: Committer) -> None:
    """Move the file away, and its log as soon as the manager asks for it: before that it may still be at work on both."""
    log = path.with_name(f"{path.name}-wal")
    path.rename(path.with_name("away"))
    eventually(lambda: kept.trouble == "" or f"is not there, and {log.name} is" in kept.trouble)
    if kept.trouble:
        log.rename(path.with_name("away-wal"))
    eventually(lambda: kept.trouble == "")


@pytest.mark.parametrize("spoil", JOURNAL_DAMAGED)
def test_a_manager_starts_on_a_damaged_journal_presses_nothing_and_goes_on_when_it_is_moved_away(
    locked_out: Path, spoil: Callable[[Path], None]
) -> None:
    path = locked_out
    spoil(path)
    before = path.read_bytes()

    async def main() -> None:
        kept = journal(path)
        assert kept.recall("east") == LOCKED
        async with writing(kept) as told:
            kept.note(Row(RowKind.MANAGER, "a manager started"))
            why = await told.get()
            assert kept.trouble == why
            assert f"the store {path} " in why
            assert "until it can be written nothing is pressed, while releases and states continue" in why
            assert "while the manager runs, move it to another folder, together with the file of the same name" in why
            assert kept.commit_now(press(1)).result() == why
            assert await asyncio.to_thread(path.read_bytes) == before
            await asyncio.to_thread(moved_away, path, kept)
            assert await told.get() == ""
            assert await kept.commit_now(press(2)) is None

    asyncio.run(main())
    assert [row.kind for row in stored(path)] == ["manager", "alarm", "press"]
    assert SqliteStore(path, SITE, Limits(400, 500)).load() == {"east": LOCKED}


def other_site(path: Path) -> None:
    create_database(path, "Harbour office")


def newer(path: Path) -> None:
    write_presses(path, 3)
    sql("PRAGMA user_version = 2")(path)


@pytest.mark.parametrize(("make", "words"), [(other_site, "'Harbour office'"), (newer, "is version 2")])
def test_a_store_of_another_site_or_a_newer_version_is_refused_at_the_start(
    path: Path, make: Callable[[Path], None], words: str
) -> None:
    make(path)
    with pytest.raises(StoreUnusable, match=words):
        journal(path)


def test_serve_that_is_refused_says_that_outputs_may_still_be_on(tmp_path: Path) -> None:
    content = {
        "schema": 1,
        "name": SITE,
        "state": "kept",
        "controllers": {"plc": {"host": "127.0.0.1", "map": "generic-registers"}},
        "lifts": {"east": {"controller": "plc", "access": "monitor", "floors": {"L1": 1, "L2": 2}}},
    }
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(content), "utf-8")  # JSON is YAML
    newer(store_path(SITE, "kept", file, {}))
    done = run("serve", file, "--port", "0")
    assert done.returncode == 1
    assert "is version 2 of a store" in done.stderr
    assert "outputs may still be on at the lifts, so look at each of them" in done.stderr
    assert "Traceback" not in done.stderr


def started_on(path: Path) -> Committer:
    """Let a manager write MORE rows to it, with a look at the file after each."""

    async def main() -> Committer:
        kept = journal(path)
        async with writing(kept):
            for number in range(MORE):
                assert await kept.commit_now(press(100 + number)) is None
        return kept

    return asyncio.run(main())


def count(path: Path) -> int:
    with opened_raw(path) as connection:
        (rows,) = connection.execute("SELECT count(*) FROM rows").fetchone()
    return int(rows)


MORE = 30


@pytest.mark.parametrize("column", ["at", "hash"])
def test_a_damaged_row_among_the_oldest_is_a_refusal_to_cut_and_ends_nobody(
    path: Path, column: str, caplog: pytest.LogCaptureFixture
) -> None:
    old = round(datetime(2020, 1, 1, tzinfo=UTC).timestamp()) * 1_000_000
    store = SqliteStore(path, SITE, Limits(400, 500))
    store.commit({}, [PendingRow(old, Row(RowKind.LINK, ""))] * 60)
    store.close()
    write_presses(path, 2, keep_days=10_000)
    sql(f"UPDATE rows SET {column} = 'x' WHERE seq IN (1, 60)")(path)
    assert started_on(path).trouble == ""
    assert count(path) == 62 + MORE
    (line,) = [line for line in caplog.messages if "the oldest rows could not be removed" in line]
    assert f"{path}: the oldest rows could not be removed: row " in line
    assert "has a value that no manager writes" in line
    assert "run `lift-manager audit --verify` for details" in line
