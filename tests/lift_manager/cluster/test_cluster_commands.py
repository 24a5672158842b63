"""The command line of a cluster, against a real etcd."""

import json
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path

import httpx
import pytest

from drivers.modbus.controller_lock import controller_lock
from lift_manager.cluster.content import Place, Solo, encode_key, encode_number, encode_solo
from lift_manager.cluster.etcd import Etcd, put, read
from lift_manager.cluster.term import Key
from lift_manager.runtime.journal import manager_ended, manager_took_over
from lift_manager.store.place import store_path
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_copy
from lift_manager.store.store import PendingRow
from tests.support.etcd import Members, etcd_members
from tests.support.programs import HANGS_S, call, eventually, free_port, running

pytestmark = pytest.mark.external("etcd")


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Members]:
    with etcd_members(tmp_path_factory.mktemp("etcd")) as members:
        yield members


SWITCHED_OFF = "127.255.255.255"
"""An address that takes no connection and refuses none, on any computer: the kernel has no route for one to a broadcast address."""


def site(folder: Path, members: Members | None, **cluster: object) -> Path:
    addresses = {"north": {"address": "http://10.0.0.1:5003"}, "south": {"address": f"http://{SWITCHED_OFF}:5003"}}
    written = {
        "schema": 1,
        "name": folder.name,
        "state": "state",
        "controllers": {"plc": {"host": "127.0.0.1", "port": free_port(), "map": "generic-registers"}},
        "lifts": {"main": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}}},
        "cluster": {"machines": addresses, "etcd": members.urls if members else []} | cluster,
    }
    path = folder / "site.yaml"
    path.write_text(json.dumps(written), "utf-8")
    return path


def test_a_site_is_prepared_once_and_its_status_shown(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members)
    early = call("cluster", "status", path)
    assert (early.returncode, "cluster init" in early.stderr) == (1, True)
    assert call("cluster", "init", path).returncode == 0
    again = call("cluster", "init", path)
    assert (again.returncode, "holds this site already" in again.stderr) == (1, True)
    raised = call("cluster", "init", path, "--replace", "--epoch", "70000")
    assert (raised.returncode, "the first term has epoch 70001" in raised.stdout) == (0, True)
    assert "no machine is active; epoch 70000, commit 0" in call("cluster", "status", path).stdout
    assert call("cluster", "init", path, "--replace").returncode == 0
    assert "no machine is active; epoch 70000, commit 0" in call("cluster", "status", path).stdout
    etcd, place = Etcd(members.urls, timeout_s=5.0), Place(tmp_path.name)
    active = encode_key(Key(0, 3, "south", f"http://{SWITCHED_OFF}:5003"))
    etcd.transact([], [put(place.active, active), put(f"{place.copied}south", encode_number(0))])
    etcd.close()
    shown = call("cluster", "status", path).stdout
    assert f"south is active, at http://{SWITCHED_OFF}:5003; epoch 3" in shown


def test_without_an_active_manager_nothing_is_handed_over(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members)
    assert call("cluster", "init", path).returncode == 0
    refused = call("handover", path, "--by", "Eve")
    assert (refused.returncode, "nothing to hand over" in refused.stderr) == (1, True)


def test_an_etcd_that_is_not_there_is_named(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members, etcd=["http://127.0.0.1:1"])
    for words in (("cluster", "init", path), ("cluster", "status", path), ("handover", path, "--by", "Eve")):
        refused = call(*words)
        assert (refused.returncode, "http://127.0.0.1:1" in refused.stderr) == (1, True)


def by_eve(*words: str | Path) -> tuple[str | Path, ...]:
    return (*words, "--by", "Eve", "--machine", "north")


def test_a_machine_does_not_go_on_alone_while_etcd_or_the_other_machine_answers(
    tmp_path: Path, members: Members
) -> None:
    refused = call(*by_eve("cluster", "solo", site(tmp_path, members), "--off", "south"))
    assert (refused.returncode, "etcd answers" in refused.stderr) == (1, True)
    with socket.create_server(("127.0.0.1", 0)) as south:
        port = south.getsockname()[1]
        machines = {"north": {"address": "http://10.0.0.1:5003"}, "south": {"address": f"http://127.0.0.1:{port}"}}
        path = site(tmp_path, members, etcd=["http://127.0.0.1:1"], machines=machines)
        answers = call(*by_eve("cluster", "solo", path, "--off", "south"))
        assert (answers.returncode, f"south answers at http://127.0.0.1:{port}" in answers.stderr) == (1, True)
    refuses_connections = call(*by_eve("cluster", "solo", path, "--off", "south"))
    assert (refuses_connections.returncode, "so it is on" in refuses_connections.stderr) == (1, True)
    assert call(*by_eve("cluster", "solo", path, "--off", "north")).returncode == 2
    assert not list((tmp_path / "state").glob("*.solo"))


