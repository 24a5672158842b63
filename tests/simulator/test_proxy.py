"""The fault proxy on real sockets, seen byte by byte from both sides."""

import asyncio
import contextlib
import gc
import math
import socket
from collections.abc import AsyncIterator, Callable, Coroutine

import pytest
import uvloop
from pyModbusTCP.server import DataBank, ModbusServer

from register_maps import frames
from register_maps.words import Table
from simulator.proxy import FaultProxy
from simulator.server import SimulatedController
from simulator.wire_faults import (
    AcceptAndSayNothing,
    AnswerWithException,
    Bandwidth,
    ConnectionLimit,
    Delay,
    DropRequest,
    Exchange,
    HalfOpen,
    LateAnswer,
    RefuseConnections,
    ReorderAnswers,
    ResetConnection,
    SplitAnswer,
    Target,
    WireFault,
    WireFaults,
)

HOST = "127.0.0.1"
LIMIT_S = 60.0
SILENCE_S = 0.03
READ = frames.read(Table.HOLDING, 10, 3)
ASK = frames.frame(READ, 7)
ANSWER = frames.answer(READ, 7, b"\x00\x0a\x00\x0b\x00\x0c")
PRESS = frames.frame(frames.write_register(2, 9), 8)
IDENTIFY = bytes.fromhex("0005 0000 0005 01 2b 0e 01 00")
IDENTITY = bytes.fromhex("0005 0000 0006 01 2b 0e 01 01 00")

Main = Callable[[], Coroutine[object, object, None]]


async def limited(main: Main) -> None:
    async with asyncio.timeout(LIMIT_S):
        await main()
    assert asyncio.all_tasks() == {asyncio.current_task()}


def on_asyncio(main: Main) -> None:
    asyncio.run(limited(main))


def on_uvloop(main: Main) -> None:
    uvloop.run(limited(main))


@pytest.fixture(params=[on_asyncio, on_uvloop])
def run(request: pytest.FixtureRequest) -> Callable[[Main], None]:
    runner: Callable[[Main], None] = request.param
    return runner


class Server:
    """One that a test writes the words of: what it heard, and a way to say something."""

    def __init__(self) -> None:
        self.heard: asyncio.Queue[bytes | None] = asyncio.Queue()
        """What came; b"" where a client ended its side, None where a connection was reset."""
        self.writers: list[asyncio.StreamWriter] = []
        self.is_connected = asyncio.Event()
        self.answers: dict[bytes, bytes] = {ASK: ANSWER}

    @property
    def connections(self) -> int:
        return len(self.writers)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.append(writer)
        self.is_connected.set()
        try:
            while data := await reader.read(65536):
                self.heard.put_nowait(data)
                if data in self.answers:
                    writer.write(self.answers[data])
            self.heard.put_nowait(b"")
        except ConnectionResetError:
            self.heard.put_nowait(None)
        writer.close()


@contextlib.asynccontextmanager
async def proxied(*faults: WireFault) -> AsyncIterator[tuple[Server, FaultProxy]]:
    server = Server()
    listener = await asyncio.start_server(server.serve, HOST, 0)
    try:
        port = listener.sockets[0].getsockname()[1]
        async with FaultProxy(HOST, port, WireFaults(faults)) as proxy:
            yield server, proxy
    finally:
        listener.close()
        for writer in server.writers:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()


@contextlib.asynccontextmanager
async def client(proxy: FaultProxy) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    reader, writer = await asyncio.open_connection(HOST, proxy.port)
    try:
        yield reader, writer
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


async def silent(waiting: Coroutine[object, object, object]) -> bool:
    """Whether nothing comes for a while."""
    try:
        async with asyncio.timeout(SILENCE_S):
            await waiting
    except TimeoutError:
        return True
    return False


# -- transparent


