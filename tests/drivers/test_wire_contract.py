"""What every wire keeps: the same tests for the one in memory and for the real one, on both loops."""

import asyncio
import socket
import ssl
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

import pytest
import uvloop

from drivers.errors import ConnectFailed, ConnectProblem, Delivery
from drivers.modbus.memory import MemoryWire
from drivers.modbus.tls import LinkTls
from drivers.modbus.wire import PymodbusWire, Wire
from register_maps import frames
from register_maps.words import Table
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S
from tests.support.virtual_time import run_virtual

READ = frames.read(Table.HOLDING, 0, 2)
ASK = frames.frame(READ, 7)
ANSWER = frames.answer(READ, 7, b"\x00\x01\x00\x02")
OTHER = frames.answer(READ, 8, b"\x00\x03\x00\x04")


class FarEnd(Protocol):
    """The controller's side of a wire."""

    heard: "asyncio.Queue[bytes]"
    """What came, as it came; b"" when the connection ended from our side."""

    def wire(self) -> Wire: ...
    def say(self, data: bytes) -> None: ...
    def hang_up(self) -> None: ...
    def refuse(self) -> None: ...


class NearEnd:
    """What a wire handed over."""

    def __init__(self) -> None:
        self.frames: asyncio.Queue[bytes] = asyncio.Queue()
        self.lost: asyncio.Queue[str] = asyncio.Queue()

    async def open(self, wire: Wire) -> None:
        await wire.open(self.frames.put_nowait, self.lost.put_nowait, timeout_s=HANGS_S)


class InMemory:
    def __init__(self) -> None:
        self.heard: asyncio.Queue[bytes] = asyncio.Queue()
        self._problem: ConnectProblem | None = None
        self._wire = MemoryWire(self._hear, admit=lambda: self._problem)

    def wire(self) -> Wire:
        return self._wire

    def say(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self._say, data)

    def _say(self, data: bytes) -> None:
        if self._wire.is_open:
            self._wire.deliver(data)

    def hang_up(self) -> None:
        self._wire.drop()

    def refuse(self) -> None:
        self._problem = ConnectProblem.REFUSED

    def _hear(self, frame: bytes) -> tuple[()]:
        self.heard.put_nowait(frame)
        return ()


