"""The envelope of the workshop API: `{"data":{...},"success":true,"msg":""}`, compact and in this order."""

from __future__ import annotations

import json
from collections.abc import Mapping

from starlette.responses import Response

_encode = json.JSONEncoder(ensure_ascii=False, separators=(",", ":")).encode


def succeeded(data: Mapping[str, object]) -> Response:
    """The answer yes."""
    return _envelope({"data": data, "success": True, "msg": ""}, 200, Response)


def failed(message: str, kind: type[Response] = Response, *, status: int = 200) -> Response:
    """The answer no; HTTP 200 because the clients look at `success` alone."""
    return _envelope({"data": {}, "success": False, "msg": message}, status, kind)


def _envelope(content: Mapping[str, object], status: int, kind: type[Response]) -> Response:
    # surrogates from a caller's JSON have no UTF-8; a backslash escape is what JSON would have written for them
    body = _encode(content).encode("utf-8", "backslashreplace")
    # a cached state is an old state
    return kind(body, status, {"cache-control": "no-store"}, "application/json")
