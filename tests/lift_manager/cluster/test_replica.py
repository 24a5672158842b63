"""The copy on each machine: every row once and in order, the newest records, and no rows left in etcd."""

import asyncio
import itertools
from pathlib import Path

import pytest

from lift_manager.cluster.content import Head, Place, encode_head, encode_key
from lift_manager.cluster.errors import EtcdUnavailable
from lift_manager.cluster.etcd import put, read_all
from lift_manager.cluster.replica import COMMITS_AT_ONCE, Replica, copy_all
from lift_manager.cluster.store import MOST_COMMITS, EtcdStore
from lift_manager.cluster.term import Key
from lift_manager.lift.journal import RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_copy
from lift_manager.store.store import MemoryStore, PendingRow
from tests.lift_manager.cluster.test_member import AtOnce
from tests.lift_manager.store.journal_disk import SITE, journal, press, stored
from tests.lift_manager.store.test_recall_contract import EVERYTHING, RECORD
from tests.support.memory_etcd import MemoryEtcd
from tests.support.virtual_time import elapse, run_virtual

PLACE = Place("Main hospital")
KEY = Key(0, 1, "a", "http://a:5003")
LATER = 1_900_000_000_000_000


@pytest.fixture
def etcd() -> MemoryEtcd:
    etcd = MemoryEtcd()
    etcd.transact([], [put(PLACE.active, encode_key(KEY)), put(PLACE.head, encode_head(Head(0, "made")))])
    return etcd


@pytest.fixture
def active(etcd: MemoryEtcd) -> EtcdStore:
    return EtcdStore(etcd, PLACE, KEY, ("a", "b"))


def noted(*range_of: int) -> list[PendingRow]:
    return [PendingRow(1_800_000_000_000_000 + number, press(number)) for number in range(*range_of)]


def test_rows_and_records_of_every_commit_are_copied_once(etcd: MemoryEtcd, active: EtcdStore) -> None:
    disk = MemoryStore()
    replica = Replica("a", etcd, PLACE, disk)
    for number in range(5):
        active.commit({"east": EVERYTHING}, noted(number, number + 1))
        active.commit({"east": SavedLift(RECORD)}, [])
        replica.step(LATER)
        replica.step(LATER)
        assert (disk.rows, disk.records) == (noted(number + 1), {"east": SavedLift(RECORD)})


def test_a_manager_that_is_alone_continues_from_the_copy(etcd: MemoryEtcd, active: EtcdStore, tmp_path: Path) -> None:
    path = tmp_path / "site.db"
    active.commit({"east": EVERYTHING}, noted(3))
    replica = Replica("a", etcd, PLACE, open_copy(path, SITE, Limits(400, 500)))
    replica.step(LATER)
    replica.close()
    assert journal(path).recall("east") == EVERYTHING
    assert [row.text for row in stored(path)] == [row.row.text for row in noted(3)]


def test_without_a_majority_what_one_member_has_is_copied_and_not_reported(etcd: MemoryEtcd, active: EtcdStore) -> None:
    active.commit({"east": EVERYTHING}, noted(3))
    etcd.has_majority, disk = False, MemoryStore()
    assert Replica("a", etcd, PLACE, disk, local=True).step(LATER) == (3, False)
    assert (disk.rows, disk.records) == (noted(3), {"east": EVERYTHING})
    assert f"{PLACE.copied}a" not in etcd.entries


def test_many_commits_are_copied_in_steps_and_the_records_with_the_last(etcd: MemoryEtcd, active: EtcdStore) -> None:
    active.commit({"east": EVERYTHING}, [])
    for number in range(COMMITS_AT_ONCE + 1):
        active.commit({}, noted(number, number + 1))
    disk = MemoryStore()
    replica = Replica("a", etcd, PLACE, disk)
    assert replica.step(LATER) == (COMMITS_AT_ONCE, True)
    assert disk.records == {}
    assert replica.step(LATER) == (1, False)
    assert (disk.rows, disk.records) == (noted(COMMITS_AT_ONCE + 1), {"east": EVERYTHING})


def test_rows_that_both_machines_have_leave_etcd(etcd: MemoryEtcd, active: EtcdStore) -> None:
    disks = {"a": MemoryStore(), "b": MemoryStore()}
    for number, (name, disk) in enumerate(disks.items()):
        active.commit({}, noted(3 * number, 3 * number + 3))
        Replica(name, etcd, PLACE, disk).step(LATER)
    active.do_upkeep(LATER, check=False)
    assert len(etcd.transact([], [read_all(PLACE.rows)]).ranges[0]) == 1
    for name, disk in disks.items():
        Replica(name, etcd, PLACE, disk).step(LATER)
        assert disk.rows == noted(6)
    active.do_upkeep(LATER, check=False)
    assert etcd.transact([], [read_all(PLACE.rows)]).ranges == ((),)


