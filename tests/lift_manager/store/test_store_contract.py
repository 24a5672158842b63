"""What any store does: in a database on the disk, in memory, or in etcd."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lift_manager.cluster.content import Head, Place, encode_head, encode_key
from lift_manager.cluster.etcd import Etcd, put
from lift_manager.cluster.store import EtcdStore
from lift_manager.cluster.term import Key
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.retention import Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import MemoryStore, PendingRow, Store
from tests.lift_manager.store.journal_disk import LIFTS, SITE, press
from tests.lift_manager.store.test_recall_contract import EVERYTHING, RECORD, VALUES
from tests.support.etcd import Members, etcd_members
from tests.support.memory_etcd import MemoryEtcd

EAST, OTHER = LIFTS
Again = Callable[[], Store]
"""Opens the store, or opens it again, as a restart of the manager does."""


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Members]:
    with etcd_members(tmp_path_factory.mktemp("etcd")) as members:
        yield members


@pytest.fixture(params=["sqlite", "memory", "etcd stand-in", pytest.param("etcd", marks=pytest.mark.external("etcd"))])
def again(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Again]:
    if request.param.startswith("etcd"):
        place, key = Place(str(tmp_path)), Key(0, 1, "a", "http://a:5003")
        is_real = request.param == "etcd"
        etcd = Etcd(request.getfixturevalue("members").urls, timeout_s=5.0) if is_real else MemoryEtcd()
        etcd.transact([], [put(place.active, encode_key(key)), put(place.head, encode_head(Head(0, "")))])
        yield lambda: EtcdStore(etcd, place, key, ("a", "b"))
        etcd.close()
        return
    if request.param == "memory":
        memory = MemoryStore()
        yield lambda: memory
        return
    yield lambda: SqliteStore(tmp_path / "var" / "site.db", SITE, Limits(400, 500))


def noted(number: int) -> PendingRow:
    return PendingRow(1_800_000_000_000_000 + number, press(number))


def test_a_store_that_nothing_was_committed_to_is_empty(again: Again) -> None:
    store = again()
    assert store.load() == {}
    store.commit({}, [])
    assert (store.load(), list(store.tail(5))) == ({}, [])


@pytest.mark.parametrize("record", VALUES)
def test_a_record_is_loaded_as_it_was_committed(again: Again, record: SavedLift) -> None:
    store = again()
    store.commit({EAST: EVERYTHING}, [])
    store.commit({EAST: record, OTHER: EVERYTHING}, [])
    store.close()
    assert again().load() == {EAST: record, OTHER: EVERYTHING}


def test_rows_are_kept_in_order_behind_those_of_earlier_commits_and_starts(again: Again) -> None:
    for begin in (0, 3, 6):
        store = again()
        store.commit({}, [noted(begin)])
        store.commit({}, [noted(begin + 1), noted(begin + 2)])
        store.close()
    store = again()
    assert list(store.tail(100)) == [noted(number) for number in range(9)]
    assert list(store.tail(2)) == [noted(7), noted(8)]
    assert list(store.tail(0)) == []
    store.close()


def test_records_and_rows_of_one_commit_are_there_together(again: Again) -> None:
    store = again()
    store.commit({EAST: EVERYTHING}, [noted(1)])
    store.commit({EAST: SavedLift(RECORD)}, [noted(2)])
    store.close()
    store = again()
    assert store.load() == {EAST: SavedLift(RECORD)}
    assert list(store.tail(9)) == [noted(1), noted(2)]
    store.close()


def test_a_closed_store_goes_on_with_the_next_call(again: Again) -> None:
    store = again()
    store.commit({}, [noted(1)])
    store.close()
    store.close()
    store.commit({}, [noted(2)])
    assert list(store.tail(9)) == [noted(1), noted(2)]
    store.close()


def test_upkeep_ends_and_leaves_what_is_young(again: Again) -> None:
    store = again()
    store.commit({EAST: EVERYTHING}, [noted(1)])
    check = True
    while store.do_upkeep(1_800_000_000_000_002, check=check).more:
        check = False
    assert list(store.tail(9)) == [noted(1)]
    store.close()


def test_a_row_without_a_lift_and_one_of_an_event_are_rows_too(again: Again) -> None:
    store = again()
    rows = [
        PendingRow(1, Row(RowKind.MANAGER, "started")),
        PendingRow(2, Row(RowKind.ALARM, "the door is blocked", EAST, data={"a": [1, 2.5, None]})),
    ]
    store.commit({}, rows)
    assert list(store.tail(2)) == rows
    store.close()
