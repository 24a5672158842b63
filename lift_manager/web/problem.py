"""Errors of /api/v1 as problem+json."""

from __future__ import annotations

from starlette.responses import Response

from lift_manager.api.problem import MEDIA_TYPE, Problem
from lift_manager.domain.asking import Blocking, Refused
from lift_manager.web.codes import REFUSALS, title


def problem(
    status: int,
    code: str,
    detail: str,
    *,
    field: str | None = None,
    blocking: Blocking | None = None,
    kind: type[Response] = Response,
) -> Response:
    """The answer no, with its reason in words and as a code."""
    said = Problem.of(status, code, title(code, status), detail, field, blocking)
    body = said.model_dump_json(exclude_none=True)
    return kind(body.encode(), status, {"cache-control": "no-store"}, MEDIA_TYPE)


def refused(no: Refused, field: str | None = None) -> Response:
    """The manager's answer no; `field` is the key of the body that is to blame, if one is."""
    return problem(REFUSALS[no.code].status, no.code, no.message, field=field, blocking=no.blocking)
