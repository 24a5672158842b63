"""The client over real connections: refused, half open, nonsense on the wire, TLS, proxies."""

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from lift_manager.client import ClientError, Disconnected, LiftManagerClient, NotAManager, Unreachable
from lift_manager.web.app import make_app
from lift_manager.web.tls import ServerCertificates, ServerTls
from tests.lift_manager.web.fake import FakeSite, serving
from tests.support.certificates import Authority
from tests.support.programs import free_port

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@asynccontextmanager
async def server(serve: Serve) -> AsyncIterator[str]:
    running = await asyncio.start_server(serve, "127.0.0.1", 0)
    host, port = running.sockets[0].getsockname()
    try:
        yield f"http://{host}:{port}"
    finally:
        running.close()


def answering(content: bytes) -> Serve:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(content)
        writer.close()

    return serve


async def fails(url: str, **how: float | ssl.SSLContext | Path) -> ClientError:
    async with LiftManagerClient(url, **how) as client:  # type: ignore[arg-type]
        with pytest.raises(ClientError) as caught:
            await client.acknowledge("lift", "M. Weber")
    return caught.value


def test_a_port_where_nobody_listens_was_told_nothing() -> None:
    error = asyncio.run(fails(f"http://127.0.0.1:{free_port()}"))
    assert isinstance(error, Unreachable)
    assert not error.may_have_arrived


def test_a_manager_that_accepts_and_never_answers_is_given_up_in_time() -> None:
    # the kernel accepts for a program that never does: a process that hangs
    with socket.create_server(("127.0.0.1", 0)) as half_open:
        url = f"http://127.0.0.1:{half_open.getsockname()[1]}"

        async def main() -> ClientError:
            async with asyncio.timeout(5):
                return await fails(url, within_s=0.3)

        error = asyncio.run(main())
    assert isinstance(error, Unreachable)
    assert error.may_have_arrived


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"", Unreachable),
        (b"220 mail ESMTP\r\n", Unreachable),
        (b"\x00\x01\x00\x00\x00\x03\x01\x83\x02", Unreachable),
        (b"HTTP/1.1 200 OK\r\ncontent-length: 900\r\n\r\n{", Unreachable),
        (b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\nzz\r\n", Unreachable),
        (b"HTTP/1.1 200 OK\r\ncontent-encoding: gzip\r\ncontent-length: 2\r\n\r\n{}", Unreachable),
        (b"HTTP/1.1 200 OK\r\ncontent-length: 6\r\n\r\n<html>", NotAManager),
        (b"HTTP/1.1 301 Moved\r\nlocation: http://127.0.0.1:9/\r\ncontent-length: 0\r\n\r\n", NotAManager),
    ],
)
def test_nonsense_on_the_wire_is_an_error_of_this_package(content: bytes, kind: type[ClientError]) -> None:
    async def main() -> ClientError:
        async with server(answering(content)) as url:
            return await fails(url)

    error = asyncio.run(main())
    assert type(error) is kind
    assert error.__cause__ is not None or kind is NotAManager


def test_nonsense_instead_of_a_stream_is_a_connection_that_broke() -> None:
    async def main() -> None:
        head = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\ncontent-length: 99\r\n\r\n"
        async with (
            server(answering(head + b"\xff\xfe\x00")) as url,
            LiftManagerClient(url) as client,
            client.events() as events,
        ):
            await anext(events)
            assert isinstance(await anext(events), Disconnected)

    asyncio.run(main())


def test_a_proxy_of_the_environment_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy", "HTTPS_PROXY"):
        monkeypatch.setenv(name, f"http://127.0.0.1:{free_port()}")

    async def main() -> bool:
        ok = b'HTTP/1.1 200 OK\r\ncontent-length: 15\r\n\r\n{"status":"ok"}'
        async with server(answering(ok)) as url, LiftManagerClient(url) as client:
            return await client.is_alive()

    assert asyncio.run(main())


def test_https_is_believed_by_its_ca_alone(tmp_path: Path) -> None:
    authority, stranger = Authority(tmp_path), Authority(tmp_path, "stranger")
    shown = authority.issue("api", "127.0.0.1")
    tls = ServerCertificates(ServerTls(shown.certificate, shown.key))

    async def main() -> None:
        async with serving(make_app(FakeSite()), tls) as port:
            url = f"https://127.0.0.1:{port}"
            own = ssl.create_default_context(cafile=str(authority.file))
            for believed in (authority.file, str(authority.file), own):
                async with LiftManagerClient(url, tls=believed) as client:
                    assert await client.is_alive()
            for tls_ in (stranger.file, None):
                async with LiftManagerClient(url, tls=tls_) as client:
                    with pytest.raises(Unreachable, match="certificate verify failed") as caught:
                        await client.is_alive()
                assert not caught.value.may_have_arrived
            async with LiftManagerClient(f"http://127.0.0.1:{port}") as client:
                with pytest.raises(Unreachable):
                    await client.is_alive()

    asyncio.run(main())


def test_metrics_are_returned_as_they_are_served() -> None:
    async def main() -> str:
        answer = b"HTTP/1.1 200 OK\r\ncontent-length: 9\r\n\r\nup 1\n# \xc3\xa9"
        async with server(answering(answer)) as url, LiftManagerClient(url) as client:
            return await client.metrics()

    assert asyncio.run(main()) == "up 1\n# é"
