"""What is found in the `cluster` of a site file, and what people are told about a good one."""

from pathlib import Path

import pytest

from lift_manager.config.check_cluster import MOST_LIFTS
from tests.lift_manager.config.site_files import GENERIC, TWO_STOP, assert_says_exactly, findings, load, said
from tests.support.rows import each_row

CLUSTER = """\
cluster:
  machines:
    north: {address: "http://10.0.0.1:5003", switch: one, supply: x}
    south: {address: "http://10.0.0.2:5003", switch: two, supply: y}
  etcd: ["http://127.0.0.1:2379", "http://127.0.0.1:2381", "http://127.0.0.1:2383"]
"""
MEMBERS = '"http://127.0.0.1:2379", "http://127.0.0.1:2381", "http://127.0.0.1:2383"'
SOUTH = '    south: {address: "http://10.0.0.2:5003", switch: two, supply: y}\n'


def of_cluster(folder: Path, text: str, *edits: tuple[str, str]) -> list[str]:
    return [line for line in load(folder, text, *edits).cautions() if "cluster" in line or "replaced" in line]


@each_row(
    ("edits", "key", "line", "words"),
    [
        ([(SOUTH, "")], "cluster.machines", 11, "has two machines, and there are 1"),
        ([("http://10.0.0.2:5003", "http://10.0.0.1:5003/")], "cluster.machines", 11, "one address"),
        ([("  etcd", "  machine: west\n  etcd")], "cluster.machine", 14, "none of the machines north, south"),
        ([(":2381", ":2379")], "cluster.etcd", 14, "names a member twice"),
        ([("http://127.0.0.1:2381", "https://127.0.0.1:2381")], "cluster.etcd", 14, "use https for all"),
        ([(MEMBERS, '"https://10.0.0.1:2379"')], "cluster.tls", 10, "https needs the CA of the members"),
        ([("http://127.0.0.1:2381", "127.0.0.1:2381")], "cluster.etcd[1]", 14, "must be a URL"),
        ([(MEMBERS, "")], "cluster.etcd", 14, ""),
        (
            [("  etcd", "  accept_latching: {west: why}\n  etcd")],
            "cluster.accept_latching.west",
            14,
            "the lifts are main",
        ),
        (
            [("  etcd", "  packet_filter: socket\n  etcd"), ("10.0.0.5", "lift.example")],
            "controllers.plc.host",
            4,
            "the packet filter of the cluster goes by addresses",
        ),
        (
            [("  etcd", "  fence: {door: {command: [sh]}}\n  etcd")],
            "cluster.fence.door",
            14,
            "the controllers are plc",
        ),
    ],
)
def test_a_mistake_is_named_with_its_place(
    tmp_path: Path, edits: list[tuple[str, str]], key: str, line: int, words: str
) -> None:
    assert_says_exactly(findings(tmp_path, GENERIC + CLUSTER, *edits), said(line, key, words))


def test_outputs_that_stay_on_need_an_acceptance_of_their_own(tmp_path: Path) -> None:
    refused = findings(tmp_path, TWO_STOP + CLUSTER)
    assert_says_exactly(
        refused,
        said(8, "lifts.goods.access", "stay on until something lets them go", "fence: {plc: ...}", "accept_latching"),
    )
    filtered = findings(tmp_path, TWO_STOP + CLUSTER + FILTER)
    assert [str(each) for each in filtered] == [str(each) for each in refused]
    accepted = of_cluster(tmp_path, TWO_STOP + CLUSTER + "  accept_latching: {goods: somebody stands beside it}\n")
    assert accepted == [
        "goods: a write of a manager that was just replaced may put an output on for good; accepted: somebody stands beside it"
    ]
    watched = ("    access: control\n    accept_latching: a person stands beside it\n", "")
    assert of_cluster(tmp_path, TWO_STOP + CLUSTER, watched) == []


FILTER = "  packet_filter: socket\n"
FENCE = "  fence: {plc: {command: [sh, close-port, south]}}\n"


def kept(folder: Path, text: str) -> list[str]:
    """What `check` says about late writes."""
    return list(load(folder, text).fence_lines())


@each_row(
    ("text", "by"),
    [
        (GENERIC.replace("generic-registers", "generic-registers-cluster") + CLUSTER, "the controller itself, which obeys the manager of the highest epoch"),
        (GENERIC.replace("generic-registers", "generic-registers-cluster") + CLUSTER + FENCE, "the controller itself, which obeys the manager of the highest epoch"),
        (TWO_STOP.replace("goods", "main") + CLUSTER + FENCE, "a command of the site, which closes the way of the other machine"),
        (TWO_STOP.replace("goods", "main") + CLUSTER + FENCE + "  accept_latching: {main: why}\n", "a command of the site, which closes the way of the other machine"),
        (TWO_STOP.replace("goods", "main") + CLUSTER + "  accept_latching: {main: why}\n", "nothing, which was accepted"),
        (GENERIC + CLUSTER, "nothing"),
        (GENERIC + CLUSTER + FILTER, "the packet filter of its machine, unless it has left that already"),
        (GENERIC + CLUSTER + FILTER + FENCE, "a command of the site, which closes the way of the other machine"),
        (TWO_STOP.replace("goods", "main") + CLUSTER + FILTER + "  accept_latching: {main: why}\n", "the packet filter of its machine, unless it has left that already"),
    ],
)  # fmt: skip
def test_check_says_what_keeps_late_writes_from_each_lift(tmp_path: Path, text: str, by: str) -> None:
    assert kept(tmp_path, text) == [f"main: a late write of a manager that was just replaced is kept away by {by}"]
    stays_open = "nothing" in by or "unless" in by
    assert any("just replaced" in line for line in of_cluster(tmp_path, text)) is stays_open


