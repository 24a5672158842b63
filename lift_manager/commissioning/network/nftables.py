"""nftables: what the manager's computer, or a gateway, lets through. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from lift_manager.commissioning.network import lines
from lift_manager.commissioning.network.model import Network

_TYPE = {4: "ipv4_addr", 6: "ipv6_addr"}
_IP = {4: "ip", 6: "ip6"}


def host(found: Network, clients: Sequence[str], user: str) -> Iterator[str]:
    """Yield a ruleset for the manager's own computer; `user` is the one it runs as, by name or number.

    `clients` are the networks that may use the API.
    """
    yield from lines.header(found, "nftables for the lift manager's own computer")
    yield from lines.comment(
        "It adds to what that computer's firewall does, and is about nothing but the lift manager: its user reaches the controllers and "
        f"nothing else{_others_text(found)}, nobody but its user reaches them, and only the named networks reach its API.",
        "Load: nft -f FILE. Try first: nft -c -f FILE. The user has to exist before. Tools that are to reach a controller run as that user.",
        *_names(found),
        *_api(found, clients),
    )
    yield "table inet lift_manager"
    yield "delete table inet lift_manager"
    yield "table inet lift_manager {"
    yield from _sets(found, clients)
    yield "  chain output {"
    yield "    type filter hook output priority filter; policy accept;"
    for version in _versions(found):
        place = f"{_IP[version]} daddr . tcp dport @controllers{version}"
        yield f"    {place} meta skuid {_user(user)} accept"
        yield f"    {place} counter reject"
    for name, version, _ in _others(found):
        yield f"    {_IP[version]} daddr . tcp dport @{name}{version} meta skuid {_user(user)} accept"
    yield f'    meta skuid {_user(user)} ct direction original oifname != "lo" counter drop'
    yield "  }"
    yield "  chain input {"
    yield "    type filter hook input priority filter; policy accept;"
    yield f'    iifname "lo" tcp dport {found.api_port} accept'
    if not found.on_loopback:
        for version, _ in _listed(clients):
            yield f"    {_IP[version]} saddr @clients{version} tcp dport {found.api_port} accept"
    yield f"    tcp dport {found.api_port} counter drop"
    yield "  }"
    yield "}"


def gateway(found: Network, clients: Sequence[str], managers: Sequence[str]) -> Iterator[str]:
    """Yield a ruleset for the gateway between the controllers' network, the manager and the rest of the building."""
    yield from lines.header(found, "nftables for the gateway in front of the controllers and of the lift manager")
    yield from lines.comment(
        f"The manager at {', '.join(managers)} reaches the controllers, on their ports. Nobody else reaches them, and they begin no "
        "connection. The manager is reached on the port of its API, by the named networks; people who look after that computer "
        "need lines of their own before the last ones, one for each direction. A connection that is there already when "
        "these rules are loaded has to fit them too.",
        "Load: nft -f FILE. Try first: nft -c -f FILE. It sees only what is forwarded: a host in the controllers' own network has to be kept "
        "out of it by the switch.",
        *_names(found),
        *_api(found, clients),
    )
    yield "table inet lift_manager_gateway"
    yield "delete table inet lift_manager_gateway"
    yield "table inet lift_manager_gateway {"
    yield from _sets(found, clients)
    for version, listed in _listed(managers):
        yield from _set(f"managers{version}", _TYPE[version], listed)
    for version, listed in _listed(each for station in found.stations for each in station.addresses):
        yield from _set(f"devices{version}", _TYPE[version], listed)
    yield "  chain forward {"
    yield "    type filter hook forward priority filter; policy accept;"
    for version in sorted(set(_versions(found)) & {version for version, _ in _listed(managers)}):
        yield from _to_controllers(version)
    for name, version, _ in _others(found):
        if version in {version for version, _ in _listed(managers)}:
            yield from _to_other(name, version)
    if not found.on_loopback:
        both = {version for version, _ in _listed(clients)} & {version for version, _ in _listed(managers)}
        for version in sorted(both):
            yield from _to_api(version, found.api_port)
    for version in _versions(found):
        yield f"    {_IP[version]} daddr @devices{version} counter drop"
        yield f"    {_IP[version]} saddr @devices{version} counter drop"
    for version, _ in _listed(managers):
        yield f"    {_IP[version]} daddr @managers{version} counter drop"
        yield f"    {_IP[version]} saddr @managers{version} counter drop"
    yield "  }"
    yield "}"


