"""Requests with a time limit, against a server that has no manners."""

import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import pytest

from lift_manager.plain.http import ANSWER_LIMIT, Address, BadAddress, Connection, NoAnswer, Reply, Server
from tests.support.certificates import Authority
from tests.support.rows import each_row
from tests.support.scripted_http import WITHIN_S, Asked, Script, Scripted, Wire, answers, said, says_and_hangs_up

KEY = "lm_robots_abcdefgh"
SOON_S = 0.2
"""For what is too late in a test."""


@dataclass
class Client:
    """Connections that are closed with the test."""

    open: ExitStack

    def at(
        self, port: int, host: str = "127.0.0.1", *, prefix: str = "", key: str = KEY, ca_file: Path | None = None
    ) -> Connection:
        address = Address(host, port, tls=ca_file is not None, prefix=prefix)
        return self.open.enter_context(closing(Connection(Server(address, key, ca_file))))


@pytest.fixture
def client() -> Iterator[Client]:
    with ExitStack() as stack:
        yield Client(stack)


def ask(connection: Connection, within_s: float = WITHIN_S) -> Reply:
    return connection.request("POST", "/x", {"a": 1}, within_s=within_s)


# where and with what


@each_row(
    ("text", "port", "url"),
    [
        ("lifts", None, "http://lifts:5003"),
        ("lifts", 8080, "http://lifts:8080"),
        ("lifts:81", 8080, "http://lifts:81"),
        (" 192.0.2.5 ", None, "http://192.0.2.5:5003"),
        ("[2001:db8::1]", None, "http://[2001:db8::1]:5003"),
        ("http://lifts", None, "http://lifts:80"),
        ("http://lifts/", 5003, "http://lifts:5003"),
        ("https://lifts.example", None, "https://lifts.example:443"),
        ("https://lifts.example:8443/building/one/", None, "https://lifts.example:8443/building/one"),
    ],
)
def test_an_address_is_a_host_a_host_with_a_port_or_a_url(text: str, port: int | None, url: str) -> None:
    assert str(Address.of(text, port)) == url


@each_row(
    ("text", "port"),
    [
        ("", None),
        ("ftp://lifts", None),
        ("http://", None),
        ("lifts:http", None),
        ("lifts:70000", None),
        ("lifts", 0),
        ("http://lifts?a=1", None),
        ("http://lifts#a", None),
        ("http://[lifts", None),
        ("my lifts", None),
        ("http://my lifts:5003", None),
        ("http://lifts/building one", None),
        ("li\tfts", None),
        ("http://lifts\u00a0here", None),
        ("http://lifts/b\u00fcro", None),
        ("http://[::1]x:5003", None),
    ],
)
def test_what_is_no_address_is_refused_with_what_to_write(text: str, port: int | None) -> None:
    with pytest.raises(BadAddress, match=r"write a host|is a number from 1 to 65535"):
        Address.of(text, port)


@pytest.mark.parametrize("text", ["http://me:secret@lifts", "me:secret@lifts", "ftp://me:secret@lifts"])
def test_a_password_in_an_address_is_refused_and_not_shown(text: str) -> None:
    with pytest.raises(BadAddress) as refused:
        Address.of(text)
    assert "secret" not in str(refused.value)


@each_row("key", ["lm_secret\n", "lm_secret\r\nx: y", "lm_secret ", "lm_secr\u00e9t", "lm_secret\x7f"])
def test_a_key_that_cannot_be_one_is_refused_and_not_shown(key: str) -> None:
    with pytest.raises(BadAddress, match="copy it again") as refused:
        Server(Address("lifts", 1), key)
    assert "secr" not in str(refused.value)


def test_a_server_shows_itself_without_its_key() -> None:
    server = Server(Address("lifts", 1), KEY)
    assert (repr(server), str(server)) == ("Server(http://lifts:1)", "Server(http://lifts:1)")
    assert server.without_key(f"it said\n{KEY} to me") == "it said ... to me"


def test_a_ca_file_that_is_none_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("no certificate", "utf-8")
    with pytest.raises(BadAddress, match=r"ca\.pem cannot be used: it contains no certificate in PEM form"):
        Server(Address("lifts", 1, tls=True), ca_file=tmp_path / "ca.pem")
    with pytest.raises(BadAddress, match=r"none\.pem cannot be used: No such file"):
        Server(Address("lifts", 1, tls=True), ca_file=tmp_path / "none.pem")
    with pytest.raises(BadAddress, match="a CA file is for https"):
        Server(Address("lifts", 1), ca_file=tmp_path / "ca.pem")


