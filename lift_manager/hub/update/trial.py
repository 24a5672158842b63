"""Judges a configuration on trial by what its lifts do. Pure."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum, unique

FIRST_READINGS_S = 60.0
"""How long lifts may take to be read after a start. Chosen: a controller with one slot may keep it for half a minute."""
OFFLINE_S = 30.0
"""How long a lift may be offline after that. Chosen: a lost connection is made again within seconds."""
TRIAL_S = 600.0
"""How long a trial lasts. Chosen: long enough for some thousand polls of each lift, and short enough to wait for."""


@unique
class Judgement(StrEnum):
    """What has become of a trial."""

    OPEN = "open"
    PASSED = "passed"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial since the start of the manager. Times are monotonic seconds."""

    began_at: float
    offline_since: float | None = None
    """Since when some lift has been offline that could be read before."""
    judgement: Judgement = Judgement.OPEN
    why: str = ""

    def observed(self, now: float, offline: Collection[str], alarm: str) -> Trial:
        """Return the trial after another look: `offline` are lifts that could be read before, `alarm` a new one; empty for none."""
        if self.judgement is not Judgement.OPEN:
            return self
        if alarm:
            return replace(self, judgement=Judgement.FAILED, why=f"an alarm: {alarm}")
        since = (now if self.offline_since is None else self.offline_since) if offline else None
        if since is not None and now - since >= OFFLINE_S and now - self.began_at >= FIRST_READINGS_S:
            why = f"{', '.join(offline)} could be read before, and cannot be read now"
            return replace(self, offline_since=since, judgement=Judgement.FAILED, why=why)
        if since is None and now - self.began_at >= TRIAL_S:
            return replace(self, offline_since=None, judgement=Judgement.PASSED)
        return replace(self, offline_since=since)
