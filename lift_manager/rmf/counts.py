"""The counters of an adapter."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Counts:
    """Counters since the adapter started. Keys are (RMF's lift name or empty, label value)."""

    requests: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Requests by what was done with them, a value of `lift_sessions.Disposition`."""
    states: Counter[str] = field(default_factory=Counter)
    """Published LiftStates, by lift."""
