"""The words of the outputs: where one is, and what a write of it is for."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum, unique

from register_maps.codec import Block


@unique
class Phase(StrEnum):
    """Where one output is."""

    REST = "rest"
    DUE = "due"
    """Wanted, not written yet."""
    LEAVING = "leaving"
    """Its press is on its way: whoever wants rest now must let it go."""
    ON = "on"
    RELEASING = "releasing"


@unique
class StepKind(StrEnum):
    """What a write is for."""

    PRESS = "press"
    REFRESH = "refresh"
    RELEASE = "release"
    PAUSE = "pause"
    """The end of one pulse of a hold that is made of pulses; the hold goes on."""
    RESET = "reset"
    """The rest value, so that the press that follows is an edge."""
    CYCLE = "cycle"
    """A block that is written whether or not anything is wanted, while nothing in it is on."""
    BEAT = "beat"
    """Our sign of life."""
    LOOK = "look"
    """No write: whether a hold that is not written again is still there."""
    VERIFY = "verify"
    """No write: whether a release that was answered has come about."""


KINDS_WITH_PERMIT = frozenset({StepKind.PRESS, StepKind.REFRESH})
"""Writes that ask for something; all others let go, or say no more than that we live."""

READ_ONLY_KINDS = frozenset({StepKind.LOOK, StepKind.VERIFY})
"""Steps that write nothing."""

CHANGING_KINDS = frozenset({StepKind.PRESS, StepKind.RELEASE, StepKind.PAUSE, StepKind.RESET})
"""Steps that write something else than what stands there already, as far as we know."""


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
