"""From findings to the text of a draft map, and to the report that a person reads. Pure."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from lift_manager.commissioning.learn.analyse import Findings
from lift_manager.commissioning.learn.samples import Recording
from lift_manager.commissioning.learn.survey import MOST_BITS, MOST_REGISTERS
from lift_manager.commissioning.learn.tracks import Confidence
from lift_manager.commissioning.wording import one_line
from register_maps.words import Table

WIDTH = 120
UNKNOWN_TO_A_RIDE = (
    "commands: nothing was written, so no point is known that calls the car or holds the door",
    "fire, inspection, fault and every other mode: the ride was a normal one",
    "robot mode, permissions, light curtain, overload: nobody tried them",
    "whether a point is the lift's own report, or one that somebody else writes",
)
"""What a draft never knows."""
NOT_FOUND = {
    "position": "where the car is",
    "door.front": "whether the door is open",
    "motion": "whether the car moves, and where to",
    "alive": "a sign of life that changes all the time",
}


def not_found(findings: Findings) -> Iterator[str]:
    """Yield what a draft should have and does not, in words."""
    has = {proposal.signal for proposal in findings.usable()}
    unsure = {proposal.signal for proposal in findings.proposals} - has
    for signal, text in NOT_FOUND.items():
        names = {"car_floor", "car_position"} if signal == "position" else {signal}
        if not names & has:
            yield f"{text}: {'not sure' if names & unsure else 'not found'}"


def draft(findings: Findings, recording: Recording, *, name: str) -> str:
    """Return the text of a draft map. It passes `lift-manager maps check`."""
    lines = [
        "# yaml-language-server: $schema=register_map.schema.json",
        *_comment(
            f"DRAFT, made by `lift-manager learn` from {len(recording.marks)} marks of one ride. It is a guess, not a vendor's table."
        ),
        *_comment("Nobody has checked it. Do not let a robot use a lift by it before every signal was tried on site."),
        "#",
        *_comment("Not known:"),
        *(line for text in (*not_found(findings), *UNKNOWN_TO_A_RIDE) for line in _comment(text, bullet=True)),
    ]
    if findings.missing:
        lines += ["#", *_comment("The ride lacked:")]
        lines += [line for text in findings.missing for line in _comment(text, bullet=True)]
    if findings.cautions:
        lines += ["#", *(line for text in findings.cautions for line in _comment(text))]
    lines += _site_floors(findings)
    lines += _head(recording, name)
    lines += list(_signals(findings))
    lines.append(f"at_floor_evidence: {_flow(dict(findings.evidence))}")
    if any(proposal.signal == "mode" for proposal in findings.usable()):
        return "\n".join([*lines, ""])
    lines += [
        "not_visible:",
        "  fire: not known yet; a ride in normal service shows no fire signal. Ask the lift company",
    ]
    if findings.unexplained:
        lines += ["", *_comment("Changed during the ride, not understood:")]
        lines += [line for text in findings.unexplained for line in _comment(text, bullet=True)]
    return "\n".join([*lines, ""])


def _head(recording: Recording, name: str) -> Iterator[str]:
    yield "schema: 1"
    yield f"name: {name}"
    yield f"title: Draft of a map for the controller at {_plain(recording.peer)}, unit {recording.unit}"
    yield "provenance:"
    yield "  trust: template"
    yield "  sources:"
    yield f"    - A ride on {_plain(recording.began)}, analysed by lift-manager learn. No table of a vendor was seen."
    yield "  notes: >-"
    yield "    Addresses are those on the wire, the first one is 0. The comment of each signal says how sure it is, and why."
    yield "addressing: {base: 0}"
    link = {"unit_id": recording.unit, "max_age_s": 1.0}
    if recording.most_registers < MOST_REGISTERS:
        link["max_registers_per_read"] = recording.most_registers
    if recording.most_bits < MOST_BITS:
        link["max_bits_per_read"] = recording.most_bits
    yield f"link: {_flow(link)}"
    yield "served:"
    for table in Table:
        ranges = [[span.first, span.last] for span in recording.spans if span.table is table]
        if ranges:
            yield f"  {table}: {_flow(ranges)}"


def _signals(findings: Findings) -> Iterator[str]:
    usable = findings.usable()
    yield "signals:" if usable else "signals: {}"
    for proposal in findings.proposals:
        yield from _comment(f"{proposal.confidence}: {'; '.join(proposal.reasons)}", indent="  ")
        entry = f"{proposal.signal}: {_flow(proposal.spec)}"
        yield f"  {entry}" if proposal in usable else f"  # {entry}"


def _site_floors(findings: Findings) -> Iterator[str]:
    if findings.codes:
        yield "#"
        yield from _comment("The floors for the site file, lowest first:")
        yield f"#   floors: {_flow(dict(findings.codes))}"


def _comment(text: str, *, indent: str = "", bullet: bool = False) -> Iterator[str]:
    first, more = ("- ", "  ") if bullet else ("", "")
    wrapped = textwrap.wrap(one_line(text), WIDTH - len(indent) - 4, break_long_words=False, break_on_hyphens=False)
    for number, line in enumerate(wrapped):
        yield f"{indent}# {more if number else first}{line}"


def _flow(value: Any) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.removesuffix("...\n").strip()


def _plain(text: str) -> str:
    return "".join(character for character in text if character.isalnum() or character in "-.:+_ ")


def report(findings: Findings, *, for_file: str) -> Iterator[str]:
    """Yield what was found and what to do next, for a person."""
    order = list(Confidence)
    for proposal in sorted(findings.proposals, key=lambda one: order.index(one.confidence)):
        yield f"{proposal.confidence}: {proposal.signal} {_flow(proposal.spec)}"
        yield from (f"    {reason}" for reason in proposal.reasons)
    yield from (f"missing: {text}" for text in not_found(findings))
    yield from (f"note: {text}" for text in findings.cautions)
    if findings.codes:
        yield "floors of the site file: " + ", ".join(f"{name} = {code}" for name, code in findings.codes.items())
    if findings.unexplained:
        yield "changed, not understood: " + "; ".join(findings.unexplained)
    if findings.missing:
        yield f"to be surer, ride again with: {'; '.join(findings.missing)}"
    if for_file:
        yield ""
        yield from next_steps(for_file, findings.codes)


def next_steps(file: str, codes: Mapping[str, int]) -> Iterator[str]:
    """Yield what to do with a draft."""
    named = f" --floors {','.join(f'{name}={code}' for name, code in codes.items())}" if len(codes) > 1 else ""
    file = file if "/" in file else f"./{file}"
    yield "next:"
    yield f"  lift-manager maps check {file}    (is it a map?)"
    yield f"  lift-manager maps show {file}    (every point in words, for the lift company)"
    yield f"  lift-manager simulate {file}{named}    (a lift by that map at your desk)"
    yield "  then a site file with `access: monitor`, and somebody who rides while you compare every signal"
    yield "  ask the lift company for the fire signal, the modes, and the points that command the lift"
