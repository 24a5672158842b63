"""Who is really in the car, by what the robots of a schedule do: nobody else may be given the lift meanwhile."""

from drivers.model import FloorName
from lift_manager.lab.world.lift_under_test import Finding
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import FaultChange, FloorRequest, ForgottenRecords
from lift_manager.lift.events import Acknowledged, HandedOver, SessionEnded, SessionOpened
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.session import EndReason, Holder
from lift_manager.lift.state import LiftState
from lift_manager.runtime.bus import Event
from lift_manager.runtime.errors import RequestRefused
from simulator.wire_faults import Exchange


class Aboard:
    """A witness that is told by the robots when they are in and out, and by the manager to whom it gives the lift."""

    def __init__(self, findings: list[Finding]) -> None:
        self._findings = findings
        self._robots: dict[str, Holder] = {}
        """Whose robot stands in each car."""
        self._at: dict[str, FloorName | None] = {}
        self._requests: dict[str, FloorRequest] = {}
        """The last request for each lift that was accepted."""

    def entered(self, lift: str, holder: Holder) -> None:
        """A robot is in the car."""
        self._robots[lift] = holder

    def left(self, lift: str) -> None:
        """It is out."""
        self._robots.pop(lift, None)

    def on_event(self, at: float, event: Event) -> None:
        """Compare to whom the lift is given with who stands in it; its holder's word and a person's are believed."""
        match event:
            case Acknowledged(lift=lift):
                self.left(lift)
            case SessionEnded(lift=lift, holder=holder, reason=EndReason.RELEASED) if self._robots.get(lift) == holder:
                self.left(lift)
            case SessionEnded(lift=lift, holder=holder, reason=EndReason.ARRIVED) if self._is_where_it_wanted(
                lift, holder
            ):
                self.left(lift)
            case SessionOpened(lift=lift, holder=holder):
                self._is_free_for(at, lift, holder)
            case HandedOver(lift=lift, holder=holder, to=to):
                # whoever gives the lift away gives away the robot in it, and speaks for it no more
                self._is_free_for(at, lift, holder)
                if lift in self._robots:
                    self._robots[lift] = to
            case _:
                pass

    def _is_free_for(self, at: float, lift: str, holder: Holder) -> None:
        if self._robots.get(lift, holder) != holder:
            text = f"{holder} is given a lift in which a robot of {self._robots[lift]} stands"
            self._findings.append(Finding(at, lift, "given to another with a robot aboard", text))

    def _is_where_it_wanted(self, lift: str, holder: Holder) -> bool:
        """Whether the car is where its robot wanted no more than to be, with the door left as it is: it gets out by itself."""
        request = self._requests.get(lift)
        if request is None or self._robots.get(lift) != holder or request.holder != holder:
            return False
        return request.robot is None and not request.hold_door and self._at.get(lift) == request.floor

    def on_truth(self, at: float, lift: str, truth: Truth) -> None:
        """Know where the car is."""
        self._at[lift] = truth.at

    def on_press(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Not its business."""

    def on_state(self, at: float, lift: str, state: LiftState) -> None:
        """Not its business."""

    def on_exchange(self, at: float, controller: str, exchange: Exchange) -> None:
        """Not its business."""

    def on_request(self, at: float, request: FloorRequest, refused: RequestRefused | None) -> None:
        """Believe a holder that releases the lift where it stands: that is its word that it is out."""
        if refused is not None:
            return
        lift = request.lift
        self._requests[lift] = request
        is_there = self._at.get(lift) == request.floor
        releases = request.robot is RobotWord.LEFT or (not request.hold_door and is_there)
        if releases and self._robots.get(lift) == request.holder:
            self.left(lift)

    def on_fault(self, at: float, change: FaultChange) -> None:
        """Forget a robot whose boarding may not have been written down when the manager was killed, as the manager does."""
        for lift in change.fault.lifts if isinstance(change.fault, ForgottenRecords) else ():
            self.left(lift)
