"""A journal that is damaged: a manager starts on it, presses nothing and says why; and nothing is cut on a damaged row's word."""

import asyncio
import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lift_manager.domain.journal import Json, Row, RowKind
from lift_manager.store.errors import JournalOfAnother
from lift_manager.store.journal.chain import canonical
from lift_manager.store.journal.database import open_database
from lift_manager.store.journal.file import Entry, JournalFile
from lift_manager.store.journal.retention import Limits
from lift_manager.store.journal.writer import SqliteJournal
from lift_manager.store.place import journal_path, state_path
from tests.lift_manager.store.journal_disk import SITE, journal, opened_raw, press, stored, write_presses, writing
from tests.support.programs import run


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.journal.db"


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


DAMAGE = [
    pytest.param(overwritten(0, 0), id="its first 100 bytes"),
    pytest.param(overwritten(0.5, 1), id="its second half"),
    pytest.param(overwritten(0.1, 1), id="all but its first page"),
    pytest.param(lambda path: path.write_bytes(path.read_bytes()[:1000]), id="torn in its first page"),
    pytest.param(sql("UPDATE rows SET text = x'00ff' WHERE seq = 60"), id="bytes for a text"),
    pytest.param(sql("UPDATE rows SET text = CAST(x'ff41' AS TEXT) WHERE seq = 60"), id="bytes that are no text"),
    pytest.param(sql("UPDATE rows SET at = 'noon' WHERE seq = 60"), id="a word for a time"),
    pytest.param(sql("UPDATE rows SET hash = 'text' WHERE seq = 59"), id="text for a hash"),
    pytest.param(sql("UPDATE rows SET data = '{' WHERE seq = 60"), id="another text in the newest row"),
    pytest.param(sql("ALTER TABLE rows DROP COLUMN caller"), id="a column less"),
    pytest.param(sql("UPDATE about SET value = x'00' WHERE key = 'site'"), id="bytes for the name of the site"),
]


@pytest.mark.parametrize("spoil", DAMAGE)
def test_a_manager_starts_on_a_damaged_journal_presses_nothing_and_goes_on_when_it_is_moved_away(
    path: Path, spoil: Callable[[Path], None]
) -> None:
    write_presses(path, 60)
    spoil(path)
    before = path.read_bytes()

    async def main() -> None:
        kept = journal(path)
        async with writing(kept) as told:
            kept.note(Row(RowKind.MANAGER, "a manager started"))
            why = await told.get()
            assert kept.trouble == why
            assert f"the journal {path} " in why
            assert "until it can be written nothing is pressed, while releases and states go on" in why
            assert (
                "move it to another folder, with what is beside it under the same name and `-wal`, and keep it" in why
            )
            assert "restart the manager" in why
            assert kept.before(press(1)).result() == why
            assert await asyncio.to_thread(path.read_bytes) == before
            await asyncio.to_thread(path.rename, path.with_name("away"))
            assert await told.get() == ""
            assert await kept.before(press(2)) is None

    asyncio.run(main())
    assert [row.kind for row in stored(path)] == ["manager", "alarm", "press"]


def other_site(path: Path) -> None:
    open_database(path, "Harbour office", create=True).close()


def newer(path: Path) -> None:
    write_presses(path, 3)
    sql("PRAGMA user_version = 2")(path)


@pytest.mark.parametrize(("make", "words"), [(other_site, "'Harbour office'"), (newer, "is version 2")])
def test_a_journal_of_another_site_or_a_newer_version_is_refused_at_the_start(
    path: Path, make: Callable[[Path], None], words: str
) -> None:
    make(path)
    with pytest.raises(JournalOfAnother, match=words):
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
    newer(journal_path(state_path(SITE, "kept", file, {})))
    done = run("serve", file, "--port", "0")
    assert done.returncode == 1
    assert "is version 2 of such a file" in done.stderr
    assert "outputs may still be on at the lifts, so look at each of them" in done.stderr
    assert "Traceback" not in done.stderr


