"""Certificates and the running manager: what the links are told, what is said every day, and what the command line refuses."""

import asyncio
import os
import ssl
import threading
from collections.abc import Callable
from contextlib import chdir, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import cast

import pytest
import uvloop

from lift_manager import app
from lift_manager.config.load import load_site
from lift_manager.web.app import make_app
from lift_manager.web.tls import ServerCertificates, ServerTls
from tests.lift_manager.web.fake import FakeSite, serving
from tests.support.certificates import Authority
from tests.support.programs import call, run

SITE = """\
schema: 1
name: A building
controllers:
  secured: {host: 127.0.0.1, port: 8802, map: generic-registers, tls: {ca: ca.pem, certificate: link.pem, key: link.key}}
  plain: {host: 127.0.0.1, port: 5020, map: generic-registers}
lifts:
  main: {controller: secured, floors: {L1: 1, L2: 2}}
  goods: {controller: plain, floors: {L1: 1, L2: 2}}
"""
ACK = ("ack", "main", "--by", "M. Weber", "--manager", "https://127.0.0.1:9")


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    (tmp_path / "site.yaml").write_text(SITE, "utf-8")
    made = Authority(tmp_path)
    made.issue("link", "lift-manager")
    return made


def test_a_link_knows_whether_an_exception_may_be_about_its_role(tmp_path: Path, authority: Authority) -> None:
    async def main() -> None:
        links = app.build(load_site(tmp_path / "site.yaml")).links
        assert [link.settings.tls for link in links] == [True, False]

    asyncio.run(main())


def test_a_certificate_that_expires_while_the_manager_runs_is_told_each_time_and_only_then(
    tmp_path: Path, authority: Authority, caplog: pytest.LogCaptureFixture
) -> None:
    loaded = load_site(tmp_path / "site.yaml")

    async def main() -> None:
        begun = asyncio.get_running_loop().time()
        reminding = asyncio.create_task(app.warn_of_expiry(loaded, every_s=0.2))
        await until(lambda: asyncio.get_running_loop().time() > begun + 0.5)
        assert caplog.messages == []
        since = datetime.now(UTC) - timedelta(days=300)
        authority.issue("link", "lift-manager", since=since, until=timedelta(days=10, hours=1))
        await until(lambda: len(caplog.messages) >= 2)
        await ended(reminding)

    asyncio.run(main())
    assert all(line.startswith(f"secured: certificate {tmp_path / 'link.pem'} expires on ") for line in caplog.messages)
    assert app.WARN_EVERY_S == 86400.0


def test_a_manager_without_tls_is_told_from_one_that_does_not_answer() -> None:
    async def main() -> None:
        async with serving(make_app(FakeSite())) as port:
            manager = f"https://127.0.0.1:{port}"
            done = await asyncio.to_thread(call, *ACK[:-1], manager)
        assert done.returncode == 1
        assert f"{manager} (it does not use TLS; begin its address with http://)" in done.stderr

    asyncio.run(main())


@pytest.fixture(params=[asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def loop(request: pytest.FixtureRequest) -> Callable[[], asyncio.AbstractEventLoop]:
    return cast(Callable[[], asyncio.AbstractEventLoop], request.param)


def test_https_takes_renewed_files_while_it_runs(
    tmp_path: Path, authority: Authority, loop: Callable[[], asyncio.AbstractEventLoop]
) -> None:
    shown = authority.issue("api", "127.0.0.1")
    tls = ServerCertificates(ServerTls(shown.certificate, shown.key))

    async def main() -> None:
        async with serving(make_app(FakeSite()), tls) as port:
            before = await certificate(port, authority)
            renewing = asyncio.create_task(app.renew_certificates(tls))
            authority.issue("api", "127.0.0.1")
            async with asyncio.timeout(60):
                while await certificate(port, authority) == before:
                    pass
            await ended(renewing)

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(main())


def test_certificates_on_a_disk_that_hangs_hold_up_neither_polls_nor_clients_nor_the_end(
    tmp_path: Path,
    authority: Authority,
    loop: Callable[[], asyncio.AbstractEventLoop],
    caplog: pytest.LogCaptureFixture,
) -> None:
    shown = authority.issue("api", "127.0.0.1")
    tls = ServerCertificates(ServerTls(shown.certificate, shown.key))
    polls = 0

    async def poll() -> None:
        nonlocal polls
        while True:
            await asyncio.sleep(0.01)
            polls += 1

    async def main() -> None:
        async with serving(make_app(FakeSite()), tls) as port:
            before = await certificate(port, authority)
            shown.certificate.unlink()
            os.mkfifo(shown.certificate)
            tasks = [asyncio.create_task(work) for work in (poll(), app.renew_certificates(tls, within_s=0.2))]
            await until(lambda: "do not answer within 0.2 s" in caplog.text)
            polled = polls
            await until(lambda: polls > polled + 20)
            assert await certificate(port, authority) == before
            for task in tasks:
                await ended(task)

    threads = set(threading.enumerate())
    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(main())
    assert len(set(threading.enumerate()) - threads) == 1
    # lets go of the thread that waits in `open`
    os.close(os.open(shown.certificate, os.O_RDWR | os.O_NONBLOCK))


async def until(done: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not done():  # noqa: ASYNC110  what it waits for tells nobody
            await asyncio.sleep(0.01)


async def ended(task: asyncio.Task[None]) -> None:
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


async def certificate(port: int, authority: Authority) -> bytes:
    context = ssl.create_default_context(cafile=str(authority.file))
    async with asyncio.timeout(60):
        _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
    der: bytes = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
    writer.transport.abort()
    return der


def test_a_manager_does_not_start_with_files_that_cannot_be_used(tmp_path: Path, authority: Authority) -> None:
    (tmp_path / "link.key").unlink()
    done = run("serve", tmp_path / "site.yaml", "--port", "0")
    assert done.returncode == 2
    assert f"controllers.secured.tls.key: {tmp_path / 'link.key'} does not exist" in done.stderr
    assert "Traceback" not in done.stderr


REFUSALS = [
    (("--ca", "none.pem"), 1, "--ca none.pem cannot be used: No such file or directory"),
    (("--ca", "link.key"), 1, "--ca link.key cannot be used: it is not in PEM form"),
    (("--certificate", "link.pem"), 1, "its key is not in it (--certificate-key FILE)"),
    (("--certificate", "link.pem", "--certificate-key", "other.key"), 1, "its key belongs to another certificate"),
    (("--certificate-key", "link.key"), 2, "a key needs its certificate"),
    (("--ca", "ca.pem"), 1, "no manager answers at https://127.0.0.1:9"),
]


def test_the_command_line_says_which_of_its_files_does_not_fit(tmp_path: Path, authority: Authority) -> None:
    authority.issue("other", "other")
    for options, code, words in REFUSALS:
        with chdir(tmp_path):
            done = call(*ACK, *options)
        assert done.returncode == code
        assert words in done.stderr
        assert "Traceback" not in done.stderr
        assert "PRIVATE" not in done.stderr