# answers


def test_a_request_carries_path_body_and_key_and_the_answer_comes_back(client: Client) -> None:
    with Scripted(answers(409, {"code": "held"}, "application/problem+json; charset=utf-8")) as server:
        reply = client.at(server.port, prefix="/behind").request(
            "POST", "/a%2Fb", {"floor": "Gr\u00fcn"}, within_s=WITHIN_S
        )
    assert reply == Reply(409, "application/problem+json", b'{"code": "held"}')
    (asked,) = server.asked
    assert (asked.method, asked.path, asked.json) == ("POST", "/behind/a%2Fb", {"floor": "Gr\u00fcn"})
    assert asked.headers["authorization"] == f"Bearer {KEY}"
    assert (asked.headers["content-type"], asked.headers["host"]) == ("application/json", f"127.0.0.1:{server.port}")


def test_without_a_key_none_is_sent(client: Client) -> None:
    with Scripted(answers(200)) as server:
        ask(client.at(server.port, key=""))
    assert "authorization" not in server.asked[0].headers


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n3\r\nabc\r\n2\r\nde\r\n0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\ncontent-length: 5\r\n\r\nabcde",
        b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK\r\ncontent-length: 5\r\n\r\nabcde",
        b"HTTP/1.0 200 OK\r\n\r\nabcde",
    ],
)
def test_a_body_is_read_whole_however_it_is_sent(client: Client, answer: bytes) -> None:
    def script(_: Asked, wire: Wire) -> None:
        for at in range(len(answer)):
            wire.send(answer[at : at + 1])
        if b"1.0" in answer:
            wire.hang_up()

    with Scripted(script) as server:
        assert ask(client.at(server.port)).body == b"abcde"


def test_a_redirect_is_not_followed(client: Client) -> None:
    with Scripted(answers(307, also="location: http://elsewhere.example/\r\n")) as server:
        assert ask(client.at(server.port)).status == 307
    assert len(server.asked) == 1


# no answers


def nothing(_: Asked, __: Wire) -> None:
    """The connection stays, and nothing comes."""


def sends(*pieces: bytes) -> Script:
    return says_and_hangs_up(b"".join(pieces))


