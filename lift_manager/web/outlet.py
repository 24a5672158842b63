"""Sends parts of a reply that has begun without waiting: for an endless reply, `send` costs several times as much."""

from __future__ import annotations

from starlette.types import Scope
from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

KEY = "lift_manager.outlet"
"""Key in the extensions that the server passes with each request."""


class Outlet:
    """Where the rest of one reply goes."""

    def __init__(self, cycle: RequestResponseCycle) -> None:
        self._cycle = cycle

    @property
    def has_room(self) -> bool:
        """Whether the reply goes on, and its client takes it."""
        cycle = self._cycle
        is_over = cycle.response_complete or cycle.disconnected or cycle.transport.is_closing()
        return bool(cycle.chunked_encoding) and not is_over and not cycle.flow.write_paused

    def write(self, part: bytes) -> None:
        """Send the next part; only while there is room."""
        self._cycle.transport.write(b"%x\r\n%b\r\n" % (len(part), part))


def outlet_of(scope: Scope) -> Outlet | None:
    """Return the outlet of the reply to a request; None if its server has none."""
    found = scope.get("extensions", {}).get(KEY)
    return found if isinstance(found, Outlet) else None
