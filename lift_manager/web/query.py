"""The query of an address, as Starlette reads it. There is one way to read it: two would be a way past a check."""

from __future__ import annotations

from fastapi import Request
from starlette.datastructures import QueryParams
from starlette.types import Scope

from lift_manager.web.errors import RequestError

LIMIT_BYTES = 4096
"""Chosen: lift names are short, and a caller's text is quoted in answers."""
TOO_LONG = f"the query is longer than {LIMIT_BYTES} bytes"


def named_lifts(scope: Scope) -> list[str]:
    """Return each `lift_name` of a query. Nothing of one that is too long may be acted on: this is of its beginning."""
    return QueryParams(scope["query_string"][:LIMIT_BYTES]).getlist("lift_name")


def require_once(request: Request, *names: str) -> None:
    """Raise RequestError for a query that is too long, or gives one of these parameters more than once."""
    if len(request.scope["query_string"]) > LIMIT_BYTES:
        raise RequestError("malformed", TOO_LONG, field=names[0])
    for name in names:
        if len(request.query_params.getlist(name)) > 1:
            raise RequestError("malformed", f"{name} is in the query more than once", field=name)
