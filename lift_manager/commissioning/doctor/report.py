"""What one run of doctor came to: as data that can be kept, as lines for a person, and compared with an earlier run. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from lift_manager.commissioning.doctor.capability_findings import largest_blocks, served_ranges
from lift_manager.commissioning.doctor.evidence import Evidence, Probe, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.findings import judge
from lift_manager.commissioning.doctor.picture import changes, pictures
from lift_manager.commissioning.doctor.subjects import ExaminedLift, Subjects
from lift_manager.commissioning.doctor.timing_findings import Latency, milliseconds, requests_per_poll
from register_maps.codec import UNLISTED, Unlisted, Value
from register_maps.words import Door, Mode, Motion

SCHEMA = 1
SLOWER_BY = 2.0
SLOWER_BY_S = 0.02
"""An answer takes longer than before if it takes twice as long and 20 ms more. Chosen: less is the network's daily variation."""


@dataclass(frozen=True, slots=True)
class ControllerFacts:
    """What is constant of a controller: its fingerprint."""

    address: str
    unit: int
    is_answering: bool
    echoes_tid: bool | None
    survives_pause: bool | None
    p50_s: float | None
    p99_s: float | None
    reads: int
    requests_per_poll: int
    units: tuple[int, ...] | None = None
    """Units that answered the probe; None where it was not chosen, as below."""
    clients: int | None = None
    served: tuple[str, ...] | None = None
    largest_blocks: tuple[str, ...] | None = None
    identities: Mapping[str, Mapping[str, str]] | None = None
    """What each unit says that it is, by its id; empty for one that says nothing."""


@dataclass(frozen=True, slots=True)
class SignalFacts:
    """The last value of one signal."""

    where: str
    raw: int
    value: str
    changes: int


@dataclass(frozen=True, slots=True)
class LiftFacts:
    """One lift as its map read it."""

    map: str
    sha256: str
    signals: Mapping[str, SignalFacts]


@dataclass(frozen=True, slots=True)
class Report:
    """One run."""

    version: str
    time: str
    seconds: float
    probes: tuple[str, ...]
    controllers: Mapping[str, ControllerFacts]
    lifts: Mapping[str, LiftFacts]
    findings: tuple[Finding, ...]
    schema: int = field(default=SCHEMA, kw_only=True)

    @property
    def needs_work(self) -> bool:
        """Whether somebody has to do something."""
        return any(finding.needs_work for finding in self.findings)


class NotAReport(Exception):
    """A file is no earlier run of doctor; the sentence says why."""


def make_report(subjects: Subjects, evidence: Evidence, *, version: str, time: str) -> Report:
    """Judge a run and summarize it."""
    return Report(
        version,
        time,
        evidence.seconds,
        tuple(sorted(evidence.probes)),
        {name: _controller(subjects, evidence, name) for name in subjects.controllers},
        {name: _lift(lift, evidence) for name, lift in subjects.lifts.items()},
        judge(subjects, evidence),
    )


def _controller(subjects: Subjects, evidence: Evidence, name: str) -> ControllerFacts:
    found = evidence.controllers[name]
    answered = [answer for answer in found.of(Purpose.POLL, Purpose.OUTPUTS) if answer.is_answer]
    latency = Latency.of(found)
    slots = found.slots
    return ControllerFacts(
        address=subjects.controllers[name].address,
        unit=subjects.unit_of(name),
        is_answering=bool(answered),
        echoes_tid=all(answer.echoes_tid for answer in answered) if answered else None,
        survives_pause=found.survives_pause,
        p50_s=None if latency is None else round(latency.p50, 5),
        p99_s=None if latency is None else round(latency.p99, 5),
        reads=len(found.answers),
        requests_per_poll=requests_per_poll(subjects, name),
        units=tuple(sorted({answer.unit for answer in found.of(Purpose.UNIT) if answer.proves_unit}))
        if Probe.UNIT in evidence.probes
        else None,
        clients=None if slots is None else 1 + slots.further if slots.first_survived else 1,
        served=tuple(
            f"unit {unit} {table} {', '.join(f'{low}-{high}' for low, high in ranges)}"
            for (unit, table), ranges in served_ranges(found).items()
        )
        if Probe.RANGE in evidence.probes
        else None,
        largest_blocks=tuple(
            f"unit {unit} {table} {start}: {good}"
            for (unit, table, start), (good, _) in sorted(largest_blocks(found).items())
        )
        if Probe.BLOCK in evidence.probes
        else None,
        identities=None
        if found.identities is None
        else {str(unit): dict(identity.texts) for unit, identity in found.identities.items()},
    )


