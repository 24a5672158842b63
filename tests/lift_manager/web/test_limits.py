"""What a caller can make the manager take in: addresses, headers, bodies and connections all end somewhere."""

import asyncio
import json
import subprocess
import sys
from collections.abc import Coroutine
from contextlib import AsyncExitStack
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.web.app import make_app
from lift_manager.web.body import KEYS_LIMIT, LIMIT_BYTES
from lift_manager.web.connections import ConnectionLimits, Connections
from lift_manager.web.http_protocol import (
    HEAD_LIMIT_BYTES,
    HEAD_WITHIN_S,
    HEADERS_LIMIT,
    READ_WITHIN_S,
    JsonHttpProtocol,
)
from lift_manager.web.limits import MAX_CONNECTIONS
from tests.lift_manager.web.fake import BASE, CALL, REQUEST, FakeSite, ask, connected, serving
from tests.lift_manager.web.listening import listening
from tests.support.programs import HANGS_S
from tests.support.rows import each_row

NAMES = f"GET {BASE}/lift_names HTTP/1.1\r\nHost: 127.0.0.1\r\n".encode()
LONG = b"x" * HEAD_LIMIT_BYTES


def run(main: Coroutine[Any, Any, Any]) -> Any:
    with asyncio.Runner() as runner:
        return runner.run(main)


async def all_of(port: int, sent: bytes) -> bytes:
    async with connected(port) as (reader, writer), asyncio.timeout(HANGS_S):
        writer.write(sent)
        await writer.drain()
        return await reader.read()


