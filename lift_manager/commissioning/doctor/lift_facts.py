"""What is known of one lift when it is judged: its map, what was read, and what of that makes no sense. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.commissioning.doctor.evidence import Evidence, Probe
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.picture import Misfit, Picture, misfits, pictures
from lift_manager.commissioning.doctor.subjects import ExaminedLift
from register_maps.codec import Unlisted, Value


@dataclass(frozen=True, slots=True)
class LiftFacts:
    """One lift, and what its map makes of what was read."""

    lift: ExaminedLift
    evidence: Evidence
    pictures: tuple[Picture, ...]
    """As mapped, without what the probes have read."""
    misfits: tuple[Misfit, ...]
    """In the order of the map."""

    @classmethod
    def of(cls, lift: ExaminedLift, evidence: Evidence) -> LiftFacts:
        """Decode what was read of a lift."""
        found = pictures(lift, evidence)
        return cls(lift, evidence, found, misfits(lift, found))

    @property
    def span_s(self) -> float:
        """How long the lift was seen."""
        return self.pictures[-1].at_s - self.pictures[0].at_s if self.pictures else 0.0

    def last_value(self, name: str) -> Value | Unlisted:
        """Return what a signal that was read at all had last."""
        return self._last(name).values[name]

    def last_raw(self, name: str) -> int:
        """Return the same as a number."""
        return self._last(name).raw[name]

    def _last(self, name: str) -> Picture:
        return next(picture for picture in reversed(self.pictures) if name in picture.raw)

    def printed(self, name: str) -> str:
        """Return the name of a signal or a command with its address; nothing for no name."""
        return f"{name} at {self.lift.printed(name)}" if name else ""

    def finding(self, severity: Severity, code: str, name: str, text: str, cure: str = "") -> Finding:
        """Return a finding about a signal or a command, or about the whole lift if `name` is empty."""
        return Finding(severity, code, self.lift.name, self.printed(name), text, cure)

    def suggested(self, *probes: Probe) -> str:
        """Return the end of a cure that names those of these probes that were not made."""
        left = [probe for probe in probes if probe not in self.evidence.probes]
        return f"; {' '.join(f'`--probe {probe}`' for probe in left)} tries it" if left else ""
