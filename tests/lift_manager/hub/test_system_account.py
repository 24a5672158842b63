"""A change of sites reaches the NATS servers however slow they are."""

import asyncio
import json
from typing import Any, cast

import pytest
from nats.errors import TimeoutError as NoMessage

from lift_manager.hub.connection import Connection
from lift_manager.hub.system_account import SystemAccount
from tests.support.virtual_time import run_virtual


class Server:
    """The system account of a NATS server with a leaf node of berlin; it is a client, its own connection, and its subscription."""

    def __init__(self) -> None:
        self.is_slow = True
        self.done: list[str] = []
        self._replies: list[object] = []

    @property
    def client(self) -> "Server":
        return self

    async def open(self) -> None:
        """Nothing to do."""

    async def close(self) -> None:
        """Nothing to do."""

    async def unsubscribe(self) -> None:
        """Nothing to do."""

    def new_inbox(self) -> str:
        return "inbox"

    async def subscribe(self, subject: str) -> "Server":
        return self

    async def publish(self, subject: str, data: bytes, reply: str) -> None:
        leafs = [{"account": "SITE_berlin", "id": 7}, {"account": "SITE_rome", "id": 8}]
        named = {"id": "S", "name": "hub"}
        self._replies.append(named if subject.endswith("IDZ") else {"server": named, "data": {"leafs": leafs}})

    async def next_msg(self, timeout: float) -> Any:  # noqa: ASYNC109  that of nats-py
        if not self._replies:
            await asyncio.sleep(timeout)
            raise NoMessage
        return Reply(self._replies.pop(0))

    async def request(self, subject: str, data: bytes, timeout: float) -> Any:  # noqa: ASYNC109
        if self.is_slow:
            await asyncio.sleep(timeout)
            raise TimeoutError
        self.done.append(f"{subject.rpartition('.')[2]} {data.decode()}")
        return Reply({})


class Reply:
    def __init__(self, content: object) -> None:
        self.data = json.dumps(content).encode()


def test_a_site_that_is_switched_off_is_disconnected_once_a_slow_server_replies(
    caplog: pytest.LogCaptureFixture,
) -> None:
    server = Server()

    async def main() -> None:
        account = SystemAccount(lambda: cast("Connection", server), 1)
        await account.reload({"SITE_berlin"})
        assert server.done == []
        assert "it is tried again" in caplog.text
        server.is_slow = False
        await account.retry()
        assert server.done == ["RELOAD {}", 'KICK {"cid": 7}']
        await account.retry()
        assert len(server.done) == 2

    run_virtual(main)


class Cluster(Server):
    """Two servers, of which the second one does not reply at first; berlin has a leaf node at each."""

    def __init__(self) -> None:
        super().__init__()
        self.is_slow = False
        self.replying = ["S1"]

    async def publish(self, subject: str, data: bytes, reply: str) -> None:
        for name in self.replying:
            named = {"id": name, "name": name}
            leafs = [{"account": "SITE_berlin", "id": 7}]
            self._replies.append(named if subject.endswith("IDZ") else {"server": named, "data": {"leafs": leafs}})

    async def request(self, subject: str, data: bytes, timeout: float) -> Any:  # noqa: ASYNC109
        self.done.append(" ".join(subject.split(".")[-2:]))
        return Reply({})


def test_a_server_that_replies_late_follows_then_and_no_other_disconnects_a_site_twice(
    caplog: pytest.LogCaptureFixture,
) -> None:
    cluster = Cluster()

    async def main() -> None:
        account = SystemAccount(lambda: cast("Connection", cluster), 2)
        await account.reload({"SITE_berlin"})
        assert cluster.done == ["S1 RELOAD", "S1 KICK"]
        for _ in range(60):
            await asyncio.sleep(0.5)
            await account.retry()
        assert cluster.done == ["S1 RELOAD", "S1 KICK"]
        assert caplog.text.count("1 of 2 NATS servers have followed the change of sites") == 1
        cluster.replying = ["S1", "S2"]
        for _ in range(60):
            await asyncio.sleep(0.5)
            await account.retry()
        assert cluster.done[2:] == ["S2 RELOAD", "S2 KICK"]
        # another change is one for both
        await account.reload({"SITE_berlin"})
        assert cluster.done[4:] == ["S1 RELOAD", "S2 RELOAD", "S1 KICK", "S2 KICK"]

    run_virtual(main)
