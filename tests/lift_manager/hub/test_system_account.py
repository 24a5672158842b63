"""A change of sites reaches the NATS servers however slow they are."""

import asyncio
import json
from collections.abc import Sequence
from typing import Any, cast

import pytest
from nats.errors import TimeoutError as NoMessage

from lift_manager.hub.connection import Connection
from lift_manager.hub.system_account import SystemAccount
from tests.support.virtual_time import cancel_at_every_turn, run_virtual


class Servers:
    """The system account of NATS servers with leaf nodes of berlin and rome; it is a client, its own connection, and its subscription."""

    def __init__(self, *names: str) -> None:
        self.replying: Sequence[str] = names
        self.leafs = {name: ["SITE_berlin", "SITE_rome"] for name in names}
        self.request_s = self.reload_s = 0.0
        """How long they take to reply to a request; how long to read their configuration."""
        self.returns_meanwhile = False
        """Whether the leaf node of berlin connects again while they read it."""
        self.done: list[str] = []
        self._replies: list[object] = []

    @property
    def client(self) -> "Servers":
        return self

    async def open(self) -> None:
        """Nothing to do."""

    async def close(self) -> None:
        """Nothing to do."""

    async def unsubscribe(self) -> None:
        """Nothing to do."""

    def new_inbox(self) -> str:
        return "inbox"

    async def subscribe(self, subject: str) -> "Servers":
        return self

    async def publish(self, subject: str, data: bytes, reply: str) -> None:
        for name in self.replying:
            named = {"id": name, "name": name}
            leafs = [{"account": account, "id": number} for number, account in enumerate(self.leafs[name])]
            self._replies.append(named if subject.endswith("IDZ") else {"server": named, "data": {"leafs": leafs}})

    async def next_msg(self, timeout: float) -> Any:  # noqa: ASYNC109  that of nats-py
        if not self._replies:
            await asyncio.sleep(timeout)
            raise NoMessage
        return Reply(self._replies.pop(0))

    async def request(self, subject: str, data: bytes, timeout: float) -> Any:  # noqa: ASYNC109
        server, what = subject.split(".")[-2:]
        takes_s = self.reload_s if what == "RELOAD" else self.request_s
        content = json.loads(data)
        if what == "KICK":
            account = self.leafs[server][content["cid"]]
            self.done.append(f"{server} {what} {account}")
            self.leafs[server].remove(account)
        else:
            self.done.append(f"{server} {what}")
        await asyncio.sleep(min(takes_s, timeout))
        if takes_s > timeout:
            raise NoMessage
        loop = asyncio.get_running_loop()
        reply = loop.create_future()
        loop.call_soon(reply.set_result, None)
        await asyncio.wait_for(reply, timeout)  # as nats-py does
        if what == "RELOAD" and self.returns_meanwhile:
            self.leafs[server].append("SITE_berlin")
        return Reply({})


class Reply:
    def __init__(self, content: object) -> None:
        self.data = json.dumps(content).encode()


def account_of(servers: Servers) -> SystemAccount:
    return SystemAccount(lambda: cast("Connection", servers), len(servers.leafs))


def test_a_site_that_is_switched_off_is_disconnected_before_the_server_has_read_a_long_configuration() -> None:
    server = Servers("S")
    server.reload_s = 12.0

    async def main() -> None:
        account = account_of(server)
        await account.reload({"SITE_berlin"})
        await account.retry()
        # a second request while it still reads the configuration would only be one more to read
        assert server.done == ["S KICK SITE_berlin", "S RELOAD"]

    run_virtual(main)


def test_a_site_that_connects_again_before_the_server_refuses_it_is_disconnected_again() -> None:
    server = Servers("S")
    server.returns_meanwhile = True

    async def main() -> None:
        await account_of(server).reload({"SITE_berlin"})
        assert server.done == ["S KICK SITE_berlin", "S RELOAD", "S KICK SITE_berlin"]

    run_virtual(main)


def test_a_server_that_hangs_follows_once_it_replies(caplog: pytest.LogCaptureFixture) -> None:
    server = Servers("S")
    server.reload_s = 1000.0

    async def main() -> None:
        account = account_of(server)
        await account.reload({"SITE_berlin"})
        assert "it is tried again" in caplog.text
        server.reload_s = 0.0
        server.leafs["S"].append("SITE_berlin")
        server.done.clear()
        await account.retry()
        assert server.done == ["S KICK SITE_berlin", "S RELOAD"]
        await account.retry()
        assert len(server.done) == 2

    run_virtual(main)


def test_a_server_that_replies_late_follows_then_and_no_other_disconnects_a_site_twice(
    caplog: pytest.LogCaptureFixture,
) -> None:
    cluster = Servers("S1", "S2")
    cluster.replying = ["S1"]

    async def main() -> None:
        account = account_of(cluster)
        await account.reload({"SITE_berlin"})
        assert cluster.done == ["S1 KICK SITE_berlin", "S1 RELOAD"]
        cluster.leafs["S1"].append("SITE_berlin")  # it was switched off and on, and is connected again
        for _ in range(60):
            await asyncio.sleep(0.5)
            await account.retry()
        assert cluster.done == ["S1 KICK SITE_berlin", "S1 RELOAD"]
        assert caplog.text.count("1 of 2 NATS servers have followed the change of sites") == 1
        cluster.replying = ["S1", "S2"]
        for _ in range(60):
            await asyncio.sleep(0.5)
            await account.retry()
        assert cluster.done[2:] == ["S2 RELOAD", "S2 KICK SITE_berlin"]
        # another change is one for both
        cluster.leafs["S2"].append("SITE_berlin")
        await account.reload({"SITE_berlin"})
        assert cluster.done[4:] == ["S1 KICK SITE_berlin", "S2 KICK SITE_berlin", "S1 RELOAD", "S2 RELOAD"]

    run_virtual(main)


def test_an_attempt_can_be_ended_at_any_moment() -> None:
    async def main() -> None:
        await cancel_at_every_turn(lambda: account_of(Servers("S")).reload({"SITE_berlin"}))

    run_virtual(main)