def _lift(lift: ExaminedLift, evidence: Evidence) -> LiftFacts:
    found = pictures(lift, evidence)
    last = {name: picture for picture in found for name in picture.raw}
    return LiftFacts(
        lift.codec.map.name,
        lift.sha256,
        {
            name: SignalFacts(
                lift.printed(name), picture.raw[name], _word(lift, picture.values[name]), changes(found, name)
            )
            for name, picture in last.items()
        },
    )


def _word(lift: ExaminedLift, value: Value | Unlisted) -> str:
    """Write a value as people read it."""
    if value is UNLISTED:
        return "not in the map"
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, frozenset):
        return ", ".join(lift.floors.get(code, str(code)) for code in sorted(value)) or "none"
    return str(value)


# -- lines


def lines(report: Report, subjects: Subjects) -> Iterator[str]:
    """Yield what was examined, and a line per finding."""
    yield f"lift-manager {report.version}, {report.time}: doctor only reads, and wrote nothing"
    yield from looks(report, subjects)
    yield from map(finding_line, report.findings)


def looks(report: Report, subjects: Subjects) -> Iterator[str]:
    """Yield how each controller answers, and where each car is."""
    for name, facts in report.controllers.items():
        yield _controller_line(name, facts)
    for name, lift in report.lifts.items():
        if lift.signals:
            yield f"{name}: {where_it_is(report, subjects.lifts[name])} (map {lift.map}, sha256 {lift.sha256[:12]})"


def finding_line(finding: Finding) -> str:
    """Write one finding: severity, subject, address, what was found, what to do, and its code."""
    where = f" {finding.where}:" if finding.where else ""
    cure = f". {finding.cure}" if finding.cure else ""
    return f"{finding.severity.upper()} {finding.subject}:{where} {finding.text}{cure}. [{finding.code}]"


def _controller_line(name: str, facts: ControllerFacts) -> str:
    at = "" if name == facts.address else f" at {facts.address}"
    if not facts.is_answering or facts.p50_s is None or facts.p99_s is None:
        return f"{name}{at}, unit {facts.unit}: no answer"
    parts = [
        f"answers in {milliseconds(facts.p50_s)}, 1 in 100 takes {milliseconds(facts.p99_s)}",
        f"{facts.reads} reads",
    ]
    if facts.requests_per_poll:
        parts.append(f"{facts.requests_per_poll} request{'' if facts.requests_per_poll == 1 else 's'} per poll")
    if facts.echoes_tid:
        parts.append("repeats transaction ids")
    if facts.survives_pause:
        parts.append("survives a pause")
    return f"{name}{at}, unit {facts.unit}: {', '.join(parts)}"


def where_it_is(report: Report, lift: ExaminedLift) -> str:
    """Say where the car is and what the doors do, as one would look at the lift."""
    signals = report.lifts[lift.name].signals
    parts = []
    if (floor := signals.get("car_floor")) is not None:
        code = lift.codec.signals["car_floor"].decode(floor.raw)
        named = lift.floors.get(code) if isinstance(code, int) else None
        if not isinstance(code, int):
            parts.append("car at no floor" if code is None else f"car at ? (reads {floor.raw})")
        else:
            parts.append(f"car at {named}" if named else f"car at floor code {code}")
    for name, signal in signals.items():
        if name.startswith("door."):
            side = name.removeprefix("door.")
            door = "door" if sum(other.startswith("door.") for other in signals) == 1 else f"{side} door"
            parts.append(f"{door} {signal.value if signal.value in set(Door) else f'? (reads {signal.raw})'}")
    for name, words in (("motion", set(Motion)), ("mode", set(Mode))):
        if name in signals:
            value = signals[name].value if signals[name].value in words else f"? (reads {signals[name].raw})"
            parts.append(value if name == "motion" else f"mode {value}")
    if (identity := signals.get("identity")) is not None:
        parts.append(f"identity {identity.value}")
    flags = [name.replace("_", " ") for name, signal in signals.items() if signal.value == "yes"]
    return ", ".join([*parts, *flags]) or "no signal was read"


def summary(report: Report) -> str:
    """Say how many findings need work, and what was not tried."""
    errors = sum(finding.severity is Severity.ERROR for finding in report.findings)
    warnings = sum(finding.severity is Severity.WARNING for finding in report.findings)
    if errors + warnings:
        counts = [f"{n} {word}{'' if n == 1 else 's'}" for n, word in ((errors, "error"), (warnings, "warning")) if n]
        return f"{' and '.join(counts)} to be dealt with."
    if not report.lifts:
        return "Something answers; what its registers mean was not looked at (--map MAP)."
    left = [probe for probe in Probe if probe not in report.probes]
    probes = f" Not probed: {', '.join(left)} (--probe NAME, or all)." if left else ""
    return f"Nothing that needs work was found by reading.{probes} What only a press can show is left to checkout."


