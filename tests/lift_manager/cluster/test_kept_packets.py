"""What is cautioned about where a computer keeps packets for longer than a takeover takes."""

from pathlib import Path

from lift_manager.cluster.kept_packets import kept_packets_cautions
from tests.support.rows import each_row


def write(settings: Path, **milliseconds: int) -> None:
    for name, value in milliseconds.items():
        version, interface = name.split("_")
        folder = settings / version / "neigh" / interface
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "retrans_time_ms").write_text(f"{value}\n", "ascii")


@each_row(
    ("hosts", "slow"),
    [
        (["10.0.0.3"], ["ipv4"]),
        (["fd00::3"], ["ipv6"]),
        (["fe80::3%eth0"], ["ipv6"]),
        (["lift.example", "10.0.0.3"], ["ipv4", "ipv6"]),
        (["127.0.0.1", "::1", "localhost"], []),
    ],
)
def test_only_controllers_beyond_this_computer_matter(tmp_path: Path, hosts: list[str], slow: list[str]) -> None:
    write(tmp_path, ipv4_default=1000, ipv6_default=1000)
    found = list(kept_packets_cautions(hosts, settings=tmp_path))
    assert [
        f"write `net.{version}.neigh.default.retrans_time_ms = 100`" in line
        for version, line in zip(slow, found, strict=True)
    ] == ([True] * len(slow))


def test_each_interface_counts_because_it_keeps_what_it_had_when_it_appeared(tmp_path: Path) -> None:
    write(tmp_path, ipv4_default=100, ipv4_eth0=1000, ipv4_eth1=100, ipv4_lo=1000, ipv6_default=1000)
    (found,) = kept_packets_cautions(["10.0.0.3"], settings=tmp_path)
    assert "above 100: eth0 (1000 ms); write" in found


def test_a_computer_that_is_set_or_has_no_such_setting_is_not_cautioned_about(tmp_path: Path) -> None:
    assert list(kept_packets_cautions(["10.0.0.3"], settings=tmp_path)) == []
    write(tmp_path, ipv4_default=100, ipv4_eth0=50)
    assert list(kept_packets_cautions(["10.0.0.3"], settings=tmp_path)) == []
