"""What measuring needs beside what every face sees: values, and where they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Durations:
    """How often something took how long, since the process began."""

    bounds_s: tuple[float, ...]
    """Longest duration of each range but the last, which has no end."""
    counts: tuple[int, ...]
    """By range, each duration once; one more than there are bounds."""
    total_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkFigures:
    """One link as it is now, and what it has counted since the process began."""

    link: str
    """The controller, as the site file names it."""
    up: bool
    in_doubt: bool
    """Up, but the last request was not answered in time."""
    since_s: float | None
    """How long it has been up, or down; None before it was started."""
    answer_age_s: float | None
    """Since the newest honest answer, exceptions included; None before the first."""
    in_flight: bool
    reads_waiting: int
    commands_waiting: int
    silent_units: int
    """Units that do not answer while others on this link do."""
    counts: Mapping[str, int]
    """By name: `requests`, `timeouts`, `late_answers`, `desyncs`, `recycles`, `connects`, `failed_connects`, `losses`, `exceptions`."""
    round_trips: Durations
    read_waits: Durations
    command_waits: Durations


class LinkSource(Protocol):
    """The links of a site."""

    def link_figures(self) -> tuple[LinkFigures, ...]:
        """Every link by the order of the site file, from memory."""
        ...


class Tallies(Protocol):
    """What the manager counts for whoever measures."""

    @property
    def refused(self) -> Mapping[tuple[str, str], int]:
        """How often the answer was no, by lift (empty where it was about none) and code; rises only."""
        ...

    def polls(self) -> Mapping[str, int]:
        """How many polls of each lift have ended, well or not."""
        ...
