"""Judges what doctor has read: evidence in, findings out, in the words of an electrician. Pure."""

from __future__ import annotations

from lift_manager.commissioning.doctor.connection_facts import ConnectionFacts
from lift_manager.commissioning.doctor.connection_findings import connection_findings
from lift_manager.commissioning.doctor.evidence import Evidence, Purpose
from lift_manager.commissioning.doctor.finding import ORDER, Finding
from lift_manager.commissioning.doctor.lift_findings import lift_findings
from lift_manager.commissioning.doctor.subjects import Subjects


def judge(subjects: Subjects, evidence: Evidence) -> tuple[Finding, ...]:
    """Return every finding, the worst first."""
    found: list[Finding] = []
    for name, controller in subjects.controllers.items():
        facts = ConnectionFacts(subjects, controller, evidence.controllers[name], evidence.probes)
        found += connection_findings(facts)
    answering = {
        name
        for name, controller in evidence.controllers.items()
        if any(answer.proves_unit for answer in controller.of(Purpose.POLL, Purpose.POINT))
    }
    for lift in subjects.lifts.values():
        if any(device.controller in answering for device in lift.devices.values()):
            found += lift_findings(lift, evidence)
    return tuple(sorted(found, key=lambda finding: ORDER[finding.severity]))
