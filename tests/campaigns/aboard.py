"""Who is really in the car, by what the robots of a schedule do: nobody else may be given the lift meanwhile."""

from drivers.model import FloorName
from lift_manager.domain.asking import Accepted, Ask, Refused, RobotWord
from lift_manager.domain.events import Event, HandedOver, PersonAcknowledged, SessionEnded, SessionOpened
from lift_manager.domain.service import EndReason
from lift_manager.domain.state import Holder, LiftState
from lift_manager.lab.world.judged import Finding
from lift_manager.lab.world.truth import Truth
from lift_manager.lab.world.witness import Forgot, Struck
from simulator.wire_faults import Exchange


class Aboard:
    """A witness that is told by the robots when they are in and out, and by the manager to whom it gives the lift."""

    def __init__(self, findings: list[Finding]) -> None:
        self._findings = findings
        self._robots: dict[str, Holder] = {}
        """Whose robot stands in each car."""
        self._at: dict[str, FloorName | None] = {}
        self._asked: dict[str, Ask] = {}
        """The last request for each lift that was accepted."""

    def entered(self, lift: str, holder: Holder) -> None:
        """A robot is in the car."""
        self._robots[lift] = holder

    def left(self, lift: str) -> None:
        """It is out."""
        self._robots.pop(lift, None)

    def heard(self, at: float, event: Event) -> None:
        """Compare to whom the lift is given with who stands in it; its holder's word and a person's are believed."""
        match event:
            case PersonAcknowledged(lift=lift):
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
        asked = self._asked.get(lift)
        if asked is None or self._robots.get(lift) != holder or asked.holder != holder:
            return False
        return asked.robot is None and not asked.hold_door and self._at.get(lift) == asked.floor

    def looked(self, at: float, lift: str, truth: Truth) -> None:
        """Know where the car is."""
        self._at[lift] = truth.at

    def pressed(self, at: float, lift: str, commands: frozenset[str]) -> None:
        """Not its business."""

    def published(self, at: float, lift: str, state: LiftState) -> None:
        """Not its business."""

    def exchanged(self, at: float, controller: str, exchange: Exchange) -> None:
        """Not its business."""

    def asked(self, at: float, ask: Ask, answer: Accepted | Refused) -> None:
        """Believe a holder that lets go of the lift where it stands: that is its word that it is out."""
        if isinstance(answer, Refused):
            return
        self._asked[ask.lift] = ask
        lets_go = ask.robot is RobotWord.LEFT or (not ask.hold_door and self._at.get(ask.lift) == ask.floor)
        if lets_go and self._robots.get(ask.lift) == ask.holder:
            self.left(ask.lift)

    def struck(self, at: float, struck: Struck) -> None:
        """Forget a robot whose boarding may not have been written down when the manager was killed, as the manager does."""
        for lift in struck.fault.lifts if isinstance(struck.fault, Forgot) else ():
            self.left(lift)
