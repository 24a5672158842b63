"""Which rows of a journal follow the one that was published last."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.hub.outbox import BACKLOG, BATCH, JournalReader, Published
from tests.support.journal import Journal


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "x.db")
    yield journal
    journal.end()


def texts(found: list[Published]) -> list[str]:
    return [entry.row.text for entry in found]


def test_a_journal_that_is_not_made_yet_has_no_rows(tmp_path: Path) -> None:
    assert JournalReader(tmp_path / "none.db").after(None) == []


def test_a_reader_that_starts_again_goes_on_behind_the_newest_published_row(journal: Journal) -> None:
    journal.write("a", "b")
    first = JournalReader(journal.path).after(None)
    journal.write("c")
    later = JournalReader(journal.path).after(first[-1])
    assert (texts(first), texts(later)) == (["a", "b"], ["c"])
    assert {entry.journal for entry in (*first, *later)} == {first[0].journal}


def test_it_reads_only_what_has_changed_and_all_of_it(journal: Journal) -> None:
    reader = JournalReader(journal.path)
    journal.write(*(f"row {number}" for number in range(BATCH + 5)))
    first = reader.after(None)
    rest = reader.after(first[-1])
    assert (len(first), len(rest), reader.after(rest[-1])) == (BATCH, 5, [])
    reader.again()
    assert reader.after(rest[-1]) == []


def test_of_a_long_journal_that_nobody_knows_only_the_end_is_published(journal: Journal) -> None:
    journal.write(*(["x"] * (BACKLOG + 50)))
    assert JournalReader(journal.path).after(None)[0].row.seq == 51


def test_a_journal_from_a_backup_is_another_one_and_goes_on_with_what_is_new(journal: Journal, tmp_path: Path) -> None:
    journal.write("a")
    journal.end()
    shutil.copy(journal.path, tmp_path / "backup.db")
    lost = Journal(journal.path, since_s=10)
    lost.write("b", "c, which is lost")
    reader = JournalReader(journal.path)
    published = reader.after(None)
    reader.close()
    lost.end()
    (tmp_path / "backup.db").replace(journal.path)
    restored = Journal(journal.path, since_s=60)
    restored.write("restored", "d", "e")
    found = JournalReader(journal.path).after(published[-1])
    restored.end()
    assert texts(found) == ["restored", "d", "e"]
    assert [entry.row.seq for entry in found] == [2, 3, 4]
    assert {entry.journal for entry in found}.isdisjoint({published[0].journal})
    # and it stays the same one from then on
    assert JournalReader(journal.path).after(found[0])[0].journal == found[0].journal
