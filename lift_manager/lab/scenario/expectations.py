"""Reads the expectations of a scenario, and describes them in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from lift_manager.lab.scenario.assertions import Count, Demand, Eventually, Never, Ordered, While, Window
from lift_manager.lab.scenario.matching import Match, read_match
from lift_manager.lab.scenario.mistakes import Mistakes
from lift_manager.lab.scenario.schema import DEMANDS, EXPECTATION_KEY_NEEDS, Expectation, Scenario
from lift_manager.lab.scenario.steps import check_key_needs, lift_of, one_of
from lift_manager.lab.scenario.trace import TracedLift
from register_maps.source import KeyPath


@dataclass(frozen=True, slots=True)
class ReadyExpectation:
    """One expectation, ready to be judged."""

    line: int
    """Its line in the file."""
    demand: Demand
    window: Window
    lifts: tuple[str, ...]
    """The lifts for each of which it is judged."""
    because: str

    def __str__(self) -> str:
        return f"{_in_words(self.demand)}{_window_in_words(self.window)}"


def read_expectations(
    scenario: Scenario | None, lifts: Mapping[str, TracedLift], mistakes: Mistakes
) -> tuple[ReadyExpectation, ...]:
    """Read the expectations and add what is wrong with them to the mistakes. Without lifts, names are not checked."""
    raw = mistakes.source.data
    listed = raw.get("expect") if isinstance(raw, dict) else None
    if listed == []:
        mistakes.add(("expect",), "is empty; add an expectation")
    if scenario is None:
        for index, one in enumerate(listed if isinstance(listed, list) else ()):
            for key in ("never", "eventually", "count", "while", "after") if isinstance(one, dict) else ():
                if key in one:
                    read_match(one[key], ("expect", index, key), mistakes, None)
        return ()
    found = [_expected(index, one, scenario, lifts, mistakes) for index, one in enumerate(scenario.expect)]
    return tuple(one for one in found if one is not None)


def _expected(
    index: int, one: Expectation, scenario: Scenario, lifts: Mapping[str, TracedLift], mistakes: Mistakes
) -> ReadyExpectation | None:
    path: KeyPath = ("expect", index)
    before = len(mistakes.findings)
    given = {key.rstrip("_") for key in one.model_fields_set if getattr(one, key) is not None}
    check_key_needs(given, EXPECTATION_KEY_NEEDS, path, mistakes)
    kind = one_of(given, DEMANDS, path, mistakes)
    everywhere = kind == "never" and one.lift is None
    named = tuple(lifts) if everywhere else (lift_of(one.lift, lifts, path, mistakes),)
    known = lifts.get(named[0]) if len(named) == 1 else None
    _check_times(one, path, scenario, mistakes)
    reader = _Reader(one, path, mistakes, None if known is None else known.floors)
    demand = None if kind is None else reader.demand(kind)
    if demand is None or len(mistakes.findings) > before:
        return None
    window = Window(one.after_s or 0.0, math.inf if one.before_s is None else one.before_s)
    return ReadyExpectation(mistakes.source.line(path) or 0, demand, window, named, one.because or "")


def _check_times(one: Expectation, path: KeyPath, scenario: Scenario, mistakes: Mistakes) -> None:
    for key in ("after_s", "before_s", "within_s"):
        value = getattr(one, key)
        if value is not None and value > scenario.lasts_s:
            mistakes.add((*path, key), f"is longer than the scenario lasts: {scenario.lasts_s:g} s")
    if one.after_s is not None and one.before_s is not None and one.after_s >= one.before_s:
        mistakes.add((*path, "before_s"), f"must be more than after_s, which is {one.after_s:g}")


@dataclass(frozen=True, slots=True)
class _Reader:
    one: Expectation
    path: KeyPath
    mistakes: Mistakes
    floors: tuple[str, ...] | None

    def demand(self, kind: str) -> Demand | None:
        if kind == "ordered":
            several = self.one.ordered or ()
            if len(several) < 2:
                self.mistakes.add((*self.path, "ordered"), f"must have at least 2 matches, not {len(several)}")
            listed = [self._match(raw, ("ordered", place)) for place, raw in enumerate(several)]
            return Ordered(tuple(match for match in listed if match is not None))
        match = self._match(getattr(self.one, kind), (kind,))
        during, after = self._while(), None
        if self.one.after is not None:
            after = self._match(self.one.after, ("after",))
        if kind == "count":
            return self._count(match, during)
        if match is None:
            return None
        return Never(match, during) if kind == "never" else Eventually(match, self.one.within_s, after)

    def _match(self, raw: object, place: KeyPath) -> Match | None:
        return read_match(raw, (*self.path, *place), self.mistakes, self.floors)

    def _while(self) -> While | None:
        if self.one.while_ is None or (match := self._match(self.one.while_, ("while",))) is None:
            return None
        if not match.lasts:
            self.mistakes.add((*self.path, "while"), f"a {match.kind} is over in a moment; {_LASTING}")
        return While(match, self.one.settled_s or 0.0)

    def _count(self, match: Match | None, during: While | None) -> Count | None:
        at_least, at_most, exactly = self.one.at_least, self.one.at_most, self.one.exactly
        if exactly is not None:
            if at_least is not None or at_most is not None:
                self.mistakes.add((*self.path, "exactly"), "cannot go with at_least or at_most; remove one of them")
            at_least = at_most = exactly
        elif at_least is None and at_most is None:
            self.mistakes.add((*self.path, "count"), "needs at_least, at_most or exactly")
        elif at_least == 0 and at_most is None:
            self.mistakes.add((*self.path, "at_least"), "of 0 is always met")
        return None if match is None else Count(match, at_least, at_most, during)


_LASTING = "`while` takes what lasts: state, truth, session, fault or wire"


def _in_words(demand: Demand) -> str:
    match demand:
        case Never(match=match, during=during):
            return f"never {match}{_during(during)}"
        case Eventually(match=match, within_s=within_s, after=after):
            return "".join(
                (
                    f"eventually {match}",
                    "" if within_s is None else f", within {within_s:g} s",
                    "" if after is None else f", after each {after}",
                )
            )
        case Ordered(matches=matches):
            return "in this order: " + "; ".join(map(str, matches))
        case Count(match=match, at_least=at_least, at_most=at_most, during=during):
            return f"{match}{_during(during)}: {_number(at_least, at_most)}"


def _during(during: While | None) -> str:
    if during is None:
        return ""
    settled = f" ({during.settled_s:g} s after it began)" if during.settled_s else ""
    return f" while {during.match}{settled}"


def _number(at_least: int | None, at_most: int | None) -> str:
    if at_least == at_most:
        return f"exactly {at_least}"
    words = ("" if at_least is None else f"at least {at_least}", "" if at_most is None else f"at most {at_most}")
    return " and ".join(word for word in words if word)


def _window_in_words(window: Window) -> str:
    after = f", after {window.after_s:g} s" if window.after_s else ""
    return after + (f", before {window.before_s:g} s" if window.before_s < math.inf else "")
