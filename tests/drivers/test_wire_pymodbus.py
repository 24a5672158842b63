"""What only the real wire can show: sockets, names, full backlogs, and pymodbus kept from doing things by itself."""

import asyncio
import os
import socket
import struct
import time
from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from pathlib import Path

import pytest
import uvloop

from drivers.errors import ConnectFailed, ConnectProblem
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.wire import PymodbusWire
from register_maps import frames
from register_maps.words import Table
from tests.support.programs import HANGS_S

Test = Callable[[], Coroutine[object, object, None]]
READ = frames.read(Table.HOLDING, 0, 1)


def with_asyncio(test: Test) -> None:
    asyncio.run(test())


def with_uvloop(test: Test) -> None:
    uvloop.run(test())


@pytest.fixture(params=[with_asyncio, with_uvloop])
def run(request: pytest.FixtureRequest) -> Callable[[Test], None]:
    runner: Callable[[Test], None] = request.param
    return runner


@pytest.fixture
def listener() -> socket.socket:
    return socket.create_server(("127.0.0.1", 0))


def nobody(_: object) -> None:
    pytest.fail("nothing should come")


def test_after_a_loss_pymodbus_does_not_connect_again_by_itself(
    run: Callable[[Test], None], listener: socket.socket
) -> None:
    async def test() -> None:
        loop = asyncio.get_running_loop()
        lost: asyncio.Queue[str] = asyncio.Queue()
        wire = PymodbusWire(*listener.getsockname())
        await wire.open(nobody, lost.put_nowait, timeout_s=HANGS_S)
        connection, _ = await loop.sock_accept(listener)
        connection.close()
        await lost.get()
        # Its reconnecting would be a task, started before the loss is told.
        assert asyncio.all_tasks() == {asyncio.current_task()}
        assert not wire.is_open

    listener.setblocking(False)
    with listener:
        run(test)


def test_a_reset_is_a_loss(run: Callable[[Test], None], listener: socket.socket) -> None:
    async def test() -> None:
        lost: asyncio.Queue[str] = asyncio.Queue()
        wire = PymodbusWire(*listener.getsockname())
        await wire.open(nobody, lost.put_nowait, timeout_s=HANGS_S)
        connection, _ = await asyncio.get_running_loop().sock_accept(listener)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        connection.close()
        assert "the connection broke" in await lost.get()
        assert not wire.is_open

    listener.setblocking(False)
    with listener:
        run(test)


def test_closing_does_not_wait_for_a_peer_that_takes_nothing(
    run: Callable[[Test], None], listener: socket.socket
) -> None:
    frame = frames.frame(frames.write_registers(0, [7] * 123), 1)

    async def test() -> None:
        loop = asyncio.get_running_loop()
        wire = PymodbusWire(*listener.getsockname())
        await wire.open(nobody, nobody, timeout_s=HANGS_S)
        connection, _ = await loop.sock_accept(listener)
        connection.setblocking(False)
        count = 20_000
        for _ in range(count):
            wire.send(frame)
        wire.close()
        # Only now does the peer read: it finds the end, and not all that was waiting to be sent.
        received = 0
        async with asyncio.timeout(HANGS_S):
            while True:
                try:
                    data = await loop.sock_recv(connection, 1 << 20)
                except ConnectionResetError:
                    break
                if not data:
                    break
                received += len(data)
        connection.close()
        assert received < count * len(frame)

    # more than both ends of the connection can hold, and no more: asyncio adds up what waits at each write
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
    listener.setblocking(False)
    with listener:
        run(test)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the socket by its file descriptor")
def test_the_socket_sends_at_once_and_keeps_itself_alive(run: Callable[[Test], None], listener: socket.socket) -> None:
    async def test() -> None:
        wire = PymodbusWire(*listener.getsockname())
        await wire.open(nobody, nobody, timeout_s=HANGS_S)
        with ExitStack() as stack:
            found = [stack.enter_context(each) for each in sockets_to(listener.getsockname())]
            assert len(found) == 1
            assert found[0].getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert found[0].getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        wire.close()

    with listener:
        run(test)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the socket by its file descriptor")
