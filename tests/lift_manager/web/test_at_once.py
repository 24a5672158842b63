"""Short requests that arrive whole are answered without the application being called, and with the same answer."""

import asyncio
import logging
from collections.abc import Callable

import pytest
import uvicorn
from fastapi import FastAPI
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from lift_manager.api.keys import Keys
from lift_manager.api.roles import Role
from lift_manager.lift.state import LiftState
from lift_manager.web.app import make_app
from lift_manager.web.body import LIMIT_BYTES
from lift_manager.web.connections import ConnectionLimits, Connections
from lift_manager.web.http_protocol import JsonHttpProtocol
from lift_manager.web.server import KEEP_ALIVE_S
from tests.lift_manager.web.fake import ACCEPTED, BASE, CALL, REQUEST, STATE, FakeSite
from tests.lift_manager.web.keyed import bearing, ring
from tests.support.rows import each_row
from tests.support.virtual_time import elapse, run_virtual

Called = list[str]


class Wire(asyncio.Transport):
    """The server's end of a connection, without a network."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = b""
        self.is_closed = False

    def is_closing(self) -> bool:
        return self.is_closed

    def close(self) -> None:
        self.is_closed = True

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.sent += data

    def pause_reading(self) -> None:
        """Nothing is read from it."""

    def resume_reading(self) -> None:
        """Nothing is read from it."""


def connect(app: FastAPI, *, at_once: bool = True) -> tuple[JsonHttpProtocol, Wire, Called]:
    """A connection to an application, and the paths with which it was called."""
    called: Called = []

    async def noted(scope: Scope, receive: Receive, send: Send) -> None:
        called.append(scope["path"])
        await app(scope, receive, send)

    config = uvicorn.Config(noted, log_config=None, timeout_keep_alive=KEEP_ALIVE_S)
    config.load()
    state = ServerState()
    state.default_headers = [(b"date", b"today")]
    reply = app.reply_at_once if at_once else None  # type: ignore[attr-defined]
    protocol, wire = JsonHttpProtocol(config, state, {}, Connections(ConnectionLimits.of(10)), reply), Wire()
    protocol.connection_made(wire)
    return protocol, wire, called


def request(target: str, body: bytes = b"", *, version: str = "1.1", **headers: str) -> bytes:
    lines = [f"{'POST' if body else 'GET'} {target} HTTP/{version}", "Host: 127.0.0.1"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    lines += [f"Content-Length: {len(body)}"] if body else []
    return "\r\n".join([*lines, "", ""]).encode() + body


NAMES = request(f"{BASE}/lift_names")
ONE_STATE = request(f"{STATE}?lift_name=lift")
ONE_CALL = request(REQUEST, CALL)
KEYED = ring(Role.ROBOT, Role.VIEWER)
KEY, OF_A_VIEWER = (bearing(role)["Authorization"] for role in (Role.ROBOT, Role.VIEWER))


@each_row(
    ("sent", "keys"),
    [
        (NAMES, None),
        (ONE_STATE, None),
        (ONE_CALL, None),
        (request(f"{STATE}?lift_name=cellar"), None),
        (request(STATE), None),
        (request(f"{STATE}?lift_name=lift", version="1.0"), None),
        (request(f"{STATE}?lift_name=lift", version="1.0", Connection="keep-alive"), None),
        (request(f"{STATE}?lift_name=lift", Connection="close"), None),
        (request(REQUEST, CALL, Connection="close"), None),
        (request(REQUEST, b"{"), None),
        (request(REQUEST, CALL, Origin="http://elsewhere"), None),
        (request(f"{STATE}?lift_name=lift").replace(b"127.0.0.1", b"elsewhere"), None),
        (request(REQUEST, CALL).replace(b"127.0.0.1", b"elsewhere"), None),
        (request(f"{STATE}?lift_name=lift", b"which nobody reads").replace(b"POST", b"GET", 1), None),
        (request(f"{STATE}?lift_name=lm_12345678_1234567890123"), None),
        (ONE_STATE, KEYED),
        (ONE_CALL, KEYED),
        (request(f"{STATE}?lift_name=lift", Authorization=KEY), KEYED),
        (request(REQUEST, CALL, Authorization=KEY), KEYED),
        (request(REQUEST, CALL, Authorization=OF_A_VIEWER), KEYED),
        (request(REQUEST, CALL, Authorization="Bearer wrong"), KEYED),
    ],
)
def test_the_answer_is_that_of_the_application_byte_for_byte(sent: bytes, keys: Keys | None) -> None:
    async def main() -> None:
        found = []
        for at_once in (True, False):
            site = FakeSite()
            protocol, wire, called = connect(make_app(site, keys), at_once=at_once)
            protocol.data_received(sent)
            assert bool(wire.sent) is at_once
            await elapse(0.01)
            assert bool(called) is not at_once
            found.append((wire.sent, wire.is_closed, site.requests, site.away))
        assert found[0] == found[1]

    run_virtual(main)


def test_a_request_in_pieces_is_answered_all_the_same() -> None:
    async def main() -> None:
        protocol, wire, _ = connect(make_app(site := FakeSite()))
        for at in range(0, len(ONE_CALL), 7):
            protocol.data_received(ONE_CALL[at : at + 7])
            await elapse(0.01)
        assert wire.sent.endswith(ACCEPTED)
        assert len(site.requests) == 1

    run_virtual(main)


def test_requests_in_one_packet_are_answered_in_their_order_and_all_but_one_in_their_turn() -> None:
    async def main() -> None:
        protocol, wire, called = connect(make_app(site := FakeSite()))
        protocol.data_received((NAMES + ONE_CALL + ONE_STATE) * 20)
        assert wire.sent.count(b"HTTP/1.1 200 OK") == 1
        await elapse(0.01)
        contents = [reply.partition(b"\r\n\r\n")[2] for reply in wire.sent.split(b"HTTP/1.1 200 OK")[1:]]
        assert contents == contents[:3] * 20
        assert [b"lift_names" in contents[0], contents[1], b"door_state" in contents[2]] == [True, ACCEPTED, True]
        assert len(called) == 59
        assert len(site.requests) == 20

    run_virtual(main)


def test_a_client_that_does_not_read_is_answered_once_it_does() -> None:
    async def main() -> None:
        protocol, wire, _ = connect(make_app(FakeSite()))
        protocol.pause_writing()
        protocol.data_received(ONE_STATE)
        await elapse(1)
        assert not wire.sent
        protocol.resume_writing()
        await elapse(0.01)
        assert wire.sent.startswith(b"HTTP/1.1 200 OK")

    run_virtual(main)


def test_who_may_wait_for_a_hundred_continue_gets_it() -> None:
    async def main() -> None:
        protocol, wire, called = connect(make_app(FakeSite()))
        protocol.data_received(request(REQUEST, CALL, Expect="100-continue"))
        await elapse(0.01)
        assert wire.sent.startswith(b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK")
        assert len(called) == 1

    run_virtual(main)


@each_row("declared", [str(LIMIT_BYTES + 1), "0" * 20 + str(len(CALL))])
def test_a_body_that_is_or_claims_to_be_too_long_is_left_to_the_application(declared: str) -> None:
    async def main() -> None:
        protocol, wire, called = connect(make_app(site := FakeSite()))
        body = CALL.ljust(int(declared))
        protocol.data_received(request(REQUEST, body).replace(f": {len(body)}".encode(), f": {declared}".encode()))
        await elapse(2)
        assert b"the body is too long" in wire.sent
        assert (len(called), site.requests) == (1, [])

    run_virtual(main)


class Broken(FakeSite):
    """It cannot tell the state of a lift."""

    def lasting_state(self, lift: str) -> LiftState:
        raise ZeroDivisionError


def test_a_bug_is_logged_once_and_the_connection_serves_on(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        protocol, wire, called = connect(make_app(Broken()))
        protocol.data_received(ONE_STATE)
        assert wire.sent.startswith(b"HTTP/1.1 500 Internal Server Error")
        assert b"internal error; the manager's log has the details" in wire.sent
        protocol.data_received(NAMES)
        assert wire.sent.count(b"HTTP/1.1 200 OK") == 1
        assert not called

    run_virtual(main)
    (record,) = (entry for entry in caplog.records if entry.levelno >= logging.ERROR)
    assert record.getMessage() == f"GET {STATE} failed"
    assert record.exc_info is not None
    assert record.exc_info[0] is ZeroDivisionError


Act = Callable[[JsonHttpProtocol], object]


@each_row(("act", "closes"), [(lambda _: None, True), (lambda line: line.data_received(NAMES[:20]), False)])
def test_a_connection_is_closed_a_minute_after_its_newest_answer_unless_the_next_request_has_begun(
    act: Act, closes: bool
) -> None:
    async def main() -> None:
        protocol, wire, _ = connect(make_app(FakeSite()))
        for _ in range(4):
            protocol.data_received(ONE_STATE)
            await elapse(KEEP_ALIVE_S - 1)
            assert not wire.is_closed
        act(protocol)
        await elapse(2)
        assert wire.is_closed is closes
        protocol.connection_lost(None)

    run_virtual(main)


def test_no_timer_of_a_lost_connection_is_left() -> None:
    async def main() -> None:
        protocol, _, _ = connect(make_app(FakeSite()))
        protocol.data_received(ONE_STATE)
        timer = protocol.timeout_keep_alive_task
        assert timer is not None
        protocol.connection_lost(ConnectionResetError())
        assert timer.cancelled()

    run_virtual(main)
