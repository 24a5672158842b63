"""The answer yes of /api/v1, and what it waits for."""

from __future__ import annotations

from pydantic import BaseModel
from starlette.responses import Response

KEPT_WITHIN_S = 0.5
"""A word that was taken is answered once it is on the disk, or after this: a slow disk delays nobody for longer. Chosen: below the time
that robots wait for an answer, and some fifty times what a write takes."""


def yes(said: BaseModel, status: int = 200, *, location: str = "") -> Response:
    """Return it as JSON that nobody keeps. `location` is relative to the request, so that it holds behind a proxy that adds a prefix."""
    headers = {"cache-control": "no-store"} | ({"location": location} if location else {})
    return Response(said.model_dump_json(by_alias=True), status, headers, "application/json")
