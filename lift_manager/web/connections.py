"""Which connections a server keeps, and which one it closes to make room for another."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Address, IPv6Network
from typing import NamedTuple

from lift_manager.web.origin import is_loopback, unmapped

LOG_EVERY_S = 60.0
"""Chosen: a flood fills no log, and a person who reads it sees that it goes on."""

Network = IPv4Network | IPv6Network

_CLIENT_SHARE = 4
"""One client gets at most one of so many places. Chosen: four hostile addresses are harder to come by than one."""
_OWN_SHARE = 20
"""One of so many places is for programs on the manager's own computer. Chosen: the command line and a few pages."""
_IPV6_CLIENT_BITS = 64
"""One client of IPv6 has as many addresses as it likes within the prefix of its network."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """How many connections may be open at a time."""

    total: int
    from_others: int
    """From other computers; the difference is reserved for programs on this one."""
    per_client: int
    """From one address of another computer that is not a trusted proxy."""
    trusted_proxies: tuple[Network, ...] = ()

    @classmethod
    def of(cls, total: int, trusted_proxies: tuple[Network, ...] = ()) -> ConnectionLimits:
        """Return the limits that go with a total."""
        reserved = min(max(1, total // _OWN_SHARE), total - 1)
        return cls(total, total - reserved, max(1, total // _CLIENT_SHARE), trusted_proxies)

    def is_trusted(self, address: str) -> bool:
        """Whether this is the address of a proxy, behind which there are many clients."""
        if not self.trusted_proxies:
            return False
        try:
            found = unmapped(address)
        except ValueError:
            return False
        return any(found in network for network in self.trusted_proxies)


class _Waiting(NamedTuple):
    """A connection that waits for its client."""

    yields_from: float
    """Loop time from which on it may be closed to make room."""
    close: Callable[[], object]


class _Bound(NamedTuple):
    """One limit: whose connections count, how many these are, how many there may be, and all of it in words."""

    is_member: Callable[[str], bool]
    taken: int
    limit: int
    text: str


class Connections:
    """The connections of one server: whose they are, and which of them wait for their client."""

    def __init__(self, limits: ConnectionLimits) -> None:
        self._loop = asyncio.get_running_loop()
        self._limits = limits
        self._client: dict[Hashable, str] = {}
        """By connection; the empty text for this computer."""
        self._count: Counter[str] = Counter()
        """Connections by client."""
        self._waiting: dict[Hashable, _Waiting] = {}
        """The one that has waited longest is the first."""
        self._report = _Report()

    def make_room(self, address: str) -> bool:
        """Whether there is a place for a connection from here; an idle connection is closed if it takes that."""
        client = self._client_of(address)
        for bound in self._bounds(client, address):
            if bound.taken < bound.limit:
                continue
            oldest = self._oldest_waiting(bound.is_member)
            self._report.note(f"{bound.text} ({self._busiest()})", closed=oldest is not None)
            if oldest is None:
                return False
            close = self._waiting[oldest].close
            self.remove(oldest)
            close()
        return True

    def add(self, connection: Hashable, address: str, close: Callable[[], object], *, yields_after_s: float) -> None:
        """Count a connection that is being made; it makes room for others when that takes this long."""
        client = self._client_of(address)
        self._client[connection] = client
        self._count[client] += 1
        self._waiting[connection] = _Waiting(self._loop.time() + yields_after_s, close)

    def wait(self, connection: Hashable, close: Callable[[], object]) -> None:
        """A connection waits for its client's next request from now on; it makes room for others at once."""
        self._waiting.pop(connection, None)
        if connection in self._client:
            self._waiting[connection] = _Waiting(self._loop.time(), close)

    def serve(self, connection: Hashable) -> None:
        """A request is being answered on a connection: it makes room for nobody."""
        self._waiting.pop(connection, None)

    def remove(self, connection: Hashable) -> None:
        """Give up the place of a connection; may be repeated."""
        self._waiting.pop(connection, None)
        client = self._client.pop(connection, None)
        if client is not None:
            self._count[client] -= 1
            if not self._count[client]:
                del self._count[client]

    def close(self) -> None:
        """Log nothing any more."""
        self._report.close()

    def _bounds(self, client: str, address: str) -> Iterator[_Bound]:
        """Yield what limits a newcomer, narrow before wide, each as it is once there is room within the one before."""
        limits = self._limits
        if client and not limits.is_trusted(address):
            text = f"{client} has {limits.per_client} connections, and one client gets no more; if it is a proxy, name it in `trusted_proxies`"
            yield _Bound(client.__eq__, self._count[client], limits.per_client, text)
        if client:
            text = f"all {limits.from_others} places for connections from other computers are taken"
            yield _Bound(bool, len(self._client) - self._count[""], limits.from_others, text)
        text = f"all {limits.total} places for connections are taken"
        yield _Bound(lambda _: True, len(self._client), limits.total, text)

    def _oldest_waiting(self, is_member: Callable[[str], bool]) -> Hashable | None:
        now = self._loop.time()
        for connection, waiting in self._waiting.items():
            if waiting.yields_from <= now and is_member(self._client[connection]):
                return connection
        return None

    def _busiest(self) -> str:
        client, count = max(self._count.items(), key=lambda entry: entry[1])
        return f"{count} by {client or 'this computer'}"

    def _client_of(self, address: str) -> str:
        """Return what counts as one client; the empty text for this computer."""
        if is_loopback(address):
            return ""
        try:
            found = unmapped(address)
        except ValueError:
            return address
        if isinstance(found, IPv6Address) and not found.is_link_local:
            return str(IPv6Network((int(found), _IPV6_CLIENT_BITS), strict=False))
        return str(found)


class _Report:
    """One line of the log when places run out, and one a minute for as long as that goes on."""

    def __init__(self) -> None:
        self._closed = 0
        self._refused = 0
        self._text = ""
        self._pause: asyncio.TimerHandle | None = None

    def note(self, text: str, *, closed: bool) -> None:
        """Count a connection that was closed to make room, or one that was refused."""
        self._text = text
        self._closed += closed
        self._refused += not closed
        if self._pause is None:
            self._write()

    def close(self) -> None:
        """Write nothing any more."""
        if self._pause is not None:
            self._pause.cancel()

    def _write(self) -> None:
        self._pause = None
        if not self._closed and not self._refused:
            return
        message = "api: %s; connections since the last such line: %d idle closed to make room, %d new refused"
        _log.warning(message, self._text, self._closed, self._refused)
        self._closed = self._refused = 0
        self._pause = asyncio.get_running_loop().call_later(LOG_EVERY_S, self._write)
