"""Lets the NATS servers of a hub read a changed configuration, and closes connections, over their system account."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

from lift_manager.hub.connection import Connection

if TYPE_CHECKING:
    from nats.aio.client import Client

REPLY_S = 5.0
"""How long a server may take to reply about itself and its connections. Chosen: it takes milliseconds, and seconds on a computer that is overloaded."""
WHOLE_S = 20.0
"""How long one attempt with all servers may take."""
GATHER_S = 0.5
"""How long to wait for the reply of a further server of a cluster. Chosen: they are in one network, and know of each other."""

_log = logging.getLogger(__name__)


class SystemAccount:
    """The system account of one NATS server, or of a cluster."""

    def __init__(self, connect: Callable[[], Connection], servers: int) -> None:
        """`connect` returns a connection of the system account that is not open; there are so many `servers`, as far as is configured."""
        self._connect, self._servers = connect, servers
        self._is_due = False
        self._to_close: set[str] = set()
        """Accounts whose connections are still to be closed."""

    async def reload(self, closed: Collection[str]) -> None:
        """Let every server read its configuration again, and close the connections of these accounts, which it does not do by itself (2.15).

        What fails is logged; `retry` tries it again.
        """
        self._is_due = True
        self._to_close |= set(closed)
        await self.retry()

    async def retry(self) -> None:
        """Try what has failed again: a site that was switched off must not stay connected because a server was slow for once."""
        from nats.errors import Error  # noqa: PLC0415

        if not self._is_due:
            return
        closed = frozenset(self._to_close)
        try:
            async with asyncio.timeout(WHOLE_S), self._opened() as client:
                for server in await self._every(client, "IDZ"):
                    reply = await _request(client, server["id"], "RELOAD", {})
                    if error := reply.get("error"):
                        why = error.get("description")
                        _log.error("the NATS server %s cannot use its configuration: %s", server["name"], why)
                if closed:
                    await self._close(client, closed)
        except (Error, OSError, TimeoutError) as error:
            why = str(error) or "no reply in time"
            _log.error("the NATS servers do not follow the change of sites: %s; it is tried again", why)
        else:
            self._is_due = False
            self._to_close -= closed

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[Client]:
        connection = self._connect()
        try:
            await connection.open()
            yield connection.client
        finally:
            await connection.close()

    async def _close(self, client: Client, accounts: Collection[str]) -> None:
        for server in await self._every(client, "LEAFZ"):
            for leaf in server["data"].get("leafs") or ():
                if leaf.get("account") in accounts:
                    await _request(client, server["server"]["id"], "KICK", {"cid": leaf["id"]})

    async def _every(self, client: Client, what: str) -> list[Any]:
        """Return the replies of all servers. Of one that does not reply nothing is known: it may have ended."""
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


async def _request(client: Client, server: str, what: str, data: object) -> Any:
    subject = f"$SYS.REQ.SERVER.{server}.{what}"
    return json.loads((await client.request(subject, json.dumps(data).encode(), timeout=REPLY_S)).data)
