"""Who talks to whom, for a person who looks after a network. Pure."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from lift_manager.commissioning.maps_list import WIDTH
from lift_manager.commissioning.network import lines
from lift_manager.commissioning.network.model import LeafNode, Network, Peer, Station, Unit
from register_maps.words import READ_FUNCTION

_PLAIN = "Modbus/TCP: no encryption, and no way to tell who sends"
_TLS = "Modbus/TCP over TLS: both sides show a certificate, and nobody on the way can look inside"


def summary(found: Network) -> Iterator[str]:
    """Yield the table: every connection, its port, and what is read and written over it; addresses as on the wire."""
    yield f"{found.site}: connections that the network has to allow, and no others"
    yield ""
    yield "Manager to controllers (TCP)"
    for station in found.stations:
        yield from _station(station)
    yield ""
    yield "Clients to manager (TCP)"
    yield from _wrapped(
        2, f"{_host(found.api_host)}:{found.api_port}, {'HTTPS' if found.api_tls else 'HTTP'}: {_clients_text(found)}"
    )
    yield from _leaf_node(found.leaf_node)
    yield from _etcd(found)
    yield ""
    yield from textwrap.wrap(
        "Addresses are as on the wire, from 0, and behind them as the map prints them. Nobody else needs a connection to a "
        "controller for the lifts to be driven; controllers begin none.",
        WIDTH,
    )


def _station(station: Station) -> Iterator[str]:
    yield from _wrapped(2, f"{lines.address_text(station)}, {_TLS if station.tls else _PLAIN}")
    for unit in station.units:
        yield from _wrapped(4, f"unit {unit.unit_id}: lift {', '.join(unit.lifts)}; map {', '.join(unit.maps)}")
        yield from _unit(unit)


def _unit(unit: Unit) -> Iterator[str]:
    for table, function in READ_FUNCTION.items():
        spans = [span for span in unit.reads if span.table == table]
        if spans:
            yield from _wrapped(6, f"reads   FC{function:02}  {', '.join(str(span) for span in spans)}")
    for write in unit.writes:
        yield from _wrapped(6, f"writes  FC{write.function:02}  {write.span}: {write.label}, lift {write.lift}")
    if not unit.writes:
        yield "      writes  nothing"


def _leaf_node(found: LeafNode | None) -> Iterator[str]:
    if found is None:
        return
    yield ""
    yield "Manager to its leaf node (TCP)"
    where = "on the manager's own computer only" if found.on_loopback else "on another computer"
    yield from _wrapped(2, f"{_peer_text(found.peer)}, {where}")
    if not found.on_loopback:
        return
    yield ""
    yield "Leaf node to the hub of many sites (TCP)"
    if found.unknown:
        yield from _wrapped(2, f"unknown here: {found.unknown}")
    for peer in found.hub:
        yield from _wrapped(2, f"{_peer_text(peer)}; the leaf node begins it, and the hub begins none")


def _etcd(found: Network) -> Iterator[str]:
    if not found.etcd:
        return
    yield ""
    yield "Both managers of the cluster to the members of its etcd (TCP)"
    for member in found.etcd:
        yield from _wrapped(2, f"{_host(member.host)}:{member.port}, {'HTTPS' if member.tls else 'HTTP'}")
    yield from _wrapped(
        2,
        "The members also reach each other, on ports of their own, and so does what moves an address between the machines",
    )


def _peer_text(peer: Peer) -> str:
    return f"{_host(peer.host)}:{peer.port}, NATS {'with' if peer.tls else 'without'} TLS"


def _clients_text(found: Network) -> str:
    if found.on_loopback:
        return "reached from the manager's own computer only"
    return "robots, the fleet and people who monitor the lifts; name their networks with --clients"


def _host(text: str) -> str:
    return f"[{text}]" if ":" in text else text


def _wrapped(indent: int, text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2))
