"""Judges how fast a controller answers: whether a reading is complete before it is too old. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median

from lift_manager.commissioning.doctor.connection_facts import ConnectionFacts
from lift_manager.commissioning.doctor.evidence import ControllerEvidence, Purpose
from lift_manager.commissioning.doctor.finding import Finding, Severity
from lift_manager.commissioning.doctor.subjects import ExaminedLift, Subjects

MARGIN = 0.6
"""The part of `max_age_s` that a reading may grow old before it is called close. Chosen: a second poll has to fit after a lost answer."""


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


def timing(facts: ConnectionFacts) -> Iterator[Finding]:
    """Compare what answers take with the time that the manager gives them, and readings with their age."""
    latency = Latency.of(facts.evidence)
    if latency is None or not facts.lifts:
        return
    timeout_s = facts.controller.link.timeout_s
    requests = requests_per_poll(facts.subjects, facts.controller.name)
    answer = f"answers take {milliseconds(latency.p50)} (1 in 100: {milliseconds(latency.p99)})"
    if latency.p50 > timeout_s:
        yield facts.finding(
            Severity.ERROR,
            "too-slow",
            f"{answer}, and the manager gives up after {timeout_s:g} s (`timeout_s`)",
            _slower(latency, requests, timeout_s),
        )
        return
    if latency.p99 > timeout_s:
        yield facts.finding(
            Severity.WARNING,
            "late-answers",
            f"{answer}, some later than `timeout_s` of {timeout_s:g} s, after which the manager gives up",
            "Look for another client and for a loaded network; otherwise raise `timeout_s` of this controller, with `max_age_s`",
        )
    for lift in facts.lifts:
        yield from _age(facts, lift, latency, requests)


def _age(facts: ConnectionFacts, lift: ExaminedLift, latency: Latency, requests: int) -> Iterator[Finding]:
    """Compare how old a reading gets with how old it may be: the next one is complete one pause and one poll later."""
    poll_s = requests * (latency.p50 + facts.controller.link.min_gap_s)
    oldest_s = max(lift.poll_s, poll_s) + poll_s
    many = (
        f"{requests} requests of {milliseconds(latency.p50)}"
        if requests > 1
        else f"one request of {milliseconds(latency.p50)}"
    )
    sums = (
        f"a poll is {many}, so a reading gets {oldest_s:.2g} s old, and {lift.max_age_s:g} s is the limit (`max_age_s`)"
    )
    if oldest_s > lift.max_age_s:
        yield Finding(
            Severity.ERROR,
            "too-slow",
            lift.name,
            "",
            sums,
            _slower(latency, requests, facts.controller.link.timeout_s),
        )
    elif oldest_s > MARGIN * lift.max_age_s and poll_s > lift.poll_s:
        yield Finding(
            Severity.WARNING,
            "slow",
            lift.name,
            "",
            f"{sums}: one lost answer takes the lift offline",
            _slower(latency, requests, facts.controller.link.timeout_s),
        )


def _slower(latency: Latency, requests: int, timeout_s: float) -> str:
    """Advise on a slow controller: what it needs to be used as it is."""
    timeout_s = max(timeout_s, round(1.5 * latency.p99 + 0.05, 1))
    poll_s = round(1.2 * requests * latency.p50 + 0.05, 1)
    age_s = round(max(2 * (poll_s + requests * latency.p99), 2 * timeout_s) + 0.05, 1)
    return (
        "Look for a serial line behind a gateway and raise its speed, and bring the points closer together (fewer requests); to use it as"
        f" it is, write `timeout_s: {timeout_s:g}` for the controller and `poll_s: {poll_s:g}`, `max_age_s: {age_s:g}` for the lift"
    )
