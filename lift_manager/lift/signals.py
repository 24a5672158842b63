"""What a lift tells signal by signal."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.model import SignalValue


@dataclass(frozen=True, slots=True)
class LiftSignals:
    """Every signal of a lift as it was read last."""

    lift: str
    age_s: float | None
    """Of the last whole reading; None when there never was one."""
    max_age_s: float
    """Older than this nothing of it may be acted on."""
    signals: tuple[SignalValue, ...]
