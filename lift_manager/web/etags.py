"""ETag and If-None-Match: an answer that is as the caller has it but for the passing of time is not sent again."""

from __future__ import annotations

import re
from collections.abc import Iterable
from hashlib import blake2b

from fastapi import Request
from pydantic import BaseModel
from starlette.responses import Response

from lift_manager.api.lifts import AGE_HEADER

_TAG = re.compile(r'"([^"]*)"')


def unless_known(request: Request, said: BaseModel, timeless: BaseModel, age_s: float | None) -> Response:
    """Return 200 with `said`, or 304 to who has it; the tag is that of `timeless`, which is `said` without ages and durations."""
    tag = blake2b(timeless.model_dump_json().encode(), digest_size=12).hexdigest()
    # weak: two bodies of one tag differ in their ages. `no-cache`: a cache may keep it, and has to ask each time
    headers = {"etag": f'W/"{tag}"', "cache-control": "no-cache"}
    if age_s is not None:
        headers[AGE_HEADER] = f"{age_s:.3f}"
    if is_known(tag, request.headers.getlist("if-none-match")):
        return Response(None, 304, headers)
    return Response(said.model_dump_json(by_alias=True), 200, headers, "application/json")


def is_known(tag: str, lines: Iterable[str]) -> bool:
    """Whether If-None-Match names the tag, by the weak comparison of RFC 9110; what is no list of tags names none."""
    return any(line.strip() == "*" or tag in _TAG.findall(line) for line in lines)