def anchored(path: Path) -> None:
    """Write 60 presses, an anchor row that lets 20 of them go, and one press more; nothing is cut yet."""
    write_presses(path, 60)
    said: Json = {"from": 1, "through": 20, "rows": 20, "hash": stored(path)[19].hash.hex()}
    file = JournalFile(path, SITE, Limits(400, 500))
    for kind, text, data in (("anchor", "rows 1 to 20 go: they are too old", said), ("press", "", {"n": 60})):
        file.write([Entry(stored(path)[-1].at, kind, "", "", text, canonical(data))])
    file.close()


def started_on(path: Path) -> SqliteJournal:
    """Let a manager write MORE rows to it, with a look at the file after each."""

    async def main() -> SqliteJournal:
        kept = journal(path)
        async with writing(kept):
            for number in range(MORE):
                assert await kept.before(press(100 + number)) is None
        return kept

    return asyncio.run(main())


def count(path: Path) -> int:
    with opened_raw(path) as connection:
        (rows,) = connection.execute("SELECT count(*) FROM rows").fetchone()
    return int(rows)


MORE = 30


def test_an_anchor_that_fits_lets_rows_go(path: Path) -> None:
    anchored(path)
    started_on(path)
    assert stored(path)[0].seq == 21


ANCHOR = 61


@pytest.mark.parametrize(
    "statement",
    [
        f"UPDATE rows SET data = replace(data, 'through', 'thsough') WHERE seq = {ANCHOR}",
        f"UPDATE rows SET data = replace(data, '20', '40') WHERE seq = {ANCHOR}",
        f"UPDATE rows SET data = '{{' WHERE seq = {ANCHOR}",
        f"UPDATE rows SET data = x'00' WHERE seq = {ANCHOR}",
        f"UPDATE rows SET data = '[1]' WHERE seq = {ANCHOR}",
        f"UPDATE rows SET hash = x'00' WHERE seq = {ANCHOR - 1}",
        f"DELETE FROM rows WHERE seq = {ANCHOR - 1}",
        "UPDATE rows SET hash = x'00' WHERE seq = 20",
        "DELETE FROM rows WHERE seq = 20",
        # one that somebody made of a press, behind the one that fits
        "UPDATE rows SET kind = 'anchor' WHERE seq = 62",
    ],
)
def test_nothing_is_cut_on_the_word_of_an_anchor_that_does_not_fit_the_chain_and_rows_are_written_on(
    path: Path, statement: str, caplog: pytest.LogCaptureFixture
) -> None:
    anchored(path)
    write_end(path)
    sql(statement)(path)
    before = count(path)
    assert started_on(path).trouble == ""
    assert count(path) == before + MORE
    (line,) = [line for line in caplog.messages if "anchor" in line]
    assert f"{path}: row " in line
    assert "is not as it was written, so nothing is cut on its word" in line
    assert "see what `lift-manager audit --verify` says of the journal" in line


def write_end(path: Path) -> None:
    """Write two rows more, so that what is spoilt is not at the end, where it would be seen at the start."""
    file = JournalFile(path, SITE, Limits(400, 500))
    file.write([Entry(stored(path)[-1].at, "link", "", "", "", "{}")] * 2)
    file.close()


@pytest.mark.parametrize("column", ["at", "hash"])
def test_a_damaged_row_among_the_oldest_is_a_refusal_to_cut_and_ends_nobody(
    path: Path, column: str, caplog: pytest.LogCaptureFixture
) -> None:
    old = round(datetime(2020, 1, 1, tzinfo=UTC).timestamp()) * 1_000_000
    file = JournalFile(path, SITE, Limits(400, 500))
    file.write([Entry(old, "link", "", "", "", "{}")] * 60)
    file.close()
    write_presses(path, 2, keep_days=10_000)
    sql(f"UPDATE rows SET {column} = 'x' WHERE seq IN (1, 60)")(path)
    assert started_on(path).trouble == ""
    assert count(path) == 62 + MORE
    (line,) = [line for line in caplog.messages if "the oldest rows were not cut off" in line]
    assert f"{path}: the oldest rows were not cut off: row " in line
    assert "holds what no manager writes" in line
    assert "see what `lift-manager audit --verify` says of it" in line