@pytest.mark.parametrize(
    ("script", "why"),
    [
        (sends(), "the connection was closed without an answer"),
        (lambda _, wire: wire.reset(), "the connection broke"),
        (sends(b"HTTP/1.1 200 OK\r\ncontent-length: 9\r\n\r\n{"), "half an answer came, and the connection was closed"),
        (sends(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n9\r\n{"), "half an answer"),
        (sends(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\nx\r\n{"), "half an answer"),
        (sends(b"SSH-2.0-OpenSSH_9.2\r\n"), "what answers there does not speak HTTP"),
        (sends(b"\x15\x03\x01\x00\x02\x02\x46"), "what answers there does not speak HTTP"),
        (sends(b"HTTP/1.1 two hundred\r\n\r\n"), "what answers there does not speak HTTP"),
        (sends(b"HTTP/1.1 200 OK\r\nx: " + 70_000 * b"x"), "what answers there does not speak HTTP"),
        (sends(b"HTTP/1.1 200 OK\r\n" + 200 * b"x: y\r\n"), "what answers there does not speak HTTP"),
        (sends(b"HTTP/1.1 200 OK\r\n\r\n", (ANSWER_LIMIT + 1) * b"x"), "what answers there does not speak HTTP"),
    ],
)
def test_what_is_no_whole_answer_is_told_in_words_and_asked_for_once(client: Client, script: Script, why: str) -> None:
    with Scripted(script) as server:
        with pytest.raises(NoAnswer) as refused:
            ask(client.at(server.port))
        assert str(refused.value).startswith(why)
    assert len(server.asked) == 1


def trickles(_: Asked, wire: Wire) -> None:
    pause = threading.Event()
    wire.send(b"HTTP/1.1 200 OK\r\ncontent-length: 99999\r\n\r\n")
    while not wire.is_gone:
        wire.send(b"x")
        pause.wait(0.01)


@pytest.mark.parametrize("script", [nothing, trickles])
def test_the_time_limit_is_for_the_whole_answer_and_a_late_one_is_not_asked_for_again(
    client: Client, script: Script
) -> None:
    with Scripted(script) as server:
        began = time.monotonic()
        with pytest.raises(NoAnswer, match="no whole answer came in time"):
            ask(client.at(server.port), SOON_S)
        assert time.monotonic() - began < WITHIN_S / 2
    assert len(server.asked) == 1


def test_nobody_there_is_told_in_words(client: Client) -> None:
    with Scripted(nothing) as server:
        pass
    with pytest.raises(NoAnswer, match="nothing listens there: is the manager running"):
        ask(client.at(server.port))
    with pytest.raises(NoAnswer, match="its name is not known to this computer"):
        ask(client.at(1, "no.such.invalid"))
    with pytest.raises(NoAnswer, match="its name is not known to this computer"):
        ask(client.at(1, 70 * "a"))


def test_of_several_addresses_the_one_that_answers_is_found(client: Client) -> None:
    with Scripted(answers(200)) as server:  # on 127.0.0.1 alone
        assert ask(client.at(server.port, "localhost")).status == 200


# connections that were used before


def test_one_connection_serves_many_requests(client: Client) -> None:
    with Scripted(answers(200)) as server:
        connection = client.at(server.port)
        for _ in range(3):
            ask(connection)
    assert [asked.connection for asked in server.asked] == [0, 0, 0]


def test_a_connection_that_was_closed_in_between_is_found_out_before_anything_is_sent(client: Client) -> None:
    gone = threading.Semaphore(0)

    def script(_: Asked, wire: Wire) -> None:
        wire.send(said(200))
        wire.hang_up()
        gone.release()

    with Scripted(script) as server:
        connection = client.at(server.port)
        for _ in range(3):
            assert ask(connection).status == 200
            assert gone.acquire(timeout=WITHIN_S)
    assert [asked.connection for asked in server.asked] == [0, 1, 2]


def second(then: Script) -> Script:
    """The first request of each connection is answered."""
    served: set[int] = set()

    def script(asked: Asked, wire: Wire) -> None:
        if asked.connection in served:
            then(asked, wire)
        else:
            served.add(asked.connection)
            wire.send(said(200))

    return script


@pytest.mark.parametrize("hang_up", [sends(), lambda _, wire: wire.reset()])
def test_a_request_that_crosses_the_end_of_an_idle_connection_goes_out_once_more(
    client: Client, hang_up: Script
) -> None:
    with Scripted(second(hang_up)) as server:
        connection = client.at(server.port)
        ask(connection)
        assert ask(connection).status == 200
    assert [asked.connection for asked in server.asked] == [0, 0, 1]


def test_it_goes_out_once_more_and_not_thrice(client: Client) -> None:
    def script(asked: Asked, wire: Wire) -> None:
        wire.send(said(200)) if len(server.asked) == 1 else wire.hang_up()

    with Scripted(script) as server:
        connection = client.at(server.port)
        ask(connection)
        with pytest.raises(NoAnswer, match="closed without an answer"):
            ask(connection)
    assert [asked.connection for asked in server.asked] == [0, 0, 1]


@pytest.mark.parametrize("then", [nothing, sends(b"H"), sends(b"HTTP/1.1 200 OK\r\ncontent-length: 9\r\n\r\n")])
def test_where_an_answer_began_or_may_still_come_it_goes_out_once(client: Client, then: Script) -> None:
    with Scripted(second(then)) as server:
        connection = client.at(server.port)
        ask(connection)
        with pytest.raises(NoAnswer):
            ask(connection, SOON_S)
    assert len(server.asked) == 2


def test_after_no_answer_the_next_request_has_a_connection_of_its_own(client: Client) -> None:
    with Scripted(second(nothing)) as server:
        connection = client.at(server.port)
        ask(connection)
        with pytest.raises(NoAnswer):
            ask(connection, SOON_S)
        assert ask(connection).status == 200
    assert [asked.connection for asked in server.asked] == [0, 0, 1]


# streams

STREAM = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\ntransfer-encoding: chunked\r\n\r\n"


def test_a_stream_is_heard_as_it_comes_until_it_ends(client: Client) -> None:
    heard = threading.Event()

    def script(_: Asked, wire: Wire) -> None:
        wire.send(STREAM, b"3\r\nabc\r\n")
        assert heard.wait(WITHIN_S)
        wire.send(b"2\r\nde\r\n0\r\n\r\n")

    with Scripted(script) as server:
        stream = client.at(server.port).open("/events", "text/event-stream", within_s=WITHIN_S)
        assert (stream.status, stream.kind, stream.read_piece(WITHIN_S)) == (200, "text/event-stream", b"abc")
        heard.set()
        assert (stream.read_piece(WITHIN_S), stream.read_piece(WITHIN_S)) == (b"de", b"")
        stream.close()
    assert (server.asked[0].headers["accept"], server.asked[0].headers["cache-control"]) == (
        "text/event-stream",
        "no-store",
    )


@pytest.mark.parametrize(
    ("script", "why"),
    [
        (lambda _, wire: wire.send(STREAM), "no whole answer came in time"),
        (sends(STREAM, b"9\r\nab"), "half an answer came"),
    ],
)
def test_a_stream_that_falls_silent_or_breaks_is_no_answer(client: Client, script: Script, why: str) -> None:
    with Scripted(script) as server:
        stream = client.at(server.port).open("/events", "text/event-stream", within_s=WITHIN_S)
        with pytest.raises(NoAnswer, match=why):  # noqa: PT012  how many pieces come before is not said
            while stream.read_piece(SOON_S):
                pass
        stream.close()


# cut by another thread


@pytest.fixture
def full() -> Iterator[int]:
    """A port whose queue is full: whoever connects waits."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as listener:
        port: int = listener.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)):
            yield port


def cut_soon(connection: Connection) -> threading.Timer:
    timer = threading.Timer(0.05, connection.cut)
    timer.start()
    return timer


def test_a_cut_ends_what_waits_for_an_answer_and_refuses_what_comes_after(client: Client) -> None:
    with Scripted(nothing) as server:
        connection = client.at(server.port)
        timer = cut_soon(connection)
        for _ in range(2):
            with pytest.raises(NoAnswer, match="the connection"):
                ask(connection)
        timer.join()
    assert len(server.asked) == 1


def test_a_cut_ends_what_waits_for_a_connection(client: Client, full: int) -> None:
    connection = client.at(full)
    timer = cut_soon(connection)
    began = time.monotonic()
    with pytest.raises(NoAnswer):
        ask(connection)
    assert time.monotonic() - began < WITHIN_S / 2
    timer.join()


def test_a_connection_that_is_not_taken_in_time_is_no_answer(client: Client, full: int) -> None:
    with pytest.raises(NoAnswer, match="no whole answer came in time"):
        ask(client.at(full), SOON_S)


# TLS


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("ca"))


@pytest.fixture(scope="module")
def context(authority: Authority) -> ssl.SSLContext:
    shown = authority.issue("server", "127.0.0.1")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(shown.certificate, shown.key)
    return context


def test_https_with_a_ca_of_ones_own(client: Client, authority: Authority, context: ssl.SSLContext) -> None:
    with Scripted(second(sends()), context) as server:
        connection = client.at(server.port, ca_file=authority.file)
        for _ in range(2):
            assert ask(connection).status == 200
    assert [asked.connection for asked in server.asked] == [0, 0, 1]


def test_who_shows_another_certificate_is_told_no_key(
    client: Client, authority: Authority, context: ssl.SSLContext, tmp_path: Path
) -> None:
    with Scripted(answers(200), context) as server:
        for connection in (
            client.at(server.port, ca_file=Authority(tmp_path, "another").file),
            client.at(server.port, "localhost", ca_file=authority.file),
        ):
            with pytest.raises(NoAnswer, match="its certificate is not trusted here"):
                ask(connection)
    assert server.asked == []


def test_http_where_https_is_spoken_and_the_other_way_round(
    client: Client, authority: Authority, context: ssl.SSLContext
) -> None:
    with Scripted(answers(200)) as server, pytest.raises(NoAnswer, match="is its address http, not https"):
        ask(client.at(server.port, ca_file=authority.file))
    with Scripted(answers(200), context) as server, pytest.raises(NoAnswer):
        ask(client.at(server.port))


def test_a_handshake_that_does_not_end_is_cut(client: Client, authority: Authority) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        connection = client.at(listener.getsockname()[1], ca_file=authority.file)
        timer = cut_soon(connection)
        with pytest.raises(NoAnswer, match="the connection broke"):
            ask(connection)
        timer.join()
