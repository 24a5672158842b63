"""How old what is known is. Pure: monotonic seconds go in.

A time is counted from when the question left, not from when the answer came: how long an answer was under way, nobody can say.
"""

from __future__ import annotations

ASK_EVERY = 3
"""Chosen: so many questions within the time that an answer is good for; two may be lost."""
SILENT_S = 3.0
"""DESIGN: a stream that says nothing for so long, not even a heartbeat (one each second), is dead."""
DEFAULT_MAX_AGE_S = 1.0
"""That of a register map which says nothing else; used until the lift's own is known."""


def age_s(told_s: float | None, asked_at: float, now: float) -> float | None:
    """Return the age of a reading that was `told_s` old in the answer to a question of `asked_at`."""
    return None if told_s is None else told_s + max(0.0, now - asked_at)


def is_too_old(age: float | None, max_age_s: float) -> bool:
    """Whether nothing may be concluded from it any more. What is no number (NaN) is never fresh."""
    return age is None or not age <= max_age_s


def ask_again_s(max_age_s: float) -> float:
    """Return the pause between two questions that keep an answer fresh."""
    return max_age_s / ASK_EVERY
