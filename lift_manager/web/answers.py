"""The answer yes of /api/v1."""

from __future__ import annotations

from pydantic import BaseModel
from starlette.responses import Response


def yes(said: BaseModel, status: int = 200, *, location: str = "") -> Response:
    """Return it as JSON that nobody keeps. `location` is relative to the request, so that it holds behind a proxy that adds a prefix."""
    headers = {"cache-control": "no-store"} | ({"location": location} if location else {})
    return Response(said.model_dump_json(by_alias=True), status, headers, "application/json")
