"""`?wait=`: how long a caller would like to wait for its answer."""

from __future__ import annotations

import math

from fastapi import Request
from starlette.responses import Response

from lift_manager.web.problem import problem
from lift_manager.web.query import TOO_LONG, read_query

LONGEST_S = 30.0
"""Chosen: common proxies and clients give up on an answer after 60 s."""


def wait_s(request: Request) -> float | Response:
    """Return the seconds that the query asks for, 0 where it asks for none; or the answer that it cannot be understood."""
    query = read_query(request.scope["query_string"])
    if query.too_long:
        return problem(422, "malformed", TOO_LONG, field="wait")
    said = query.all("wait")
    if not said:
        return 0.0
    seconds = _number(said[0]) if len(said) == 1 else math.nan
    if 0.0 <= seconds <= LONGEST_S:
        return seconds
    return problem(422, "malformed", f"wait must be one number of seconds from 0 to {LONGEST_S:g}", field="wait")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
