"""The store that two managers share: the key is its fence, and a lost answer neither loses nor repeats anything."""

import itertools
import json

import pytest

from lift_manager.cluster.content import (
    MIGRATIONS,
    VERSION,
    Head,
    Place,
    decode_record,
    decode_rows,
    encode_head,
    encode_key,
    encode_number,
)
from lift_manager.cluster.errors import ClusterUnusable, EtcdUnavailable
from lift_manager.cluster.etcd import Entry, put, read, read_all
from lift_manager.cluster.store import MOST_COMMITS, ROWS_IN_A_COMMIT, UPKEEP_COMMITS, EtcdStore
from lift_manager.cluster.term import Key
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.errors import CommitFailed
from lift_manager.store.store import PendingRow
from tests.lift_manager.store.journal_disk import press
from tests.lift_manager.store.test_recall_contract import EVERYTHING, RECORD
from tests.support.memory_etcd import MemoryEtcd

PLACE = Place("Main hospital")
OURS, THEIRS = Key(0, 4, "a", "http://a:5003"), Key(0, 5, "b", "http://b:5003")


@pytest.fixture
def etcd() -> MemoryEtcd:
    etcd = MemoryEtcd()
    etcd.transact([], [put(PLACE.active, encode_key(OURS)), put(PLACE.head, encode_head(Head(0, "made")))])
    return etcd


def store_of(etcd: MemoryEtcd, key: Key = OURS, *, tries_s: float = 0.0) -> EtcdStore:
    """Open the store; it gives up at the first lost answer, unless it tries for some time."""
    return EtcdStore(etcd, PLACE, key, ("a", "b"), tries_s=tries_s, retry_s=0.0)


def noted(*range_of: int) -> list[PendingRow]:
    return [PendingRow(1_800_000_000_000_000 + number, press(number)) for number in range(*range_of)]


def stored(etcd: MemoryEtcd) -> list[PendingRow]:
    (entries,) = etcd.transact([], [read_all(PLACE.rows)]).ranges
    return [row for entry in entries for row in decode_rows(entry)]


def lose(etcd: MemoryEtcd, *what: str) -> None:
    etcd.lose = iter(what)


def take_over(etcd: MemoryEtcd) -> EtcdStore:
    etcd.transact([], [put(PLACE.active, encode_key(THEIRS))])
    return store_of(etcd, THEIRS)


def test_nothing_is_stored_once_another_manager_has_the_key(etcd: MemoryEtcd) -> None:
    ours = store_of(etcd)
    ours.commit({"east": EVERYTHING}, noted(3))
    take_over(etcd)
    before = dict(etcd.entries)
    for records, rows in (({"east": SavedLift()}, noted(3, 5)), ({}, noted(3, 4)), ({}, [])):
        with pytest.raises(CommitFailed, match="not active any more"):
            ours.commit(records, rows)
    assert etcd.entries == before


def test_a_manager_that_takes_over_finds_all_that_was_committed(etcd: MemoryEtcd) -> None:
    store_of(etcd).commit({"east": EVERYTHING}, noted(3))
    theirs = take_over(etcd)
    assert theirs.load() == {"east": EVERYTHING}
    theirs.commit({"east": SavedLift(RECORD)}, noted(3, 5))
    assert stored(etcd) == noted(5)


def test_a_newer_manager_continues_what_an_older_one_left(etcd: MemoryEtcd) -> None:
    store_of(etcd).commit({"east": EVERYTHING}, noted(3))
    (written,) = etcd.transact([], [read(f"{PLACE.records}east")]).ranges[0]
    older = json.loads(written.value)
    older["saved"]["was_called_record"] = older["saved"].pop("record")

    def migrate(saved: dict[str, object]) -> dict[str, object]:
        return {"record": saved.pop("was_called_record")} | saved

    entry = Entry(written.key, json.dumps(older).encode(), 1)
    assert decode_record(entry, (*MIGRATIONS, migrate)) == EVERYTHING
    with pytest.raises(ClusterUnusable, match="is not one that a manager of this version writes"):
        decode_record(entry)


def test_what_a_newer_manager_wrote_is_refused_in_words(etcd: MemoryEtcd) -> None:
    ours = store_of(etcd)
    ours.commit({"east": EVERYTHING}, noted(3))
    newer = json.dumps({"version": VERSION + 1, "saved": {}}).encode()
    head = encode_head(Head(2, "x", version=VERSION + 1))
    for key, value in ((f"{PLACE.records}east", newer), (PLACE.head, head)):
        etcd.transact([], [put(key, value)])
        with pytest.raises(ClusterUnusable, match="install the newer version on this machine too"):
            store_of(etcd).load()


@pytest.mark.parametrize("lost", ["request", "answer"])
def test_the_next_commit_stores_what_a_lost_one_did_not_and_nothing_twice(etcd: MemoryEtcd, lost: str) -> None:
    ours = store_of(etcd)
    ours.commit({}, noted(2))
    lose(etcd, lost)
    with pytest.raises(CommitFailed, match="cannot be written"):
        ours.commit({"east": EVERYTHING}, noted(2, 4))
    ours.commit({"east": SavedLift(RECORD)}, noted(2, 6))
    assert stored(etcd) == noted(6)
    assert ours.load() == {"east": SavedLift(RECORD)}


