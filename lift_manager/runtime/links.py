"""The links to the controllers as faces see them: figures for metrics, and frames for tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Durations:
    """A histogram of durations since the process began."""

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


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One frame that left, or arrived."""

    link: str
    sent: bool
    """To the controller; otherwise from it."""
    frame: bytes
    """Whole, with its MBAP header."""
    at: float
    """Monotonic seconds of the event loop."""


class FrameSource(Protocol):
    """What goes over the wires, for tools."""

    def link_names(self) -> tuple[str, ...]:
        """Every controller of the site file by its name there."""
        ...

    def tap_frames(self, link: str, receive: Callable[[WireFrame], None]) -> AbstractContextManager[None]:
        """Call `receive` with every frame of a link for as long as the context lasts. It must neither wait nor raise."""
        ...