def _to_controllers(version: int) -> Iterator[str]:
    """Let through what the managers ask, what is answered to it, and ICMP about both.

    No line lets through whatever is established: a stranger's connection would outlive the loading of the rules.
    """
    ip = _IP[version]
    yield f"    {ip} saddr @managers{version} {ip} daddr . tcp dport @controllers{version} accept"
    yield f"    {ip} daddr @managers{version} {ip} saddr . tcp sport @controllers{version} ct direction reply accept"
    yield f"    ct state related ct original {ip} saddr @managers{version} ct reply {ip} saddr @devices{version} accept"


def _to_other(name: str, version: int) -> Iterator[str]:
    """Let through what the leaf node or a manager of a cluster begins; neither the hub nor etcd begins a connection."""
    ip = _IP[version]
    yield f"    {ip} saddr @managers{version} {ip} daddr . tcp dport @{name}{version} accept"
    yield f"    {ip} daddr @managers{version} {ip} saddr . tcp sport @{name}{version} ct direction reply accept"


def _to_api(version: int, port: int) -> Iterator[str]:
    ip = _IP[version]
    yield f"    {ip} saddr @clients{version} {ip} daddr @managers{version} tcp dport {port} accept"
    yield f"    {ip} daddr @clients{version} {ip} saddr @managers{version} tcp sport {port} ct direction reply accept"
    yield f"    ct state related ct original {ip} saddr @clients{version} ct reply {ip} saddr @managers{version} accept"


def _sets(found: Network, clients: Sequence[str]) -> Iterator[str]:
    for version in _versions(found):
        places = [
            f"{address} . {station.port}"
            for station in found.stations
            for address in lines.by_version(station.addresses)[version]
        ]
        yield from _set(f"controllers{version}", f"{_TYPE[version]} . inet_service", places)
    for name, version, places in _others(found):
        yield from _set(f"{name}{version}", f"{_TYPE[version]} . inet_service", places)
    if not found.on_loopback:
        for version, listed in _listed(clients):
            yield from _set(f"clients{version}", _TYPE[version], listed, flags="interval")


def _set(name: str, kind: str, elements: Iterable[str], flags: str = "") -> Iterator[str]:
    yield f"  set {name} {{"
    yield f"    type {kind}"
    if flags:
        yield f"    flags {flags}"
        yield "    auto-merge"
    yield f"    elements = {{ {', '.join(dict.fromkeys(elements))} }}"
    yield "  }"


def _versions(found: Network) -> list[int]:
    return [version for version, _ in _listed(each for station in found.stations for each in station.addresses)]


def _others(found: Network) -> Iterator[tuple[str, int, list[str]]]:
    """Yield what else the manager's computer connects to: the name of a set, the version of IP, and the elements of the set."""
    for name, peers in (("hub", found.outside), ("etcd", found.etcd)):
        for version in _IP:
            places = [
                f"{address} . {peer.port}" for peer in peers for address in lines.by_version(peer.addresses)[version]
            ]
            if places:
                yield name, version, places


def _others_text(found: Network) -> str:
    others = [text for text, peers in (("the hub of many sites", found.outside), ("etcd", found.etcd)) if peers]
    return f" but {' and '.join(others)}" if others else ""


def _listed(texts: Iterable[str]) -> list[tuple[int, list[str]]]:
    return [(version, listed) for version, listed in lines.by_version(texts).items() if listed]


def _user(user: str) -> str:
    return user if user.isdigit() else f'"{user}"'


def _names(found: Network) -> Iterator[str]:
    if any(station.is_name for station in found.stations):
        yield (
            "Some controllers are given by name. nftables goes by addresses, and the manager looks the name up again at every connection: "
            "let it reach the resolver too, or better, write addresses in the site file."
        )
    if any(peer.addresses != (peer.host,) for peer in found.etcd):
        yield "Some members of etcd are given by name: let the manager reach the resolver too, or better, write addresses."
    if any(peer.addresses != (peer.host,) for peer in found.outside):
        yield (
            "The hub is given by name, which the leaf node looks up again at every connection: let it reach the resolver too, or write the "
            "address in its leaf.conf."
        )


def _api(found: Network, clients: Sequence[str]) -> Iterator[str]:
    if found.on_loopback:
        yield f"The API listens on {found.api_host}, so nobody outside this computer reaches it, whatever a firewall says."
    elif not clients:
        yield "No network was named with --clients: only programs on this computer reach the API."
