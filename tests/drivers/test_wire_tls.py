"""Modbus/TCP Security over real sockets: whom the wire believes, and what it says when the two sides do not fit."""

import asyncio
import os
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from drivers.errors import ConnectProblem, ControllerException, PointsRefused
from drivers.modbus.link import Link, LinkSettings
from drivers.modbus.tls import LinkTls
from drivers.modbus.wire import PymodbusWire
from register_maps import frames
from tests.drivers.secured import (
    ANSWER,
    ASK,
    READ,
    Near,
    Plc,
    Run,
    opened,
    refusal,
    server_side,
)
from tests.support.certificates import Authority
from tests.support.programs import HANGS_S

NO_TIME = timedelta(days=-1)


@contextmanager
def in_a_thread(
    context: ssl.SSLContext, late_s: float = 0.0, then: Callable[[ssl.SSLSocket], object] = lambda _: None
) -> Iterator[int]:
    """One connection of a controller on plain sockets: asyncio's server tells nobody why it refused a certificate.

    It answers the first request, and does `then` at the second.
    """

    def serve() -> None:
        connection, _ = listener.accept()
        threading.Event().wait(late_s)
        with suppress(OSError), context.wrap_socket(connection, server_side=True) as secured:
            if secured.recv(100):
                secured.sendall(ANSWER)
            if secured.recv(100):
                then(secured)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        thread.join(HANGS_S)
        assert not thread.is_alive()


@pytest.mark.parametrize("newest", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_both_sides_show_their_certificates_and_frames_go_both_ways(
    run: Run, authority: Authority, tls: LinkTls, newest: ssl.TLSVersion
) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file, newest))

    async def test() -> None:
        async with plc.listening() as port:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            near = await opened(wire)
            wire.send(ASK)
            assert await near.frames.get() == ANSWER
            assert plc.transport is not None
            assert plc.transport.get_extra_info("peercert")["subjectAltName"] == (("DNS", "lift-manager"),)
            assert plc.transport.get_extra_info("cipher")[1] == newest.name.replace("_", ".")
            wire.close()

    run(test)


# -- the controller's certificate


def test_a_certificate_of_another_ca_is_not_believed(run: Run, tmp_path: Path, tls: LinkTls) -> None:
    stranger = Authority(tmp_path / "stranger", "stranger")
    plc = Plc(server_side(stranger.issue("plc", "127.0.0.1"), tls.ca))

    async def test() -> None:
        async with plc.listening() as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=tls))
        assert error.problem is ConnectProblem.TLS
        text = f"127.0.0.1:{port}: the certificate of the controller is not from the CA in {tls.ca}"
        assert text in str(error)
        assert plc.heard == []

    run(test)


def test_an_expired_certificate_says_so_and_where_to_look(run: Run, authority: Authority, tls: LinkTls) -> None:
    old = authority.issue("plc", "127.0.0.1", since=datetime.now(UTC) - timedelta(days=9), until=NO_TIME)
    plc = Plc(server_side(old, authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=tls))
        assert "has expired" in str(error)
        assert "clock of this computer" in str(error)

    run(test)


def test_a_certificate_from_the_future_points_at_the_clock(run: Run, authority: Authority, tls: LinkTls) -> None:
    early = authority.issue("plc", "127.0.0.1", since=datetime.now(UTC) + timedelta(days=9))
    plc = Plc(server_side(early, authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=tls))
        assert "is not valid yet; check the clock of this computer" in str(error)

    run(test)


def test_a_certificate_for_another_name_says_which_word_of_the_site_file_mends_it(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    plc = Plc(server_side(authority.issue("plc", "plc.machine-room"), authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=tls))
            assert "for another name" in str(error)
            assert "not valid for '127.0.0.1'" in str(error)
            assert "set `server_name` to one" in str(error)
            wrong = await refusal(PymodbusWire("127.0.0.1", port, tls=replace(tls, server_name="plc.roof")))
            assert "`server_name` in the site file must be" in str(wrong)
            wire = PymodbusWire("127.0.0.1", port, tls=replace(tls, server_name="plc.machine-room"))
            await opened(wire)
            wire.close()

    run(test)


def test_the_very_certificate_of_the_controller_may_stand_in_for_a_ca(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    shown = authority.issue("plc", "127.0.0.1")
    plc = Plc(server_side(shown, authority.file))

    async def test() -> None:
        async with plc.listening() as port:
            wire = PymodbusWire("127.0.0.1", port, tls=replace(tls, ca=shown.certificate))
            await opened(wire)
            wire.close()

    run(test)


# -- our certificate


def test_a_controller_that_refuses_our_certificate_in_the_handshake(run: Run, tmp_path: Path, tls: LinkTls) -> None:
    elsewhere = Authority(tmp_path / "elsewhere", "elsewhere")
    plc = server_side(elsewhere.issue("plc", "127.0.0.1"), elsewhere.file, ssl.TLSVersion.TLSv1_2)

    async def test() -> None:
        with in_a_thread(plc) as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=replace(tls, ca=elsewhere.file)))
        assert f"the controller refuses our certificate {tls.certificate}" in str(error)
        assert "does not know the CA of it" in str(error)

    run(test)


