"""What people do with a cluster: prepare it once, look at it, hand over."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import pytest

from lift_manager.cluster import operations
from lift_manager.cluster.connect import certificates_of, etcd_of, machine_of
from lift_manager.cluster.content import (
    Handover,
    Head,
    Place,
    Solo,
    decode_handover,
    encode_head,
    encode_key,
    encode_number,
    encode_solo,
)
from lift_manager.cluster.errors import ClusterUnusable
from lift_manager.cluster.etcd import Json, Result, put, read
from lift_manager.cluster.replica import Replica
from lift_manager.cluster.store import EtcdStore
from lift_manager.cluster.term import Key
from lift_manager.config.site import Cluster
from lift_manager.lift.journal import Row, RowKind
from lift_manager.runtime.recorder import SavedLift
from lift_manager.store.store import MemoryStore, PendingRow
from tests.lift_manager.store.test_recall_contract import EVERYTHING
from tests.support.memory_etcd import MemoryEtcd

PLACE = Place("Main hospital")
NORTH, SOUTH = Key(0, 4, "north", "http://north:5003"), Key(0, 5, "south", "http://south:5003")
MACHINES = {"north": {"address": "http://10.0.0.1:5003"}, "south": {"address": "http://10.0.0.2:5003"}}


def prepared() -> MemoryEtcd:
    etcd = MemoryEtcd()
    operations.prepare(etcd, PLACE, {"east": EVERYTHING})
    return etcd


def test_what_one_machine_remembers_becomes_what_both_do() -> None:
    etcd = prepared()
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"east": EVERYTHING}
    assert operations.read_status(etcd, PLACE).key.owner == ""


def test_a_cluster_is_prepared_once() -> None:
    etcd = prepared()
    with pytest.raises(ClusterUnusable, match="holds this site already"):
        operations.prepare(etcd, PLACE, {})
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"east": EVERYTHING}


def test_what_etcd_holds_is_replaced_as_a_whole_and_the_epoch_only_rises() -> None:
    etcd = prepared()
    etcd.transact([], [put(PLACE.active, encode_key(NORTH)), put(PLACE.rows_of(3), b"[]")])
    operations.replace(etcd, PLACE, {"west": SavedLift()}, unchanged_s=0.0)
    operations.replace(etcd, PLACE, {"east": SavedLift()}, unchanged_s=0.0)
    assert EtcdStore(etcd, PLACE, SOUTH, MACHINES).load() == {"east": SavedLift()}
    assert operations.read_status(etcd, PLACE).key.epoch == NORTH.epoch
    assert PLACE.rows_of(3) not in etcd.entries


@pytest.mark.parametrize(("epoch", "begins"), [(0, 4), (3, 4), (4, 4), (70_000, 70_000)])
@pytest.mark.parametrize("is_replaced", [False, True])
def test_an_etcd_begins_above_what_a_controller_has_obeyed_and_never_below_what_it_had_itself(
    epoch: int, begins: int, *, is_replaced: bool
) -> None:
    etcd = MemoryEtcd()
    etcd.transact([], [put(PLACE.active, encode_key(NORTH))])
    if is_replaced:
        operations.replace(etcd, PLACE, {}, epoch=epoch, unchanged_s=0.0)
    else:
        operations.prepare(etcd, PLACE, {}, epoch=epoch)
    assert operations.read_status(etcd, PLACE).key.epoch == begins


def test_an_etcd_that_is_new_begins_far_above_the_epochs_that_a_machine_knows() -> None:
    etcd = MemoryEtcd()
    operations.prepare(etcd, PLACE, {}, known_epoch=7)
    assert operations.read_status(etcd, PLACE).key.epoch == 7 + operations.EPOCHS_AHEAD
    operations.replace(etcd, PLACE, {}, known_epoch=8)
    assert operations.read_status(etcd, PLACE).key.epoch == 7 + operations.EPOCHS_AHEAD


def test_nothing_is_replaced_while_a_manager_renews_its_key() -> None:
    etcd = Renewed()
    etcd.transact([], [put(PLACE.active, encode_key(NORTH)), put(PLACE.head, encode_head(Head(9, "x")))])
    with pytest.raises(ClusterUnusable, match="a manager is active"):
        operations.replace(etcd, PLACE, {}, unchanged_s=0.0)
    assert PLACE.head in etcd.entries


class Renewed(MemoryEtcd):
    """Its key is renewed after each transaction."""

    def transact(self, compare: Sequence[Json], then: Sequence[Json], otherwise: Sequence[Json] = ()) -> Result:
        result = super().transact(compare, then, otherwise)
        super().transact([], [put(PLACE.active, encode_key(NORTH))])
        return result


SOLO = Solo("abc", "north", "south", "Eve", "today", 1_000_004, 7, 9)


def alone(head: int = 9) -> MemoryEtcd:
    """An etcd that knows that north goes on alone; south was active before."""
    etcd = prepared()
    writes = [put(PLACE.active, encode_key(SOUTH)), put(PLACE.head, encode_head(Head(head, "x")))]
    writes += [put(PLACE.solo, encode_solo(SOLO)), put(f"{PLACE.copied}south", encode_number(head))]
    etcd.transact([], writes)
    return etcd


def test_a_machine_that_went_on_alone_brings_what_it_remembers_once() -> None:
    etcd = alone()
    assert operations.replace(etcd, PLACE, {"west": SavedLift()}, SOLO, unchanged_s=0.0) == 0
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"west": SavedLift()}
    status = operations.read_status(etcd, PLACE)
    assert (status.key.epoch, status.key.owner, status.solo) == (SOLO.epoch, "", None)
    assert operations.replace(etcd, PLACE, {}, SOLO, unchanged_s=0.0) == 0
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"west": SavedLift()}


def test_the_journal_of_the_other_machine_says_what_it_lacks_since_then() -> None:
    etcd, disk = alone(), {"north": MemoryStore(), "south": MemoryStore()}
    operations.replace(etcd, PLACE, {}, SOLO, unchanged_s=0.0)
    for name, store in disk.items():
        store.rows = [PendingRow(0, Row(RowKind.MANAGER, "before"))]
        Replica(name, etcd, PLACE, store).step(1)
    assert [row.row.text for row in disk["north"].rows] == ["before"]
    assert [row.row.text for row in disk["south"].rows] == [
        "before",
        "rows of up to 1 commit are only in the journal of the other machine",
    ]


def test_commits_that_the_machine_did_not_have_are_counted() -> None:
    assert operations.replace(alone(head=12), PLACE, {}, SOLO, unchanged_s=0.0) == 3


def test_only_the_machine_that_goes_on_alone_replaces_what_etcd_holds() -> None:
    etcd = alone()
    for other in (None, dataclasses.replace(SOLO, id="def")):
        with pytest.raises(ClusterUnusable, match="cluster join` on north"):
            operations.replace(etcd, PLACE, {}, other, unchanged_s=0.0)
    with pytest.raises(ClusterUnusable, match="nothing to hand over"):
        operations.hand_over(etcd, PLACE, "Eve")
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"east": EVERYTHING}


def test_what_it_decided_alone_can_be_given_up() -> None:
    etcd = alone()
    with pytest.raises(ClusterUnusable, match="and not south"):
        operations.forget_solo(etcd, PLACE, "south", unchanged_s=0.0)
    for _ in range(2):
        operations.forget_solo(etcd, PLACE, "north", unchanged_s=0.0)
    assert operations.read_status(etcd, PLACE).solo is None
    assert EtcdStore(etcd, PLACE, NORTH, MACHINES).load() == {"east": EVERYTHING}


@pytest.mark.parametrize("knows_of_it", [True, False])
def test_a_controller_obeys_the_managers_that_continue_without_what_was_decided_alone(*, knows_of_it: bool) -> None:
    etcd = alone() if knows_of_it else prepared()
    operations.forget_solo(etcd, PLACE, "north", 0 if knows_of_it else SOLO.epoch, unchanged_s=0.0)
    assert operations.read_status(etcd, PLACE).key.epoch == SOLO.epoch


def test_an_active_manager_stays_in_its_epoch_when_what_was_decided_alone_is_given_up() -> None:
    etcd = Renewed()
    etcd.transact([], [put(PLACE.head, encode_head(Head(9, "x"))), put(PLACE.solo, encode_solo(SOLO))])
    operations.forget_solo(etcd, PLACE, "north", unchanged_s=0.0)
    status = operations.read_status(etcd, PLACE)
    assert (status.key.epoch, status.key.owner, status.solo) == (NORTH.epoch, "north", None)


def test_without_a_majority_the_member_that_knows_most_is_found() -> None:
    members = [alone(head) for head in (9, 12, 11)]
    for member in members:
        member.has_majority = False
    assert operations.answering_member(members, PLACE) is None
    found = operations.best_informed(members, PLACE)
    assert found is not None
    assert (found[0], found[1].epoch, found[2]) == (members[1], SOUTH.epoch, 12)
    members[2].has_majority = True
    assert operations.answering_member(members, PLACE) is members[2]
    lost = MemoryEtcd()
    lost.lose = iter(["request"])
    assert operations.best_informed([lost], PLACE) is None


def test_the_status_has_the_active_machine_and_what_each_has_copied() -> None:
    etcd = prepared()
    etcd.transact([], [put(PLACE.active, encode_key(NORTH)), put(PLACE.head, encode_head(Head(9, "x")))])
    etcd.transact([], [put(f"{PLACE.copied}south", encode_number(7))])
    status = operations.read_status(etcd, PLACE)
    assert (status.key.owner, status.commit, status.copied) == ("north", 9, {"south": 7})
    with pytest.raises(ClusterUnusable, match="cluster init"):
        operations.read_status(MemoryEtcd(), PLACE)


def test_a_machine_is_active_while_it_renews_its_key_and_no_longer() -> None:
    assert operations.find_active(prepared(), PLACE) == ""
    for etcd, active in ((Renewed(), "north is active, at http://north:5003"), (MemoryEtcd(), "")):
        etcd.transact([], [put(PLACE.active, encode_key(NORTH))])
        assert operations.find_active(etcd, PLACE, unchanged_s=0.02, look_every_s=0.01) == active
    assert operations.find_active(alone(), PLACE) == SOLO.text


class Standby(MemoryEtcd):
    """Accepts a handover, and takes over, or does not."""

    def __init__(self, *, is_there: bool) -> None:
        super().__init__()
        self.is_there = is_there

    def transact(self, compare: Sequence[Json], then: Sequence[Json], otherwise: Sequence[Json] = ()) -> Result:
        result = super().transact(compare, then, otherwise)
        if self.is_there and PLACE.handover in self.entries:
            super().transact([], [put(PLACE.active, encode_key(SOUTH))])
        return result


def test_a_handover_ends_once_the_other_machine_is_active() -> None:
    etcd = Standby(is_there=True)
    etcd.transact([], [put(PLACE.active, encode_key(NORTH)), put(PLACE.head, encode_head(Head(9, "x")))])
    assert operations.hand_over(etcd, PLACE, "Eve").owner == "south"


def test_a_handover_that_no_standby_accepts_is_withdrawn() -> None:
    etcd = Standby(is_there=False)
    etcd.transact([], [put(PLACE.active, encode_key(NORTH)), put(PLACE.head, encode_head(Head(9, "x")))])
    with pytest.raises(ClusterUnusable, match=r"no standby has answered within 0\.1 s, so north stays active"):
        operations.hand_over(etcd, PLACE, "Eve", accepted_within_s=0.1)
    left = decode_handover(etcd.transact([], [read(PLACE.handover)]).ranges[0])
    assert left == Handover(0, "Eve")


def test_without_an_active_manager_there_is_nothing_to_hand_over() -> None:
    with pytest.raises(ClusterUnusable, match="nothing to hand over"):
        operations.hand_over(prepared(), PLACE, "Eve")


def test_a_machine_is_one_of_the_two_by_its_name_or_by_the_site_file(tmp_path: Path) -> None:
    cluster = Cluster.model_validate({"machines": MACHINES, "etcd": ["http://127.0.0.1:2379"], "machine": "south"})
    assert machine_of(cluster) == "south"
    with pytest.raises(ClusterUnusable, match="the machines of the cluster are north, south"):
        machine_of(cluster.model_copy(update={"machine": None}))
    etcd_of(cluster, certificates_of(cluster, tmp_path), timeout_s=1.0).close()


def test_certificates_that_are_gone_since_the_check_are_named(tmp_path: Path) -> None:
    tls = {"ca": "ca.pem", "certificate": "own.pem", "key": "own.key"}
    cluster = Cluster.model_validate({"machines": MACHINES, "etcd": ["https://127.0.0.1:2379"], "tls": tls})
    with pytest.raises(ClusterUnusable, match="cannot be used"):
        certificates_of(cluster, tmp_path)
