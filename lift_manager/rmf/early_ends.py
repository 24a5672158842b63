"""Sessions whose newest request was END_SESSION, kept until there is a manager that can end them. Pure."""

from __future__ import annotations

import math

from lift_manager.rmf.lift_sessions import TEXT_LIMIT
from lift_manager.rmf.messages import END_SESSION, LiftRequest

MOST_ENDS = 100
"""How many are kept; humble's supervisor sends each only once (open-rmf 1.4). Chosen: more than the robots of a site."""


class EarlyEnds:
    """What was received before the manager's first answer. Any other request of a session cancels its END."""

    def __init__(self, keep_s: float = math.inf) -> None:
        """An END is forgotten after `keep_s`."""
        self._keep_s = keep_s
        self._ended_at: dict[tuple[str, str], float] = {}
        """By lift and session, the oldest first."""

    def note(self, request: LiftRequest, now: float) -> None:
        """Take a request with any content into account."""
        ended = (request.lift_name, request.session_id)
        self._ended_at.pop(ended, None)
        fits = len(request.lift_name) <= TEXT_LIMIT and 0 < len(request.session_id) <= TEXT_LIMIT
        if request.request_type == END_SESSION and fits:
            self._ended_at[ended] = now
            if len(self._ended_at) > MOST_ENDS:
                del self._ended_at[next(iter(self._ended_at))]

    def at(self, now: float) -> list[tuple[str, str]]:
        """Return lift and session of those that are not forgotten yet, the oldest first."""
        return [ended for ended, at in self._ended_at.items() if now - at <= self._keep_s]

    def clear(self) -> None:
        """Forget all of them: the manager has answered."""
        self._ended_at.clear()
