"""The answer no, in the form of the face that was asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from starlette.responses import JSONResponse, Response

from lift_manager.web.envelope import failed
from lift_manager.web.problem import problem


class No(NamedTuple):
    """Why a request got as far as this and no further."""

    status: int
    code: str
    """Stable, for programs; only /api/v1 has a place for it."""
    text: str
    headers: Mapping[str, str] | None = None


def is_workshop(path: str) -> bool:
    """Whether this is asked of the workshop API."""
    return path == "/open-rmf" or path.startswith("/open-rmf/")


def is_api(path: str) -> bool:
    """Whether this is asked of /api."""
    return path == "/api" or path.startswith("/api/")


def answer(path: str, no: No, kind: type[Response] = Response) -> Response:
    """Return the answer: the envelope of the workshop API, problem+json under /api, `{"detail": ...}` elsewhere."""
    if is_workshop(path):
        said = failed(no.text, kind, status=no.status)
    elif is_api(path):
        said = problem(no.status, no.code, no.text, kind=kind)
    else:
        plain = JSONResponse({"detail": no.text})
        said = kind(bytes(plain.body), no.status, None, "application/json")
    said.headers.update(no.headers or {})
    return said


def not_found(path: str) -> No:
    """Return the answer for a path where nothing is."""
    return No(404, "no_such_path", _hint(path, "Not Found"))


def wrong_method(path: str, methods: tuple[str, ...]) -> No:
    """Return the answer for a path that takes other methods."""
    return No(405, "wrong_method", _hint(path, "Method Not Allowed"), {"allow": ", ".join(methods)})


def _hint(path: str, text: str) -> str:
    routes = "GET lift_names, GET lift_state?lift_name=, POST lift_request?lift_name="
    return f"{text}; under /open-rmf/demo-lift/ there are: {routes}" if is_workshop(path) else text