def test_without_faults_every_byte_passes_both_ways(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied() as (server, proxy), client(proxy) as (reader, writer):
            for ask, answer in ((ASK, ANSWER), (IDENTIFY, IDENTITY), (PRESS, PRESS)):
                server.answers[ask] = answer
                writer.write(ask)
                assert await server.heard.get() == ask
                assert await reader.readexactly(len(answer)) == answer

    run(main)


def test_each_request_that_reaches_the_server_is_reported_with_its_client() -> None:
    async def main() -> None:
        reported: list[tuple[str, bytes]] = []
        server = Server()
        listener = await asyncio.start_server(server.serve, HOST, 0)
        port = listener.sockets[0].getsockname()[1]
        faults = WireFaults()
        async with (
            FaultProxy(HOST, port, faults, on_request=lambda *request: reported.append(request)) as proxy,
            client(proxy) as (reader, writer),
        ):
            faults.add(DropRequest(times=1))
            for request in (PRESS, ASK):
                writer.write(request)
            assert await reader.readexactly(len(ANSWER)) == ANSWER
            address = ":".join(map(str, writer.get_extra_info("sockname")))
        assert reported == [(address, ASK)]
        listener.close()
        await listener.wait_closed()

    asyncio.run(limited(main))


async def everything(server: Server) -> bytes:
    """What the server hears until its client has ended."""
    came = b""
    while data := await server.heard.get():
        came += data
    return came


def test_frames_that_come_in_pieces_pass() -> None:
    async def main() -> None:
        async with proxied() as (server, proxy), client(proxy) as (_, writer):
            stream = (ASK + IDENTIFY) * 20
            for at in range(0, len(stream), 5):
                writer.write(stream[at : at + 5])
                await writer.drain()
            writer.write_eof()
            assert await everything(server) == stream

    on_asyncio(main)


@pytest.mark.parametrize("noise", [b"HTTP/1.1 400 Bad Request\r\n\r\n", ASK + b"\x00\x01\x00\x00\xff\xff!", ASK[:7]])
def test_what_is_no_modbus_passes_too(noise: bytes) -> None:
    async def main() -> None:
        async with proxied() as (server, proxy), client(proxy) as (reader, writer):
            writer.write(noise)
            writer.write_eof()
            assert await everything(server) == noise
            assert await reader.read() == b""

    on_asyncio(main)


def test_noise_from_the_device_passes() -> None:
    async def main() -> None:
        async with proxied() as (server, proxy), client(proxy) as (reader, writer):
            server.answers = {ASK: ANSWER + b"garbage that is no frame", PRESS: b"more of it"}
            for ask, noise in server.answers.items():
                writer.write(ask)
                assert await reader.readexactly(len(noise)) == noise
            server.answers[ASK] = ANSWER[:9]
            writer.write(ASK)
            writer.write_eof()
            assert await reader.read() == ANSWER[:9]

    on_asyncio(main)


def test_the_last_piece_of_a_frame_passes_when_the_device_ends_the_connection() -> None:
    async def main() -> None:
        async with proxied() as (server, proxy), client(proxy) as (reader, writer):
            writer.write(PRESS)
            await server.heard.get()
            server.writers[0].write(ANSWER[:9])
            server.writers[0].close()
            assert await reader.read() == ANSWER[:9]

    on_asyncio(main)


def reset(writer: asyncio.StreamWriter) -> None:
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, bytes((1, 0, 0, 0, 0, 0, 0, 0)))
    writer.transport.abort()


