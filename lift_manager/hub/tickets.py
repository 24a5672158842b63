"""One-time tickets: they show that a command is fresh, by the clock of the site alone."""

from __future__ import annotations

import secrets

from lift_manager.hub.messages import TICKET_S

MOST = 64
"""Tickets that are good at the same time; the oldest goes when there is no room. Chosen: thirty commands a second of one site."""


class Tickets:
    """The tickets of one site. Times are those of its monotonic clock."""

    def __init__(self) -> None:
        self._issued: dict[str, float] = {}
        """Until when each is good, the oldest first."""

    def issue(self, now: float) -> str:
        """Return a new ticket."""
        while self._issued and (len(self._issued) >= MOST or next(iter(self._issued.values())) < now):
            del self._issued[next(iter(self._issued))]
        ticket = secrets.token_urlsafe(18)
        self._issued[ticket] = now + TICKET_S
        return ticket

    def take(self, ticket: str, now: float) -> bool:
        """Whether a ticket is good; no ticket is good twice."""
        return self._issued.pop(ticket, now) > now
