"""Finds where this computer keeps packets for longer than a takeover takes: docs/explanation/cluster.md, "Bytes that outlive"."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from ipaddress import ip_address

MOST_RETRANS_MS = 100
"""Linux asks three times for a hardware address, and keeps the packets meanwhile: 0.3 s, of the 0.5 s between two terms."""

DEFAULT = "default"
"""What an interface takes over when it appears."""

ANSWER_S = 2.0
"""How long the kernel may take. Chosen: it answers at once."""

_HEADER, _FAMILY, _ATTRIBUTE = struct.Struct("=IHHII"), struct.Struct("=BBH"), struct.Struct("=HH")
# linux/netlink.h, linux/rtnetlink.h and linux/neighbour.h
_REQUEST_DUMP, _DONE, _GET_TABLES = 0x301, 3, 66
_PARAMETERS, _INTERFACE, _RETRANS_TIME = 6, 1, 5

Retransmissions = Callable[[int], Mapping[str, int]]
"""Returns for an address family how long each interface waits for a hardware address before it asks again, in milliseconds."""


def retransmissions(family: int) -> Mapping[str, int]:
    """Return what the kernel has. Raises OSError.

    By netlink, because a service has no /proc/sys: `ProcSubset=pid` of the systemd unit hides it.
    """
    found: dict[str, int] = {}
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW) as kernel:
        kernel.settimeout(ANSWER_S)
        kernel.send(
            _HEADER.pack(_HEADER.size + _FAMILY.size, _GET_TABLES, _REQUEST_DUMP, 1, 0) + _FAMILY.pack(family, 0, 0)
        )
        while True:
            for kind, body in _messages(kernel.recv(65536)):
                if kind == _DONE:
                    return found
                parameters = dict(_attributes(dict(_attributes(body[_FAMILY.size :])).get(_PARAMETERS, b"")))
                if _RETRANS_TIME not in parameters:
                    continue
                index = struct.unpack("=I", parameters.get(_INTERFACE, bytes(4)))[0]
                with suppress(OSError):  # an interface that was just removed
                    name = socket.if_indextoname(index) if index else DEFAULT
                    found[name] = struct.unpack("=Q", parameters[_RETRANS_TIME])[0]


def kept_packets_cautions(hosts: Iterable[str], *, of_family: Retransmissions = retransmissions) -> Iterator[str]:
    """Yield a caution for each version of IP by which a controller among these hosts is reached, where packets are kept too long.

    Systems other than Linux yield nothing.
    """
    if not hasattr(socket, "AF_NETLINK"):
        return
    for version, family in sorted({version for host in hosts for version in _versions(host)}):
        setting = f"net.{version}.neigh.default.retrans_time_ms"
        try:
            found = of_family(family)
        except OSError as error:
            yield f"cluster: {setting}, which has to be {MOST_RETRANS_MS}, cannot be read here ({error})"
            continue
        slow = sorted(f"{name} ({ms} ms)" for name, ms in found.items() if ms > MOST_RETRANS_MS and name != "lo")
        if slow:
            yield (
                f"cluster: a packet for a controller may be kept by this computer and sent after the other machine has taken over, while"
                f" {setting} is above {MOST_RETRANS_MS}: {', '.join(slow)}; write `{setting} = {MOST_RETRANS_MS}` in /etc/sysctl.d and"
                " restart the computer, because an interface takes it over when it appears"
            )


def _versions(host: str) -> tuple[tuple[str, int], ...]:
    """Return by which versions of IP a host is reached; none for this computer itself."""
    both = (("ipv4", socket.AF_INET), ("ipv6", socket.AF_INET6))
    if host.lower() == "localhost":
        return ()
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return both  # a name may be either
    return () if address.is_loopback else both[address.version == 6 :][:1]


def _messages(answer: bytes) -> Iterator[tuple[int, bytes]]:
    while answer:
        length, kind, *_ = _HEADER.unpack_from(answer)
        yield kind, answer[_HEADER.size : length]
        answer = answer[_aligned(length) :]


def _attributes(body: bytes) -> Iterator[tuple[int, bytes]]:
    while len(body) >= _ATTRIBUTE.size:
        length, kind = _ATTRIBUTE.unpack_from(body)
        yield kind, body[_ATTRIBUTE.size : length]
        body = body[_aligned(length) :]


def _aligned(length: int) -> int:
    return (length + 3) & ~3
