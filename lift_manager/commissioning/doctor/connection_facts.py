"""What is known of the connection to one controller when it is judged. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from lift_manager.commissioning.doctor.evidence import ControllerEvidence, Probe
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.subjects import ExaminedController, ExaminedLift, Subjects


@dataclass(frozen=True, slots=True)
class ConnectionFacts:
    """One controller, and what it answered."""

    subjects: Subjects
    controller: ExaminedController
    evidence: ControllerEvidence
    probes: frozenset[Probe]

    @property
    def unit(self) -> int:
        """The unit id at which the controller is expected first."""
        return self.subjects.unit_of(self.controller.name)

    @property
    def lifts(self) -> tuple[ExaminedLift, ...]:
        """The lifts with a device on the controller."""
        return self.subjects.lifts_on(self.controller.name)

    @property
    def other_units(self) -> str:
        """The end of a cure: how to find the unit id, where that was not tried."""
        return "" if Probe.UNIT in self.probes else "; `--probe unit` tries others"

    def finding(self, severity: Severity, code: str, text: str, cure: str = "") -> Finding:
        """Return a finding about the controller."""
        return Finding(severity, code, self.controller.name, "", text, cure)
