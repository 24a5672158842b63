"""Checks demands on a trace. Pure.

An entry of a kind that lasts holds until the next one of its subject, and a match of such a kind refers to that time. Every other
entry is over in a moment.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import assert_never

from lift_manager.lab.scenario.matching import Match
from lift_manager.lab.scenario.trace import Entry, Subject


@dataclass(frozen=True, slots=True)
class Window:
    """The part of a run that counts."""

    after_s: float = 0.0
    before_s: float = math.inf


ALWAYS = Window()


@dataclass(frozen=True, slots=True)
class While:
    """The time in which a match holds, once it has held for `settled_s`."""

    match: Match
    settled_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Never:
    match: Match
    during: While | None = None


@dataclass(frozen=True, slots=True)
class Eventually:
    match: Match
    within_s: float | None = None
    after: Match | None = None
    """If given, each of these must be followed by the match."""


@dataclass(frozen=True, slots=True)
class Ordered:
    matches: tuple[Match, ...]


@dataclass(frozen=True, slots=True)
class Count:
    match: Match
    at_least: int | None = None
    at_most: int | None = None
    during: While | None = None


Demand = Never | Eventually | Ordered | Count


@dataclass(frozen=True, slots=True)
class Broken:
    """Why a demand is not met."""

    text: str
    at_s: float | None = None
    entry: Entry | None = None
    """The entry that broke it, or that no match followed."""


@dataclass(frozen=True, slots=True)
class DemandMet:
    """A demand is met; the text has the details."""

    text: str = ""


@dataclass(frozen=True, slots=True)
class Run:
    """The trace of one lift, and how long the run lasted."""

    entries: Sequence[Entry]
    lasts_s: float


@dataclass(frozen=True, slots=True)
class _Span:
    """A time in which a match held; for a moment, both ends are the same."""

    start_s: float
    stop_s: float
    first: int
    """Index of the entry that began it."""
    stop: int
    """Index of the entry that ended it; the length of the trace if none did."""
    entry: Entry
    lasts: bool = True


def judge(demand: Demand, run: Run, window: Window = ALWAYS) -> Broken | DemandMet:
    """Return whether the trace of one lift meets a demand, and why not."""
    window = Window(window.after_s, min(window.before_s, run.lasts_s))
    match demand:
        case Never():
            return _never(demand, run, window)
        case Eventually():
            return _eventually(demand, run, window)
        case Ordered():
            return _ordered(demand, run, window)
        case Count():
            return _count(demand, run, window)
        case _:
            assert_never(demand)


def _never(demand: Never, run: Run, window: Window) -> Broken | DemandMet:
    during = None if demand.during is None else list(_trials(demand.during, run, window))
    if during == [] and demand.during is not None:
        return Broken(f"was never tested: {_tried(demand.during)} did not occur")
    for span in _spans(demand.match, run):
        at_s = _within(span, window) if during is None else _first(span, during, window)
        if at_s is not None:
            return Broken("it happened", at_s, span.entry)
    return DemandMet()


def _eventually(demand: Eventually, run: Run, window: Window) -> Broken | DemandMet:
    spans = list(_spans(demand.match, run))
    if demand.after is None:
        until_s = window.before_s if demand.within_s is None else window.after_s + demand.within_s
        limited = Window(window.after_s, min(window.before_s, until_s))
        found = [at for span in spans if (at := _within(span, limited)) is not None]
        return DemandMet(_at(min(found))) if found else Broken("it did not happen", limited.before_s)
    befores = [one for one in _spans(demand.after, run) if window.after_s <= one.start_s <= window.before_s]
    if not befores:
        return Broken(f"was never tested: {demand.after} did not occur")
    longest = 0.0
    for before in befores:
        until_s = min(window.before_s, before.start_s + (math.inf if demand.within_s is None else demand.within_s))
        fitting = [span for span in spans if span.stop > before.first and span.start_s <= until_s]
        following = [span for span in fitting if demand.match.lasts or span.first > before.first]
        if not following:
            return Broken(f"no match followed within {until_s - before.start_s:g} s", until_s, before.entry)
        longest = max(longest, following[0].start_s - before.start_s)
    return DemandMet(
        f"{len(befores)} times, after {longest:g} s at most" if len(befores) > 1 else f"after {longest:g} s"
    )


def _ordered(demand: Ordered, run: Run, window: Window) -> Broken | DemandMet:
    reached, at_s, last = -1, window.after_s, None
    for number, match in enumerate(demand.matches, 1):
        spans = [span for span in _spans(match, run) if _within(span, window) is not None]
        later = [span for span in spans if (span.stop if match.lasts else span.first) > reached]
        if not later:
            return Broken(f"number {number} did not follow: {match}", at_s, last)
        reached, last = max(reached, later[0].first), later[0].entry
        at_s = max(at_s, later[0].start_s)
    return DemandMet(_at(at_s))


def _count(demand: Count, run: Run, window: Window) -> Broken | DemandMet:
    spans = [one for one in _spans(demand.match, run) if window.after_s <= one.start_s <= window.before_s]
    if demand.during is not None:
        trials = list(_trials(demand.during, run, window))
        if not trials:
            return Broken(f"was never tested: {_tried(demand.during)} did not occur")
        spans = [span for span in spans if _first(span, trials, window) is not None]
    number, last = len(spans), spans[-1] if spans else None
    if demand.at_most is not None and number > demand.at_most:
        one_more = spans[demand.at_most]
        return Broken(f"it happened {_times(number)}", one_more.start_s, one_more.entry)
    if demand.at_least is not None and number < demand.at_least:
        text = f"it happened {_times(number)}"
        return Broken(text) if last is None else Broken(text, last.start_s, last.entry)
    return DemandMet(_times(number))


# -- when something holds


def _spans(match: Match, run: Run) -> Iterator[_Span]:
    if not match.lasts:
        for index, entry in enumerate(run.entries):
            if match.fits(entry):
                yield _Span(entry.at_s, entry.at_s, index, index + 1, entry, lasts=False)
        return
    fitting: dict[Subject, Entry] = {}
    began: tuple[int, Entry] | None = None
    for index, entry in enumerate(run.entries):
        if entry.kind != match.kind:
            continue
        fitting.pop(entry.subject, None)
        if match.fits(entry):
            fitting[entry.subject] = entry
        if fitting and began is None:
            began = index, entry
        elif not fitting and began is not None:
            yield _Span(began[1].at_s, entry.at_s, began[0], index, began[1])
            began = None
    if began is not None:
        yield _Span(began[1].at_s, run.lasts_s, began[0], len(run.entries), began[1])


def _trials(during: While, run: Run, window: Window) -> Iterator[tuple[_Span, float]]:
    """Yield each time in which the condition holds within the window, and when the demand applies from."""
    for span in _spans(during.match, run):
        since_s = span.start_s + during.settled_s
        if span.stop_s >= since_s and span.stop_s >= window.after_s and since_s <= window.before_s:
            yield span, since_s


def _first(span: _Span, trials: Iterable[tuple[_Span, float]], window: Window) -> float | None:
    """Return when a match first held together with a condition. Spans that only touch do not count."""
    for trial, since_s in trials:
        if not span.lasts:
            if (
                trial.first <= span.first < trial.stop
                and max(since_s, window.after_s) <= span.start_s <= window.before_s
            ):
                return span.start_s
            continue
        start_s = max(span.start_s, since_s, window.after_s)
        if start_s < min(span.stop_s, trial.stop_s, window.before_s):
            return start_s
    return None


def _within(span: _Span, window: Window) -> float | None:
    """Return when a match first held in the window."""
    if span.start_s > window.before_s:
        return None
    if span.start_s >= window.after_s:
        return span.start_s
    return window.after_s if span.lasts and span.stop_s > window.after_s else None


def _tried(during: While) -> str:
    return str(during.match) + (f", for {during.settled_s:g} s" if during.settled_s else "")


def _at(at_s: float) -> str:
    return f"at {at_s:g} s"


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"
