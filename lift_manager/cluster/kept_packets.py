"""Finds where this computer keeps packets for longer than a takeover takes: docs/explanation/cluster.md, "Bytes that outlive"."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

MOST_RETRANS_MS = 100
"""Linux asks three times for a hardware address, and keeps the packets meanwhile: 0.3 s, of the 0.5 s between two terms."""

SETTINGS = Path("/proc/sys/net")


def kept_packets_cautions(hosts: Iterable[str], *, settings: Path = SETTINGS) -> Iterator[str]:
    """Yield a caution for each version of IP by which a controller among these hosts is reached, where packets are kept too long.

    `settings` is the folder in which the kernel shows its own; a system without it yields nothing.
    """
    for version in sorted({version for host in hosts for version in _versions(host)}):
        slow = sorted(
            f"{interface} ({milliseconds} ms)"
            for interface, milliseconds in _retransmissions(settings / version / "neigh")
            if milliseconds > MOST_RETRANS_MS
        )
        if slow:
            setting = f"net.{version}.neigh.default.retrans_time_ms"
            yield (
                f"cluster: a packet for a controller may be kept by this computer and sent after the other machine has taken over, while"
                f" {setting} is above {MOST_RETRANS_MS}: {', '.join(slow)}; write `{setting} = {MOST_RETRANS_MS}` in /etc/sysctl.d and"
                " restart the computer, because an interface takes it over when it appears"
            )


def _versions(host: str) -> tuple[str, ...]:
    """Return by which versions of IP a host is reached; none for this computer itself."""
    if host.lower() == "localhost":
        return ()
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return ("ipv4", "ipv6")  # a name may be either
    return () if address.is_loopback else (f"ipv{address.version}",)


def _retransmissions(folder: Path) -> Iterator[tuple[str, int]]:
    for setting in folder.glob("*/retrans_time_ms"):
        if setting.parent.name != "lo":
            with suppress(FileNotFoundError):  # an interface that was just removed
                yield setting.parent.name, int(setting.read_text("ascii"))
