"""The answers of each face: the envelope of the workshop API, problem+json under /api, `{"detail": ...}` elsewhere."""

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
from lift_manager.web.codes import title
from lift_manager.web.errors import RequestError

NO_STORE = {"cache-control": "no-store"}
"""An answer that was stored is out of date."""

Model = TypeVar("Model", bound=BaseModel)

_encode = json.JSONEncoder(ensure_ascii=False, separators=(",", ":")).encode


def request_error(refused: RequestRefused, field: str | None = None) -> RequestError:
    """Return a refusal of the site as one of this face; `field` is the key of the body that it is about."""
    return RequestError(refused.code, refused.message, field=field, blocking=refused.blocking)


@contextmanager
def naming_field(fields: Mapping[Refusal, str]) -> Iterator[None]:
    """Add the key of the body that a refusal is about, by its code."""
    try:
        yield
    except RequestRefused as refused:
        raise request_error(refused, fields.get(refused.code)) from refused


def marked(changed: Model, *, recorded: bool) -> Model:
    """Return the answer to a change, one with a field `recorded`, that tells whether the change is on the disk."""
    return changed.model_copy(update={"recorded": recorded})


def is_workshop(path: str) -> bool:
    """Whether a path belongs to the workshop API."""
    return path == "/open-rmf" or path.startswith("/open-rmf/")


def is_api(path: str) -> bool:
    """Whether a path belongs to /api."""
    return path == "/api" or path.startswith("/api/")


def succeeded(data: Mapping[str, object]) -> Response:
    """Return the workshop API's answer to a request that was carried out."""
    return _envelope({"data": data, "success": True, "msg": ""}, 200)


def failed(message: str, status: int = 200) -> Response:
    """Return the workshop API's answer to one that was not: HTTP 200, because its clients look at `success` alone."""
    return _envelope({"data": {}, "success": False, "msg": message}, status)


def answer(path: str, error: RequestError) -> Response:
    """Return the answer to a request that is not carried out, in the form of the face that was addressed."""
    if is_workshop(path):
        made = failed(error.message, error.status)
    elif is_api(path):
        made = _problem(error)
    else:
        made = JSONResponse({"detail": error.message}, error.status)
    made.headers.update(error.headers or {})
    return made


def not_found(path: str) -> RequestError:
    """Return the error for a path that does not exist."""
    return RequestError("no_such_path", _hint(path, "Not Found"))


def wrong_method(path: str, methods: tuple[str, ...]) -> RequestError:
    """Return the error for a path that takes other methods."""
    return RequestError("wrong_method", _hint(path, "Method Not Allowed"), headers={"allow": ", ".join(methods)})


def _hint(path: str, text: str) -> str:
    routes = "GET lift_names, GET lift_state?lift_name=, POST lift_request?lift_name="
    return f"{text}; under /open-rmf/demo-lift/ there are: {routes}" if is_workshop(path) else text


def _problem(error: RequestError) -> Response:
    heading = title(error.code, error.status)
    problem = Problem.of(error.status, error.code, heading, error.message, error.field, error.blocking)
    return Response(problem.model_dump_json(exclude_none=True).encode(), error.status, NO_STORE, MEDIA_TYPE)


def _envelope(content: Mapping[str, object], status: int) -> Response:
    # surrogates from a caller's JSON have no UTF-8; a backslash escape is what JSON would have written for them
    body = _encode(content).encode("utf-8", "backslashreplace")
    return Response(body, status, NO_STORE, "application/json")
