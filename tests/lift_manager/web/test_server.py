import asyncio
import http.client
import json
import logging
import signal
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import AsyncExitStack
from typing import Any

import pytest
import uvloop
from fastapi import FastAPI
from starlette.responses import StreamingResponse

from lift_manager.api.roles import ROUTES, AccessLevel, Route
from lift_manager.web.app import make_app
from lift_manager.web.errors import ListenError
from lift_manager.web.server import listen, serve
from tests.lift_manager.web.fake import ACCEPTED, CALL, REQUEST, FakeSite, connected, serving
from tests.support.programs import HANGS_S, soon
from tests.support.rows import each_row

Loop = Callable[[], asyncio.AbstractEventLoop]

on_both_loops = pytest.mark.parametrize(
    "loop", [asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"]
)


def run(main: Coroutine[Any, Any, Any], loop: Loop = asyncio.new_event_loop) -> Any:
    with asyncio.Runner(loop_factory=loop) as runner:
        return runner.run(main)


def head(length: str = "") -> bytes:
    return f"POST {REQUEST} HTTP/1.1\r\nHost: 127.0.0.1\r\n{length}\r\n".encode()


async def answer_to(port: int, *sent: bytes) -> tuple[bytes, bytes]:
    """Header and body of the first answer to these raw bytes; the connection stays open until it is there."""
    async with connected(port) as (reader, writer):
        for part in sent:
            writer.write(part)
            await writer.drain()
        return await one_answer(reader)


async def one_answer(reader: asyncio.StreamReader) -> tuple[bytes, bytes]:
    async with asyncio.timeout(HANGS_S):
        header = await reader.readuntil(b"\r\n\r\n")
        length = next(line for line in header.lower().split(b"\r\n") if line.startswith(b"content-length"))
        return header, await reader.readexactly(int(length.partition(b":")[2]))


@on_both_loops
def test_a_request_over_a_real_socket_is_answered_byte_for_byte(loop: Loop) -> None:
    async def main() -> None:
        manager = FakeSite()
        async with serving(make_app(manager)) as port:
            header, body = await answer_to(port, head(f"Content-Length: {len(CALL)}\r\n") + CALL)
        assert header.startswith(b"HTTP/1.1 200 OK\r\n")
        assert b"server:" not in header.lower()
        assert body == ACCEPTED
        assert len(manager.requests) == 1

    run(main(), loop)


TOO_LONG = b'{"data":{},"success":false,"msg":"the body is too long; at most 65536 bytes are read"}'
CHUNK = b"8000\r\n" + b" " * 0x8000 + b"\r\n"


@each_row(
    "sent",
    [
        [head("Transfer-Encoding: chunked\r\n"), CHUNK, CHUNK, CHUNK],
        [head("Content-Length: 1000000\r\n")],
        [head("Content-Length: 1000000\r\n"), CALL],
        [head("Content-Length: 1000000\r\nExpect: 100-continue\r\n")],
        [head("Content-Length: 99999999999999999999\r\n")],
    ],
)
def test_a_body_that_is_or_will_be_too_long_is_answered_before_its_end(sent: list[bytes]) -> None:
    async def main() -> None:
        manager = FakeSite()
        async with serving(make_app(manager)) as port:
            header, body = await answer_to(port, *sent)
        # a length that fits no machine word is no HTTP to the parser
        assert body == TOO_LONG or header.startswith(b"HTTP/1.1 400 ")
        assert b"100 Continue" not in header
        assert manager.requests == []

    run(main())


@pytest.mark.parametrize("keep", ["close", "keep-alive"])
def test_a_client_that_sends_a_whole_megabyte_first_still_gets_the_answer(keep: str) -> None:
    def send(port: int) -> bytes:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=HANGS_S)
        try:
            connection.request("POST", REQUEST, body=b" " * 1_000_000, headers={"Connection": keep})
            return connection.getresponse().read()
        finally:
            connection.close()

    async def main() -> bytes:
        async with serving(make_app(FakeSite())) as port:
            return await asyncio.to_thread(send, port)

    assert run(main()) == TOO_LONG


def test_a_length_that_promises_too_much_is_answered_after_a_second() -> None:
    async def main() -> None:
        manager = FakeSite()
        async with serving(make_app(manager)) as port:
            _, body = await answer_to(port, head("Content-Length: 100\r\n"), CALL)
        assert json.loads(body)["msg"] == "the body did not arrive within 1 s"
        assert manager.requests == []

    run(main())


def test_a_length_that_promises_too_little_calls_nothing() -> None:
    async def main() -> None:
        manager = FakeSite()
        async with serving(make_app(manager)) as port:
            _, body = await answer_to(port, head("Content-Length: 5\r\n") + CALL)
        # the rest of the body is taken for a second request, and that is no HTTP
        assert json.loads(body)["success"] is False
        assert manager.requests == []

    run(main())


def test_a_request_without_any_length_has_no_body() -> None:
    async def main() -> None:
        async with serving(make_app(FakeSite())) as port:
            _, body = await answer_to(port, head())
        assert json.loads(body)["msg"].startswith("the body is empty; expected ")

    run(main())


def test_half_a_request_is_forgotten_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        manager = FakeSite()
        async with serving(make_app(manager)) as port:
            for half in (
                head("Content-Length: 100\r\n") + CALL,
                head()[:20],
                b"",
                head("Transfer-Encoding: chunked\r\n"),
            ):
                async with connected(port) as (reader, writer):
                    writer.write(half)
                    writer.write_eof()
                    assert await reader.read() == b""
            _, body = await answer_to(port, head(f"Content-Length: {len(CALL)}\r\n") + CALL)
        assert body == ACCEPTED
        assert len(manager.requests) == 1

    run(main())
    assert caplog.records == []