def test_nothing_is_said_of_a_lift_that_is_only_watched_or_of_a_site_without_a_cluster(tmp_path: Path) -> None:
    assert kept(tmp_path, GENERIC) == []
    assert kept(tmp_path, (GENERIC + CLUSTER).replace("    access: control\n", "")) == []


def test_a_second_device_needs_a_fence_of_its_own(tmp_path: Path) -> None:
    second = GENERIC.replace("lifts:", "  door: {host: 10.0.0.6, map: generic-registers}\nlifts:") + (
        "    endpoints: {door: {controller: door}}\n"
        "    override:\n"
        "      endpoints: {door: {served: {holding: [[0, 9]]}}}\n"
        '      commands: {close_door.front: {at: "door/holding:1"}}\n'
    )
    assert kept(tmp_path, second + CLUSTER + FENCE)[0].endswith("by nothing")
    both = FENCE.replace("]}}", "]}, door: {command: [sh, close-port]}}")
    assert "a command of the site" in kept(tmp_path, second + CLUSTER + both)[0]


def test_a_fence_whose_program_is_not_there_is_a_caution(tmp_path: Path) -> None:
    absent = FENCE.replace("[sh, close-port, south]", "[./close-port]")
    lines = [line for line in load(tmp_path, GENERIC + CLUSTER + absent).cautions() if "./close-port" in line]
    assert lines == [
        "plc: ./close-port, which closes its fence, is no program on this computer: without it its lifts stay offline"
    ]
    (tmp_path / "close-port").touch(0o755)
    assert not any("./close-port" in line for line in load(tmp_path, GENERIC + CLUSTER + absent).cautions())


def test_more_lifts_than_a_commit_can_hold_are_refused(tmp_path: Path) -> None:
    lifts = "".join(
        f"  lift{number}: {{controller: plc, floors: {{L1: 1, L2: 2}}, offset: {{holding: {100 * number}}}}}\n"
        for number in range(1, MOST_LIFTS + 1)
    )
    found = findings(tmp_path, GENERIC + lifts + CLUSTER)
    assert [(one.key, f"there are {MOST_LIFTS + 1}" in one.message) for one in found] == [("cluster", True)]


@each_row(
    ("edits", "expected"),
    [
        ([], []),
        ([(", switch: two", ", switch: one")], ["cluster: both machines are on the switch one, and are lost with it"]),
        ([(", supply: y", ", supply: x")], ["cluster: both machines are on the supply x, and are lost with it"]),
        (
            [(", supply: y", "")],
            [
                "cluster: the site file does not say on which supply each machine is; if it is one, both are lost with it",
            ],
        ),
        (
            [(MEMBERS, '"http://10.0.0.1:2379", "http://10.0.0.2:2379", "http://10.0.0.3:2379"')],
            [
                "cluster: etcd is used without TLS: who reaches it can command the lifts, and change what the managers remember"
            ],
        ),
        (
            [(MEMBERS, '"http://127.0.0.1:2379"')],
            [
                "cluster: etcd has 1 member, so the loss of one stops both managers; run three, one of them on a third machine"
            ],
        ),
        (
            [("http://127.0.0.1:2383", "http://localhost:2383"), ("http://127.0.0.1:2381", "http://one.example:2381")],
            [
                "cluster: http://one.example:2381 has a name and no address: a name server that is silent would cost the term",
                "cluster: etcd is used without TLS: who reaches it can command the lifts, and change what the managers remember",
            ],
        ),
        (
            [(MEMBERS, MEMBERS + ', "http://127.0.0.1:2385"')],
            ["cluster: etcd has 4 members, of which no more may fail than of 3"],
        ),
    ],
)
def test_people_are_told_what_both_machines_are_lost_with(
    tmp_path: Path, edits: list[tuple[str, str]], expected: list[str]
) -> None:
    watched = "main: a write of a manager that was just replaced may still arrive; what it puts on, the controller itself takes off again"
    assert of_cluster(tmp_path, GENERIC + CLUSTER, *edits) == [*expected, watched]


def test_a_site_without_a_cluster_hears_nothing_of_it(tmp_path: Path) -> None:
    assert of_cluster(tmp_path, GENERIC) == []


@pytest.mark.parametrize("missing", ["etcd-ca.pem", "manager.pem"])
def test_certificates_for_etcd_are_looked_at_as_any_others(tmp_path: Path, missing: str) -> None:
    tls = (
        CLUSTER.replace("http://127", "https://127")
        + "  tls: {ca: etcd-ca.pem, certificate: manager.pem, key: manager.key}\n"
    )
    unusable = load(tmp_path, GENERIC + tls).unusable
    assert any(missing in finding.message and "does not exist" in finding.message for finding in unusable)


def test_a_site_of_two_machines_is_refused_at_a_hub(tmp_path: Path) -> None:
    (tmp_path / "hub.password").write_text("a password")
    (tmp_path / "hub.password").chmod(0o600)
    unusable = load(tmp_path, GENERIC + CLUSTER + "hub: {site: berlin, password: hub.password}\n").unusable
    assert [finding.message for finding in unusable] == [
        "a site with a `cluster` cannot take part in a hub yet: each of its machines has a journal of its own"
    ]
