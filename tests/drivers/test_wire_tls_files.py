"""The certificates and keys of a link: what cannot be used, what is renewed while it runs, and a disk that hangs."""

import asyncio
import logging
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest
import uvloop
from cryptography.hazmat.primitives import serialization

from drivers.errors import ConnectFailed
from drivers.modbus.tls import LinkTls
from drivers.modbus.wire import PymodbusWire
from tests.drivers.secured import (
    ANSWER,
    ASK,
    Plc,
    Run,
    opened,
    refusal,
    server_side,
)
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S


def test_a_missing_file_is_named(run: Run, tls: LinkTls, tmp_path: Path) -> None:
    async def test() -> None:
        error = await refusal(PymodbusWire("127.0.0.1", 802, tls=replace(tls, ca=tmp_path / "none.pem")))
        assert f"cannot use the CA file {tmp_path / 'none.pem'}: No such file or directory" in str(error)

    run(test)


def test_a_key_of_another_certificate_is_found_out(run: Run, tls: LinkTls, authority: Authority) -> None:
    other = authority.issue("other", "other")

    async def test() -> None:
        error = await refusal(PymodbusWire("127.0.0.1", 802, tls=replace(tls, key=other.key)))
        assert "the key does not belong to the certificate" in str(error)

    run(test)


def test_a_key_with_a_passphrase_is_refused_and_nobody_is_asked_for_it(run: Run, tls: LinkTls) -> None:
    key = serialization.load_pem_private_key(tls.key.read_bytes(), None)
    locked = serialization.BestAvailableEncryption(b"open sesame")
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    tls.key.write_bytes(key.private_bytes(pem, pkcs8, locked))

    async def test() -> None:
        error = await refusal(PymodbusWire("127.0.0.1", 802, tls=tls))
        assert "the key is protected by a passphrase; store it without one" in str(error)

    run(test)


def test_renewed_files_are_read_at_the_next_connection(run: Run, authority: Authority, tls: LinkTls) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            names = []
            for name in ("last-year", "this-year"):
                authority.issue("manager", name)
                near = await opened(wire)
                wire.send(ASK)
                await near.frames.get()
                assert plc.transport is not None
                names.append(plc.transport.get_extra_info("peercert")["subjectAltName"][0][1])
            wire.close()
        assert names == ["last-year", "this-year"]

    run(test)


@pytest.mark.parametrize("loop", [asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def test_between_the_renewal_of_certificate_and_key_the_last_pair_is_shown_on(
    loop: Callable[[], asyncio.AbstractEventLoop],
    authority: Authority,
    tls: LinkTls,
    caplog: pytest.LogCaptureFixture,
) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file))
    wire = PymodbusWire("127.0.0.1", 0, tls=tls)

    async def shown() -> str:
        near = await opened(wire)
        wire.send(ASK)
        await near.frames.get()
        assert plc.transport is not None
        name: str = plc.transport.get_extra_info("peercert")["subjectAltName"][0][1]
        return name

    async def test() -> None:
        nonlocal wire
        async with plc.listening() as port, asyncio.timeout(HANGS_S):
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            renewed = authority.issue("later", "renewed")
            names = [await shown()]
            tls.certificate.write_bytes(renewed.certificate.read_bytes())
            names += [await shown(), await shown()]
            tls.certificate.unlink()
            names.append(await shown())
            tls.certificate.write_bytes(renewed.certificate.read_bytes())
            tls.key.write_bytes(renewed.key.read_bytes())
            names.append(await shown())
            wire.close()
        assert names == ["lift-manager"] * 4 + ["renewed"]

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(test())
    told = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(told) == 2
    assert "the key does not belong to the certificate" in told[0]
    assert "No such file or directory" in told[1]
    assert all("the last certificate and key that could be used are shown on" in line for line in told)


@contextmanager
def hanging(path: Path) -> Iterator[None]:
    """A file whose reader waits for ever, as on a disk that hangs."""
    before = set(threading.enumerate())
    path.unlink()
    os.mkfifo(path)
    try:
        yield
    finally:
        # releases every thread that waits in `open`; what it logs then is no news of the next test
        os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))
        for thread in set(threading.enumerate()) - before:
            thread.join(HANGS_S)
            assert not thread.is_alive()


@pytest.mark.parametrize("which", ["ca", "certificate", "key"])
def test_a_disk_that_hangs_fails_the_connection_and_holds_up_nothing_else(run: Run, tls: LinkTls, which: str) -> None:
    tls = replace(tls, files_s=1.0)

    async def test() -> None:
        turns = 0

        async def poll() -> None:
            nonlocal turns
            while True:
                await asyncio.sleep(0.01)
                turns += 1

        others = asyncio.create_task(poll())
        with hanging(getattr(tls, which)):
            wire = PymodbusWire("127.0.0.1", 802, tls=tls)
            threads = threading.active_count()
            for _ in range(2):
                error = await refusal(wire)
                assert "does not answer within 1 s; check the disk that it is on" in str(error)
            assert threading.active_count() <= threads + 1, "the second connection began no look of its own"
        assert turns > 5  # in two seconds; none if it were held up
        others.cancel()

    run(test)


def test_a_disk_that_hangs_after_the_first_connection_leaves_the_link_its_certificate(
    authority: Authority, tls: LinkTls, caplog: pytest.LogCaptureFixture
) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file))
    tls = replace(tls, files_s=1.0)

    async def test() -> None:
        async with plc.listening() as port, asyncio.timeout(HANGS_S):
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            while not wire.is_open:  # a busy machine may need several attempts to read the files in time
                with suppress(ConnectFailed):
                    await opened(wire)
            with hanging(tls.key):
                for _ in range(2):
                    near = await opened(wire)
                    wire.send(ASK)
                    assert await near.frames.get() == ANSWER
            wire.close()

    asyncio.run(test())
    (told,) = [record.getMessage() for record in caplog.records if "does not answer" in record.getMessage()]
    assert str(tls.key) in told


def test_closing_while_the_files_are_looked_at_ends_the_opening(run: Run, authority: Authority, tls: LinkTls) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            opening = asyncio.create_task(refusal(wire))
            await asyncio.sleep(0)
            wire.close()
            assert "the connection was closed as soon as it was made" in str(await opening)
        assert plc.transport is None

    run(test)