def test_a_controller_that_refuses_our_certificate_only_after_the_handshake(
    run: Run, tmp_path: Path, tls: LinkTls
) -> None:
    elsewhere = Authority(tmp_path / "elsewhere", "elsewhere")
    plc = server_side(elsewhere.issue("plc", "127.0.0.1"), elsewhere.file)

    async def test() -> None:
        with in_a_thread(plc) as port:
            wire = PymodbusWire("127.0.0.1", port, tls=replace(tls, ca=elsewhere.file))
            near = await opened(wire)
            reason = await near.lost.get()
        assert f"refuses our certificate {tls.certificate}: it does not know the CA of it" in reason
        assert not wire.is_open

    run(test)


def test_our_expired_certificate_is_named_by_the_controller_that_refuses_it(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    old = authority.issue("old", "lift-manager", since=datetime.now(UTC) - timedelta(days=9), until=NO_TIME)
    plc = server_side(authority.issue("plc", "127.0.0.1"), authority.file)

    async def test() -> None:
        with in_a_thread(plc) as port:
            wire = PymodbusWire("127.0.0.1", port, tls=replace(tls, certificate=old.certificate, key=old.key))
            near = await opened(wire)
            assert f"refuses our certificate {old.certificate}: it has expired" in await near.lost.get()

    run(test)


def test_a_controller_that_hangs_up_before_its_first_answer_may_have_refused_our_certificate(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    plc = Plc(server_side(authority.issue("plc", "127.0.0.1"), authority.file), answer=b"")

    async def test() -> None:
        async with plc.listening() as port:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            near = await opened(wire)
            wire.send(ASK)
            reason = await near.lost.get()
        assert reason.startswith(
            "the controller closed the connection before the first answer; it may refuse our certificate"
        )

    run(test)


# -- ends after a good beginning


def reset(secured: ssl.SSLSocket) -> None:
    secured.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
    os.close(secured.detach())


def garble(secured: ssl.SSLSocket) -> None:
    os.write(secured.fileno(), b"below TLS, where nothing is plain")


def say_goodbye(secured: ssl.SSLSocket) -> None:
    secured.unwrap().close()


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (reset, "the connection broke: [Errno 104] Connection reset by peer"),
        (garble, "the connection broke: TLS failed (wrong version number)"),
        (lambda secured: os.close(secured.detach()), "the controller closed the connection"),
        (say_goodbye, "the controller closed the connection"),
    ],
    ids=["reset", "garbage", "cut off", "orderly"],
)
def test_however_a_connection_ends_it_is_a_loss_with_its_reason(
    run: Run, authority: Authority, tls: LinkTls, end: Callable[[ssl.SSLSocket], object], reason: str
) -> None:
    with in_a_thread(server_side(authority.issue("plc", "127.0.0.1"), authority.file), then=end) as port:

        async def test() -> None:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            near = await opened(wire)
            wire.send(ASK)
            assert await near.frames.get() == ANSWER
            wire.send(ASK)
            assert await near.lost.get() == reason
            assert not wire.is_open
            wire.send(ASK)
            wire.close()
            assert near.lost.empty()

        run(test)


