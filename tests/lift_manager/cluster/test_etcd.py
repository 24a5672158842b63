"""The client against real members of etcd: what it reads and writes, and what it reports when members are gone."""

import asyncio
import itertools
import socket
import ssl
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from lift_manager.cluster.certificates import EtcdCertificates
from lift_manager.cluster.connect import certificates_of, etcd_of
from lift_manager.cluster.content import Place, encode_key
from lift_manager.cluster.errors import EtcdRefused, EtcdUnavailable
from lift_manager.cluster.etcd import Etcd, has_revision, has_value, put, read, read_all, remove_upto
from lift_manager.cluster.member import Member
from lift_manager.cluster.term import Key
from lift_manager.config.site import Cluster
from tests.support.certificates import Authority
from tests.support.etcd import Certificates, Members, answers, etcd_members
from tests.support.memory_etcd import MemoryEtcd
from tests.support.programs import HANGS_S, eventually
from tests.support.virtual_time import cancel_all

pytestmark = pytest.mark.external("etcd", "etcdctl")


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Members]:
    with etcd_members(tmp_path_factory.mktemp("etcd")) as members:
        yield members


@pytest.fixture(params=["real", "memory"])
def etcd(request: pytest.FixtureRequest, members: Members) -> Iterator[Etcd]:
    """The stand-in of other tests does what the real one does."""
    etcd = MemoryEtcd() if request.param == "memory" else Etcd(members.urls, timeout_s=HANGS_S)
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
    etcd = Etcd(["http://127.0.0.1:1", "http://127.0.0.1:2", *members.urls], timeout_s=HANGS_S)
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

        def is_read() -> bool:
            # a busy member may be late as well; without a change of member every request goes to the silent one
            with suppress(EtcdUnavailable):
                return etcd.transact([], [read("/silent")]).ranges == ((),)
            return False

        eventually(is_read)
        etcd.close()


def test_three_members_go_on_without_their_leader_and_answer_nothing_without_a_majority(tmp_path: Path) -> None:
    with etcd_members(tmp_path, "a", "b", "w") as members:
        etcd, patient = Etcd(members.urls, timeout_s=0.5), Etcd(members.urls, timeout_s=HANGS_S)
        made = patient.transact([], [put("/key", b"before")])
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
        own = patient.transact([], [read("/key", local=True), read_all("/k", local=True)]).ranges
        assert [[entry.value for entry in entries] for entries in own] == [[b"after"], [b"after"]]
        members.start(other)
        answers(members)
        (found,) = eventually(lambda: _read(etcd))
        assert found == b"after"
        etcd.close()
        patient.close()


def _read(etcd: Etcd) -> list[bytes] | None:
    try:
        return [entry.value for entry in etcd.transact([], [read("/key")]).ranges[0]]
    except EtcdUnavailable:
        return None


def issue(authority: Authority, folder: Path, name: str) -> Certificates:
    """Issue a certificate for a member or a manager on the loopback, over one of the same name, as a renewal does."""
    shown = authority.issue(name, "127.0.0.1")
    ca = shown.certificate.with_name(f"{name}-ca.pem")
    ca.write_bytes(authority.file.read_bytes())
    return Certificates(ca, shown.certificate, shown.key)


def manager_with(members: Members, own: Certificates) -> tuple[Etcd, EtcdCertificates]:
    tls = {"ca": str(own.ca), "certificate": str(own.certificate), "key": str(own.key)}
    machines = {"north": {"address": "http://10.0.0.1:5003"}}
    cluster = Cluster.model_validate({"machines": machines, "etcd": members.urls, "tls": tls})
    certificates = certificates_of(cluster, own.ca.parent)
    assert certificates is not None
    etcd = etcd_of(cluster, certificates, timeout_s=5.0)
    eventually(lambda: _answers(etcd))
    return etcd, certificates


def test_only_a_certificate_of_the_same_authority_is_admitted(tmp_path: Path) -> None:
    ours, others = (issue(Authority(tmp_path, name), tmp_path, f"{name}-own") for name in ("ours", "others"))

    def context(own: Certificates | None) -> ssl.SSLContext:
        made = ssl.create_default_context(cafile=ours.ca)
        if own is not None:
            made.load_cert_chain(own.certificate, own.key)
        return made

    with etcd_members(tmp_path, tls=ours) as members:
        etcd, _ = manager_with(members, ours)
        for own in (None, others):
            strange = context(own)
            stranger = Etcd(members.urls, tls=partial(_same, strange), timeout_s=5.0)
            with pytest.raises(EtcdUnavailable):
                stranger.transact([], [read("/key")])
            stranger.close()
        etcd.close()


def _same(context: ssl.SSLContext) -> ssl.SSLContext:
    return context


def test_a_renewed_certificate_is_used_once_a_member_accepts_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    before, after = Authority(tmp_path, "before"), Authority(tmp_path, "after")
    with etcd_members(tmp_path, tls=issue(before, tmp_path, "member")) as members:
        etcd, certificates = manager_with(members, issue(before, tmp_path, "own"))
        issue(after, tmp_path, "own")
        for _ in range(2):
            certificates.renew()
        assert _answers(etcd)
        assert len([line for line in caplog.messages if "the previous one stays in use" in line]) == 1
        members.kill("one")
        members.tls = issue(after, tmp_path, "member")
        members.start("one")

        def renewed() -> bool:
            certificates.renew()
            return _answers(etcd)

        eventually(renewed)
        etcd.close()


def test_a_term_goes_on_while_the_certificate_is_renewed(tmp_path: Path) -> None:
    authority, place = Authority(tmp_path), Place("site")

    async def goes_on(etcd: Etcd, certificates: EtcdCertificates) -> bool:
        member = Member("north", "http://10.0.0.1:5003", etcd, place)
        running = asyncio.create_task(member.run())
        active = await member.until_active()
        used = certificates.latest()
        issue(authority, tmp_path, "own")
        await asyncio.to_thread(certificates.renew)
        assert certificates.latest() is not used
        renewals, renewed = itertools.count(), asyncio.Event()

        def follow(_: float) -> None:
            if next(renewals) == 3:
                renewed.set()

        active.follow(follow)
        waits = [asyncio.create_task(event.wait()) for event in (renewed, active.ends)]
        await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        for wait in waits:
            wait.cancel()
        await cancel_all([running])
        return not active.ends.is_set()

    with etcd_members(tmp_path, tls=issue(authority, tmp_path, "member")) as members:
        etcd, certificates = manager_with(members, issue(authority, tmp_path, "own"))
        etcd.transact([], [put(place.active, encode_key(Key(0)))])
        # on a busy machine a term may end because a renewal is late
        eventually(lambda: asyncio.run(goes_on(etcd, certificates)))


def _answers(etcd: Etcd) -> bool:
    try:
        return etcd.transact([], [read("/key")]).ranges == ((),)
    except EtcdUnavailable:
        return False