@pytest.mark.parametrize("rows_of_next", [0, 2])
def test_a_process_that_ended_before_etcd_knew_what_it_had_copied_repeats_nothing(
    etcd: MemoryEtcd, active: EtcdStore, rows_of_next: int
) -> None:
    disk = MemoryStore()
    active.commit({}, noted(2))
    Replica("a", etcd, PLACE, disk).step(LATER)
    active.commit({}, noted(2, 5))
    etcd.lose = iter(("", "", "request"))
    with pytest.raises(EtcdUnavailable):
        Replica("a", etcd, PLACE, disk).step(LATER)
    assert disk.rows == noted(5)
    active.commit({}, noted(5, 5 + rows_of_next))
    again = Replica("a", etcd, PLACE, disk)
    again.step(LATER)
    again.step(LATER)
    assert disk.rows == noted(5 + rows_of_next)


@pytest.mark.parametrize("lost", ["request", "answer"])
@pytest.mark.parametrize("missed", [False, True])
def test_a_process_that_goes_on_repeats_nothing_that_etcd_did_not_learn_of(
    etcd: MemoryEtcd, active: EtcdStore, lost: str, *, missed: bool
) -> None:
    disk = MemoryStore()
    replica = Replica("a", etcd, PLACE, disk)
    active.commit({}, noted(2))
    replica.step(LATER)
    if missed:
        etcd.transact([], [put(PLACE.head, encode_head(Head(MOST_COMMITS + 9, "x")))])
        active = EtcdStore(etcd, PLACE, KEY, ("a", "b"))
    active.commit({}, noted(2, 5))
    if missed:
        active.do_upkeep(LATER, check=False)
    etcd.lose = iter(("", lost))
    with pytest.raises(EtcdUnavailable):
        replica.step(LATER)
    active.commit({}, noted(5, 6))
    replica.step(LATER)
    replica.step(LATER)
    assert [row for row in disk.rows if row.row.kind is not RowKind.GAP] == noted(6)
    assert len(disk.rows) == 6 + missed
    active.do_upkeep(LATER, check=False)
    Replica("a", etcd, PLACE, disk).step(LATER)
    assert len(disk.rows) == 6 + missed


def test_a_journal_that_missed_rows_says_so(etcd: MemoryEtcd, active: EtcdStore) -> None:
    disk = MemoryStore()
    active.commit({}, noted(1))
    Replica("b", etcd, PLACE, disk).step(LATER)
    etcd.transact([], [put(PLACE.head, encode_head(Head(MOST_COMMITS + 9, "x")))])
    later = EtcdStore(etcd, PLACE, KEY, ("a", "b"))
    later.commit({}, noted(1, 2))
    later.do_upkeep(LATER, check=False)
    Replica("b", etcd, PLACE, disk).step(LATER)
    assert [row.row.kind for row in disk.rows] == [RowKind.PRESS, RowKind.GAP, RowKind.PRESS]
    assert disk.rows[1].row.data == {"from_commit": 2, "to_commit": 10}


def test_the_journal_of_a_machine_that_was_replaced_says_what_it_lacks(etcd: MemoryEtcd, active: EtcdStore) -> None:
    active.commit({"east": EVERYTHING}, noted(3))
    for machine in ("a", "b"):
        Replica(machine, etcd, PLACE, MemoryStore()).step(LATER)
    active.do_upkeep(LATER, check=False)
    active.commit({}, noted(3, 5))
    disk = MemoryStore()
    Replica("b", etcd, PLACE, disk).step(LATER)
    assert [row.row.kind for row in disk.rows] == [RowKind.GAP, *(row.row.kind for row in noted(3, 5))]
    assert "up to 1 commit are only in the journal of the other machine" in disk.rows[0].row.text
    assert disk.records == {"east": EVERYTHING}


def test_an_etcd_that_was_never_prepared_has_nothing_to_copy() -> None:
    disk = MemoryStore()
    assert Replica("a", MemoryEtcd(), PLACE, disk).step(LATER) == (0, False)
    assert (disk.rows, disk.records) == ([], {})


def test_what_cannot_be_copied_is_logged_once_and_copied_later(
    etcd: MemoryEtcd, active: EtcdStore, caplog: pytest.LogCaptureFixture
) -> None:
    disk = MemoryStore()

    async def check() -> None:
        ended = asyncio.Event()
        etcd.lose = itertools.repeat("request")
        copying = asyncio.create_task(
            copy_all(Replica("a", etcd, PLACE, disk), ended, jobs=AtOnce, now_us=lambda: LATER)
        )
        await elapse(5.0)
        etcd.lose = iter(())
        active.commit({}, noted(1))
        await elapse(1.0)
        assert disk.rows == noted(1)
        active.commit({}, noted(1, 2))
        ended.set()
        await copying

    run_virtual(check)
    assert disk.rows == noted(2)
    assert [record.levelname for record in caplog.records] == ["ERROR"]