def test_the_end_of_a_connection_passes_as_what_it_is(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied() as (server, proxy):
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER
                server.writers[0].close()
                assert await reader.read() == b""
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER
                reset(server.writers[1])
                with pytest.raises(ConnectionResetError):
                    await reader.read()

    run(main)


def test_requests_sent_ahead_are_answered_in_order() -> None:
    async def main() -> None:
        async with controller(WireFaults()) as (_, proxy), client(proxy) as (reader, writer):
            # 240 bytes: of much more at once pymodbus's server throws everything away.
            requests = [frames.read(Table.HOLDING, nth) for nth in range(20)]
            writer.write(b"".join(frames.frame(request, 100 + nth) for nth, request in enumerate(requests)))
            answers = [frames.answer(request, 100 + nth, bytes([0, nth])) for nth, request in enumerate(requests)]
            assert await reader.readexactly(20 * len(answers[0])) == b"".join(answers)

    on_asyncio(main)


def test_clients_do_not_hear_each_other() -> None:
    async def ask(proxy: FaultProxy, nth: int) -> None:
        async with client(proxy) as (reader, writer):
            request = frames.read(Table.HOLDING, nth)
            for _ in range(20):
                writer.write(frames.frame(request, 1))
                expected = frames.answer(request, 1, bytes([0, nth]))
                assert await reader.readexactly(len(expected)) == expected

    async def main() -> None:
        faults = WireFaults([DropRequest(on=Target(addresses=(99, 99)))])
        async with controller(faults) as (_, proxy), asyncio.TaskGroup() as group:
            for nth in range(10):
                group.create_task(ask(proxy, nth))

    on_asyncio(main)


class Cells:
    """A device whose holding registers say their own address."""

    def __init__(self) -> None:
        self.written: list[tuple[int, list[int]]] = []

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        return list(range(address, address + count))

    def write(self, table: Table, address: int, values: list[int], now: float) -> None:
        self.written.append((address, values))

    def stored(self, table: Table, address: int, now: float) -> int:
        return self.written[-1][1][0]

    def pulse(self, address: int, counts: int, now: float) -> None:
        self.written.append((address, [counts]))


@contextlib.asynccontextmanager
async def controller(faults: WireFaults) -> AsyncIterator[tuple[Cells, FaultProxy]]:
    """The simulator's own server behind the proxy."""
    cells = Cells()
    server = SimulatedController({1: cells})
    await server.start()
    try:
        async with FaultProxy(HOST, server.port, faults) as proxy:
            yield cells, proxy
    finally:
        await server.stop()


def test_it_stands_in_front_of_a_server_that_nobody_here_wrote() -> None:
    with socket.create_server((HOST, 0)) as free:
        port = free.getsockname()[1]
    bank = DataBank()
    bank.set_holding_registers(10, [10, 11, 12])
    foreign = ModbusServer(HOST, port, no_block=True, data_bank=bank)

    async def main() -> None:
        faults = WireFaults([AnswerWithException(6, times=1)])
        async with FaultProxy(HOST, port, faults) as proxy, client(proxy) as (reader, writer):
            writer.write(ASK)
            assert (await reader.readexactly(9))[7:] == b"\x83\x06"
            writer.write(ASK)
            assert await reader.readexactly(len(ANSWER)) == ANSWER
            writer.write(PRESS)
            assert await reader.readexactly(len(PRESS)) == PRESS
        assert bank.get_holding_registers(2) == [9]

    foreign.start()
    try:
        on_asyncio(main)
    finally:
        foreign.stop()


# -- faults, as sockets see them


@pytest.mark.parametrize("executed", [False, True])
def test_a_reset_is_one(run: Callable[[Main], None], *, executed: bool) -> None:
    async def main() -> None:
        async with proxied(ResetConnection(executed=executed)) as (server, proxy), client(proxy) as (reader, writer):
            writer.write(ASK)
            with pytest.raises(ConnectionResetError):
                await reader.read()
            assert await server.heard.get() == (ASK if executed else b"")

    run(main)


def test_a_half_open_connection_passes_nothing_and_no_end_and_the_next_one_lives(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied(HalfOpen(times=1)) as (server, proxy):
            async with client(proxy) as (reader, writer):
                writer.write(ASK + PRESS)
                assert await silent(reader.read(1))
                await server.is_connected.wait()
                server.writers[0].write(ANSWER + b"and something that is no frame")
                assert await silent(reader.read(1))
                async with client(proxy) as (other, another):
                    another.write(ASK)
                    assert await other.readexactly(len(ANSWER)) == ANSWER
                assert [await server.heard.get(), await server.heard.get()] == [ASK, b""]
                writer.write(b"not Modbus at all")
            assert await silent(server.heard.get())

    run(main)


def test_the_end_of_a_half_open_connection_does_not_reach_its_client() -> None:
    async def main() -> None:
        async with proxied(HalfOpen(times=1)) as (server, proxy), client(proxy) as (reader, writer):
            writer.write(ASK)
            assert await silent(reader.read(1))
            await server.is_connected.wait()
            server.writers[0].close()
            assert await silent(reader.read(1))

    on_asyncio(main)


def test_an_accepted_connection_may_say_nothing_and_the_device_does_not_know_of_it() -> None:
    async def main() -> None:
        async with proxied(AcceptAndSayNothing(times=1)) as (server, proxy):
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await silent(reader.read(1))
                assert server.connections == 0
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER

    on_asyncio(main)


def test_a_refused_connection_is_reset(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied(RefuseConnections(times=1)) as (server, proxy):
            with pytest.raises(ConnectionResetError):
                async with client(proxy) as (reader, _):
                    await reader.readexactly(1)
            assert server.connections == 0
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER

    run(main)


def test_a_place_is_free_again_when_its_client_has_gone() -> None:
    async def main() -> None:
        async with proxied(ConnectionLimit(1)) as (server, proxy):
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER
                with pytest.raises(ConnectionResetError):
                    async with client(proxy) as (other, _):
                        await other.readexactly(1)
            assert await everything(server) == ASK
            while not await served(proxy):  # the proxy hears of the end a moment after the device
                pass

    on_asyncio(main)


def test_an_answer_that_is_long_in_coming_keeps_no_place_for_a_client_that_has_gone() -> None:
    async def main() -> None:
        async with proxied(ConnectionLimit(1), LateAnswer(60.0, times=1)) as (server, proxy):
            async with client(proxy) as (_, writer):
                writer.write(ASK)
                assert await server.heard.get() == ASK
            while not await served(proxy):
                pass

    on_asyncio(main)


async def served(proxy: FaultProxy) -> bool:
    async with client(proxy) as (reader, writer):
        writer.write(ASK)
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            return await reader.readexactly(len(ANSWER)) == ANSWER
    return False


async def arrivals(reader: asyncio.StreamReader, length: int) -> list[tuple[float, bytes]]:
    """Every segment with its time, until so many bytes have come."""
    came: list[tuple[float, bytes]] = []
    while sum(len(data) for _, data in came) < length:
        data = await reader.read(65536)
        came.append((asyncio.get_running_loop().time(), data))
    return came


def test_pieces_and_delays_take_their_time() -> None:
    async def main() -> None:
        faults = (Delay(0.02, times=1), SplitAnswer(3, 0.02, times=1), Bandwidth(1000.0, on=Target(functions=(6,))))
        async with proxied(*faults) as (server, proxy), client(proxy) as (reader, writer):
            server.answers[PRESS] = PRESS
            began = asyncio.get_running_loop().time()
            writer.write(ASK)
            came = await arrivals(reader, len(ANSWER))
            total = 0
            for at, data in came:  # a busy machine may join pieces, but none is early
                total += len(data)
                assert at - began >= 0.02 * math.ceil(total / 5)
            assert b"".join(data for _, data in came) == ANSWER
            began = asyncio.get_running_loop().time()
            writer.write(PRESS)
            ((at, _),) = await arrivals(reader, len(PRESS))
            assert at - began >= 0.024

    on_asyncio(main)


def test_answers_change_places_and_a_late_one_is_overtaken() -> None:
    async def main() -> None:
        once = LateAnswer(0.03, times=1, on=Target(addresses=(5, 5)))
        asks = [frames.read(Table.HOLDING, nth) for nth in range(10)]

        async def ask(*numbers: int) -> list[int]:
            writer.write(b"".join(frames.frame(asks[nth], nth) for nth in numbers))
            return [frames.tid_of(await reader.readexactly(11)) for _ in numbers]

        faults = WireFaults([ReorderAnswers(times=1), once])
        async with controller(faults) as (_, proxy), client(proxy) as (reader, writer):
            assert await ask(1, 2, 3) == [2, 1, 3]
            assert await ask(5, 6) == [6, 5]

    on_asyncio(main)


def test_the_record_says_what_the_client_got() -> None:
    async def main() -> None:
        faults = WireFaults([DropRequest(times=1, on=Target(functions=(6,)))])
        told: list[Exchange] = []
        faults.on_exchange = told.append
        async with controller(faults) as (cells, proxy), client(proxy) as (reader, writer):
            writer.write(PRESS + ASK)
            assert await reader.readexactly(len(ANSWER)) == ANSWER
            assert cells.written == []
        press, ask = told
        assert (press.executed, press.answers, press.faults) == (False, (), faults.faults)
        assert (ask.executed, ask.honest, [data for _, data in ask.answers]) == (True, True, [ANSWER])
        assert ask.answers[0][0] >= ask.sent_at

    on_asyncio(main)


# -- its own life


def test_it_can_be_stopped_with_everything_at_work_and_started_again(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied(LateAnswer(60.0, times=2), HalfOpen(times=1, on=Target(functions=(6,)))) as (server, proxy):
            port = proxy.port
            async with client(proxy) as (reader, writer), client(proxy) as (other, another):
                async with client(proxy) as (_, third):
                    third.write(PRESS)
                    writer.write(ASK)
                    another.write(ASK)
                    assert [await server.heard.get(), await server.heard.get()] == [ASK, ASK]
                await proxy.stop()
                await proxy.stop()
                for end in (reader, other):
                    with contextlib.suppress(ConnectionResetError):
                        assert await end.read() == b""
            assert server.connections == 3
            assert [await server.heard.get() or b"" for _ in range(3)] == [b"", b"", b""]
            with pytest.raises(ConnectionRefusedError):
                await asyncio.open_connection(HOST, port)
            await proxy.start()
            assert proxy.port == port
            with pytest.raises(RuntimeError, match="runs already"):
                await proxy.start()
            async with client(proxy) as (reader, writer):
                writer.write(ASK)
                assert await reader.readexactly(len(ANSWER)) == ANSWER

    run(main)


def test_it_can_be_stopped_while_a_client_does_not_read(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied() as (server, proxy):
            server.answers[ASK] = b"no frame" * 2_000_000
            deaf = socket.create_connection((HOST, proxy.port))
            with deaf:
                deaf.sendall(ASK)
                assert await server.heard.get() == ASK
                assert await silent(server.heard.get())
                await proxy.stop()
            server.writers[0].transport.abort()

    run(main)


def test_it_can_be_stopped_at_any_moment_of_a_new_connection(run: Callable[[Main], None]) -> None:
    async def main() -> None:
        async with proxied() as (_, proxy):
            for turns in range(12):
                with socket.create_connection((HOST, proxy.port)):
                    for _ in range(turns):
                        await asyncio.sleep(0)
                    await proxy.stop()
                await proxy.start()
        gc.collect()  # a socket that was forgotten warns when it is thrown away, and warnings are errors

    run(main)


def test_a_client_whose_server_is_not_there_is_reset() -> None:
    async def main() -> None:
        with socket.socket() as mute:  # has the port, so that nobody else's server can be there, and does not listen
            mute.bind((HOST, 0))
            async with FaultProxy(HOST, mute.getsockname()[1], WireFaults()) as proxy:
                with pytest.raises(ConnectionResetError):
                    async with client(proxy) as (reader, _):
                        await reader.readexactly(1)

    on_asyncio(main)


def test_a_port_that_is_taken_is_an_error() -> None:
    async def main() -> None:
        with socket.create_server((HOST, 0)) as taken:
            proxy = FaultProxy(HOST, 502, WireFaults(), listen_port=taken.getsockname()[1])
            with pytest.raises(OSError, match="in use"):
                await proxy.start()
            await proxy.stop()

    on_asyncio(main)