def test_a_machine_goes_on_alone_and_joins_the_other_again(tmp_path: Path) -> None:
    with etcd_members(tmp_path) as members:
        path, place = site(tmp_path, members), Place(tmp_path.name)
        assert call("cluster", "init", path).returncode == 0
        early = call(*by_eve("cluster", "join", path))
        assert (early.returncode, "does not go on alone" in early.stderr) == (1, True)
        members.kill("one")
        alone = call(*by_eve("cluster", "solo", path, "--off", "south"))
        assert (alone.returncode, "as Eve has decided because south is off" in alone.stdout) == (0, True)
        assert "nobody knows whether its copy lacks something" in alone.stdout
        assert "north goes on alone since" in call("cluster", "status", path).stdout
        again = call(*by_eve("cluster", "solo", path, "--off", "south"))
        assert (again.returncode, "start its manager" in again.stderr) == (1, True)
        port = free_port()
        with running("serve", path, "--machine", "north", "--port", str(port)) as program:
            program.logs("it commands the lifts from now on")
            ready = eventually(lambda: fetched(port, "/readyz?role=active"))
            assert "north goes on alone since" in str(ready["alone"])
            busy = call(*by_eve("cluster", "join", path))
            assert (busy.returncode, "another manager on this computer" in busy.stderr) == (1, True)
            members.start("one")
            program.logs("etcd answers, and says that this one does")
            assert "north goes on alone since" in call("cluster", "status", path).stdout
            assert call("cluster", "init", path, "--replace").returncode == 1
            assert program.stop()[0] == 0
        joined = call(*by_eve("cluster", "join", path))
        assert (joined.returncode, "start both managers" in joined.stdout) == (0, True), joined.stderr
        etcd = Etcd(members.urls, timeout_s=5.0)
        (solo,) = etcd.transact([], [read(place.solo)]).ranges
        etcd.close()
        assert solo == ()
        shown = call("cluster", "status", path).stdout
        assert "no machine is active; epoch 1000000" in shown
        assert "north: has every row on its disk" in shown
        audit = call("audit", path, "--kind", "person").stdout
        assert "north goes on alone since" in audit
        assert "north goes on with south again" in audit


def test_a_machine_that_goes_on_alone_ends_in_words_if_another_program_has_its_controller(tmp_path: Path) -> None:
    path = site(tmp_path, None, etcd=["http://127.0.0.1:1"])
    port = json.loads(path.read_text("utf-8"))["controllers"]["plc"]["port"]
    with controller_lock("127.0.0.1", port):
        assert call(*by_eve("cluster", "solo", path, "--off", "south")).returncode == 0
        with running("serve", path, "--machine", "north", "--port", "0") as program:
            assert program.ended() == 1
            assert f"127.0.0.1:{port}" in program.err.splitlines()[-1]


def test_an_etcd_that_was_lost_is_made_again_above_the_epochs_that_the_journal_has(
    tmp_path: Path, members: Members
) -> None:
    path = site(tmp_path, members)
    disk = open_copy(store_path(tmp_path.name, "state", path, {}), tmp_path.name, Limits(400, 500))
    disk.commit(
        {}, [PendingRow(1, manager_took_over("north", 7)), PendingRow(2, manager_ended(released=True, commands=True))]
    )
    disk.close()
    assert call("cluster", "init", path).returncode == 0
    assert "epoch 1000007" in call("cluster", "status", path).stdout


def fetched(port: int, path: str) -> Mapping[str, object] | None:
    try:
        reply = httpx.get(f"http://127.0.0.1:{port}{path}", trust_env=False, timeout=HANGS_S)
    except httpx.HTTPError:
        return None
    return dict(reply.json()) if reply.status_code == 200 else None


