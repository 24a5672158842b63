"""What the hub stores of journals: each row once, gaps as events, and never more of one site than it may have."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.hub.messages import Position, RowMessage
from lift_manager.hub.rows import RowStore


@pytest.fixture
def store(tmp_path: Path) -> Iterator[RowStore]:
    store = RowStore(tmp_path / "hub.db")
    yield store
    store.close()


def row(seq: int, journal: str = "j", text: str = "") -> RowMessage:
    about = {"kind": "press", "lift": "", "caller": "", "data": "{}", "hash": "0" * 64}
    return RowMessage(journal=journal, seq=seq, at=0, text=text, **about)


def at(number: int, stream: str = "s") -> Position:
    return Position(stream=stream, at=number)


def names(store: RowStore, site: str | None = None) -> list[str]:
    return [event.name for event in store.after(0, site)]


def test_a_row_that_comes_again_is_the_same_row_over_streams_and_restarts(store: RowStore, tmp_path: Path) -> None:
    assert len(store.add_rows("a", [row(1), row(2)], at(2))) == 2
    assert store.add_rows("a", [row(1), row(2)], at(2, "another stream")) == []
    store.close()
    again = RowStore(tmp_path / "hub.db")
    assert [event.number for event in again.add_rows("a", [row(2), row(3)], at(4, "another stream"))] == [3]
    assert again.positions() == {"a": at(4, "another stream")}
    again.close()


def test_the_same_number_of_another_site_or_journal_is_another_row(store: RowStore) -> None:
    store.add_rows("a", [row(1), row(1, "restored")], at(2))
    store.add_rows("b", [row(1)], at(1))
    assert names(store) == ["row"] * 3


def test_numbers_that_are_skipped_are_a_gap(store: RowStore) -> None:
    found = store.add_rows("a", [row(3), row(4), row(9)], at(3))
    assert [event.name for event in found] == ["gap", "row", "row", "gap", "row"]
    assert '"first":1,"last":2' in found[0].text
    assert '"first":5,"last":8' in found[3].text


def test_a_site_with_too_many_events_loses_its_own_oldest(tmp_path: Path) -> None:
    store = RowStore(tmp_path / "hub.db", kept=20, max_bytes=50_000)
    store.add_rows("a", [row(1)], at(1))
    for first in range(1, 200, 10):
        store.add_rows("noisy", [row(first + number) for number in range(10)], at(first))
    assert names(store, "a") == ["row"]
    assert 10 <= len(names(store, "noisy")) <= 20
    for first in range(201, 300, 10):
        store.add_rows("noisy", [row(first + number, text="x" * 10_000) for number in range(10)], at(first))
    assert sum(len(event.text) for event in store.after(0, "noisy")) < 200_000
    assert names(store, "a") == ["row"]
    store.close()


def test_a_row_longer_than_any_that_a_manager_writes_is_refused() -> None:
    with pytest.raises(ValueError, match="text"):
        row(1, text="x" * 100_000)
