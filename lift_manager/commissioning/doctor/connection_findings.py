"""Judges the connection to one controller: whether there is one, what is answered over it, and what goes wrong on the way. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from drivers.errors import ACCEPTED, BUSY, ConnectProblem
from drivers.modbus.wire import CLOSED_BY_CONTROLLER, NOT_MODBUS
from lift_manager.commissioning.doctor.capability_findings import clients, ports, read_lengths, tables
from lift_manager.commissioning.doctor.connection_facts import ConnectionFacts
from lift_manager.commissioning.doctor.evidence import PAUSE_S, Answer, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.timing_findings import timing
from lift_manager.commissioning.doctor.unit_findings import identities, units
from lift_manager.commissioning.prober import NO_ANSWER, TIMEOUT_S
from register_maps.errors import EXCEPTION_NAMES

USUAL_PORT = 502


def connection_findings(facts: ConnectionFacts) -> Iterator[Finding]:
    """Judge the connection to one controller."""
    if facts.evidence.problem is not None:
        yield _not_connected(facts, facts.evidence.problem)
        return
    if not any(answer.is_answer for answer in facts.evidence.of(Purpose.POLL, Purpose.POINT)):
        yield from list(units(facts)) or [_unanswered(facts)]
        return
    yield from units(facts)
    yield from _failed_reads(facts)
    yield from _habits(facts)
    yield from timing(facts)
    yield from clients(facts)
    yield from identities(facts)
    yield from ports(facts)
    yield from tables(facts)
    yield from read_lengths(facts)


def _not_connected(facts: ConnectionFacts, problem: ConnectProblem) -> Finding:
    port = facts.controller.port
    ports = facts.evidence.open_ports
    if ports is None:
        try_ports = "`--probe port` tries the usual ones"
    elif ports:
        try_ports = f"port {' and '.join(map(str, ports))} accepts a connection there: try that"
    else:
        try_ports = "none of the usual ports accepts a connection there"
    match problem:
        case ConnectProblem.REFUSED:
            usual = "" if port == USUAL_PORT else f", usually {USUAL_PORT}"
            text = f"it refuses the connection: nothing listens on port {port}, or all of its slots are taken"
            cure = f"Compare the port with the controller's settings{usual} ({try_ports}), and end other clients of it"
            return facts.finding(Severity.ERROR, "refused", text, cure)
        case ConnectProblem.TIMED_OUT:
            text = "nothing takes the connection"
            cure = (
                f"Look at power and cable, and whether `ping {facts.controller.host}` is answered; if it is, a firewall drops"
                f" port {port}, or it is the wrong one ({try_ports})"
            )
            return facts.finding(Severity.ERROR, "no-connection", text, cure)
        case ConnectProblem.HOST_NOT_FOUND:
            text = f"the name {facts.controller.host} is not known on this network"
            return facts.finding(Severity.ERROR, "host-not-found", text, "Give the controller's IP address instead")
        case ConnectProblem.TLS:
            return facts.finding(
                Severity.ERROR,
                "tls",
                facts.evidence.problem_text,
                "Correct `tls` of this controller in the site file",
            )
        case _:
            text = f"no connection: {facts.evidence.problem_text}"
            cure = f"Correct this computer's network settings, then look whether `ping {facts.controller.host}` is answered"
            return facts.finding(Severity.ERROR, "no-connection", text, cure)


def _unanswered(facts: ConnectionFacts) -> Finding:
    """Explain a connection over which nothing was answered."""
    troubles = [answer.trouble for answer in facts.evidence.of(Purpose.POLL)]
    if any(NOT_MODBUS in trouble or "TLS" in trouble for trouble in troubles):
        text = f"what listens there speaks no Modbus/TCP ({troubles[0]})"
        return facts.finding(
            Severity.ERROR,
            "wrong-port",
            text,
            f"Find the Modbus/TCP port in the controller's settings, usually {USUAL_PORT}",
        )
    if any(CLOSED_BY_CONTROLLER in trouble or "no new connection" in trouble for trouble in troubles):
        text = "it takes the connection and ends it without an answer: its only slot is taken, or this computer may not talk to it"
        cure = (
            "End every other client (building management, another manager, a diagnosis tool); if there is none, wait a minute or switch"
            " the controller off and on, because it may still count an old connection; look for a list of permitted addresses in it"
        )
        return facts.finding(Severity.ERROR, "slot-taken", text, cure)
    if all(trouble.startswith(NO_ANSWER) for trouble in troubles):
        text = f"it takes the connection, but unit {facts.unit} never answers within {TIMEOUT_S:g} s"
        cure = (
            f"Compare the unit id with the controller's settings (often 1, 0 or 255{facts.other_units}); end other clients, because some controllers"
            " answer only the first one; look whether this is the Modbus port, and whether its server is switched on"
        )
        return facts.finding(Severity.ERROR, "silent", text, cure)
    text = f"no answer fits its request ({troubles[0]})"
    return facts.finding(
        Severity.ERROR,
        "wrong-answers",
        text,
        "Look whether another device has the same IP address, or a gateway mixes answers up",
    )


def _failed_reads(facts: ConnectionFacts) -> Iterator[Finding]:
    evidence, polled = facts.evidence, _polled(facts)
    busy = [answer for answer in polled if answer.exception in (ACCEPTED, BUSY)]
    if busy:
        yield facts.finding(
            Severity.WARNING,
            "busy",
            f"{len(busy)} of {len(polled)} reads were answered with exception {busy[0].exception:02X}"
            f" ({EXCEPTION_NAMES[busy[0].exception or BUSY]})",
            "Look for another client that polls fast, and read more slowly (`poll_s` of the lift)",
        )
    unanswered = [answer for answer in polled if answer.trouble]
    lost = [answer for answer in unanswered if not answer.trouble.startswith(NO_ANSWER)]
    silent = [answer for answer in unanswered if answer.trouble.startswith(NO_ANSWER)]
    if silent:
        yield facts.finding(
            Severity.ERROR,
            "silent-reads",
            f"{len(silent)} of {len(polled)} reads were not answered ({_blocks_text(silent)})",
            "Look at the cable and at what else loads the controller; if it is always the same block, leave it out of the map"
            " and ask the vendor",
        )
    if lost:
        yield facts.finding(
            Severity.ERROR,
            "unstable",
            f"{len(lost)} of {len(polled)} reads ended in trouble: {lost[0].trouble}",
            "Look for another client, for a second device with this IP address, and at the cable",
        )
    elif evidence.connects > 1 and not silent:
        yield facts.finding(
            Severity.WARNING,
            "unstable",
            f"the connection broke {evidence.connects - 1} times between two reads",
            "Look for another client that takes the only slot in turn, and for an idle limit in the controller's settings",
        )


def _habits(facts: ConnectionFacts) -> Iterator[Finding]:
    """Judge how the controller treats a connection that is good."""
    if facts.evidence.survives_pause is False:
        yield facts.finding(
            Severity.WARNING,
            "drops-idle",
            f"it ends the connection after {PAUSE_S:g} s without a request",
            f"Raise the idle limit in the controller's settings, or write it as `idle_timeout_s` for this controller; until then keep"
            f" `poll_s` well below {PAUSE_S:g}",
        )
    if any(answer.is_answer and not answer.echoes_tid for answer in _polled(facts)):
        severity = Severity.ERROR if facts.controller.link.tid_echo else Severity.NOTE
        yield facts.finding(
            severity,
            "transaction-ids",
            "it does not repeat transaction ids",
            "Write `tid_echo: false` for this controller; the manager then trusts one answer per connection and request"
            if severity is Severity.ERROR
            else "",
        )


def _polled(facts: ConnectionFacts) -> list[Answer]:
    """Return the reads of every poll from the units that answer at all."""
    known = {answer.unit for answer in facts.evidence.answers if answer.is_answer}
    return [answer for answer in facts.evidence.of(Purpose.POLL, Purpose.OUTPUTS) if answer.unit in known]


def _blocks_text(answers: Iterable[Answer]) -> str:
    blocks = dict.fromkeys((a.table, a.address, a.count) for a in answers)
    return "; ".join(
        f"{table} {start} to {start + count - 1}" if count > 1 else f"{table} {start}" for table, start, count in blocks
    )
