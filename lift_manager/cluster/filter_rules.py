"""The rules of the packet filter of a cluster, for nftables: which packets of this machine reach the controllers, and when. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from ipaddress import ip_address

TABLE = "lift_manager_term"
"""Not `lift_manager`: that one is of the rules which `lift-manager network` prints."""
PERMITTED = "permitted"
"""The set with the user of the manager, for as long as its term lasts."""
FORGOTTEN_S = 600
"""After so long without a packet a connection is forgotten, and made again. Chosen: the slowest poll is much faster."""

_FAMILIES = {4: ("ip", "ipv4_addr"), 6: ("ip6", "ipv6_addr")}


def connection_sets(controllers: Iterable[tuple[str, int]]) -> tuple[str, ...]:
    """Return the sets with the connections that were begun in the present term."""
    return tuple(f"connections{version}" for version in _by_version(controllers))


def ruleset(controllers: Iterable[tuple[str, int]]) -> Iterator[str]:
    """Yield a file for `nft -f` that replaces the table of the filter, for controllers by address and port.

    Until somebody is permitted nothing but resets leaves for them: a reset carries nothing, and frees the slot of a controller. A
    connection counts from its first packet in a term on, so what an earlier term left in the kernel is not sent in a later one. What
    does not count is dropped and not rejected, so that its program can still reset it; a new connection is refused at once.
    """
    places = _by_version(controllers)
    yield f"table inet {TABLE}"
    yield f"delete table inet {TABLE}"
    yield f"table inet {TABLE} {{"
    yield f"  set {PERMITTED} {{ typeof meta skuid; flags timeout; }}"
    for version, listed in places.items():
        kind = _FAMILIES[version][1]
        elements = ", ".join(f"{host} . {port}" for host, port in listed)
        yield f"  set controllers{version} {{ type {kind} . inet_service; elements = {{ {elements} }} }}"
        yield (
            f"  set connections{version} {{ type {kind} . inet_service . inet_service; flags dynamic,timeout; timeout {FORGOTTEN_S}s; }}"
        )
    yield "  chain output {"
    yield "    type filter hook output priority filter; policy accept;"
    for version in places:
        ip = _FAMILIES[version][0]
        yield f"    {ip} daddr . tcp dport @controllers{version} goto controllers{version}"
    yield "  }"
    for version in places:
        yield from _chain(version)
    yield "}"


def _chain(version: int) -> Iterator[str]:
    ip = _FAMILIES[version][0]
    connection = f"{ip} daddr . tcp dport . tcp sport"
    begins = "tcp flags & (fin | syn | rst | ack) == syn"
    update = f"update @connections{version} {{ {connection} }}"
    yield f"  chain controllers{version} {{"
    yield "    tcp flags & rst == rst accept"
    # a packet without an owner, such as one that a process left behind, has no skuid and passes neither of these
    yield f"    meta skuid @{PERMITTED} {begins} {update} accept"
    yield f"    meta skuid @{PERMITTED} {connection} @connections{version} {update} accept"
    yield f"    {begins} counter reject with tcp reset"
    yield "    counter drop"
    yield "  }"


def _by_version(controllers: Iterable[tuple[str, int]]) -> dict[int, list[tuple[str, int]]]:
    found: dict[int, list[tuple[str, int]]] = {}
    for host, port in sorted(set(controllers)):
        address = ip_address(host.partition("%")[0])
        found.setdefault(address.version, []).append((str(address), port))
    return found
