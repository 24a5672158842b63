"""Errors of /api/v1 as problem+json."""

from __future__ import annotations

from http import HTTPStatus

from starlette.responses import Response

from lift_manager.api.problem import MEDIA_TYPE, Problem

TITLES = {
    "unknown_lift": "There is no such lift",
    "offline": "The lift cannot be read",
    "fire_active": "The lift still tells of a fire",
    "nothing_to_acknowledge": "There is nothing to acknowledge",
    "locked_out": "The lift is locked out",
    "not_locked_out": "The lift is not locked out",
    "not_held": "Nobody holds the lift",
    "another_site": "Another site's web page asked",
    "other_computer": "Another computer asked",
    "too_long": "The body is too long",
    "malformed": "The body is not what is expected",
    "key_needed": "A key is needed",
    "bad_key": "The key does not count here",
    "not_allowed": "The key may not do this",
    "key_in_address": "The address holds a key",
    "not_http": "This could not be read as HTTP",
    "head_too_long": "Address and headers are too long",
}


def problem(
    status: int, code: str, detail: str, *, field: str | None = None, kind: type[Response] = Response
) -> Response:
    """The answer no, with its reason in words and as a code."""
    title = TITLES.get(code, HTTPStatus(status).phrase)
    body = Problem.of(status, code, title, detail, field).model_dump_json(exclude_none=True)
    return kind(body.encode(), status, {"cache-control": "no-store"}, MEDIA_TYPE)
