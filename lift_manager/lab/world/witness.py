"""The interface of observers: a world reports to every witness what happens, in order, with the time of the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from drivers.model import FloorName
from lift_manager.lab.world.truth import Truth
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from simulator.wire_faults import Exchange

RESTART = "restart"
"""The fault that a world reports when the manager is killed and restarted."""
STOP = "stop"
"""The fault that a world reports before an orderly stop. A stop releases robot mode wherever the car is; nothing could do so later."""


@dataclass(frozen=True, slots=True)
class FloorRequest:
    """A request to a lift, in the terms of the judge."""

    lift: str
    holder: Holder
    floor: FloorName
    hold_door: bool
    robot: RobotWord | None = None
    stays: bool = False
    """Whether the session lasts until the caller ends it."""


@dataclass(frozen=True, slots=True)
class ForgottenRecords:
    """The fault at a restart if the disk lacks the newest records of some lifts. A fire or a lockout may be lost."""

    lifts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FaultChange:
    """A fault of a device, or on a wire, that began or ended."""

    where: str
    """The lift, or the controller at the end of the wire."""
    fault: object
    began: bool


class Witness(Protocol):
    """Receives what happens in a world, in order; `at` is the time of the loop."""

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """The physical state of a lift, whenever it may have changed."""

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """A write gave these new commands to the controller. `on_truth` has just reported the result."""

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """A state as a client gets it on request, or a published change."""

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """A request on the wire, what the device did with it, and the reply, which may arrive later."""

    def on_event(self, at: float, event: Event) -> None:
        """A published event other than a state."""

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """A request to the manager, and its refusal; None if it was accepted."""

    def on_fault(self, at: float, change: FaultChange) -> None:
        """A fault began or ended."""
