"""Age of what a client knows about a lift. Pure: times are monotonic seconds.

Ages count from the time at which the request was sent, not from when its answer arrived: how long the answer was under way is unknown.
"""

from __future__ import annotations

READINGS_PER_MAX_AGE = 3
"""Requests within the time for which an answer is valid. Chosen: two of them may be lost."""
SILENT_S = 3.0
"""A stream without any data for this long, not even a heartbeat (one each second), is dead (DESIGN)."""
DEFAULT_MAX_AGE_S = 1.0
"""The default of register maps; used until the value of the lift is known."""


def age_s(reported_age_s: float | None, sent_at: float, now: float) -> float | None:
    """Return the age of a reading that was `reported_age_s` old in the answer to a request sent at `sent_at`."""
    return None if reported_age_s is None else reported_age_s + max(0.0, now - sent_at)


def is_too_old(age: float | None, max_age_s: float) -> bool:
    """Whether a reading of this age is stale. NaN is never fresh."""
    return age is None or not age <= max_age_s


def refresh_pause_s(max_age_s: float) -> float:
    """Return the pause between two requests that keeps the answer fresh."""
    return max_age_s / READINGS_PER_MAX_AGE
