"""`?wait=`: how long a caller would like to wait for its answer."""

from __future__ import annotations

import math
from urllib.parse import parse_qsl

from fastapi import Request
from starlette.responses import Response

from lift_manager.web.access import QUERY_LIMIT
from lift_manager.web.problem import problem

LONGEST_S = 30.0
"""Chosen: common proxies and clients give up on an answer after 60 s."""


def wait_s(request: Request) -> float | Response:
    """Return the seconds that the query asks for, 0 where it asks for none; or the answer that it cannot be understood."""
    query: bytes = request.scope["query_string"]
    pairs = parse_qsl(query[:QUERY_LIMIT].decode("utf-8", "replace"), keep_blank_values=True)
    said = [value for key, value in pairs if key == "wait"]
    if not said:
        return 0.0
    seconds = _number(said[0]) if len(said) == 1 and len(query) <= QUERY_LIMIT else math.nan
    if 0.0 <= seconds <= LONGEST_S:
        return seconds
    return problem(422, "malformed", f"wait must be one number of seconds from 0 to {LONGEST_S:g}", field="wait")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
