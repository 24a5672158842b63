"""Who talks to whom, and what about: everything that the rules and the summary are made from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from register_maps.words import Table


@dataclass(frozen=True, slots=True, order=True)
class Span:
    """Addresses of one table that follow one another, as on the wire."""

    table: Table
    start: int
    count: int

    @property
    def last(self) -> int:
        """The last address in it."""
        return self.start + self.count - 1

    def __str__(self) -> str:
        return f"{self.table} {self.start}" + (f" to {self.last}" if self.count > 1 else "")


@dataclass(frozen=True, slots=True)
class Write:
    """One command, or the part of it that one request writes."""

    function: int
    span: Span
    """What the request covers: more than the command itself where a block is always written as a whole."""
    command: str
    printed: tuple[str, ...]
    """Its addresses as the map prints them."""
    map: str
    lift: str

    @property
    def label(self) -> str:
        """The command and its place: `go_to at holding:16`."""
        return f"{self.command} at {', '.join(self.printed)}"


@dataclass(frozen=True, slots=True)
class Unit:
    """One unit id of a controller: what is read and written there."""

    unit_id: int
    lifts: tuple[str, ...]
    maps: tuple[str, ...]
    reads: tuple[Span, ...]
    """Polls and read-backs, joined where they touch."""
    writes: tuple[Write, ...]
    """None where every lift on it is only watched."""

    @property
    def functions(self) -> frozenset[int]:
        """The write functions that are used here."""
        return frozenset(write.function for write in self.writes)


@dataclass(frozen=True, slots=True)
class Station:
    """One controller: an address, a port, and the units behind it."""

    name: str
    host: str
    """As in the site file: an address or a name."""
    addresses: tuple[str, ...]
    """What the host stands for; empty where nobody looked."""
    port: int
    tls: bool
    units: tuple[Unit, ...]

    @property
    def writes(self) -> tuple[Write, ...]:
        """Of all its units."""
        return tuple(write for unit in self.units for write in unit.writes)

    @property
    def maps(self) -> tuple[str, ...]:
        """Of all its units, each once."""
        return tuple(dict.fromkeys(name for unit in self.units for name in unit.maps))

    @property
    def is_name(self) -> bool:
        """Whether its host had to be looked up."""
        return bool(self.addresses) and self.addresses != (self.host,)


@dataclass(frozen=True, slots=True)
class Peer:
    """A NATS server, or a member of etcd."""

    host: str
    """As it is configured: an address or a name."""
    addresses: tuple[str, ...]
    """What the host stands for; empty where nobody looked."""
    port: int
    tls: bool


@dataclass(frozen=True, slots=True)
class LeafNode:
    """The leaf node of a site that belongs to a hub."""

    peer: Peer
    """Where the manager reaches it."""
    on_loopback: bool
    hub: tuple[Peer, ...]
    """Where it reaches the hub; empty if it is on another computer, or if that is unknown."""
    unknown: str = ""
    """Why it is unknown, as a sentence without a full stop."""

    @property
    def outside(self) -> tuple[Peer, ...]:
        """What the manager's computer connects to."""
        return self.hub if self.on_loopback else (self.peer,)


@dataclass(frozen=True, slots=True)
class MapUse:
    """The map of one lift, with the hash of what was loaded."""

    lift: str
    map: str
    sha256: str
    access: str


@dataclass(frozen=True, slots=True)
class Network:
    """Everything that a site needs of the network."""

    site: str
    api_host: str
    api_port: int
    api_tls: bool
    maps: tuple[MapUse, ...]
    stations: tuple[Station, ...]
    leaf_node: LeafNode | None = None
    etcd: tuple[Peer, ...] = ()
    """The members of the etcd of a cluster; empty if the manager is alone."""

    @property
    def outside(self) -> tuple[Peer, ...]:
        """What the manager's computer connects to for the hub of many sites."""
        return () if self.leaf_node is None else self.leaf_node.outside

    @property
    def on_loopback(self) -> bool:
        """Whether only programs on the manager's own computer reach it."""
        return is_loopback(self.api_host)


def is_loopback(host: str) -> bool:
    """Whether a host is the computer itself."""
    return host == "localhost" or host.startswith("127.") or host == "::1"


def joined(spans: Iterable[Span]) -> Iterator[Span]:
    """Yield spans in order, those that touch or overlap as one."""
    held: Span | None = None
    for span in sorted(spans):
        if held is not None and span.table == held.table and span.start <= held.last + 1:
            held = Span(held.table, held.start, max(held.last, span.last) - held.start + 1)
            continue
        if held is not None:
            yield held
        held = span
    if held is not None:
        yield held
