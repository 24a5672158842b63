"""One finding of doctor."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum, unique


@unique
class Severity(StrEnum):
    """How much a finding matters."""

    ERROR = "error"
    """A manager cannot work like this, or would work wrongly."""
    WARNING = "warning"
    """Somebody has to look at it before a robot rides."""
    NOTE = "note"
    """For the record; nothing needs to be done."""


ORDER = {Severity.ERROR: 0, Severity.WARNING: 1, Severity.NOTE: 2}


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that doctor found."""

    severity: Severity
    code: str
    """Stable, for programs."""
    subject: str
    """The controller or the lift."""
    where: str
    """The address as printed in the map, and on the wire where that differs; empty if it is about no address."""
    text: str
    cure: str
    """What to do; empty where nothing needs to be done."""

    @property
    def needs_work(self) -> bool:
        """Whether somebody has to do something."""
        return self.severity is not Severity.NOTE