@each_row(
    "sent",
    [
        b"\x00\xff\xfe\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01",
        b"GET / HTTP/9.9\r\n\r\n",
        "GET /open-rmf/demo-lift/lift_state?lift_name=Güter HTTP/1.1\r\n\r\n".encode(),
        head("Content-Length: many\r\n"),
        head("Content-Length: -1\r\n"),
    ],
)
def test_what_is_no_http_is_answered_400_in_the_envelope(sent: bytes) -> None:
    async def main() -> tuple[bytes, bytes]:
        async with serving(make_app(FakeSite())) as port:
            return await answer_to(port, sent)

    header, body = run(main())
    assert header.startswith(b"HTTP/1.1 400 Bad Request\r\n")
    assert b"\r\nconnection: close\r\n" in header
    envelope = json.loads(body)
    assert (envelope["data"], envelope["success"]) == ({}, False)
    assert "percent-encoded (curl: -G --data-urlencode 'lift_name=...')" in envelope["msg"]


@on_both_loops
def test_open_connections_do_not_delay_the_stop(loop: Loop, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> float:
        streams = [Route(("GET",), path, AccessLevel.READ) for path in ("/stream", "/flood")]
        app = with_stream(make_app(FakeSite(), routes=[*ROUTES, *streams]))
        async with AsyncExitStack() as stack:
            port = await stack.enter_async_context(serving(app))
            idle, stream, no_reader, half, _silent = [
                await stack.enter_async_context(connected(port)) for _ in range(5)
            ]
            idle[1].write(b"GET /nothing HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            await one_answer(idle[0])
            stream[1].write(b"GET /stream HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            await stream[0].readuntil(b"first")
            no_reader[1].write(b"GET /flood HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            await no_reader[0].readexactly(1)
            half[1].write(head("Content-Length: 100\r\n") + CALL)
            await half[1].drain()
            return await stopped(port, serve_task())

    soon(lambda: float(run(main(), loop)), 1.0)
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []


def with_stream(app: FastAPI) -> FastAPI:
    @app.get("/stream")
    async def stream() -> StreamingResponse:
        return StreamingResponse(once_then_nothing())

    @app.get("/flood")
    async def flood() -> StreamingResponse:
        return StreamingResponse(flooding())

    return app


async def once_then_nothing() -> AsyncIterator[bytes]:
    yield b"first"
    await asyncio.Event().wait()


async def flooding() -> AsyncIterator[bytes]:
    while True:
        await asyncio.sleep(0)  # a real stream waits for news
        yield b"x" * 65536


def serve_task() -> asyncio.Task[Any]:
    (task,) = (task for task in asyncio.all_tasks() if getattr(task.get_coro(), "__name__", "") == "serve")
    return task


async def stopped(port: int, task: Awaitable[None]) -> float:
    """Stop the server; returns how long that took."""
    began = time.monotonic()
    assert isinstance(task, asyncio.Task)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    took_s = time.monotonic() - began
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", port)
    return took_s


@on_both_loops
def test_a_stop_before_the_first_request_leaves_the_port_free(loop: Loop) -> None:
    async def main() -> None:
        sock = listen("127.0.0.1", 0)
        port = sock.getsockname()[1]
        task = asyncio.create_task(serve(make_app(FakeSite()), sock))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert sock.fileno() == -1
        again = asyncio.create_task(serve(make_app(FakeSite()), listen("127.0.0.1", port)))
        async with connected(port):
            await stopped(port, again)

    run(main(), loop)


def test_signals_are_left_to_the_program() -> None:
    async def main() -> None:
        before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        async with serving(make_app(FakeSite())) as port:
            await answer_to(port, head())
            assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before

    asyncio.run(main())


def test_a_busy_port_is_one_clear_sentence() -> None:
    with listen("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        with pytest.raises(ListenError) as caught:
            listen("127.0.0.1", port)
    assert str(caught.value) == (
        f"port {port} on 127.0.0.1 is in use by another program; stop that one, or choose another with --port"
    )


@each_row(
    ("host", "port", "said"),
    [
        ("192.0.2.1", 5003, "192.0.2.1 is not an address of this computer, so port 5003 cannot be opened on it"),
        ("no-such-host.invalid", 5003, "host 'no-such-host.invalid' is not known here"),
        ("a..b", 5003, "host 'a..b' is not known here"),
        ("x" * 300, 5003, "is not known here"),
        ("", 5003, "the host is empty"),
        ("[]", 5003, "the host is empty"),
        ("127.0.0.1", 65536, "port 65536 does not exist; choose one from 1 to 65535 with --port"),
        ("127.0.0.1", -1, "port -1 does not exist"),
    ],
)
def test_an_address_that_cannot_be_used_is_one_sentence_with_a_cure(host: str, port: int, said: str) -> None:
    with pytest.raises(ListenError) as caught:
        listen(host, port)
    assert said in str(caught.value)
    assert "--host" in str(caught.value) or "--port" in str(caught.value)


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
            return True
    except OSError:
        return False


@pytest.mark.skipif(not has_ipv6(), reason="this computer has no IPv6 loopback")
@pytest.mark.parametrize("host", ["::1", "[::1]"])
def test_an_ipv6_address_works_with_and_without_brackets(host: str) -> None:
    with listen(host, 0) as sock:
        assert sock.getsockname()[0] == "::1"


def test_localhost_is_where_clients_of_127_0_0_1_look() -> None:
    with listen("localhost", 0) as sock:
        assert sock.getsockname()[0] == "127.0.0.1"