class OnLoopback(asyncio.Protocol):
    """One real connection at a time."""

    def __init__(self, host: str, port: int, tls: LinkTls | None) -> None:
        self.heard: asyncio.Queue[bytes] = asyncio.Queue()
        self._host, self._port, self._tls = host, port, tls
        self._transport: asyncio.Transport
        self.server: asyncio.Server

    def wire(self) -> Wire:
        return PymodbusWire(self._host, self._port, tls=self._tls)

    def say(self, data: bytes) -> None:
        self._transport.write(data)

    def hang_up(self) -> None:
        self._transport.close()

    def refuse(self) -> None:
        self.server.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is one in all but its bases

    def data_received(self, data: bytes) -> None:
        self.heard.put_nowait(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self.heard.put_nowait(b"")


Contract = Callable[[FarEnd, NearEnd], Coroutine[object, object, None]]
Runner = Callable[[Contract], None]


@dataclass(frozen=True)
class BothSides:
    """Mutual TLS: what the wire is told, and what the controller keeps to."""

    near: LinkTls
    far: ssl.SSLContext


def in_memory(contract: Contract, _: BothSides) -> None:
    run_virtual(lambda: contract(InMemory(), NearEnd()))


async def on_loopback(contract: Contract, tls: BothSides | None) -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    host, port = listener.getsockname()
    near_tls, far_tls = (None, None) if tls is None else (tls.near, tls.far)
    far = OnLoopback(host, port, near_tls)
    far.server = await asyncio.get_running_loop().create_server(lambda: far, sock=listener, ssl=far_tls)
    try:
        async with asyncio.timeout(HANGS_S):
            await contract(far, NearEnd())
    finally:
        far.server.close()


def on_asyncio(contract: Contract, _: BothSides) -> None:
    asyncio.run(on_loopback(contract, None))


def on_uvloop(contract: Contract, _: BothSides) -> None:
    uvloop.run(on_loopback(contract, None))


def on_asyncio_with_tls(contract: Contract, tls: BothSides) -> None:
    asyncio.run(on_loopback(contract, tls))


def on_uvloop_with_tls(contract: Contract, tls: BothSides) -> None:
    uvloop.run(on_loopback(contract, tls))


@pytest.fixture(scope="module")
def both_sides(tmp_path_factory: pytest.TempPathFactory) -> BothSides:
    folder: Path = tmp_path_factory.mktemp("tls")
    authority = Authority(folder)
    ours, theirs = authority.issue("manager", "lift-manager"), authority.issue("controller", "127.0.0.1")
    far = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    far.load_cert_chain(theirs.certificate, theirs.key)
    far.load_verify_locations(authority.file)
    far.verify_mode = ssl.CERT_REQUIRED
    near = LinkTls(ca=authority.file, certificate=ours.certificate, key=ours.key, handshake_s=HANGS_S, files_s=HANGS_S)
    return BothSides(near, far)


@pytest.fixture(params=[in_memory, on_asyncio, on_uvloop, on_asyncio_with_tls, on_uvloop_with_tls])
def run(request: pytest.FixtureRequest, both_sides: BothSides) -> Runner:
    runner: Callable[[Contract, BothSides], None] = request.param
    return lambda contract: runner(contract, both_sides)


def test_frames_go_out_and_come_in_whole(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        before = wire.is_open
        await near.open(wire)
        assert (before, wire.is_open) == (False, True)
        wire.send(ASK)
        assert await far.heard.get() == ASK
        far.say(ANSWER)
        assert await near.frames.get() == ANSWER
        wire.close()

    run(contract)


def test_a_frame_in_pieces_is_handed_over_once_and_whole(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        for place in range(len(ANSWER)):
            far.say(ANSWER[place : place + 1])
        assert await near.frames.get() == ANSWER
        assert near.frames.empty()
        wire.close()

    run(contract)


def test_a_frame_that_began_before_a_request_was_sent_is_no_answer_to_it(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        far.say(ANSWER + OTHER[:5])
        assert await near.frames.get() == ANSWER
        wire.send(ASK)
        await far.heard.get()
        far.say(OTHER[5:] + ANSWER)
        assert await near.frames.get() == ANSWER
        assert near.frames.empty()
        wire.close()

    run(contract)


def test_frames_in_one_segment_are_handed_over_one_by_one_in_order(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        # More than the 516 bytes at which pymodbus's own buffer is thrown away.
        many = [frames.answer(READ, tid, b"\x00\x01\x00\x02") for tid in range(1, 100)]
        wire.send(ASK)
        await far.heard.get()
        far.say(b"".join(many))
        assert [await near.frames.get() for _ in many] == many
        wire.close()

    run(contract)


def test_a_loss_is_told_once_with_its_reason(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        far.hang_up()
        # a wire may add what can stand behind a connection that ended before anything came
        assert (await near.lost.get()).startswith("the controller closed the connection")
        assert not wire.is_open
        wire.send(ASK)
        wire.close()
        assert near.lost.empty()
        assert near.frames.empty()

    run(contract)


def test_closing_is_not_a_loss_and_may_be_repeated(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        wire.close()
        await near.open(wire)
        wire.send(ASK)
        assert await far.heard.get() == ASK
        wire.close()
        wire.close()
        assert not wire.is_open
        if isinstance(far, OnLoopback):
            assert await far.heard.get() == b""
        assert near.lost.empty()

    run(contract)


def test_nothing_is_sent_over_a_closed_wire(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        wire.send(ASK)
        await near.open(wire)
        wire.close()
        wire.send(ASK)
        await near.open(wire)
        wire.send(OTHER)
        while not (came := await far.heard.get()):
            pass
        assert came == OTHER
        wire.close()

    run(contract)


def test_a_receiver_that_closes_the_wire_gets_nothing_more_of_the_same_segment(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        taken: list[bytes] = []
        closed = asyncio.Event()

        def take(frame: bytes) -> None:
            taken.append(frame)
            wire.close()
            closed.set()

        await wire.open(take, near.lost.put_nowait, timeout_s=HANGS_S)
        wire.send(ASK)
        await far.heard.get()
        far.say(ANSWER + OTHER)
        await closed.wait()
        assert taken == [ANSWER]
        assert near.lost.empty()

    run(contract)


def test_a_wire_opened_again_hears_nothing_of_its_last_connection(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        far.say(ANSWER[:5])
        wire.close()
        after = NearEnd()
        await after.open(wire)
        wire.send(ASK)
        while not await far.heard.get():
            pass
        far.say(OTHER)
        assert await after.frames.get() == OTHER
        assert near.frames.empty()
        assert near.lost.empty()
        wire.close()

    run(contract)


def test_bytes_that_are_not_modbus_are_a_loss(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        far.say(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        assert (await near.lost.get()).startswith("the data received is not Modbus/TCP: protocol id")
        assert not wire.is_open
        assert near.frames.empty()

    run(contract)


def test_a_refused_connection_says_so(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        far.refuse()
        wire = far.wire()
        with pytest.raises(ConnectFailed, match="refused") as caught:
            await near.open(wire)
        assert caught.value.problem is ConnectProblem.REFUSED
        assert caught.value.sent is Delivery.NO
        assert wire.peer in str(caught.value)
        assert not wire.is_open

    run(contract)


def test_a_wire_closed_while_it_opens_is_not_open(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        async with asyncio.TaskGroup() as group:
            opening = group.create_task(expect_failure(near, wire))
            await asyncio.sleep(0)
            wire.close()
        assert opening.done()
        assert not wire.is_open
        assert near.lost.empty()

    async def expect_failure(near: NearEnd, wire: Wire) -> None:
        with pytest.raises(ConnectFailed):
            await near.open(wire)

    run(contract)


def test_a_cancelled_attempt_leaves_nothing_open(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        async with asyncio.TaskGroup() as group:
            opening = group.create_task(near.open(wire))
            await asyncio.sleep(0)
            opening.cancel()
        assert opening.cancelled()
        assert not wire.is_open

    run(contract)


def test_a_trace_sees_every_frame_in_both_directions(run: Runner) -> None:
    async def contract(far: FarEnd, near: NearEnd) -> None:
        wire = far.wire()
        trace: list[tuple[bool, bytes]] = []
        wire.on_bytes = lambda sent, frame: trace.append((sent, frame))
        await near.open(wire)
        wire.send(ASK)
        await far.heard.get()
        far.say(ANSWER[:4])
        far.say(ANSWER[4:])
        await near.frames.get()
        wire.close()
        wire.send(ASK)
        assert trace == [(True, ASK), (False, ANSWER)]

    run(contract)
