"""A drop-in for the systemd unit: which addresses the manager's process may speak to, and on which port it may listen. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lift_manager.commissioning.network import lines
from lift_manager.commissioning.network.model import Network


def drop_in(found: Network, clients: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a drop-in for lift-manager.service; `clients` are the networks that may use the API."""
    yield from lines.header(found, "A drop-in for lift-manager.service")
    yield from lines.comment(
        "Install as /etc/systemd/system/lift-manager.service.d/network.conf, then systemctl daemon-reload and restart. It knows addresses "
        "and no ports; the ports are for nftables.",
        *(
            [
                "Some controllers are given by name: add the address of the resolver, or better, write addresses in the site file."
            ]
            if any(station.is_name for station in found.stations)
            else []
        ),
    )
    yield "[Service]"
    yield "IPAddressDeny=any"
    yield "IPAddressAllow=localhost"
    for station in found.stations:
        yield from lines.comment(lines.address_text(station))
        for address in station.addresses:
            yield f"IPAddressAllow={address}"
    if found.leaf_node is not None and not found.leaf_node.on_loopback:
        yield from lines.comment("the leaf node of this site, for the hub of many sites")
        for address in found.leaf_node.peer.addresses:
            yield f"IPAddressAllow={address}"
    if found.etcd:
        yield from lines.comment("the members of etcd, which decide which of the two managers is active")
        for address in dict.fromkeys(address for member in found.etcd for address in member.addresses):
            yield f"IPAddressAllow={address}"
    if clients and not found.on_loopback:
        yield from lines.comment("clients of the API")
        for network in clients:
            yield f"IPAddressAllow={network}"
    yield from lines.comment("the API, and nothing else to listen on")
    yield "SocketBindDeny=any"
    yield f"SocketBindAllow=tcp:{found.api_port}"