def test_what_a_machine_decided_alone_is_discarded_or_given_up_with_the_machine(tmp_path: Path) -> None:
    with etcd_members(tmp_path) as members:
        path, place = site(tmp_path, members), Place(tmp_path.name)
        assert call("cluster", "init", path).returncode == 0
        members.kill("one")
        assert call(*by_eve("cluster", "solo", path, "--off", "south")).returncode == 0
        members.start("one")
        assert eventually(lambda: call(*by_eve("cluster", "join", path, "--discard")).returncode == 0)
        assert not list((tmp_path / "state").glob("*.solo"))
        lost = Solo("abc", "south", "north", "Eve", "today", 1_000_000, 0, 0)
        etcd = Etcd(members.urls, timeout_s=5.0)
        etcd.transact([], [put(place.solo, encode_solo(lost))])
        assert call("cluster", "init", path, "--replace").returncode == 1
        assert call(*by_eve("cluster", "join", path, "--off", "south")).returncode == 0
        assert etcd.transact([], [read(place.solo)]).ranges == ((),)
        etcd.close()


def test_a_decision_that_cannot_be_read_starts_nothing(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members, machine="north")
    (tmp_path / "state").mkdir(mode=0o700)
    decision = store_path(tmp_path.name, "state", path, {}).with_suffix(".db.solo")
    decision.write_text("{", "utf-8")
    for words in (("serve", path, "--machine", "north"), ("cluster", "init", path)):
        refused = call(*words)
        assert (refused.returncode, str(decision) in refused.stderr) == (1, True)
    assert f"caution: cluster: {decision}, which says" in call("check", path).stdout
    decision.write_bytes(encode_solo(Solo("abc", "south", "north", "Eve", "today", 1_000_000, 0, 0)))
    refused = call("serve", path, "--machine", "north")
    assert (refused.returncode, "is of another one" in refused.stderr) == (1, True)
    assert "caution: cluster: south goes on alone since today" in call("check", path).stdout


TOOLS = (
    ("doctor", "SITE", "--seconds", "1"),
    ("watch", "main", "--once", "--site", "SITE"),
    ("trace", "record", "-o", "NEW", "--for", "1s", "--site", "SITE"),
    ("poke", "main", "--site", "SITE"),
    ("checkout", "SITE", "main", "--by", "Eve", "--technician", "Bo"),
)
"""Commands that talk to a controller themselves."""


def called_tools(path: Path, *more: str) -> list[str]:
    """What each tool prints that could not run."""
    places = {"SITE": str(path), "NEW": str(path.parent / "new")}
    done = [call(*[places.get(word, word) for word in tool], *more) for tool in TOOLS]
    assert all(one.returncode in (1, 2) for one in done)
    return [one.stderr for one in done]


def test_no_tool_talks_to_a_controller_while_a_machine_of_the_cluster_is_active(
    tmp_path: Path, members: Members
) -> None:
    path, place = site(tmp_path, members), Place(tmp_path.name)
    alone = Solo("abc", "south", "north", "Adam", "today", 1_000_000, 0, 0)
    etcd = Etcd(members.urls, timeout_s=5.0)
    etcd.transact([], [put(place.solo, encode_solo(alone))])
    etcd.close()
    for printed in called_tools(path):
        assert f"{alone.text}, so nothing else may talk to the controllers" in printed


def test_a_tool_needs_a_word_of_its_own_where_etcd_does_not_answer(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members, etcd=["http://127.0.0.1:1"])
    for printed in called_tools(path):
        assert "say so with --without-etcd" in printed
    watched = call("watch", "main", "--once", "--site", path, "--without-etcd")
    assert "etcd" not in watched.stderr


def test_a_machine_that_is_none_of_the_two_serves_nothing(tmp_path: Path, members: Members) -> None:
    refused = call("serve", site(tmp_path, members), "--machine", "west")
    assert (refused.returncode, "the machines of the cluster are north, south" in refused.stderr) == (1, True)


def test_a_standby_that_cannot_join_rmf_fails_at_its_start(tmp_path: Path, members: Members) -> None:
    words = ("serve", site(tmp_path, members), "--machine", "north", "--port", "0", "--rmf")
    refused = call(*words, CYCLONEDDS_URI="<broken")
    assert (refused.returncode, "CYCLONEDDS_URI is '<broken'" in refused.stderr) == (1, True)


def test_a_site_without_a_cluster_has_nothing_to_show(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members)
    alone = json.loads(path.read_text("utf-8"))
    del alone["cluster"]
    path.write_text(json.dumps(alone), "utf-8")
    refused = call("cluster", "status", path)
    assert (refused.returncode, "has no `cluster`" in refused.stderr) == (1, True)