# -- comparison


def as_json(report: Report) -> str:
    """Write a run down, for programs and for --against."""
    return json.dumps(asdict(report), indent=2, ensure_ascii=False)


def read_report(path: Path) -> Mapping[str, Any]:
    """Read an earlier run, also the one that the record of a checkout keeps as the state as left. Raises NotAReport."""
    try:
        data = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise NotAReport(f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise NotAReport(f"{path} is no JSON: give a file that `lift-manager doctor --json` has written") from error
    if isinstance(data, dict) and "baseline" in data:
        data = data["baseline"]
        if data is None:
            raise NotAReport(f"{path} is the record of a checkout that keeps no run: it was made without `--baseline`")
    keys = {f.name for f in fields(Report)}
    if not isinstance(data, dict) or not keys <= data.keys() or data["schema"] != SCHEMA:
        raise NotAReport(f"{path} was not written by `lift-manager doctor --json` of this version")
    return data


def differences(before: Mapping[str, Any], report: Report) -> tuple[str, ...]:
    """Return what differs from an earlier run, a line each; positions and doors are not compared."""
    now = json.loads(as_json(report))
    return tuple(_differences(before, now))


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for part in ("controllers", "lifts"):
        for name in before[part].keys() - now[part].keys():
            yield f"{name}: is no longer there"
        for name in now[part].keys() - before[part].keys():
            yield f"{name}: is new"
    for name, facts in now["controllers"].items():
        if name in before["controllers"]:
            yield from _controller_differences(name, before["controllers"][name], facts)
    for name, lift in now["lifts"].items():
        if name in before["lifts"]:
            yield from _lift_differences(name, before["lifts"][name], lift)
    known, found = _keyed(before["findings"]), _keyed(now["findings"])
    for key in found.keys() - known.keys():
        yield f"new: {finding_line(_finding(found[key]))}"
    for key in known.keys() - found.keys():
        yield f"gone: {finding_line(_finding(known[key]))}"


def _lift_differences(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    if (before["map"], before["sha256"]) != (now["map"], now["sha256"]):
        maps = (f"{lift['map']} {lift['sha256'][:12]}" for lift in (before, now))
        yield f"{name}: the map was changed: {', now '.join(maps)}"
    for signal in before["signals"].keys() - now["signals"].keys():
        yield f"{name}: {signal} at {before['signals'][signal]['where']} is no longer answered"


_COMPARED = (
    ("address", "address"),
    ("unit", "unit id"),
    ("is_answering", "answers"),
    ("echoes_tid", "repeats transaction ids"),
    ("survives_pause", "survives a pause"),
    ("requests_per_poll", "requests per poll"),
    ("units", "unit ids that answer"),
    ("clients", "clients at once"),
    ("served", "addresses served"),
    ("largest_blocks", "largest blocks"),
)


def _controller_differences(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    for key, text in _COMPARED:
        was, is_now = before.get(key), now.get(key)
        if was is not None and is_now is not None and was != is_now:
            yield f"{name}: {text}: {_text(was)} before, {_text(is_now)} now"
    yield from _identity_differences(name, before.get("identities"), now.get("identities"))
    was_s, now_s = before.get("p50_s"), now.get("p50_s")
    if was_s is not None and now_s is not None:
        low, high = sorted((was_s, now_s))
        if high > SLOWER_BY * low and high - low > SLOWER_BY_S:
            yield f"{name}: an answer took {milliseconds(was_s)} before, {milliseconds(now_s)} now"


def _identity_differences(
    name: str, before: Mapping[str, Mapping[str, str]] | None, now: Mapping[str, Mapping[str, str]] | None
) -> Iterator[str]:
    """Name what a unit says of itself and did not say before: another controller, or another version of its firmware."""
    if before is None or now is None:
        return
    for unit in dict.fromkeys([*before, *now]):
        was, says = before.get(unit, {}), now.get(unit, {})
        for key in dict.fromkeys([*was, *says]):
            if was.get(key) != says.get(key):
                texts = f"{was.get(key, 'none')} before, {says.get(key, 'none')} now"
                yield f"{name}: unit {unit} is another controller or has other firmware: {key.replace('_', ' ')} {texts}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(map(str, value)) if isinstance(value, Sequence) and not isinstance(value, str) else str(value)


def _keyed(findings: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str, str], Mapping[str, Any]]:
    """Return findings that need work by what makes them the same in two runs."""
    return {
        (item["code"], item["subject"], item["where"]): item for item in findings if item["severity"] != Severity.NOTE
    }


def _finding(data: Mapping[str, Any]) -> Finding:
    return Finding(**{**data, "severity": Severity(data["severity"])})
