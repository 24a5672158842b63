"""Reads the query of a request as Starlette does. All checks use the same parser, so that none can be bypassed."""

from __future__ import annotations

from functools import lru_cache

from fastapi import Request
from starlette.datastructures import QueryParams
from starlette.types import Scope

from lift_manager.web.errors import RequestError

LIMIT_BYTES = 4096
"""Chosen: lift names are short, and a caller's text is quoted in answers."""
TOO_LONG = f"the query is longer than {LIMIT_BYTES} bytes"


def named_lifts(scope: Scope) -> tuple[str, ...]:
    """Return each `lift_name` of a query. Do not act on a query that is too long: this reads only its beginning."""
    return _named_lifts(scope["query_string"][:LIMIT_BYTES])


@lru_cache(maxsize=256)  # a client polls with the same query
def _named_lifts(query: bytes) -> tuple[str, ...]:
    return tuple(QueryParams(query).getlist("lift_name"))


def require_once(request: Request, *names: str) -> None:
    """Raise RequestError for a query that is too long, or gives one of these parameters more than once."""
    if len(request.scope["query_string"]) > LIMIT_BYTES:
        raise RequestError("malformed", TOO_LONG, field=names[0])
    for name in names:
        if len(request.query_params.getlist(name)) > 1:
            raise RequestError("malformed", f"{name} is in the query more than once", field=name)
