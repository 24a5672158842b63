"""Records what the hub's API decides about its callers: a hub has no journal of its own."""

from __future__ import annotations

import logging
from collections import Counter

from lift_manager.runtime.refusals import FaceRefusal

_log = logging.getLogger(__name__)


class HubFaceLog:
    """Counts requests that were refused, and logs who logged in."""

    def __init__(self) -> None:
        self.refusals = Counter[str]()
        """By code."""

    def turned_away(self, who: FaceRefusal) -> None:
        """Count a request that was refused."""
        self.refusals[who.code] += 1

    def logged_in(self, key: str, address: str, *, ended: bool = False) -> None:
        """Log that a browser logged in with this key, or out."""
        action = "out" if ended else "in"
        _log.info("a browser logged %s with the key %s, from %s", action, key, address or "an unknown address")
