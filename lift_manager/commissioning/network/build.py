"""From a checked site to what it needs of the network."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from ipaddress import ip_address
from urllib.parse import urlsplit

from drivers.modbus.read_plan import plan_reads, polled_points
from drivers.modbus.writes import read_back_blocks
from lift_manager.commissioning.network.errors import UnknownHost
from lift_manager.commissioning.network.model import (
    LeafNode,
    MapUse,
    Network,
    Peer,
    Span,
    Station,
    Unit,
    Write,
    is_loopback,
    joined,
)
from lift_manager.commissioning.wording import one_line
from lift_manager.config.devices import Device, devices
from lift_manager.config.hub import LeafUnreadable, Server, hub_servers, leaf_files
from lift_manager.config.load import LoadedSite
from lift_manager.config.site import Lift
from register_maps.codec import Block, Codec

Lookup = Callable[[str], tuple[str, ...]]
"""From a host name to its addresses; none where the name is not known."""

PlannedRead = tuple[Device, str, Span]
"""A read: the device, the lift, the place."""
PlannedWrite = tuple[Device, Write]


def network(loaded: LoadedSite, lookup: Lookup | None = None) -> Network:
    """Work out what a site reads and writes, and where; host names are looked up where `lookup` is given.

    Raises UnknownHost for a name that cannot be resolved.
    """
    site = loaded.site
    reads: list[PlannedRead] = []
    writes: list[PlannedWrite] = []
    for name, lift in site.lifts.items():
        codec = loaded.codecs[name]
        placed = devices(site, lift, codec.map)
        reads += [(placed[block.endpoint], name, _span(block)) for block in _read_blocks(loaded, lift, codec)]
        if lift.access == "control":
            writes += [(placed[endpoint], write) for endpoint, write in _write_spans(name, codec)]
    stations = tuple(_station(loaded, name, reads, writes, lookup) for name in loaded.controllers)
    uses = tuple(
        MapUse(one_line(name), loaded.maps[name].map.name, loaded.maps[name].sha256, lift.access)
        for name, lift in site.lifts.items()
    )
    return Network(
        site=one_line(site.name),
        api_host=site.api.host.strip("[]"),
        api_port=site.api.port,
        api_tls=site.api.tls is not None,
        maps=uses,
        stations=stations,
        leaf_node=_leaf_node(loaded, lookup),
        etcd=tuple(_member(url, lookup) for url in ([] if site.cluster is None else site.cluster.etcd)),
    )


def _member(url: str, lookup: Lookup | None) -> Peer:
    parts = urlsplit(url)
    tls, host = parts.scheme == "https", parts.hostname or ""
    return _peer(Server(host, parts.port or (443 if tls else 80), tls), lookup, owner="etcd")


def _leaf_node(loaded: LoadedSite, lookup: Lookup | None) -> LeafNode | None:
    """Return the leaf node; where rules are made, its hub must be known."""
    if loaded.site.hub is None:
        return None
    server = Server.of(loaded.site.hub.server)
    leaf_conf, _ = leaf_files(loaded.site, loaded.path.parent)
    if not is_loopback(server.host):
        return LeafNode(_peer(server, lookup), on_loopback=False, hub=())
    peer = Peer(server.host, (), server.port, server.uses_tls)
    try:
        hub = tuple(_peer(server, lookup) for server in hub_servers(leaf_conf))
    except LeafUnreadable as error:
        if lookup is not None:
            raise UnknownHost(
                f"{error}, and it names the address of the hub: run this as a user who can read it"
            ) from error
        return LeafNode(peer, on_loopback=True, hub=(), unknown=str(error))
    return LeafNode(peer, on_loopback=True, hub=hub)


def _peer(server: Server, lookup: Lookup | None, *, owner: str = "hub") -> Peer:
    found = () if lookup is None else addresses(owner, server.host, lookup)
    return Peer(one_line(server.host), found, server.port, server.uses_tls)


def look_up(host: str) -> tuple[str, ...]:
    """Ask this computer's resolver for the addresses of a host; none where it knows none."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except OSError:
        return ()
    return tuple(sorted({str(address[0]) for *_, address in found}))


def addresses(owner: str, host: str, lookup: Lookup) -> tuple[str, ...]:
    """Return what the host of a controller or a server stands for. Raises UnknownHost for a name that cannot be resolved."""
    try:
        return (str(ip_address(host.strip("[]"))),)
    except ValueError:
        found = lookup(host)
    if not found:
        raise UnknownHost(
            f"{owner}: this computer cannot resolve {host}, and firewalls go by addresses; run this "
            "on the manager's computer, or write the address in place of the name"
        )
    return found


def _station(
    loaded: LoadedSite, name: str, reads: list[PlannedRead], writes: list[PlannedWrite], lookup: Lookup | None
) -> Station:
    controller = loaded.controllers[name]
    places = {*(device for device, _, _ in reads), *(device for device, _ in writes)}
    units = sorted(device.unit_id for device in places if device.controller == name)
    return Station(
        name=one_line(name),
        host=one_line(controller.host.strip("[]")),
        addresses=() if lookup is None else addresses(f"controller {one_line(name)}", controller.host, lookup),
        port=controller.port,
        tls=controller.tls is not None,
        units=tuple(_unit(loaded, Device(name, unit), reads, writes) for unit in units),
    )


def _unit(loaded: LoadedSite, device: Device, reads: list[PlannedRead], writes: list[PlannedWrite]) -> Unit:
    own_reads = [(lift, span) for place, lift, span in reads if place == device]
    own_writes = tuple(write for place, write in writes if place == device)
    lifts = tuple(dict.fromkeys([*(lift for lift, _ in own_reads), *(write.lift for write in own_writes)]))
    return Unit(
        unit_id=device.unit_id,
        lifts=tuple(one_line(lift) for lift in lifts),
        maps=tuple(dict.fromkeys(loaded.maps[lift].map.name for lift in lifts)),
        reads=tuple(joined(span for _, span in own_reads)),
        writes=tuple(sorted(own_writes, key=lambda write: (write.span, write.function))),
    )


def _read_blocks(loaded: LoadedSite, lift: Lift, codec: Codec) -> Iterator[Block]:
    """Yield what is polled and, of a lift that is commanded, what is read back."""
    placed = devices(loaded.site, lift, codec.map).values()
    needs = [loaded.links[device.controller] for device in placed]
    registers = min(need.max_registers_per_read for need in needs)
    bits = min(need.max_bits_per_read for need in needs)
    yield from plan_reads(polled_points(codec), codec.served, max_registers=registers, max_bits=bits)
    if lift.access != "control":
        return
    for command in codec.commands.values():
        planned = plan_reads(command.read_points, codec.served, max_registers=registers, max_bits=bits)
        yield from read_back_blocks(command, codec.written, planned)
        if command.is_shared:
            yield from command.blocks  # read afresh before each write


def _write_spans(lift: str, codec: Codec) -> Iterator[tuple[str, Write]]:
    for command in codec.commands.values():
        printed = list(zip(command.points, command.spec.addresses, strict=True))
        for block, function in zip(command.blocks, command.functions, strict=True):
            addresses_in_block = tuple(text for point, text in printed if block.holds(point))
            yield (
                block.endpoint,
                Write(function, _span(block), command.name, addresses_in_block, codec.map.name, one_line(lift)),
            )


def _span(block: Block) -> Span:
    return Span(block.table, block.start, block.count)