@each_row(
    ("sent", "media_type"),
    [
        (b"GET /" + LONG, b"application/json"),
        (b"GET /" + LONG + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", b"application/json"),
        (NAMES + b"X-Long: " + LONG, b"application/json"),
        (NAMES + b"X-Long: " + LONG + b"\r\n\r\n", b"application/json"),
        (NAMES + b"X-Many: x\r\n" * HEADERS_LIMIT + b"\r\n", b"application/json"),
        (b"GET /api/v1/x HTTP/1.1\r\nX-Long: " + LONG + b"\r\n\r\n", b"application/problem+json"),
        (LONG + LONG, b"application/json"),
    ],
)
def test_a_head_that_is_too_long_is_answered_and_hung_up_on(sent: bytes, media_type: bytes) -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            return await all_of(port, sent)

    header, _, body = run(main()).partition(b"\r\n\r\n")
    expected = 400 if sent == LONG + LONG else 431
    assert header.startswith(f"HTTP/1.1 {expected} ".encode())
    assert b"content-type: " + media_type in header
    assert b"connection: close" in header
    assert str(HEAD_LIMIT_BYTES) in json.loads(body).get("msg", json.loads(body).get("detail")) or expected == 400


def test_a_head_below_the_limit_is_read_in_however_many_pieces() -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port, connected(port) as (reader, writer):
            head = NAMES + b"X-Long: " + LONG[:-200] + b"\r\n"
            for start in range(0, len(head), 5000):
                writer.write(head[start : start + 5000])
                await writer.drain()
                await asyncio.sleep(0)
            writer.write(b"Connection: close\r\n\r\n")
            async with asyncio.timeout(HANGS_S):
                return await reader.read()

    assert run(main()).startswith(b"HTTP/1.1 200 ")


def test_a_connection_counts_each_of_its_requests_for_itself() -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            one = NAMES + b"X-Long: " + b"x" * (HEAD_LIMIT_BYTES // 2) + b"\r\n"
            return await all_of(port, (one + b"\r\n") * 4 + one + b"Connection: close\r\n\r\n")

    assert run(main()).count(b"HTTP/1.1 200 ") == 5


async def ask_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Make a request, and read its answer to the end."""
    writer.write(NAMES + b"\r\n")
    head = await reader.readuntil(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200"), head
    await reader.readexactly(int(head.partition(b"content-length: ")[2].split(b"\r\n")[0]))


async def is_closed(reader: asyncio.StreamReader) -> bool:
    try:
        return await reader.read() == b""
    except ConnectionError:
        return True


def test_idle_connections_lock_nobody_out_and_the_one_that_was_idle_longest_is_closed_first(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        async with (
            serving(make_app(FakeSite()), connections=20) as port,
            AsyncExitStack() as stack,
            asyncio.timeout(HANGS_S),
        ):
            kept = [await stack.enter_async_context(connected(port)) for _ in range(20)]
            for connection in (*kept[1:], kept[0]):
                await ask_on(*connection)
            for _ in range(3):
                await ask_on(*(await stack.enter_async_context(connected(port))))
            assert [await is_closed(reader) for reader, _ in kept[1:4]] == [True] * 3
            await ask_on(*kept[0])
            await ask_on(*kept[4])

    run(main())
    (line,) = [record.getMessage() for record in caplog.records]
    assert line == (
        "api: all 20 places for connections are taken (20 by this computer); connections since the last such line:"
        " 1 idle closed to make room, 0 new refused"
    )


def test_a_connection_on_which_nothing_was_asked_yet_makes_room_as_well() -> None:
    async def main() -> None:
        async with (
            serving(make_app(FakeSite()), connections=20) as port,
            AsyncExitStack() as stack,
            asyncio.timeout(HANGS_S),
        ):
            silent = [await stack.enter_async_context(connected(port)) for _ in range(20)]
            await ask_on(*silent[-1])  # all of them are taken by then
            await ask_on(*(await stack.enter_async_context(connected(port))))
            assert await is_closed(silent[0][0])

    run(main())


def test_where_every_connection_is_being_served_a_new_one_is_hung_up_on_and_the_others_go_on() -> None:
    async def main() -> None:
        site = FakeSite()
        async with serving(make_app(site, streams=20), connections=20) as port, AsyncExitStack() as stack:
            async with asyncio.timeout(HANGS_S):
                streams = [await stack.enter_async_context(listening(port)) for _ in range(20)]
                assert [await stream.begin() for stream in streams] == [200] * 20
                one_more, _ = await stack.enter_async_context(connected(port))
                assert await is_closed(one_more)
                for stream in streams:
                    await stream.take(1)

    run(main())


def test_a_stream_for_which_there_is_no_place_keeps_no_connection() -> None:
    async def main() -> None:
        async with (
            serving(make_app(FakeSite(), streams=1)) as port,
            AsyncExitStack() as stack,
            asyncio.timeout(HANGS_S),
        ):
            first, second = [await stack.enter_async_context(listening(port)) for _ in range(2)]
            assert await first.begin() == 200
            assert await second.begin() == 503
            assert b"connection: close" in second.head
            assert (await second.reader.read()).endswith(b"}")

    run(main())


@pytest.mark.parametrize("head", [b"", b"Host: a\r\nHost: a\r\n"], ids=["no host", "two hosts"])
def test_a_request_of_http_1_1_names_one_host(head: bytes) -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            return await all_of(port, f"GET {BASE}/lift_names HTTP/1.1\r\n".encode() + head + b"\r\n")

    header, _, body = run(main()).partition(b"\r\n\r\n")
    assert header.startswith(b"HTTP/1.1 400 ")
    assert "needs the header Host, once" in json.loads(body)["msg"]


def test_a_request_of_http_1_0_needs_no_host() -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            return await all_of(port, f"GET {BASE}/lift_names HTTP/1.0\r\n\r\n".encode())

    assert run(main()).startswith(b"HTTP/1.1 200 ")


def test_a_header_of_a_megabyte_is_answered_before_the_connection_is_closed() -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            return await all_of(port, NAMES + b"X-Long: " + b"x" * 1_000_000 + b"\r\n\r\n")

    assert run(main()).startswith(b"HTTP/1.1 431 ")


@pytest.mark.parametrize(
    "body",
    [
        {f"key {number}": 0 for number in range(KEYS_LIMIT + 1)},
        {"floor": {f"key {number}": 0 for number in range(KEYS_LIMIT + 1)}, "door_state": 0},
    ],
)
def test_an_object_of_too_many_keys_is_refused(body: dict[str, object]) -> None:
    site = FakeSite()
    answer = ask(site, "POST", REQUEST, json=body)
    assert f"an object in the body has {KEYS_LIMIT + 1} keys" in answer.json()["msg"]
    assert site.requests == []


def test_a_body_that_nobody_wants_is_not_waited_for() -> None:
    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port, connected(port) as (reader, writer), asyncio.timeout(HANGS_S):
            writer.write(NAMES + b"Content-Length: 100000000\r\n\r\n" + b" " * 1_000_000)
            return await reader.readexactly(12)

    assert run(main()) == b"HTTP/1.1 200"


def test_a_good_request_is_within_all_limits() -> None:
    assert len(CALL) < LIMIT_BYTES
    assert ask(FakeSite(), "POST", REQUEST, content=CALL).json()["success"] is True


class Line(asyncio.Transport):
    """The server's end of a connection, without a network."""

    def __init__(self) -> None:
        super().__init__()
        self.closed = False
        self.aborted = False

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.aborted = True

    def write(self, data: bytes | bytearray | memoryview) -> None:
        raise AssertionError(bytes(data))


async def begun() -> tuple[JsonHttpProtocol, Line]:
    config = uvicorn.Config(make_app(FakeSite()), log_config=None)
    config.load()
    protocol, line = JsonHttpProtocol(config, ServerState(), {}, Connections(ConnectionLimits.of(10))), Line()
    protocol.connection_made(line)
    return protocol, line


@pytest.mark.parametrize("pause_s", [0.1, 1.0])
def test_a_head_that_comes_drop_by_drop_is_hung_up_on_after_ten_seconds(pause_s: float) -> None:
    async def main() -> float:
        protocol, line = await begun()
        waited_s = 0.0
        protocol.data_received(NAMES)
        while not line.closed:
            protocol.data_received(b"x")
            await elapse(pause_s)
            waited_s += pause_s
        return waited_s

    assert run_virtual(main) == pytest.approx(HEAD_WITHIN_S, abs=2 * pause_s)


def test_a_connection_on_which_nobody_says_anything_is_hung_up_on() -> None:
    async def main() -> None:
        _, line = await begun()
        await elapse(HEAD_WITHIN_S - 0.1)
        assert not line.closed
        await elapse(0.2)
        assert line.closed

    run_virtual(main)


def test_whoever_does_not_take_an_answer_is_hung_up_on_after_a_minute_and_whoever_takes_it_late_is_not() -> None:
    async def main() -> None:
        protocol, line = await begun()
        protocol.pause_writing()
        await elapse(READ_WITHIN_S - 1)
        protocol.resume_writing()
        await elapse(READ_WITHIN_S)
        assert not line.aborted
        protocol.pause_writing()
        protocol.pause_writing()
        await elapse(READ_WITHIN_S + 0.1)
        assert line.aborted

    run_virtual(main)


@each_row(
    ("soft", "hard", "connections", "streams"),
    [
        (1024, 1024, 256, 153),
        (1024, 4096, MAX_CONNECTIONS, 600),
        (64, 64, 16, 9),
        (8192, 20000, MAX_CONNECTIONS, 600),
    ],
)
def test_clients_have_a_quarter_of_the_descriptors_and_streams_a_part_of_that(
    soft: int, hard: int, connections: int, streams: int
) -> None:
    code = (
        "import resource; from lift_manager.web import limits as a;"
        f" resource.setrlimit(resource.RLIMIT_NOFILE, ({soft}, {hard})); a.raise_file_limit();"
        " print(a.connections_limit(), a.streams_limit())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(connections), str(streams)]
