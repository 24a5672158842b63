import asyncio
from typing import Any

from starlette.types import Message, Scope

from lift_manager.web.app import make_app
from lift_manager.web.body import LIMIT_BYTES, LINGER_BYTES
from tests.lift_manager.web.fake import FakeSite

CHUNK = 16 * 1024


class EndlessCaller:
    """Sends for ever and notes what it had sent when the answer began and when it ended."""

    def __init__(self) -> None:
        self.sent = 0
        self.messages: list[tuple[int, Message]] = []

    async def receive(self) -> Message:
        self.sent += CHUNK
        return {"type": "http.request", "body": b" " * CHUNK, "more_body": True}

    async def send(self, message: Message) -> None:
        self.messages.append((self.sent, message))


def post_scope(headers: list[tuple[bytes, bytes]]) -> Scope:
    path = "/open-rmf/demo-lift/lift_request"
    scope: dict[str, Any] = {
        "type": "http",
        "http_version": "1.1",
        "method": "POST",
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"lift_name=lift",
        "headers": headers,
    }
    return scope


def call_endlessly(headers: list[tuple[bytes, bytes]]) -> EndlessCaller:
    caller = EndlessCaller()
    asyncio.run(make_app(FakeSite())(post_scope(headers), caller.receive, caller.send))
    return caller


def test_a_body_without_end_is_answered_as_soon_as_it_is_too_long() -> None:
    caller = call_endlessly([])
    sent_at_start, start = caller.messages[0]
    sent_at_answer, answer = caller.messages[1]
    assert start["status"] == 200
    assert b'"msg":"the body is too long' in answer["body"]
    assert sent_at_start == sent_at_answer == LIMIT_BYTES + CHUNK


def test_a_declared_length_that_is_too_long_is_answered_before_anything_is_read() -> None:
    for declared in (b"65537", b"1000000", b"9" * 5000):
        sent_at_answer, _ = call_endlessly([(b"content-length", declared)]).messages[0]
        assert sent_at_answer == 0


def test_what_comes_after_the_answer_is_thrown_away_and_only_for_so_long() -> None:
    caller = call_endlessly([])
    assert caller.messages[-1][1] == {"type": "http.response.body", "body": b"", "more_body": False}
    assert caller.sent == LIMIT_BYTES + CHUNK + LINGER_BYTES
    assert dict(caller.messages[0][1]["headers"])[b"connection"] == b"close"


def test_a_declared_length_that_is_no_number_is_not_believed() -> None:
    for declared in (b"-1", b"many", "²".encode("latin-1"), b""):
        sent_at_answer, _ = call_endlessly([(b"content-length", declared)]).messages[0]
        assert sent_at_answer == LIMIT_BYTES + CHUNK