@pytest.mark.parametrize("lost", ["request", "answer"])
def test_a_commit_is_tried_again_by_itself(etcd: MemoryEtcd, lost: str) -> None:
    ours = store_of(etcd, tries_s=60.0)
    ours.load()
    lose(etcd, lost, lost, "request")
    ours.commit({"east": EVERYTHING}, noted(2))
    assert stored(etcd) == noted(2)
    assert ours.load() == {"east": EVERYTHING}


def test_whatever_is_lost_every_row_is_there_once_and_in_order(etcd: MemoryEtcd) -> None:
    ours, queue, committed, number = store_of(etcd), list[PendingRow](), 0, 0
    ours.load()
    for losses in itertools.product(("", "request", "answer"), repeat=5):
        queue += noted(number, number + 2)
        number += 2
        lose(etcd, *losses)
        for _ in losses:
            queue = _tried(ours, queue)
            queue += noted(number, number + 1)
            number += 1
        etcd.lose = iter(())
        queue = _tried(ours, queue)
        assert queue == []
        committed += 1
    assert stored(etcd) == noted(number)
    assert committed == 3**5


def _tried(store: EtcdStore, queue: list[PendingRow]) -> list[PendingRow]:
    """What is still queued after an attempt to commit it, as the Committer keeps it."""
    try:
        store.commit({}, queue)
    except CommitFailed:
        return queue
    return []


def test_a_late_attempt_of_the_same_manager_changes_nothing(etcd: MemoryEtcd) -> None:
    ours = store_of(etcd)
    ours.load()
    lose(etcd, "request")
    with pytest.raises(CommitFailed):
        ours.commit({"east": EVERYTHING}, noted(1))
    late = etcd.newest
    ours.commit({"east": SavedLift(RECORD)}, noted(2))
    assert not etcd.transact(*late).succeeded
    assert store_of(etcd).load() == {"east": SavedLift(RECORD)}
    assert stored(etcd) == noted(2)


def test_many_rows_go_in_several_transactions_and_the_records_with_the_last(etcd: MemoryEtcd) -> None:
    ours, rows = store_of(etcd), noted(2 * ROWS_IN_A_COMMIT + 1)
    ours.load()
    lose(etcd, "", "answer")
    with pytest.raises(CommitFailed):
        ours.commit({"east": EVERYTHING}, rows)
    assert store_of(etcd).load() == {}
    assert stored(etcd) == rows[: 2 * ROWS_IN_A_COMMIT]
    ours.commit({"east": EVERYTHING}, rows)
    assert store_of(etcd).load() == {"east": EVERYTHING}
    assert stored(etcd) == rows


def test_rows_leave_etcd_once_both_machines_have_copied_them(etcd: MemoryEtcd) -> None:
    ours = store_of(etcd)
    needs_upkeep = [ours.commit({}, noted(number, number + 1)) for number in range(UPKEEP_COMMITS)]
    assert needs_upkeep == [False] * (UPKEEP_COMMITS - 1) + [True]
    etcd.transact([], [put(f"{PLACE.copied}a", encode_number(40))])
    ours.do_upkeep(0, check=False)
    assert len(stored(etcd)) == UPKEEP_COMMITS
    etcd.transact([], [put(f"{PLACE.copied}b", encode_number(30))])
    ours.do_upkeep(0, check=False)
    assert stored(etcd) == noted(30, UPKEEP_COMMITS)


def test_rows_are_not_kept_for_ever_for_a_machine_that_is_away(etcd: MemoryEtcd) -> None:
    etcd.transact([], [put(PLACE.head, encode_head(Head(MOST_COMMITS + 2, "x"))), put(PLACE.rows_of(3), b"[]")])
    ours = store_of(etcd)
    ours.commit({}, noted(1))
    ours.do_upkeep(0, check=False)
    assert stored(etcd) == noted(1)
    assert etcd.transact([], [read(PLACE.rows_of(3))]).ranges == ((),)


def test_a_takeover_reads_from_another_member_if_one_does_not_answer(etcd: MemoryEtcd) -> None:
    store_of(etcd).commit({"east": EVERYTHING}, [])
    lose(etcd, "answer", "request")
    assert store_of(etcd, tries_s=60.0).load() == {"east": EVERYTHING}
    lose(etcd, "answer")
    with pytest.raises(EtcdUnavailable):
        store_of(etcd).load()


def test_an_etcd_that_was_never_prepared_is_not_used() -> None:
    with pytest.raises(ClusterUnusable, match="cluster init"):
        store_of(MemoryEtcd()).load()


def test_a_value_that_no_manager_writes_is_named(etcd: MemoryEtcd) -> None:
    etcd.transact([], [put(f"{PLACE.records}east", b"{}")])
    with pytest.raises(ClusterUnusable, match="records/east"):
        store_of(etcd).load()