def test_of_two_managers_each_sends_bytes_again_only_for_as_long_as_it_may(
    run: Callable[[Test], None], listener: socket.socket
) -> None:
    remaining_s = 1.25

    async def test() -> None:
        nonlocal remaining_s
        wire = PymodbusWire(*listener.getsockname(), remaining_s=lambda: remaining_s)
        await wire.open(nobody, nobody, timeout_s=HANGS_S)
        with ExitStack() as stack:
            (own,) = [stack.enter_context(each) for each in sockets_to(listener.getsockname())]
            wire.send(b"\0\1\0\0\0\2\1\7")
            assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 1250
            remaining_s = 0.5
            wire.send(b"\0\2\0\0\0\2\1\7")
            assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 500
            remaining_s = 0.0
            wire.send(b"\0\3\0\0\0\2\1\7")
            assert own.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8) == struct.pack("ii", 1, 0)
        await asyncio.sleep(0)
        controller, _ = await asyncio.get_running_loop().sock_accept(listener)
        with controller:
            controller.setblocking(False)
            received = b""
            while len(received) < 16:
                received += await asyncio.get_running_loop().sock_recv(controller, 100)
            assert received == b"\0\1\0\0\0\2\1\7\0\2\0\0\0\2\1\7"
            wire.close()
            with pytest.raises(ConnectionResetError):
                await asyncio.get_running_loop().sock_recv(controller, 100)

    listener.setblocking(False)
    with listener:
        run(test)


def sockets_to(address: tuple[str, int]) -> list[socket.socket]:
    found = []
    for entry in os.listdir("/proc/self/fd"):  # noqa: PTH208 - numbers, not paths
        try:
            each = socket.socket(fileno=os.dup(int(entry)))
        except OSError:
            continue
        try:
            matches = each.getpeername() == address
        except OSError:
            matches = False
        if matches:
            found.append(each)
        else:
            each.close()
    return found


def test_a_controller_without_a_free_slot_is_named_as_a_possible_cause(run: Callable[[Test], None]) -> None:
    with ExitStack() as stack:
        full = stack.enter_context(socket.socket())
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        # One connection fits into a backlog of 0; further requests are not answered.
        for _ in range(3):
            guest = stack.enter_context(socket.socket())
            guest.setblocking(False)
            guest.connect_ex(full.getsockname())

        async def test() -> None:
            wire = PymodbusWire(*full.getsockname())
            with pytest.raises(ConnectFailed, match="may have no free connection slot") as caught:
                await wire.open(nobody, nobody, timeout_s=0.1)
            assert caught.value.problem is ConnectProblem.TIMED_OUT
            assert isinstance(caught.value.__cause__, TimeoutError)

        run(test)


def test_a_name_that_no_host_can_have_is_host_not_found(run: Callable[[Test], None]) -> None:
    async def test() -> None:
        wire = PymodbusWire("lift..local")
        with pytest.raises(ConnectFailed, match=r"lift\.\.local:502") as caught:
            await wire.open(nobody, nobody, timeout_s=HANGS_S)
        assert caught.value.problem is ConnectProblem.HOST_NOT_FOUND

    run(test)


def test_an_address_of_version_6_is_written_with_brackets() -> None:
    assert PymodbusWire("::1", 5020).peer == "[::1]:5020"
    assert PymodbusWire("127.0.0.1", 5020).peer == "127.0.0.1:5020"


def test_an_answer_that_came_while_our_own_process_was_held_up_is_not_a_time_out(
    run: Callable[[Test], None], listener: socket.socket
) -> None:
    settings = LinkSettings(timeout_s=0.05, tid_echo=False)

    async def test() -> None:
        loop = asyncio.get_running_loop()
        link = Link(lambda: PymodbusWire(*listener.getsockname()), settings, name="lobby")
        async with asyncio.timeout(HANGS_S), asyncio.TaskGroup() as group:
            group.create_task(link.run())
            connection, _ = await loop.sock_accept(listener)
            with connection:
                await link.wait_up()
                # As a reader: what it does comes after the loop has looked at its sockets, and before its timers.
                loop.add_reader(connection, hold_up, connection)
                assert await link.read(READ) == b"\x00\x07"
                loop.remove_reader(connection)
            assert link.stats.timeouts == 0
            await link.close()

    def hold_up(connection: socket.socket) -> None:
        """The answer arrives in the socket, and our process does not look until the deadline is long over."""
        if request := connection.recv(100):
            connection.sendall(frames.answer(READ, frames.tid_of(request), b"\x00\x07"))
            free_again = time.monotonic() + 0.15
            while time.monotonic() < free_again:
                pass

    listener.setblocking(False)
    with listener:
        run(test)
