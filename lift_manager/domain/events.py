"""What the bus carries: facts about lifts, as values."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.model import Outcome
from lift_manager.domain.state import Holder, LiftState


@dataclass(frozen=True, slots=True)
class StateChanged:
    """What a lift publishes has changed in more than its age."""

    lift: str
    state: LiftState


@dataclass(frozen=True, slots=True)
class SessionOpened:
    """A caller holds the lift now."""

    lift: str
    holder: Holder
    floor: str


@dataclass(frozen=True, slots=True)
class SessionEnded:
    """The lift is free; the car is not moved by it."""

    lift: str
    holder: Holder
    reason: str


@dataclass(frozen=True, slots=True)
class CommandEnded:
    """A command has its outcome."""

    lift: str
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something a person should know of."""

    lift: str
    text: str


Event = StateChanged | SessionOpened | SessionEnded | CommandEnded | Alarm
