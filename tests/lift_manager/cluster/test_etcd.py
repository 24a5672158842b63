"""The client against real members of etcd: what it reads and writes, and what it reports when members are gone."""

import socket
import ssl
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.cluster.connect import etcd_of
from lift_manager.cluster.errors import EtcdRefused, EtcdUnavailable
from lift_manager.cluster.etcd import Etcd, has_revision, has_value, put, read, read_all, remove_upto
from lift_manager.config.site import Cluster
from tests.support.etcd import Certificates, Members, answers, etcd_members
from tests.support.memory_etcd import MemoryEtcd
from tests.support.programs import eventually

pytestmark = pytest.mark.external("etcd", "etcdctl")


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Members]:
    with etcd_members(tmp_path_factory.mktemp("etcd")) as members:
        yield members


@pytest.fixture(params=["real", "memory"])
def etcd(request: pytest.FixtureRequest, members: Members) -> Iterator[Etcd]:
    """The stand-in of other tests does what the real one does."""
    etcd = MemoryEtcd() if request.param == "memory" else Etcd(members.urls, timeout_s=5.0)
    yield etcd
    etcd.close()


def test_a_key_that_does_not_exist_has_revision_0_and_is_made_once(etcd: Etcd) -> None:
    make = [has_revision("/made", 0)], [put("/made", b"one")], [read("/made")]
    first, second = etcd.transact(*make), etcd.transact(*make)
    assert (first.succeeded, first.ranges) == (True, ())
    assert not second.succeeded
    ((found,),) = second.ranges
    assert (found.key, found.value, found.revision) == ("/made", b"one", first.revision)


def test_a_key_is_written_only_if_nobody_has_changed_it(etcd: Etcd) -> None:
    made = etcd.transact([], [put("/changed", b"1")])
    assert etcd.transact([has_revision("/changed", made.revision)], [put("/changed", b"1")]).succeeded
    assert not etcd.transact([has_revision("/changed", made.revision)], [put("/changed", b"2")]).succeeded
    assert etcd.transact([has_value("/changed", b"1")], []).succeeded
    assert not etcd.transact([has_value("/changed", b"2")], []).succeeded


def test_keys_are_read_in_order_page_by_page_and_removed_from_the_front(etcd: Etcd) -> None:
    for number in range(5):
        etcd.transact([], [put(f"/rows/{number}", bytes([0, 255, number]))])
    etcd.transact([], [put("/rowt", b"another")])
    first, behind = etcd.transact([], [read_all("/rows/", limit=2), read_all("/rows/", after="/rows/1")]).ranges
    assert [entry.key for entry in first] == ["/rows/0", "/rows/1"]
    assert [entry.value for entry in behind] == [bytes([0, 255, number]) for number in (2, 3, 4)]
    etcd.transact([], [remove_upto("/rows/", "/rows/3")])
    assert [entry.key for entry in etcd.transact([], [read_all("/rows/")]).ranges[0]] == ["/rows/4"]
    assert etcd.transact([], [read("/rows/0")]).ranges == ((),)


def test_an_empty_value_is_read_as_one(etcd: Etcd) -> None:
    etcd.transact([], [put("/empty", b"")])
    assert [entry.value for entry in etcd.transact([], [read("/empty")]).ranges[0]] == [b""]


def test_a_request_that_etcd_does_not_take_is_refused_with_its_reason(etcd: Etcd) -> None:
    with pytest.raises(EtcdRefused, match="too many operations"):
        etcd.transact([], [put(f"/many/{number}", b"") for number in range(129)])


def test_a_member_that_is_gone_is_passed_over(members: Members) -> None:
    etcd = Etcd(["http://127.0.0.1:1", "http://127.0.0.1:2", *members.urls], timeout_s=5.0)
    assert etcd.transact([], [read("/x")]).ranges == ((),)
    etcd.close()
    etcd = Etcd(["http://127.0.0.1:1", "http://127.0.0.1:2"], timeout_s=5.0)
    with pytest.raises(EtcdUnavailable, match=r"http://127\.0\.0\.1:1 .*http://127\.0\.0\.1:2 "):
        etcd.transact([], [read("/x")])
    etcd.close()


def test_after_a_member_that_does_not_answer_the_next_request_goes_to_the_next(members: Members) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        etcd = Etcd([url, *members.urls], timeout_s=2.0)
        with pytest.raises(EtcdUnavailable, match=url):
            etcd.transact([], [put("/silent", b"")])
        assert etcd.transact([], [read("/silent")]).ranges == ((),)
        etcd.close()


def test_three_members_go_on_without_their_leader_and_answer_nothing_without_a_majority(tmp_path: Path) -> None:
    with etcd_members(tmp_path, "a", "b", "w") as members:
        etcd = Etcd(members.urls, timeout_s=0.5)
        made = etcd.transact([], [put("/key", b"before")])
        leader = members.leader()
        members.kill(leader)

        def written() -> bool:
            try:
                return etcd.transact([has_revision("/key", made.revision)], [put("/key", b"after")], ()).succeeded or (
                    etcd.transact([has_value("/key", b"after")], []).succeeded
                )
            except EtcdUnavailable:
                return False

        eventually(written)
        other = next(name for name in members.names if name != leader)
        members.kill(other)
        for _ in range(6):
            with pytest.raises(EtcdUnavailable):
                etcd.transact([], [read("/key")])
        members.start(other)
        answers(members)
        (found,) = eventually(lambda: _read(etcd))
        assert found == b"after"
        etcd.close()


def _read(etcd: Etcd) -> list[bytes] | None:
    try:
        return [entry.value for entry in etcd.transact([], [read("/key")]).ranges[0]]
    except EtcdUnavailable:
        return None


def test_only_a_certificate_of_the_same_authority_is_admitted(tmp_path: Path) -> None:
    import trustme

    files = {}
    for name in ("ours", "others"):
        ca, issued = trustme.CA(), None
        issued = ca.issue_cert("127.0.0.1")
        (tmp_path / f"{name}-ca.pem").write_bytes(ca.cert_pem.bytes())
        (tmp_path / f"{name}.pem").write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        (tmp_path / f"{name}.key").write_bytes(issued.private_key_pem.bytes())
        files[name] = Certificates(tmp_path / f"{name}-ca.pem", tmp_path / f"{name}.pem", tmp_path / f"{name}.key")

    def context(own: Certificates | None) -> ssl.SSLContext:
        made = ssl.create_default_context(cafile=files["ours"].ca)
        if own is not None:
            made.load_cert_chain(own.certificate, own.key)
        return made

    with etcd_members(tmp_path, tls=files["ours"]) as members:
        tls = {"ca": "ours-ca.pem", "certificate": "ours.pem", "key": "ours.key"}
        machines = {"north": {"address": "http://10.0.0.1:5003"}}
        cluster = Cluster.model_validate({"machines": machines, "etcd": members.urls, "tls": tls})
        etcd = etcd_of(cluster, tmp_path, timeout_s=5.0)
        assert eventually(lambda: _answers(etcd))
        for own in (None, files["others"]):
            stranger = Etcd(members.urls, tls=context(own), timeout_s=5.0)
            with pytest.raises(EtcdUnavailable):
                stranger.transact([], [read("/key")])
            stranger.close()
        etcd.close()


def _answers(etcd: Etcd) -> bool:
    try:
        return etcd.transact([], [read("/key")]).ranges == ((),)
    except EtcdUnavailable:
        return False
