"""Reads the body of a request safely, however long, late or broken it is."""

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
BODY_WITHIN_S = 1.0
"""Clients of the workshop API give up after 1 s, so a later body is useless."""
KEYS_LIMIT = 100
"""Per object. Chosen: a request has two."""
LINGER_S = 1.0
LINGER_BYTES = 4 * 1024 * 1024
"""Chosen: enough for a client that sends a few megabytes before it reads the reply."""

_as_text = json.JSONEncoder(ensure_ascii=False).encode


async def read_body(request: Request) -> bytes:
    """Return the whole body, at most `LIMIT_BYTES`.

    Raises RequestError if it is too long, late or truncated. A declared length is only trusted if it is too long.
    """
    if is_too_long(request):
        raise _too_long()
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_WITHIN_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > LIMIT_BYTES:
                    raise _too_long()
    except TimeoutError as error:
        raise RequestError("malformed", f"the body did not arrive within {BODY_WITHIN_S:g} s") from error
    except ClientDisconnect as error:
        raise RequestError("malformed", "the connection ended before the body did") from error
    return bytes(body)


def is_too_long(request: Request, received: int = 0) -> bool:
    """Whether a request declares a body longer than `LIMIT_BYTES`, or so many bytes of it have arrived."""
    declared = request.headers.get("content-length", "")
    return received > LIMIT_BYTES or (declared.isdecimal() and (len(declared) > 18 or int(declared) > LIMIT_BYTES))


def _too_long() -> RequestError:
    return RequestError("too_long", f"the body is too long; at most {LIMIT_BYTES} bytes are read")


def decode_object(body: bytes) -> dict[str, object]:
    """Return the JSON object in a body, whatever its declared content type.

    Raises RequestError for anything else, including ambiguity (a repeated key, NaN) and an API key, because values are quoted in
    replies and in the journal.
    """
    if not body.strip():
        raise RequestError("malformed", "the body is empty")
    try:
        # utf-8-sig: some Windows tools put a byte order mark in front
        value = json.loads(body.decode("utf-8-sig"), object_pairs_hook=_unique_keys, parse_constant=_refuse_constant)
        has_key = holds_key(_as_text(value))
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
        raise RequestError("malformed", f"the body must be a JSON object, not {quoted(value)}")
    return value


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    if len(pairs) > KEYS_LIMIT:
        raise RequestError("malformed", f"an object in the body has {len(pairs)} keys; at most {KEYS_LIMIT} are read")
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise RequestError("malformed", f"the key {quoted(key)} is in the body twice")
        found[key] = value
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise RequestError("malformed", f"{name} is not JSON")


def quoted(value: object) -> str:
    """Return a value from a caller in a form for messages: short and printable."""
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
    """A response for a caller that may still be sending.

    It is sent at once. Further data is discarded for a bounded time, because closing with unread data resets the connection, and a
    client that sends everything before it reads would never see the reply.
    """

    def __init__(self, reply: Response) -> None:
        super().__init__(reply.body, reply.status_code, {**reply.headers, "connection": "close"})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        await send({"type": "http.response.body", "body": bytes(self.body), "more_body": True})
        await _discard(receive)
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _discard(receive: Receive) -> None:
    remaining = LINGER_BYTES
    try:
        async with asyncio.timeout(LINGER_S):
            while remaining > 0:
                message = await receive()
                if not message.get("more_body", False):
                    return
                remaining -= len(message["body"])
    except TimeoutError:
        return
