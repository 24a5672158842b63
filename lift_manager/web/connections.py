"""Limits the connections of a server, and closes idle ones to make room for new ones."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import IPv4Network, IPv6Address, IPv6Network
from typing import NamedTuple

from lift_manager.web.origin import is_loopback, unmapped

LOG_EVERY_S = 60.0
"""Chosen: a flood does not fill the log, and a reader of the log sees that it continues."""

Network = IPv4Network | IPv6Network

_CLIENT_SHARE = 4
"""One client gets at most a quarter of all connections. Chosen: four hostile addresses are harder to get than one."""
_LOCAL_SHARE = 20
"""One in twenty connections is reserved for programs on the manager's own computer. Chosen: the command line and a few pages."""
_IPV6_CLIENT_BITS = 64
"""An IPv6 client can use any address within the prefix of its network."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """How many connections may be open at a time."""

    total: int
    remote: int
    """From other computers; the rest is reserved for programs on this one."""
    per_client: int
    """From one address of another computer that is not a trusted proxy."""
    trusted_proxies: tuple[Network, ...] = ()

    @classmethod
    def of(cls, total: int, trusted_proxies: tuple[Network, ...] = ()) -> ConnectionLimits:
        """Return the limits for a total."""
        reserved = min(max(1, total // _LOCAL_SHARE), total - 1)
        return cls(total, total - reserved, max(1, total // _CLIENT_SHARE), trusted_proxies)

    def is_trusted(self, address: str) -> bool:
        """Whether this is the address of a trusted proxy, which may have many clients."""
        if not self.trusted_proxies:
            return False
        try:
            found = unmapped(address)
        except ValueError:
            return False
        return any(found in network for network in self.trusted_proxies)


class _IdleConnection(NamedTuple):
    """A connection that waits for its client."""

    evictable_at: float
    """Loop time from which it may be closed to make room."""
    close: Callable[[], object]


class _Limit(NamedTuple):
    """A limit: which clients it covers, how many connections they have and may have, and a text for the log."""

    is_member: Callable[[str], bool]
    used: int
    maximum: int
    text: str


class Connections:
    """The connections of one server, by client, and which of them are idle."""

    def __init__(self, limits: ConnectionLimits) -> None:
        self._loop = asyncio.get_running_loop()
        self._limits = limits
        self._client: dict[Hashable, str] = {}
        """By connection; the empty text for this computer."""
        self._count: Counter[str] = Counter()
        """Connections by client."""
        self._idle: dict[Hashable, _IdleConnection] = {}
        """In the order in which they became idle."""
        self._report = _LimitLog()

    def make_room(self, address: str) -> bool:
        """Return whether a connection from this address is accepted; closes an idle connection if that is needed."""
        client = _client_of(address)
        for limit in self._limits_for(client, address):
            if limit.used < limit.maximum:
                continue
            oldest = self._oldest_idle(limit.is_member)
            self._report.note(f"{limit.text} ({self._busiest()})", closed=oldest is not None)
            if oldest is None:
                return False
            close = self._idle[oldest].close
            self.remove(oldest)
            close()
        return True

    def add(self, connection: Hashable, address: str, close: Callable[[], object], *, evictable_after_s: float) -> None:
        """Count a connection that is being established; it may be closed to make room if that takes too long."""
        client = _client_of(address)
        self._client[connection] = client
        self._count[client] += 1
        self._idle[connection] = _IdleConnection(self._loop.time() + evictable_after_s, close)

    def mark_idle(self, connection: Hashable, close: Callable[[], object]) -> None:
        """Mark a connection as waiting for the next request: it may be closed to make room."""
        self._idle.pop(connection, None)
        if connection in self._client:
            self._idle[connection] = _IdleConnection(self._loop.time(), close)

    def mark_busy(self, connection: Hashable) -> None:
        """Mark a connection as answering a request: it is not closed to make room."""
        self._idle.pop(connection, None)

    def remove(self, connection: Hashable) -> None:
        """Stop counting a connection; may be repeated."""
        self._idle.pop(connection, None)
        client = self._client.pop(connection, None)
        if client is not None:
            self._count[client] -= 1
            if not self._count[client]:
                del self._count[client]

    def close(self) -> None:
        """Stop logging."""
        self._report.close()

    def _limits_for(self, client: str, address: str) -> Iterator[_Limit]:
        """Yield the limits for a new connection, the narrowest first, each with the count after room was made for the one before."""
        limits = self._limits
        if client and not limits.is_trusted(address):
            text = f"{client} has {limits.per_client} connections, and one client gets no more; if it is a proxy, name it in `trusted_proxies`"
            yield _Limit(client.__eq__, self._count[client], limits.per_client, text)
        if client:
            text = f"all {limits.remote} places for connections from other computers are taken"
            yield _Limit(bool, len(self._client) - self._count[""], limits.remote, text)
        text = f"all {limits.total} places for connections are taken"
        yield _Limit(lambda _: True, len(self._client), limits.total, text)

    def _oldest_idle(self, is_member: Callable[[str], bool]) -> Hashable | None:
        now = self._loop.time()
        for connection, waiting in self._idle.items():
            if waiting.evictable_at <= now and is_member(self._client[connection]):
                return connection
        return None

    def _busiest(self) -> str:
        client, count = max(self._count.items(), key=lambda entry: entry[1])
        return f"{count} by {client or 'this computer'}"


@lru_cache(maxsize=1024)  # twice for each connection, and most come from few addresses
def _client_of(address: str) -> str:
    """Return the client that an address belongs to; empty for this computer."""
    if is_loopback(address):
        return ""
    try:
        found = unmapped(address)
    except ValueError:
        return address
    if isinstance(found, IPv6Address) and not found.is_link_local:
        return str(IPv6Network((int(found), _IPV6_CLIENT_BITS), strict=False))
    return str(found)


class _LimitLog:
    """Logs one line when a limit is reached, and one a minute while that continues."""

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
        """Stop logging."""
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
