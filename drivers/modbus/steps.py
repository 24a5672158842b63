"""The phases of an output, and the kinds of steps that change it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum, unique

from register_maps.codec import Block


@unique
class Phase(StrEnum):
    """The phase of one output."""

    REST = "rest"
    DUE = "due"
    """Requested, not written yet."""
    LEAVING = "leaving"
    """Its press is under way, so it has to be released to come to rest."""
    ON = "on"
    RELEASING = "releasing"


@unique
class StepKind(StrEnum):
    """The purpose of a write."""

    PRESS = "press"
    REFRESH = "refresh"
    RELEASE = "release"
    PAUSE = "pause"
    """The end of one pulse of a hold that consists of pulses; the hold continues."""
    RESET = "reset"
    """The rest value, so that the press that follows is an edge."""
    CYCLE = "cycle"
    """A block that is written in a cycle while nothing in it is on."""
    BEAT = "beat"
    """Our heartbeat."""
    LOOK = "look"
    """No write: reads back a hold that is not refreshed."""
    VERIFY = "verify"
    """No write: reads back a release that was answered."""


KINDS_WITH_PERMIT = frozenset({StepKind.PRESS, StepKind.REFRESH})
"""Writes that press; all others release, or are heartbeats."""

READ_ONLY_KINDS = frozenset({StepKind.LOOK, StepKind.VERIFY})
"""Steps that write nothing."""

CHANGING_KINDS = frozenset({StepKind.PRESS, StepKind.RELEASE, StepKind.PAUSE, StepKind.RESET})
"""Steps that change the points, as far as we know."""


@dataclass(frozen=True, slots=True)
class Step:
    """One write to carry out now."""

    kind: StepKind
    name: str
    code: int | None
    block: Block | None = None
    """Of a cycle: what is written."""
    was: int | None = field(default=None, compare=False)
    """Of a release: what was pressed."""
