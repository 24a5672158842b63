"""The replies of each face: the envelope of the workshop API, problem+json under /api, `{"detail": ...}` elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from pydantic import BaseModel
from starlette.responses import JSONResponse, Response

from lift_manager.api.problem import MEDIA_TYPE, Problem
from lift_manager.lift.refusals import Refusal
from lift_manager.runtime.errors import RequestRefused
from lift_manager.web.error_codes import title
from lift_manager.web.errors import RequestError

NO_STORE = {"cache-control": "no-store"}
"""A cached reply would be out of date."""

Model = TypeVar("Model", bound=BaseModel)

_encode = json.JSONEncoder(ensure_ascii=False, separators=(",", ":")).encode


def request_error(refused: RequestRefused, field: str | None = None) -> RequestError:
    """Convert a refusal of the site; `field` is the key of the body that it concerns."""
    return RequestError(refused.code, refused.message, field=field, blocking=refused.blocking)


@contextmanager
def naming_field(fields: Mapping[Refusal, str]) -> Iterator[None]:
    """Add the key of the body that a refusal concerns, by its code."""
    try:
        yield
    except RequestRefused as refused:
        raise request_error(refused, fields.get(refused.code)) from refused


def with_recorded(changed: Model, *, recorded: bool) -> Model:
    """Return the reply to a change with its field `recorded` set: whether the change is on the disk."""
    return changed.model_copy(update={"recorded": recorded})


def is_workshop(path: str) -> bool:
    """Whether a path belongs to the workshop API."""
    return path == "/open-rmf" or path.startswith("/open-rmf/")


def is_api(path: str) -> bool:
    """Whether a path belongs to /api."""
    return path == "/api" or path.startswith("/api/")


def workshop_success(data: Mapping[str, object]) -> Response:
    """Return the reply of the workshop API to a request that succeeded."""
    return _envelope({"data": data, "success": True, "msg": ""}, 200)


def workshop_failure(message: str, status: int = 200) -> Response:
    """Return the reply of the workshop API to a request that failed: HTTP 200, because its clients only look at `success`."""
    return _envelope({"data": {}, "success": False, "msg": message}, status)


def error_reply(path: str, error: RequestError) -> Response:
    """Return the reply to a failed request in the format of the requested face."""
    if is_workshop(path):
        reply = workshop_failure(error.message, error.status)
    elif is_api(path):
        reply = _problem(error)
    else:
        reply = JSONResponse({"detail": error.message}, error.status)
    reply.headers.update(error.headers or {})
    return reply


def not_found(path: str) -> RequestError:
    """Return the error for a path that does not exist."""
    return RequestError("no_such_path", _hint(path, "Not Found"))


def wrong_method(path: str, methods: tuple[str, ...]) -> RequestError:
    """Return the error for a path that accepts other methods only."""
    return RequestError("wrong_method", _hint(path, "Method Not Allowed"), headers={"allow": ", ".join(methods)})


def _hint(path: str, text: str) -> str:
    routes = "GET lift_names, GET lift_state?lift_name=, POST lift_request?lift_name="
    return f"{text}; under /open-rmf/demo-lift/ there are: {routes}" if is_workshop(path) else text


def _problem(error: RequestError) -> Response:
    heading = title(error.code, error.status)
    problem = Problem.of(error.status, error.code, heading, error.message, error.field, error.blocking)
    return Response(problem.model_dump_json(exclude_none=True).encode(), error.status, NO_STORE, MEDIA_TYPE)


def _envelope(content: Mapping[str, object], status: int) -> Response:
    # a surrogate from a caller's JSON has no UTF-8; JSON writes it as a backslash escape
    body = _encode(content).encode("utf-8", "backslashreplace")
    return Response(body, status, NO_STORE, "application/json")
