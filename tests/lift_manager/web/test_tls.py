"""HTTPS on a real socket: who is heard, what is shown, renewal without a restart, and a quick end."""

import asyncio
import os
import socket
import ssl
import subprocess
import time
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
import uvloop
from cryptography import x509

from lift_manager.web.app import make_app
from lift_manager.web.errors import ListenError
from lift_manager.web.tls import ServerCertificates, ServerTls
from tests.lift_manager.web.fake import STATE, FakeSite, connected, serving
from tests.support.certificates import Authority, Shown
from tests.support.programs import HANGS_S, soon

Run = Callable[[Coroutine[Any, Any, None]], None]


@pytest.fixture(params=[asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def run(request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture) -> Run:
    def runner(main: Coroutine[Any, Any, None]) -> None:
        with asyncio.Runner(loop_factory=request.param) as loop:
            loop.run(main)
        assert [record.getMessage() for record in caplog.records if record.exc_info] == []

    return runner


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority(tmp_path)


@pytest.fixture
def files(authority: Authority) -> ServerTls:
    shown = authority.issue("manager", "127.0.0.1", "lift-pc")
    return ServerTls(shown.certificate, shown.key)


async def curl(port: int, *options: str | Path) -> tuple[int, str, str]:
    """Exit code, status and what it complains about."""
    command = ["curl", "--silent", "--show-error", "--max-time", "5", "--noproxy", "*", "--output", os.devnull]
    command += ["--write-out", "%{http_code} %{ssl_verify_result}", *map(str, options)]
    process = await asyncio.create_subprocess_exec(
        *command, f"https://127.0.0.1:{port}{STATE}?lift_name=lift", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    out, err = await process.communicate()
    return process.returncode or 0, out.decode(), err.decode()


def shown_by(client: Shown) -> list[str | Path]:
    return ["--cert", client.certificate, "--key", client.key]


@pytest.mark.external("curl")
def test_curl_reads_a_lift_over_https_and_believes_the_ca_alone(
    run: Run, tmp_path: Path, authority: Authority, files: ServerTls
) -> None:
    async def main() -> None:
        async with serving(make_app(FakeSite()), ServerCertificates(files)) as port:
            assert await curl(port, "--cacert", authority.file) == (0, "200 0", "")
            code, _, complaint = await curl(port, "--cacert", Authority(tmp_path / "other", "other").file)
            assert (code, "certificate" in complaint) == (60, True)
            code, _, _ = await curl(port, "--cacert", authority.file, "--tls-max", "1.1")
            assert code == 35

    run(main())


@pytest.mark.external("curl")
@pytest.mark.parametrize("newest", ["1.2", "1.3"])
def test_with_a_client_ca_only_its_clients_are_heard(
    run: Run, tmp_path: Path, authority: Authority, files: ServerTls, newest: str
) -> None:
    manager = FakeSite()
    members = Authority(tmp_path / "members", "members")
    stranger = authority.issue("stranger", "stranger")

    async def main() -> None:
        tls = ServerCertificates(replace(files, client_ca=members.file))
        async with serving(make_app(manager), tls) as port:
            options: list[str | Path] = ["--cacert", authority.file, "--tls-max", newest]
            assert (await curl(port, *options, *shown_by(members.issue("robot", "robot"))))[:2] == (0, "200 0")
            nobodies: list[list[str | Path]] = [[], shown_by(stranger)]
            for nobody in nobodies:
                code, status, _ = await curl(port, *options, *nobody)
                assert code != 0
                assert status.startswith("000")

    run(main())


def test_renewed_files_are_shown_to_the_next_client(
    run: Run, authority: Authority, files: ServerTls, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        tls = ServerCertificates(files)
        async with serving(make_app(FakeSite()), tls) as port:
            before = await names_shown(port, authority)
            renewed = authority.issue("later", "127.0.0.1", "renewed")
            # as it happens in the middle of a renewal: a certificate whose key is not there yet
            files.certificate.write_bytes(renewed.certificate.read_bytes())
            tls.renew()
            tls.renew()
            between = await names_shown(port, authority)
            files.key.write_bytes(renewed.key.read_bytes())
            tls.renew()
            after = await names_shown(port, authority)
        assert ("lift-pc" in before, "lift-pc" in between, "renewed" in after) == (True, True, True)

    with caplog.at_level("INFO", "lift_manager"):
        run(main())
    told = [record.getMessage() for record in caplog.records if record.name == "lift_manager.web.tls"]
    assert len(told) == 2
    assert "cannot be used yet" in told[0]
    assert "was renewed" in told[1]
    assert not any("PRIVATE" in line for line in told)


def test_a_renewed_client_ca_counts_for_the_next_client(
    run: Run, tmp_path: Path, authority: Authority, files: ServerTls
) -> None:
    old, new = Authority(tmp_path / "old", "old"), Authority(tmp_path / "new", "new")
    believed = tmp_path / "clients.pem"
    believed.write_bytes(old.file.read_bytes())

    async def main() -> None:
        tls = ServerCertificates(replace(files, client_ca=believed))
        async with serving(make_app(FakeSite()), tls) as port:
            was, will_be = old.issue("robot", "robot"), new.issue("robot", "robot")
            before = [await is_heard(port, authority, each) for each in (was, will_be)]
            believed.write_bytes(new.file.read_bytes())
            tls.renew()
            after = [await is_heard(port, authority, each) for each in (was, will_be)]
        assert (before, after) == ([True, False], [False, True])

    run(main())


@pytest.mark.parametrize("newest", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize("renewed", [True, False], ids=["another CA", "the same CA"])
def test_with_a_client_ca_no_session_is_resumed(
    run: Run, tmp_path: Path, authority: Authority, files: ServerTls, newest: ssl.TLSVersion, *, renewed: bool
) -> None:
    old, new = Authority(tmp_path / "old", "old"), Authority(tmp_path / "new", "new")
    believed = tmp_path / "clients.pem"
    believed.write_bytes(old.file.read_bytes())
    context = client_side(authority)
    context.maximum_version = newest
    robot = old.issue("robot", "robot")
    context.load_cert_chain(robot.certificate, robot.key)

    async def main() -> None:
        tls = ServerCertificates(replace(files, client_ca=believed))
        async with serving(make_app(FakeSite()), tls) as port:
            status, _, session = await asyncio.to_thread(asked, port, context, None)
            assert status == b"HTTP/1.1 200"
            if renewed:
                believed.write_bytes(new.file.read_bytes())
                tls.renew()
            status, reused, _ = await asyncio.to_thread(asked, port, context, session)
        assert (status == b"HTTP/1.1 200", reused) == (not renewed, False)

    run(main())


@pytest.mark.parametrize("newest", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_without_a_client_ca_a_session_is_resumed_until_the_certificate_is_renewed(
    run: Run, authority: Authority, files: ServerTls, newest: ssl.TLSVersion
) -> None:
    context = client_side(authority)
    context.maximum_version = newest

    async def main() -> None:
        tls = ServerCertificates(files)
        async with serving(make_app(FakeSite()), tls) as port:
            _, _, session = await asyncio.to_thread(asked, port, context, None)
            _, reused, _ = await asyncio.to_thread(asked, port, context, session)
            authority.issue("manager", "127.0.0.1", "renewed")
            tls.renew()
            status, again, _ = await asyncio.to_thread(asked, port, context, session)
        assert (status, reused, again) == (b"HTTP/1.1 200", True, False)

    run(main())


def asked(
    port: int, context: ssl.SSLContext, session: ssl.SSLSession | None
) -> tuple[bytes, bool | None, ssl.SSLSession | None]:
    """What comes back, whether the session was resumed, and the session; on sockets, for asyncio takes no session."""
    reused = None
    try:
        with (
            socket.create_connection(("127.0.0.1", port), 5) as plain,
            context.wrap_socket(plain, server_hostname="127.0.0.1", session=session) as secured,
        ):
            reused = secured.session_reused
            secured.sendall(f"GET {STATE}?lift_name=lift HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            return secured.recv(12), reused, secured.session
    except OSError:
        return b"", reused or False, None


async def is_heard(port: int, authority: Authority, client: Shown) -> bool:
    context = client_side(authority)
    context.load_cert_chain(client.certificate, client.key)
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        writer.write(f"GET {STATE}?lift_name=lift HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        answer = await reader.read(12)
        writer.transport.abort()
    except OSError:
        return False
    return answer == b"HTTP/1.1 200"


async def names_shown(port: int, authority: Authority) -> list[str]:
    _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=client_side(authority))
    der = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
    writer.transport.abort()
    names = x509.load_der_x509_certificate(der).extensions.get_extension_for_class(x509.SubjectAlternativeName)
    return names.value.get_values_for_type(x509.DNSName)


def client_side(authority: Authority) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(authority.file))


def test_the_server_is_out_within_a_second_though_a_client_keeps_its_connection_and_says_nothing(
    run: Run, authority: Authority, files: ServerTls, caplog: pytest.LogCaptureFixture
) -> None:
    took_s: list[float] = []

    async def main() -> None:
        async with serving(make_app(FakeSite()), ServerCertificates(files)) as port:
            reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=client_side(authority))
            writer.write(f"GET {STATE}?lift_name=lift HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            assert await reader.read(12) == b"HTTP/1.1 200"
            # one that has not shaken hands
            _, mute = await asyncio.open_connection("127.0.0.1", port)
            cast(asyncio.Transport, writer.transport).pause_reading()
            began = time.monotonic()
        took_s.append(time.monotonic() - began)
        mute.transport.abort()
        writer.transport.abort()

    def attempt() -> float:
        run(main())
        return took_s[-1]

    soon(attempt, 1.0)
    assert caplog.messages == []


def test_a_client_without_tls_and_one_that_hangs_up_early_make_no_noise(
    run: Run, authority: Authority, files: ServerTls, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        async with serving(make_app(FakeSite()), ServerCertificates(files)) as port:
            reader, plain = await asyncio.open_connection("127.0.0.1", port)
            plain.write(b"GET / HTTP/1.1\r\n\r\n")
            assert await reader.read() == b""
            plain.close()
            _, early = await asyncio.open_connection("127.0.0.1", port)
            early.transport.abort()
            assert "lift-pc" in await names_shown(port, authority)

    run(main())
    assert [record for record in caplog.records if record.levelname in ("WARNING", "ERROR")] == []


def test_files_that_do_not_fit_are_refused_before_anybody_is_served(authority: Authority, files: ServerTls) -> None:
    other = authority.issue("other", "other")
    with pytest.raises(ListenError, match=r"api\.tls: .* cannot be used with .*other\.key"):
        ServerCertificates(replace(files, key=other.key))


@pytest.mark.parametrize("sent", [b"", b"\x16\x03\x01\x02\x00\x01"], ids=["nothing", "half a hello"])
def test_whoever_does_not_finish_the_handshake_counts_as_a_connection_and_makes_room_after_a_second(
    run: Run, authority: Authority, files: ServerTls, sent: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        tls = ServerCertificates(files)
        waits = serving(make_app(FakeSite()), tls, connections=50, handshake_s=2 * HANGS_S)
        async with waits as port, AsyncExitStack() as stack:
            assert "lift-pc" in await names_shown(port, authority)
            halves = [await stack.enter_async_context(connected(port)) for _ in range(50)]
            for _, writer in halves:
                writer.write(sent)
            async with asyncio.timeout(HANGS_S):
                await until_shown(port, authority)
                with suppress(ConnectionError):
                    assert await halves[0][0].read() == b""
            # no more than had to
            gone = [reader.at_eof() or reader.exception() is not None for reader, _ in halves]
            assert gone.count(True) <= 2

    run(main())
    assert all("places for connections are taken" in line for line in caplog.messages)


async def until_shown(port: int, authority: Authority) -> None:
    while True:
        with suppress(OSError):
            assert "lift-pc" in await names_shown(port, authority)
            return


def test_a_handshake_that_failed_leaves_its_place(
    run: Run, tmp_path: Path, authority: Authority, files: ServerTls
) -> None:
    stranger = Authority(tmp_path / "stranger", "stranger")

    async def main() -> None:
        tls = ServerCertificates(replace(files, client_ca=authority.file))
        async with serving(make_app(FakeSite()), tls, connections=20) as port:
            for _ in range(21):
                with suppress(OSError):
                    await names_shown(port, stranger)
            assert await is_heard(port, authority, authority.issue("robot", "robot"))

    run(main())


def test_a_handshake_has_a_bounded_time(run: Run, authority: Authority, files: ServerTls) -> None:
    async def main() -> None:
        tls = ServerCertificates(files)
        async with (
            serving(make_app(FakeSite()), tls, handshake_s=2 * HANGS_S) as patient,
            connected(patient) as (waiting, _),
            serving(make_app(FakeSite()), tls, handshake_s=1.0) as port,
        ):
            began = time.monotonic()
            async with connected(port) as (reader, _), asyncio.timeout(HANGS_S):
                with suppress(ConnectionError):
                    assert await reader.read() == b""
            assert time.monotonic() - began > 0.9
            assert not waiting.at_eof()

    run(main())
