"""What is cautioned about where a computer keeps packets for longer than a takeover takes."""

import errno
import os
import socket
from collections.abc import Mapping
from pathlib import Path

import pytest

from lift_manager.cluster.kept_packets import kept_packets_cautions, retransmissions
from tests.support.rows import each_row

SETTINGS = Path("/proc/sys/net/ipv4/neigh")


def slow(_: int) -> Mapping[str, int]:
    return {"default": 1000}


@each_row(
    ("hosts", "expected"),
    [
        (["10.0.0.3"], ["ipv4"]),
        (["fd00::3"], ["ipv6"]),
        (["fe80::3%eth0"], ["ipv6"]),
        (["lift.example", "10.0.0.3"], ["ipv4", "ipv6"]),
        (["127.0.0.1", "::1", "localhost"], []),
    ],
)
def test_only_controllers_beyond_this_computer_matter(hosts: list[str], expected: list[str]) -> None:
    found = list(kept_packets_cautions(hosts, of_family=slow))
    for version, line in zip(expected, found, strict=True):
        assert f"write `net.{version}.neigh.default.retrans_time_ms = 100`" in line


def test_each_interface_counts_because_it_keeps_what_it_had_when_it_appeared() -> None:
    def of_family(family: int) -> Mapping[str, int]:
        return {"default": 100, "eth0": 1000, "eth1": 100, "lo": 1000} if family == socket.AF_INET else slow(family)

    (found,) = kept_packets_cautions(["10.0.0.3"], of_family=of_family)
    assert "above 100: eth0 (1000 ms); write" in found


def test_a_computer_that_is_set_is_not_cautioned_about() -> None:
    assert list(kept_packets_cautions(["10.0.0.3"], of_family=lambda _: {"default": 100, "eth0": 50})) == []


def test_a_kernel_that_does_not_say_it_is_reported() -> None:
    def of_family(_: int) -> Mapping[str, int]:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    (found,) = kept_packets_cautions(["10.0.0.3"], of_family=of_family)
    assert "cannot be read here" in found


@pytest.mark.skipif(not SETTINGS.exists(), reason="no Linux")
def test_the_kernel_says_by_netlink_what_its_settings_are() -> None:
    settings = {path.parent.name: int(path.read_text("ascii")) for path in SETTINGS.glob("*/retrans_time_ms")}
    assert settings.items() <= retransmissions(socket.AF_INET).items()
