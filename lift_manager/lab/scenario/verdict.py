"""The verdict on a scenario, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lift_manager.lab.scenario.assertions import Broken, DemandMet, Run, judge
from lift_manager.lab.scenario.expectations import ReadyExpectation
from lift_manager.lab.scenario.play import ScenarioResult
from lift_manager.lab.scenario.trace import Entry, Value, changes

CONTEXT_ENTRIES = 3
"""How many entries are printed before and after the one that broke an expectation. Chosen: enough to be read at a glance."""
MAX_TEXT_LENGTH = 60
"""How many characters of a text are printed; the trace file has all of it. Chosen."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """One expectation of one lift, and whether it was met."""

    line: int
    expectation: str
    lift: str
    ok: bool
    text: str
    because: str
    at_s: float | None
    around: tuple[str, ...]
    """The entries before and after the one that broke it, which is marked with `>`."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of one scenario."""

    file: str
    title: str
    seed: int
    lasts_s: float
    ok: bool
    expectations: tuple[Judgement, ...]
    problems: tuple[str, ...]
    """Steps that were not carried out."""
    findings: tuple[str, ...]
    """The violations that the judge found, whatever the file expects."""
    undetectable: tuple[str, ...]
    """What the judge excused because it cannot be seen through these registers."""
    judged: int
    invitations: int
    released: bool
    entries: int


def verdict_of(played: ScenarioResult) -> Verdict:
    """Judge the result of playing a scenario."""
    loaded = played.scenario
    judgements = tuple(
        judgement for expected in loaded.expected for judgement in _judged(expected, played, loaded.scenario.lasts_s)
    )
    excused = [
        f"{lift}: {rule}, after {fault}: {number} times" for (lift, rule, fault), number in played.excused.items()
    ]
    return Verdict(
        file=str(loaded.path),
        title=loaded.scenario.title,
        seed=played.seed,
        lasts_s=loaded.scenario.lasts_s,
        ok=all(one.ok for one in judgements) and not played.findings and not played.problems,
        expectations=judgements,
        problems=tuple(played.problems),
        findings=tuple(str(finding).strip() for finding in played.findings),
        undetectable=tuple(excused),
        judged=played.judged,
        invitations=played.invitations,
        released=played.released,
        entries=len(played.trace),
    )


def lines(verdict: Verdict) -> Iterator[str]:
    """Yield the verdict in full, line by line."""
    yield f"{verdict.file}: {verdict.title} (seed {verdict.seed}, {verdict.lasts_s:g} s, {verdict.entries} entries)"
    for judgement in verdict.expectations:
        yield from _expectation_lines(judgement)
    for problem in verdict.problems:
        yield f"  FAILED  {problem}"
    for finding in verdict.findings:
        yield from _indented(f"  FAILED  judge: {finding}")
    if not verdict.findings:
        yield (
            f"  ok      judge: compared {verdict.judged} published states with the truth, {verdict.invitations} of them open"
        )
    for excused in verdict.undetectable:
        yield f"          excused as undetectable: {excused}"
    if not verdict.released:
        yield "          the release of some outputs at the end was not verified"


def summary(verdict: Verdict) -> str:
    """Return the verdict in one line."""
    failed = sum(not one.ok for one in verdict.expectations) + len(verdict.problems) + len(verdict.findings)
    word = "ok    " if verdict.ok else "FAILED"
    return f"{word}  {verdict.file}: {verdict.title}" + ("" if verdict.ok else f" ({failed} failed)")


def _judged(expected: ReadyExpectation, played: ScenarioResult, lasts_s: float) -> Iterator[Judgement]:
    for lift in expected.lifts:
        entries = [entry for entry in played.trace if entry.lift == lift]
        result = judge(expected.demand, Run(entries, lasts_s), expected.window)
        at_s = result.at_s if isinstance(result, Broken) else None
        context = tuple(_context_lines(result, entries)) if isinstance(result, Broken) else ()
        shown = f"{lift}: {expected}" if len(played.scenario.lifts) > 1 else str(expected)
        ok = isinstance(result, DemandMet)
        yield Judgement(expected.line, shown, lift, ok, result.text, expected.because, at_s, context)


def _context_lines(broken: Broken, entries: Sequence[Entry]) -> Iterator[str]:
    """Yield the entries around the moment at which an expectation broke, and the entry that broke it, which may be earlier."""
    if broken.at_s is None:
        return
    cause = next((index for index, entry in enumerate(entries) if entry is broken.entry), None)
    at = sum(entry.at_s <= broken.at_s for entry in entries) - 1
    if cause is not None and entries[cause].at_s == broken.at_s:
        at = cause
    listed = list(changes(entries))
    indices = set(range(max(0, at - CONTEXT_ENTRIES), min(len(listed), at + CONTEXT_ENTRIES + 1)))
    for index in sorted(indices if cause is None else indices | {cause}):
        entry, fields = listed[index]
        mark = ">" if entry is broken.entry else " "
        yield f"{mark} {entry.at_s:9.3f} s  {entry.kind:<8} {_fields(fields)}"


def _fields(fields: object) -> str:
    found: dict[str, Value] = dict(fields) if isinstance(fields, dict) else {}
    return ", ".join(f"{name} {_shown(value)}" for name, value in found.items()) or "(nothing but its age)"


def _shown(value: Value) -> str:
    match value:
        case None | ():
            return "-"
        case bool():
            return str(value).lower()
        case tuple():
            return " ".join(value)
        case _:
            text = str(value)
            return text if len(text) <= MAX_TEXT_LENGTH else f"{text[: MAX_TEXT_LENGTH - 1]}…"


def _expectation_lines(one: Judgement) -> Iterator[str]:
    if one.ok:
        yield f"  ok      line {one.line}: {one.expectation}" + (f": {one.text}" if one.text else "")
        return
    yield f"  FAILED  line {one.line}: {one.expectation}"
    when = "" if one.at_s is None else f" at {one.at_s:.3f} s"
    yield f"          {one.text}{when}"
    if one.because:
        yield f"          because: {one.because}"
    for entry in one.around:
        yield f"          {entry}"


def _indented(text: str) -> Iterator[str]:
    first, *rest = text.splitlines()
    yield first
    yield from (f"          {line}" for line in rest)