def test_closing_does_not_wait_for_a_controller_that_takes_nothing(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    frame = frames.frame(frames.write_registers(0, [7] * 123), 1)
    count, closed, received = 20_000, threading.Event(), bytearray()

    def read_late(secured: ssl.SSLSocket) -> None:
        closed.wait(HANGS_S)
        with suppress(OSError):
            while data := secured.recv(1 << 16):
                received.extend(data)

    with in_a_thread(server_side(authority.issue("plc", "127.0.0.1"), authority.file), then=read_late) as port:

        async def test() -> None:
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            near = await opened(wire)
            wire.send(ASK)
            await near.frames.get()
            for _ in range(count):
                wire.send(frame)
            wire.close()
            await asyncio.sleep(0)
            assert near.lost.empty()

        run(test)
        closed.set()
    assert len(received) < count * len(frame)


# -- one side speaks TLS


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (ANSWER, "speaks no TLS; a controller without Modbus/TCP Security needs no `tls`"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "speaks no TLS"),
        (b"", "ended the connection in the middle of the TLS handshake; it may speak no TLS on this port"),
    ],
    ids=["Modbus", "HTTP", "hangs up"],
)
def test_a_port_without_tls_is_told_from_one_that_refuses(run: Run, tls: LinkTls, answer: bytes, words: str) -> None:
    async def test() -> None:
        async with Plc(None, answer).listening() as port:
            error = await refusal(PymodbusWire("127.0.0.1", port, tls=tls))
        assert error.problem is ConnectProblem.TLS
        assert words in str(error)

    run(test)


def test_a_port_that_takes_connections_and_says_nothing_is_not_called_off(run: Run, tls: LinkTls) -> None:
    async def test() -> None:
        with socket.create_server(("127.0.0.1", 0)) as mute:
            wire = PymodbusWire("127.0.0.1", mute.getsockname()[1], tls=replace(tls, handshake_s=0.2))
            error = await refusal(wire)
        assert "accepted the connection, but the TLS handshake did not complete within 0.2 s" in str(error)
        assert "may be off" not in str(error)

    run(test)


def test_a_controller_that_is_slow_at_arithmetic_has_longer_than_tcp_has(
    run: Run, authority: Authority, tls: LinkTls
) -> None:
    plc = server_side(authority.issue("plc", "127.0.0.1"), authority.file)
    # its thread is waited for when the loop has ended, which is what closes the socket
    with in_a_thread(plc, late_s=1.2) as port:

        async def test() -> None:
            near = Near()
            wire = PymodbusWire("127.0.0.1", port, tls=tls)
            await wire.open(near.frames.put_nowait, near.lost.put_nowait, timeout_s=1.0)
            wire.send(ASK)
            assert await near.frames.get() == ANSWER
            wire.close()

        run(test)


def test_nobody_there_is_refused_as_without_tls(run: Run, tls: LinkTls) -> None:
    async def test() -> None:
        with socket.socket() as mute:  # has the port, so that nobody else can be there, and does not listen
            mute.bind(("127.0.0.1", 0))
            error = await refusal(PymodbusWire("127.0.0.1", mute.getsockname()[1], tls=tls))
        assert error.problem is ConnectProblem.REFUSED

    run(test)


def test_a_wire_without_tls_knows_an_answer_in_tls_when_it_sees_one(run: Run) -> None:
    async def test() -> None:
        async with Plc(None, b"\x15\x03\x03\x00\x02\x02\x46").listening() as port:
            wire = PymodbusWire("127.0.0.1", port)
            near = await opened(wire)
            wire.send(ASK)
            reason = await near.lost.get()
        assert reason.startswith("the data received is not Modbus/TCP: it answers in TLS; ")
        assert "give this controller `tls` in the site file" in reason

    run(test)


# -- the role in the certificate


@pytest.mark.parametrize("secured", [True, False])
def test_over_tls_exception_01_may_be_about_our_role(
    run: Run, authority: Authority, tls: LinkTls, *, secured: bool
) -> None:
    context = server_side(authority.issue("plc", "127.0.0.1"), authority.file) if secured else None
    plc = Plc(context, frames.exception_answer(frames.frame(READ, 1), 1))

    async def test() -> None:
        async with plc.listening() as port, asyncio.TaskGroup() as group:
            settings = LinkSettings(tls=secured)
            link = Link(lambda: PymodbusWire("127.0.0.1", port, tls=tls if secured else None), settings, name="lobby")
            group.create_task(link.run())
            await link.wait_up()
            with pytest.raises(ControllerException) as caught:
                await link.read(READ)
            await link.close()
        told = [str(caught.value), str(PointsRefused(caught.value, "this block holds car_floor"))]
        assert [("the role in our certificate does not allow it" in text) for text in told] == [secured, secured]

    run(test)
