"""The command line of a cluster, against a real etcd."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from lift_manager.cluster.content import Place, encode_key, encode_number
from lift_manager.cluster.etcd import Etcd, put
from lift_manager.cluster.term import Key
from tests.support.etcd import Members, etcd_members
from tests.support.programs import call

pytestmark = pytest.mark.external("etcd")


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Members]:
    with etcd_members(tmp_path_factory.mktemp("etcd")) as members:
        yield members


def site(folder: Path, members: Members, **cluster: object) -> Path:
    addresses = {"north": {"address": "http://10.0.0.1:5003"}, "south": {"address": "http://10.0.0.2:5003"}}
    written = {
        "schema": 1,
        "name": folder.name,
        "state": "state",
        "controllers": {"plc": {"host": "127.0.0.1", "map": "generic-registers"}},
        "lifts": {"main": {"controller": "plc", "access": "control", "floors": {"L1": 1, "L2": 2}}},
        "cluster": {"machines": addresses, "etcd": members.urls} | cluster,
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
    active = encode_key(Key(0, 3, "south", "http://10.0.0.2:5003"))
    etcd.transact([], [put(place.active, active), put(f"{place.copied}south", encode_number(0))])
    etcd.close()
    shown = call("cluster", "status", path).stdout
    assert "south is active, at http://10.0.0.2:5003; epoch 3" in shown


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


def test_a_machine_that_is_none_of_the_two_serves_nothing(tmp_path: Path, members: Members) -> None:
    refused = call("serve", site(tmp_path, members), "--machine", "west")
    assert (refused.returncode, "the machines of the cluster are north, south" in refused.stderr) == (1, True)


def test_a_site_without_a_cluster_has_nothing_to_show(tmp_path: Path, members: Members) -> None:
    path = site(tmp_path, members)
    alone = json.loads(path.read_text("utf-8"))
    del alone["cluster"]
    path.write_text(json.dumps(alone), "utf-8")
    refused = call("cluster", "status", path)
    assert (refused.returncode, "has no `cluster`" in refused.stderr) == (1, True)
