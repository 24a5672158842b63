"""Take a request's body off the wire, however long, late or broken it is."""

from __future__ import annotations

import asyncio
import json
from typing import NoReturn

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from lift_manager.api.keys import holds_key
from lift_manager.web.errors import RequestError

LIMIT_BYTES = 64 * 1024
"""Chosen: a request is about 40 bytes."""
ARRIVES_WITHIN_S = 1.0
"""The workshop's clients give up after 1 s, so nobody waits for a later body."""
KEYS_LIMIT = 100
"""Of one object. Chosen: a request has two."""
LINGER_S = 1.0
LINGER_BYTES = 4 * 1024 * 1024
"""Chosen: room for a client that sends some megabytes before it looks at the answer."""


async def read_body(request: Request) -> bytes:
    """The whole body, at most `LIMIT_BYTES` of it.

    Raises RequestError when it is too long, too late or cut off. A declared length is only believed when it is too long.
    """
    declared = request.headers.get("content-length", "")
    if declared.isdecimal() and (len(declared) > 18 or int(declared) > LIMIT_BYTES):
        raise _too_long()
    body = bytearray()
    try:
        async with asyncio.timeout(ARRIVES_WITHIN_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > LIMIT_BYTES:
                    raise _too_long()
    except TimeoutError as late:
        raise RequestError("malformed", f"the body did not arrive within {ARRIVES_WITHIN_S:g} s") from late
    except ClientDisconnect as gone:
        raise RequestError("malformed", "the connection ended before the body did") from gone
    return bytes(body)


def _too_long() -> RequestError:
    return RequestError("too_long", f"the body is too long; at most {LIMIT_BYTES} bytes are read")


def decode_object(body: bytes) -> dict[str, object]:
    """The JSON object that the body holds, whatever content type was declared for it.

    Raises RequestError for anything else, ambiguity (the same key twice, NaN) and an API key included: what is said here is quoted
    in answers and written down.
    """
    if not body.strip():
        raise RequestError("malformed", "the body is empty")
    try:
        # utf-8-sig: some Windows tools put a byte order mark in front
        value = json.loads(body.decode("utf-8-sig"), object_pairs_hook=_unique_keys, parse_constant=_no_constant)
        has_key = holds_key(json.dumps(value, ensure_ascii=False))
    except UnicodeDecodeError as error:
        raise RequestError("malformed", f"the body is not UTF-8 (byte {error.start})") from error
    except json.JSONDecodeError as error:
        raise RequestError("malformed", f"the body is not JSON ({error.msg}, character {error.pos})") from error
    except ValueError as error:  # an integer of thousands of digits
        raise RequestError("malformed", "the body holds a number that is too long") from error
    except RecursionError as error:
        raise RequestError("malformed", "the body is nested too deeply") from error
    if has_key:
        raise RequestError(
            "malformed",
            "the body holds what looks like an API key; revoke that one, and send the next in the header"
            " `Authorization: Bearer ...` alone",
        )
    if not isinstance(value, dict):
        raise RequestError("malformed", f"the body must be a JSON object, not {shown(value)}")
    return value


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    if len(pairs) > KEYS_LIMIT:
        raise RequestError("malformed", f"an object in the body has {len(pairs)} keys; at most {KEYS_LIMIT} are read")
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise RequestError("malformed", f"the key {shown(key)} is in the body twice")
        found[key] = value
    return found


def _no_constant(name: str) -> NoReturn:
    raise RequestError("malformed", f"{name} is not JSON")


def shown(value: object) -> str:
    """A caller's value as it may be quoted in a message: short, and always printable."""
    match value:
        case dict():
            return "an object"
        case list():
            return "a list"
        case _:
            text = json.dumps(value, ensure_ascii=isinstance(value, str) and not value.isprintable())
            if holds_key(text):
                return "[an API key]"
            return text if len(text) <= 60 else f"{text[:60]}..."


class LingeringResponse(Response):
    """Another response, for a caller who may still be sending.

    It goes out at once. What still comes is thrown away for a bounded while, because closing with unread data resets the
    connection, and a client that sends everything before it reads would then never see the answer.
    """

    def __init__(self, made: Response) -> None:
        super().__init__(made.body, made.status_code, {**made.headers, "connection": "close"})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": bytes(self.body), "more_body": True})
        await _discard(receive)
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _discard(receive: Receive) -> None:
    left = LINGER_BYTES
    try:
        async with asyncio.timeout(LINGER_S):
            while left > 0:
                message = await receive()
                if not message.get("more_body", False):
                    return
                left -= len(message["body"])
    except TimeoutError:
        return
