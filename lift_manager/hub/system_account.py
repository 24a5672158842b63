"""Lets the NATS servers of a hub read a changed configuration, and closes connections, over their system account."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

from lift_manager.hub.connection import Connection, cancellable

if TYPE_CHECKING:
    from nats.aio.client import Client

REPLY_S = 5.0
"""How long a server may take to reply about itself and its connections. Chosen: it takes milliseconds, and seconds on a computer that is overloaded."""
WHOLE_S = 30.0
"""How long one attempt with all servers may take. Chosen: with 1,000 sites a server needs 0.4 s of CPU to read its configuration."""
GATHER_S = 0.5
"""How long to wait for the reply of a further server of a cluster. Chosen: they are in one network, and know of each other."""
MISSING_S = 10.0
"""How long to wait before servers are looked for that did not reply. Chosen: one that is slow is found soon, and one that is off costs little."""

_log = logging.getLogger(__name__)


class SystemAccount:
    """The system account of one NATS server, or of a cluster."""

    def __init__(self, connect: Callable[[], Connection], servers: int) -> None:
        """`connect` returns a connection of the system account that is not open; there are so many `servers`, as far as is configured."""
        self._connect, self._servers = connect, servers
        self._is_due = False
        self._not_before = 0.0
        self._to_close: set[str] = set()
        """Accounts whose connections are still to be closed at some server."""
        self._reloaded: set[str] = set()
        """Servers, by id, that have read the newest configuration."""
        self._closed: dict[str, set[str]] = {}
        """Accounts whose connections a server has closed since it read that: a site that has connected again is not to be disconnected again."""

    async def reload(self, closed: Collection[str]) -> None:
        """Let every server read its configuration again, and close the connections of these accounts, which it does not do by itself (2.15).

        They are closed at once, so that a site that is switched off does not stay connected while a server reads; and once more after that,
        because a leaf node connects again within seconds.
        What fails is logged; `retry` tries it again, also at servers that did not reply.
        """
        self._is_due, self._not_before = True, 0.0
        self._to_close |= set(closed)
        self._reloaded = set()
        for accounts in self._closed.values():
            accounts -= set(closed)
        await self.retry()

    async def retry(self) -> None:
        """Try what has failed again: a site that was switched off must not stay connected because a server was slow for once."""
        from nats.errors import Error  # noqa: PLC0415

        if not self._is_due or _now() < self._not_before:
            return
        is_first = not self._reloaded
        try:
            with cancellable():
                async with asyncio.timeout(WHOLE_S), self._opened() as client:
                    if self._to_close and is_first:
                        await self._close(client)
                    await self._reload(client)
                    if self._to_close:
                        await self._close(client)
        except (Error, OSError, TimeoutError) as error:
            why = str(error) or "no reply in time"
            _log.error("the NATS servers do not follow the change of sites: %s; it is tried again", why)
            return
        done = len(self._reloaded & self._closed.keys() if self._to_close else self._reloaded)
        if done >= self._servers:
            self._is_due = False
            self._to_close, self._closed = set(), {}
            return
        self._not_before = _now() + MISSING_S
        if is_first:
            _log.warning(
                "%d of %d NATS servers have followed the change of sites; the others follow once they reply",
                done,
                self._servers,
            )

    async def _reload(self, client: Client) -> None:
        for server in await self._every(client, "IDZ"):
            if server["id"] not in self._reloaded:
                # it replies once it has read everything; to request it again meanwhile would only take longer
                reply = await _request(client, server["id"], "RELOAD", {}, WHOLE_S)
                if error := reply.get("error"):
                    why = error.get("description")
                    _log.error("the NATS server %s cannot use its configuration: %s", server["name"], why)
                self._reloaded.add(server["id"])

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[Client]:
        connection = self._connect()
        try:
            await connection.open()
            yield connection.client
        finally:
            await connection.close()

    async def _close(self, client: Client) -> None:
        for server in await self._every(client, "LEAFZ"):
            ident = server["server"]["id"]
            closed = self._closed.get(ident, set())
            for leaf in server["data"].get("leafs") or ():
                if leaf.get("account") in self._to_close - closed:
                    await _request(client, ident, "KICK", {"cid": leaf["id"]}, REPLY_S)
            if ident in self._reloaded:
                self._closed[ident] = closed | self._to_close

    async def _every(self, client: Client, what: str) -> list[Any]:
        """Return the replies of all servers. One that does not reply may be slow, or may have ended."""
        from nats.errors import NoRespondersError  # noqa: PLC0415
        from nats.errors import TimeoutError as NoMessage  # noqa: PLC0415

        inbox = client.new_inbox()
        subscription = await client.subscribe(inbox)
        await client.publish(f"$SYS.REQ.SERVER.PING.{what}", b"{}", reply=inbox)
        first = await subscription.next_msg(timeout=REPLY_S)
        if not first.data:
            raise NoRespondersError
        found = [json.loads(first.data)]
        with suppress(NoMessage):
            while len(found) < self._servers:
                found.append(json.loads((await subscription.next_msg(timeout=GATHER_S)).data))
        await subscription.unsubscribe()
        return found


async def _request(client: Client, server: str, what: str, data: object, within_s: float) -> Any:
    subject = f"$SYS.REQ.SERVER.{server}.{what}"
    return json.loads((await client.request(subject, json.dumps(data).encode(), timeout=within_s)).data)


def _now() -> float:
    return asyncio.get_running_loop().time()
