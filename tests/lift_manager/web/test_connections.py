"""Whose connections are kept when places run out: no network, no time."""

import asyncio
from collections.abc import Callable
from ipaddress import ip_network
from typing import Any

import pytest

from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.web.connections import LOG_EVERY_S, ConnectionLimits, Connections

LIMITS = ConnectionLimits(total=10, remote=8, per_client=3, trusted_proxies=(ip_network("192.0.2.128/25"),))
HERE = "127.0.0.1"


class Server:
    """Takes connections as a listening socket does."""

    def __init__(self, limits: ConnectionLimits = LIMITS) -> None:
        self.connections = Connections(limits)
        self.closed: list[int] = []
        self._last = 0

    def take(self, address: str, *, busy: bool = True) -> int:
        """Return the number of a new connection; 0 where there is no place for it."""
        if not self.connections.make_room(address):
            return 0
        self._last += 1
        number = self._last
        self.connections.add(number, address, self._closing(number), evictable_after_s=1.0)
        self.mark_idle(number)
        if busy:
            self.connections.mark_busy(number)
        return number

    def mark_idle(self, number: int) -> None:
        """Let a connection have its answer."""
        self.connections.mark_idle(number, self._closing(number))

    def _closing(self, number: int) -> Callable[[], None]:
        return lambda: self.closed.append(number)


@pytest.fixture
def run() -> Callable[[Callable[[], None]], None]:
    async def within(main: Callable[[], Any]) -> None:
        main()

    return lambda main: asyncio.run(within(main))


Run = Callable[[Callable[[], None]], None]


def test_one_address_gets_its_share_and_no_more_and_others_go_on(run: Run) -> None:
    def main() -> None:
        server = Server()
        assert all(server.take("192.0.2.7") for _ in range(3))
        assert not server.take("192.0.2.7")
        assert not server.take("::ffff:192.0.2.7")
        assert server.take("192.0.2.8")

    run(main)


def test_an_address_that_has_its_share_gets_a_new_connection_for_its_idle_one(run: Run) -> None:
    def main() -> None:
        server = Server()
        server.take("192.0.2.8", busy=False)
        mine = [server.take("192.0.2.7") for _ in range(3)]
        server.mark_idle(mine[2])
        server.mark_idle(mine[1])
        assert server.take("192.0.2.7")
        assert server.closed == [mine[2]], "its own, and the one that has waited longest"

    run(main)


def test_the_addresses_of_one_network_of_ipv6_are_one_client(run: Run) -> None:
    def main() -> None:
        server = Server()
        assert all(server.take(f"2001:db8::{number}") for number in range(3))
        assert not server.take("2001:db8::ffff:1")
        assert server.take("2001:db8:0:1::1")
        assert all(server.take("fe80::1%eth0") for _ in range(3))
        assert server.take("fe80::2%eth0"), "neighbours on one wire share that prefix"

    run(main)


def test_a_trusted_proxy_has_no_share_of_its_own(run: Run) -> None:
    def main() -> None:
        server = Server()
        assert all(server.take("192.0.2.200") for _ in range(8))
        assert not server.take("192.0.2.200")

    run(main)


def test_programs_on_this_computer_have_places_that_others_cannot_take(run: Run) -> None:
    def main() -> None:
        server = Server()
        assert [bool(server.take(f"198.51.100.{number}")) for number in range(9)] == [True] * 8 + [False]
        assert server.take(HERE)
        assert server.take("::1")
        assert not server.take(HERE)

    run(main)


def test_programs_on_this_computer_may_have_all_places(run: Run) -> None:
    def main() -> None:
        server = Server()
        assert all(server.take(HERE) for _ in range(10))
        assert not server.take("192.0.2.7")

    run(main)


def test_other_computers_make_room_among_themselves_as_long_as_they_have_their_share(run: Run) -> None:
    def main() -> None:
        server = Server()
        own = server.take(HERE, busy=False)
        first = server.take("198.51.100.100", busy=False)
        for number in range(7):
            server.take(f"198.51.100.{number}", busy=False)
        assert server.take("198.51.100.200")
        assert server.closed == [first]
        assert own not in server.closed

    run(main)


def test_a_connection_that_is_gone_leaves_its_place_once(run: Run) -> None:
    def main() -> None:
        server = Server()
        mine = [server.take("192.0.2.7") for _ in range(3)]
        server.connections.remove(mine[0])
        server.connections.remove(mine[0])
        server.mark_idle(mine[0])
        assert server.take("192.0.2.7")
        assert not server.take("192.0.2.7")

    run(main)


def test_a_connection_that_is_being_made_yields_after_its_time() -> None:
    async def main() -> None:
        server = Server(ConnectionLimits(1, 1, 1))
        server.connections.add("handshake", "192.0.2.7", lambda: server.closed.append(-1), evictable_after_s=1.0)
        assert not server.take("192.0.2.8")
        await elapse(1.0)
        assert server.take("192.0.2.8")
        assert server.closed == [-1]

    run_virtual(main)


def test_the_log_has_one_line_when_places_run_out_and_one_a_minute_as_long_as_that_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def lines() -> list[str]:
        found = [
            record.getMessage().partition("; connections since the last such line: ")[2] for record in caplog.records
        ]
        caplog.clear()
        return found

    async def main() -> None:
        server = Server()
        mine = [server.take("192.0.2.7") for _ in range(3)]
        server.mark_idle(mine[0])
        for _ in range(5):
            server.take("192.0.2.7")
        assert lines() == ["1 idle closed to make room, 0 new refused"]
        await elapse(LOG_EVERY_S + 1)
        assert lines() == ["0 idle closed to make room, 4 new refused"]
        await elapse(LOG_EVERY_S * 3)
        assert lines() == []
        server.take("192.0.2.7")
        assert "192.0.2.7 has 3 connections" in caplog.text
        assert "(3 by 192.0.2.7)" in caplog.text
        assert lines() == ["0 idle closed to make room, 1 new refused"]
        server.connections.close()

    run_virtual(main)


@pytest.mark.parametrize(("total", "remote", "per_client"), [(1000, 950, 250), (256, 244, 64), (16, 15, 4), (1, 1, 1)])
def test_the_shares_go_with_the_total(total: int, remote: int, per_client: int) -> None:
    limits = ConnectionLimits.of(total)
    assert (limits.total, limits.remote, limits.per_client) == (total, remote, per_client)
