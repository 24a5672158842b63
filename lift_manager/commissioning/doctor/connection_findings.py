"""Judges the connection to one controller: whether it answers, as which unit, how fast, and for how many clients. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from statistics import median

from drivers.errors import (
    ACCEPTED,
    BUSY,
    ILLEGAL_FUNCTION,
    ConnectProblem,
)
from drivers.modbus.wire import CLOSED_BY_CONTROLLER, NOT_MODBUS
from lift_manager.commissioning.doctor.evidence import (
    PAUSE_S,
    Answer,
    ControllerEvidence,
    Probe,
    Purpose,
)
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.subjects import ExaminedController, ExaminedLift, Subjects
from lift_manager.commissioning.prober import NO_ANSWER, TIMEOUT_S
from lift_manager.commissioning.wording import TABLE_NAMES, identity_text
from register_maps.errors import EXCEPTION_NAMES
from register_maps.words import BIT_TABLES, READ_FUNCTION, Table

USUAL_PORT = 502
MARGIN = 0.6
"""The part of `max_age_s` that a reading may grow old before it is called close. Chosen: a second poll has to fit after a lost answer."""
STRANGE_UNIT = 247
"""A unit id that nobody uses: what answers for it answers for any."""


@dataclass(frozen=True, slots=True)
class Latency:
    """How long answers took, in seconds."""

    p50: float
    p99: float

    @classmethod
    def of(cls, controller: ControllerEvidence) -> Latency | None:
        """Summarize the polls; None without an answer."""
        times = sorted(answer.took_s for answer in controller.of(Purpose.POLL) if answer.is_answer)
        if not times:
            return None
        return cls(median(times), times[min(len(times) - 1, round(0.99 * (len(times) - 1)))])


def milliseconds(seconds: float) -> str:
    """Write a latency."""
    if seconds >= 1:
        return f"{seconds:.1f} s"
    return f"{1000 * seconds:.0f} ms" if seconds >= 0.01 else f"{1000 * seconds:.1f} ms"


def requests_per_poll(subjects: Subjects, controller: str) -> int:
    """Return how many reads one poll of all lifts on a controller takes."""
    return sum(
        lift.device(block).controller == controller
        for lift in subjects.lifts_on(controller)
        for block in dict.fromkeys(lift.blocks)
    )


class ConnectionJudge:
    """Judges the connection to one controller."""

    def __init__(
        self,
        subjects: Subjects,
        controller: ExaminedController,
        evidence: ControllerEvidence,
        probes: frozenset[Probe],
    ) -> None:
        self._subjects = subjects
        self._controller = controller
        self._evidence = evidence
        self._probes = probes
        self._unit = subjects.unit_of(controller.name)

    def findings(self) -> Iterator[Finding]:
        if self._evidence.problem is not None:
            yield self._not_connected(self._evidence.problem)
            return
        if not any(answer.is_answer for answer in self._evidence.of(Purpose.POLL, Purpose.POINT)):
            units = list(self._units())
            yield from units or [self._unanswered()]
            return
        yield from self._units()
        yield from self._interruptions()
        yield from self._timing()
        yield from self._slots()
        yield from self._identities()
        yield from self._facts()

    def _finding(self, severity: Severity, code: str, text: str, cure: str = "", where: str = "") -> Finding:
        return Finding(severity, code, self._controller.name, where, text, cure)

    # -- no connection

    def _not_connected(self, problem: ConnectProblem) -> Finding:
        port = self._controller.port
        ports = self._evidence.open_ports
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
                cure = (
                    f"Compare the port with the controller's settings{usual} ({try_ports}), and end other clients of it"
                )
                return self._finding(Severity.ERROR, "refused", text, cure)
            case ConnectProblem.TIMED_OUT:
                text = "nothing takes the connection"
                cure = (
                    f"Look at power and cable, and whether `ping {self._controller.host}` is answered; if it is, a firewall drops"
                    f" port {port}, or it is the wrong one ({try_ports})"
                )
                return self._finding(Severity.ERROR, "no-connection", text, cure)
            case ConnectProblem.HOST_NOT_FOUND:
                text = f"the name {self._controller.host} is not known on this network"
                return self._finding(Severity.ERROR, "host-not-found", text, "Give the controller's IP address instead")
            case ConnectProblem.TLS:
                return self._finding(
                    Severity.ERROR,
                    "tls",
                    self._evidence.problem_text,
                    "Correct `tls` of this controller in the site file",
                )
            case _:
                text = f"no connection: {self._evidence.problem_text}"
                cure = f"Correct this computer's network settings, then look whether `ping {self._controller.host}` is answered"
                return self._finding(Severity.ERROR, "no-connection", text, cure)

    def _unanswered(self) -> Finding:
        """Explain a connection over which nothing was answered."""
        troubles = [answer.trouble for answer in self._evidence.of(Purpose.POLL)]
        if any(NOT_MODBUS in trouble or "TLS" in trouble for trouble in troubles):
            text = f"what listens there speaks no Modbus/TCP ({troubles[0]})"
            return self._finding(
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
            return self._finding(Severity.ERROR, "slot-taken", text, cure)
        if all(trouble.startswith(NO_ANSWER) for trouble in troubles):
            text = f"it takes the connection, but unit {self._unit} never answers within {TIMEOUT_S:g} s"
            probe = "" if Probe.UNIT in self._probes else "; `--probe unit` tries others"
            cure = (
                f"Compare the unit id with the controller's settings (often 1, 0 or 255{probe}); end other clients, because some controllers"
                " answer only the first one; look whether this is the Modbus port, and whether its server is switched on"
            )
            return self._finding(Severity.ERROR, "silent", text, cure)
        text = f"no answer fits its request ({troubles[0]})"
        return self._finding(
            Severity.ERROR,
            "wrong-answers",
            text,
            "Look whether another device has the same IP address, or a gateway mixes answers up",
        )

    # -- units

    def _units(self) -> Iterator[Finding]:
        """Judge which unit ids answer. Where the probe has not run, only those of the lifts are known."""
        probed = {answer.unit: answer for answer in self._evidence.of(Purpose.UNIT)}
        proven = sorted(unit for unit, answer in probed.items() if answer.proves_unit)
        for unit in dict.fromkeys(answer.unit for answer in self._evidence.of(Purpose.POLL)):
            yield from self._unit_findings(unit, proven)
        own, strange = probed.get(self._unit), probed.get(STRANGE_UNIT)
        if own is not None and strange is not None and self._unit != STRANGE_UNIT and _same_answer(own, strange):
            yield self._finding(
                Severity.WARNING if self._unit_matters else Severity.NOTE,
                "any-unit",
                f"it answers for every unit id, {STRANGE_UNIT} included, as for unit {self._unit}: a wrong unit id would not be noticed",
                "If this is a gateway, find out which device it talks to, for instance by switching that one off; a single controller may"
                " ignore the unit id"
                if self._unit_matters
                else "",
            )
        elif own is not None and own.proves_unit and len(proven) > 1:
            others = ", ".join(str(unit) for unit in proven if unit != self._unit)
            yield self._finding(Severity.NOTE, "other-units", f"unit {others} answers as well as unit {self._unit}")

    def _unit_findings(self, unit: int, proven: Sequence[int]) -> Iterator[Finding]:
        """Judge one unit of the lifts; `proven` are those that the probe has found."""
        polled = [answer for answer in self._evidence.of(Purpose.POLL) if answer.unit == unit]
        if any(answer.proves_unit for answer in self._evidence.answers if answer.unit == unit):
            return
        names = [
            lift.name
            for lift in self._subjects.lifts_on(self._controller.name)
            if any((d.controller, d.unit_id) == (self._controller.name, unit) for d in lift.devices.values())
        ]
        of_lift = f" (lift {', '.join(names)})" if names and len(self._subjects.lifts) > 1 else ""
        others = [other for other in proven if other != unit]
        probe = "" if Probe.UNIT in self._probes else "; `--probe unit` tries others"
        offline = [answer.exception for answer in polled if answer.exception is not None]
        if offline:
            yield self._finding(
                Severity.ERROR,
                "unit-offline",
                f"a gateway answers, but it does not reach unit {unit}{of_lift} (exception {offline[0]:02X},"
                f" {EXCEPTION_NAMES.get(offline[0], '')})",
                "Compare the unit id with the address switch of the controller, and look at power and serial line behind the gateway"
                f"{probe}",
            )
        elif any(answer.is_answer for answer in self._evidence.of(Purpose.POLL)):
            yield self._finding(
                Severity.ERROR,
                "silent",
                f"unit {unit}{of_lift} never answers, and another unit here does",
                f"Compare the unit id with the controller's settings{probe}",
            )
        if others:
            yield self._finding(
                Severity.ERROR,
                "wrong-unit",
                f"unit {unit}{of_lift} does not answer, and unit {' and '.join(map(str, others))} does",
                f"Write `unit_id: {others[0]}` for it, after comparing it with the controller's settings",
            )

    @property
    def _unit_matters(self) -> bool:
        """Whether the unit id says which device is meant: 0 and 255 mean whatever has the address."""
        return self._unit not in (0, 255)

    # -- what went wrong on the way

    def _interruptions(self) -> Iterator[Finding]:
        evidence = self._evidence
        known = {answer.unit for answer in evidence.answers if answer.is_answer}
        polled = [answer for answer in evidence.of(Purpose.POLL, Purpose.OUTPUTS) if answer.unit in known]
        busy = [answer for answer in polled if answer.exception in (ACCEPTED, BUSY)]
        if busy:
            yield self._finding(
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
            yield self._finding(
                Severity.ERROR,
                "silent-reads",
                f"{len(silent)} of {len(polled)} reads were not answered ({_blocks_text(silent)})",
                "Look at the cable and at what else loads the controller; if it is always the same block, leave it out of the map"
                " and ask the vendor",
            )
        if lost:
            yield self._finding(
                Severity.ERROR,
                "unstable",
                f"{len(lost)} of {len(polled)} reads ended in trouble: {lost[0].trouble}",
                "Look for another client, for a second device with this IP address, and at the cable",
            )
        elif evidence.connects > 1 and not silent:
            yield self._finding(
                Severity.WARNING,
                "unstable",
                f"the connection broke {evidence.connects - 1} times between two reads",
                "Look for another client that takes the only slot in turn, and for an idle limit in the controller's settings",
            )
        if evidence.survives_pause is False:
            yield self._finding(
                Severity.WARNING,
                "drops-idle",
                f"it ends the connection after {PAUSE_S:g} s without a request",
                f"Raise the idle limit in the controller's settings; until then keep `poll_s` well below {PAUSE_S:g}",
            )
        if any(answer.is_answer and not answer.echoes_tid for answer in polled):
            severity = Severity.ERROR if self._controller.link.tid_echo else Severity.NOTE
            yield self._finding(
                severity,
                "transaction-ids",
                "it does not repeat transaction ids",
                "Write `tid_echo: false` for this controller; the manager then trusts one answer per connection and request"
                if severity is Severity.ERROR
                else "",
            )

    def _timing(self) -> Iterator[Finding]:
        latency = Latency.of(self._evidence)
        lifts = self._subjects.lifts_on(self._controller.name)
        if latency is None or not lifts:
            return
        timeout_s = self._controller.link.timeout_s
        requests = requests_per_poll(self._subjects, self._controller.name)
        answer = f"answers take {milliseconds(latency.p50)} (1 in 100: {milliseconds(latency.p99)})"
        if latency.p50 > timeout_s:
            yield self._finding(
                Severity.ERROR,
                "too-slow",
                f"{answer}, and the manager gives up after {timeout_s:g} s (`timeout_s`)",
                _slower(latency, requests, timeout_s),
            )
            return
        if latency.p99 > timeout_s:
            yield self._finding(
                Severity.WARNING,
                "late-answers",
                f"{answer}, some later than `timeout_s` of {timeout_s:g} s, after which the manager gives up",
                "Look for another client and for a loaded network; otherwise raise `timeout_s` of this controller, with `max_age_s`",
            )
        for lift in lifts:
            yield from self._age(lift, latency, requests)

    def _age(self, lift: ExaminedLift, latency: Latency, requests: int) -> Iterator[Finding]:
        """Compare how old a reading gets with how old it may be: the next one is complete one pause and one poll later."""
        poll_s = requests * (latency.p50 + self._controller.link.min_gap_s)
        oldest_s = max(lift.poll_s, poll_s) + poll_s
        many = (
            f"{requests} requests of {milliseconds(latency.p50)}"
            if requests > 1
            else f"one request of {milliseconds(latency.p50)}"
        )
        sums = f"a poll is {many}, so a reading gets {oldest_s:.2g} s old, and {lift.max_age_s:g} s is the limit (`max_age_s`)"
        if oldest_s > lift.max_age_s:
            yield Finding(
                Severity.ERROR,
                "too-slow",
                lift.name,
                "",
                sums,
                _slower(latency, requests, self._controller.link.timeout_s),
            )
        elif oldest_s > MARGIN * lift.max_age_s and poll_s > lift.poll_s:
            yield Finding(
                Severity.WARNING,
                "slow",
                lift.name,
                "",
                f"{sums}: one lost answer takes the lift offline",
                _slower(latency, requests, self._controller.link.timeout_s),
            )

    def _slots(self) -> Iterator[Finding]:
        slots = self._evidence.slots
        if slots is None:
            return
        if slots.further == 0:
            text = "it serves one client at a time"
            cure = (
                "Keep every other client off it while the manager runs; watch, trace and poke then work through the manager, building"
                " management needs another way; write `max_connections: 1` under `link` in the map"
            )
            is_known = self._controller.link.max_connections == 1
            yield self._finding(Severity.NOTE if is_known else Severity.WARNING, "single-slot", text, cure)
        elif not slots.first_survived:
            yield self._finding(
                Severity.WARNING,
                "drops-oldest",
                "a new connection throws the oldest one out",
                "Keep every other client off it: a diagnosis tool would cut off the manager",
            )
        else:
            most = f"{slots.further + 1}" if slots.further < slots.tried else f"at least {slots.further + 1}"
            yield self._finding(Severity.NOTE, "slots", f"it serves {most} clients at once")

    def _identities(self) -> Iterator[Finding]:
        """Repeat what each unit says that it is. Many say nothing, which is no fault."""
        found = self._evidence.identities or {}
        for unit, identity in found.items():
            whose = f"unit {unit}" if len(found) > 1 else "it"
            if identity.texts:
                yield self._finding(
                    Severity.NOTE, "identity", f"{whose} says that it is: {identity_text(identity.texts)}"
                )
                continue
            if identity.exception is not None:
                why = f"function 43 is answered with exception {identity.exception:02X}"
            else:
                why = identity.trouble or "its texts are empty"
            yield self._finding(
                Severity.NOTE, "no-identity", f"{whose} gives no identity ({why}); many controllers do not"
            )

    # -- what the probes of ranges have found

    def _facts(self) -> Iterator[Finding]:
        if self._evidence.open_ports is not None:
            ports = ", ".join(map(str, self._evidence.open_ports)) or "none"
            yield self._finding(Severity.NOTE, "ports", f"of the usual ports these accept a connection: {ports}")
        for table in Table:
            at_zero = [a for a in self._evidence.of(Purpose.RANGE) if a.table is table]
            if at_zero and all(answer.exception == ILLEGAL_FUNCTION for answer in at_zero):
                yield self._finding(
                    Severity.NOTE,
                    "no-table",
                    f"it has no {TABLE_NAMES[table]} (function {READ_FUNCTION[table]} is refused)",
                )
        served = served_ranges(self._evidence)
        for (unit, table), ranges in served.items():
            text = ", ".join(f"{low} to {high}" if high > low else f"{low}" for low, high in ranges)
            yield self._finding(
                Severity.NOTE, "served", f"{TABLE_NAMES[table]} that answered, on the wire: {text} (unit {unit})"
            )
        yield from self._largest_blocks()

    def _largest_blocks(self) -> Iterator[Finding]:
        for (unit, table, start), (good, refused) in largest_blocks(self._evidence).items():
            noun = TABLE_NAMES[table]
            limit = self._limit(table)
            if refused is not None and good < limit:
                key = "max_bits_per_read" if table in BIT_TABLES else "max_registers_per_read"
                yield self._finding(
                    Severity.ERROR if good < self._longest_poll(table) else Severity.NOTE,
                    "largest-block",
                    f"it answers reads of up to {good} {noun}, and refuses {refused} ({start} on the wire, unit {unit})",
                    f"Write `{key}: {good}` for this controller" if good < self._longest_poll(table) else "",
                )
            elif refused is None:
                yield self._finding(
                    Severity.NOTE,
                    "largest-block",
                    f"it answers all {good} {noun} from {start} on the wire in one read (unit {unit})",
                )

    def _limit(self, table: Table) -> int:
        link = self._controller.link
        return link.max_bits_per_read if table in BIT_TABLES else link.max_registers_per_read

    def _longest_poll(self, table: Table) -> int:
        return max(
            (
                block.count
                for lift in self._subjects.lifts_on(self._controller.name)
                for block in lift.blocks
                if block.table is table and lift.device(block).controller == self._controller.name
            ),
            default=0,
        )


def served_ranges(evidence: ControllerEvidence) -> dict[tuple[int, Table], tuple[tuple[int, int], ...]]:
    """Return the addresses that answered with values, by unit and table, as ranges without a refused address in them."""
    read: dict[tuple[int, Table], dict[int, bool]] = {}
    if not any(True for _ in evidence.of(Purpose.RANGE)):
        return {}
    for answer in evidence.of(Purpose.RANGE, Purpose.POLL, Purpose.POINT, Purpose.OUTPUTS):
        if answer.values is not None or answer.count == 1:
            addresses = range(answer.address, answer.address + answer.count)
            read.setdefault((answer.unit, answer.table), {}).update(dict.fromkeys(addresses, answer.values is not None))
    found = {key: tuple(_ranges(sorted(tried.items()))) for key, tried in sorted(read.items())}
    return {key: ranges for key, ranges in found.items() if ranges}


def largest_blocks(evidence: ControllerEvidence) -> dict[tuple[int, Table, int], tuple[int, int | None]]:
    """Return the longest read that was answered, and the shortest that was not, by unit, table and first address."""
    found: dict[tuple[int, Table, int], tuple[int, int | None]] = {}
    for answer in evidence.of(Purpose.BLOCK):
        key = answer.unit, answer.table, answer.address
        good, refused = found.get(key, (0, None))
        if answer.values is not None:
            found[key] = max(good, answer.count), refused
        else:
            found[key] = good, answer.count if refused is None else min(refused, answer.count)
    return found


def _ranges(tried: Iterable[tuple[int, bool]]) -> Iterator[tuple[int, int]]:
    """Yield (first, last) of the addresses that answered, up to the next one that did not."""
    for answered, run in itertools.groupby(tried, key=itemgetter(1)):
        if answered:
            first, *rest = (address for address, _ in run)
            yield first, rest[-1] if rest else first


def _slower(latency: Latency, requests: int, timeout_s: float) -> str:
    """Advise on a slow controller: what it needs to be used as it is."""
    timeout_s = max(timeout_s, round(1.5 * latency.p99 + 0.05, 1))
    poll_s = round(1.2 * requests * latency.p50 + 0.05, 1)
    age_s = round(max(2 * (poll_s + requests * latency.p99), 2 * timeout_s) + 0.05, 1)
    return (
        "Look for a serial line behind a gateway and raise its speed, and bring the points closer together (fewer requests); to use it as"
        f" it is, write `timeout_s: {timeout_s:g}` for the controller and `poll_s: {poll_s:g}`, `max_age_s: {age_s:g}` for the lift"
    )


def _same_answer(one: Answer, other: Answer) -> bool:
    """Whether two units answered alike: values of which at most a counter differs, or the same exception."""
    if one.values is None or other.values is None:
        return one.values == other.values and one.exception == other.exception and one.proves_unit
    differ = sum(a != b for a, b in zip(one.values, other.values, strict=True))
    return differ <= max(1, len(one.values) // 8)


def _blocks_text(answers: Iterable[Answer]) -> str:
    blocks = dict.fromkeys((a.table, a.address, a.count) for a in answers)
    return "; ".join(
        f"{table} {start} to {start + count - 1}" if count > 1 else f"{table} {start}" for table, start, count in blocks
    )
