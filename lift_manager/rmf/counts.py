"""What an adapter counts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Counts:
    """Since the adapter started. Keys are (RMF's lift name or empty, word)."""

    requests: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Requests by what was done with them: `granted`, `updated`, `repeated`, `ended`, or why one was ignored (`contract.Ignored`)."""
    states: Counter[str] = field(default_factory=Counter)
    """LiftStates published, by lift."""
