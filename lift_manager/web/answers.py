"""The answer yes of /api/v1, and what it waits for."""

from __future__ import annotations

from typing import Protocol

from pydantic import BaseModel
from starlette.responses import Response

KEPT_WITHIN_S = 0.5
"""A word that was taken is answered once it is on the disk, or after this: a slow disk delays nobody for longer. Chosen: below the time
that robots wait for an answer, and some fifty times what a write takes."""


class Keeps(Protocol):
    """Knows whether what it remembers of a lift is on the disk."""

    async def kept(self, lift: str, within_s: float) -> bool:
        """Wait until that is so; False where it takes longer than `within_s`."""
        ...


async def recorded(facade: Keeps, lift: str) -> bool:
    """Wait until everything that was taken so far for a lift is on the disk, for KEPT_WITHIN_S at the most, and say whether it is."""
    return await facade.kept(lift, KEPT_WITHIN_S)


def yes(said: BaseModel, status: int = 200, *, location: str = "", recorded: bool = True) -> Response:
    """Return it as JSON that nobody keeps. `location` is relative to the request, so that it holds behind a proxy that adds a prefix.

    `recorded` tells whether the change that it answers is on the disk.
    """
    if not recorded:
        said = said.model_copy(update={"recorded": False})
    headers = {"cache-control": "no-store"} | ({"location": location} if location else {})
    return Response(said.model_dump_json(by_alias=True), status, headers, "application/json")
