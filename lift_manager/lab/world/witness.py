"""Who watches a world: everything that happens is told to every witness, in order, at the loop's time."""

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
"""What a world strikes when the manager is killed and started again."""
STOP = "stop"
"""And before its orderly end, which releases robot mode too, wherever the car is: nobody is left to do it later."""


@dataclass(frozen=True, slots=True)
class FloorRequest:
    """What a caller that knows no sessions requests of a lift, in the judge's own words."""

    lift: str
    holder: Holder
    floor: FloorName
    hold_door: bool
    robot: RobotWord | None = None
    stays: bool = False
    """Its session goes on until it is ended."""


@dataclass(frozen=True, slots=True)
class ForgottenRecords:
    """What else a world strikes at a restart if the disk did not have the newest of some lifts: a fire or a lockout may be forgotten."""

    lifts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FaultChange:
    """A fault of a device, or on a wire, that began or ended."""

    where: str
    """The lift, or the controller on whose wire it is."""
    fault: object
    began: bool


class Witness(Protocol):
    """What a world tells. `at` is the loop's time; nothing is told out of order."""

    def looked(self, at: float, lift: str, truth: Truth) -> None:
        """What a lift really does, whenever it may have changed."""

    def pressed(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """A write that the controller took newly asks for these; the truth after it was told just before."""

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """What anybody who asks is told, and every change that is sent out."""

    def exchanged(self, at: float, controller: str, exchange: Exchange) -> None:
        """A request, what the device made of it, and what comes back, perhaps later."""

    def heard(self, at: float, event: Event) -> None:
        """What the manager sends out, states apart."""

    def requested(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """A request to the manager, and why it was refused; None where it was taken."""

    def struck(self, at: float, struck: FaultChange) -> None:
        """A fault began or ended."""
