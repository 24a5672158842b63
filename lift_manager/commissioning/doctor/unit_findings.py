"""Judges which unit ids of a controller answer, and what each says that it is. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lift_manager.commissioning.doctor.connection_facts import ConnectionFacts
from lift_manager.commissioning.doctor.evidence import Answer, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.wording import identity_text
from register_maps.errors import EXCEPTION_NAMES

STRANGE_UNIT = 247
"""A unit id that nobody uses: what answers for it answers for any."""


def units(facts: ConnectionFacts) -> Iterator[Finding]:
    """Judge which unit ids answer. Where the probe has not run, only those of the lifts are known."""
    probed = {answer.unit: answer for answer in facts.evidence.of(Purpose.UNIT)}
    proven = sorted(unit for unit, answer in probed.items() if answer.proves_unit)
    for unit in dict.fromkeys(answer.unit for answer in facts.evidence.of(Purpose.POLL)):
        yield from _unit_findings(facts, unit, proven)
    own, strange = probed.get(facts.unit), probed.get(STRANGE_UNIT)
    if own is not None and strange is not None and facts.unit != STRANGE_UNIT and _same_answer(own, strange):
        yield facts.finding(
            Severity.WARNING if _unit_matters(facts) else Severity.NOTE,
            "any-unit",
            f"it answers for every unit id, {STRANGE_UNIT} included, as for unit {facts.unit}: a wrong unit id would not be noticed",
            "If this is a gateway, find out which device it talks to, for instance by switching that one off; a single controller may"
            " ignore the unit id"
            if _unit_matters(facts)
            else "",
        )
    elif own is not None and own.proves_unit and len(proven) > 1:
        others = ", ".join(str(unit) for unit in proven if unit != facts.unit)
        yield facts.finding(Severity.NOTE, "other-units", f"unit {others} answers as well as unit {facts.unit}")


def _unit_findings(facts: ConnectionFacts, unit: int, proven: Sequence[int]) -> Iterator[Finding]:
    """Judge one unit of the lifts; `proven` are those that the probe has found."""
    polled = [answer for answer in facts.evidence.of(Purpose.POLL) if answer.unit == unit]
    if any(answer.proves_unit for answer in facts.evidence.answers if answer.unit == unit):
        return
    names = [
        lift.name
        for lift in facts.lifts
        if any((d.controller, d.unit_id) == (facts.controller.name, unit) for d in lift.devices.values())
    ]
    of_lift = f" (lift {', '.join(names)})" if names and len(facts.subjects.lifts) > 1 else ""
    others = [other for other in proven if other != unit]
    offline = [answer.exception for answer in polled if answer.exception is not None]
    if offline:
        yield facts.finding(
            Severity.ERROR,
            "unit-offline",
            f"a gateway answers, but it does not reach unit {unit}{of_lift} (exception {offline[0]:02X},"
            f" {EXCEPTION_NAMES.get(offline[0], '')})",
            "Compare the unit id with the address switch of the controller, and look at power and serial line behind the gateway"
            f"{facts.other_units}",
        )
    elif any(answer.is_answer for answer in facts.evidence.of(Purpose.POLL)):
        yield facts.finding(
            Severity.ERROR,
            "silent",
            f"unit {unit}{of_lift} never answers, and another unit here does",
            f"Compare the unit id with the controller's settings{facts.other_units}",
        )
    if others:
        yield facts.finding(
            Severity.ERROR,
            "wrong-unit",
            f"unit {unit}{of_lift} does not answer, and unit {' and '.join(map(str, others))} does",
            f"Write `unit_id: {others[0]}` for it, after comparing it with the controller's settings",
        )


def _unit_matters(facts: ConnectionFacts) -> bool:
    """Whether the unit id says which device is meant: 0 and 255 mean whatever has the address."""
    return facts.unit not in (0, 255)


def _same_answer(one: Answer, other: Answer) -> bool:
    """Whether two units answered alike: values of which at most a counter differs, or the same exception."""
    if one.values is None or other.values is None:
        return one.values == other.values and one.exception == other.exception and one.proves_unit
    differ = sum(a != b for a, b in zip(one.values, other.values, strict=True))
    return differ <= max(1, len(one.values) // 8)


def identities(facts: ConnectionFacts) -> Iterator[Finding]:
    """Repeat what each unit says that it is. Many say nothing, which is no fault."""
    found = facts.evidence.identities or {}
    for unit, identity in found.items():
        whose = f"unit {unit}" if len(found) > 1 else "it"
        if identity.texts:
            yield facts.finding(Severity.NOTE, "identity", f"{whose} says that it is: {identity_text(identity.texts)}")
            continue
        if identity.exception is not None:
            why = f"function 43 is answered with exception {identity.exception:02X}"
        else:
            why = identity.trouble or "its texts are empty"
        yield facts.finding(Severity.NOTE, "no-identity", f"{whose} gives no identity ({why}); many controllers do not")
