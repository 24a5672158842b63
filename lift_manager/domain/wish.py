"""What a caller of sessions asks for, as it is written down: without the id of the session, and without keys. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.model import FloorName
from lift_manager.domain.asking import RobotWord
from lift_manager.domain.session_requests import Do, SessionRequest
from lift_manager.domain.state import Holder


@dataclass(frozen=True, slots=True)
class Wish:
    """One request; repeats of it are equal."""

    lift: str
    holder: Holder
    what: str
    """Such as `open`, `renew`, `close` or one of `Do`."""
    floor: FloorName | None = None
    more: str = ""
    """What else it says, in words."""

    @property
    def text(self) -> str:
        """It in words."""
        return " ".join(part for part in (self.what, self.floor, self.more) if part)


def opening(lift: str, holder: Holder) -> Wish:
    """Return the wish to open a session."""
    return Wish(lift, holder, "open", more="a session")


def renewing(lift: str, holder: Holder) -> Wish:
    """Return the wish to begin its lease anew."""
    return Wish(lift, holder, "renew", more="its session")


def closing(lift: str, holder: Holder, robot: RobotWord | None) -> Wish:
    """Return the wish to close it."""
    return Wish(lift, holder, "close", more="its session" + ("" if robot is None else f", robot {robot}"))


def ending(lift: str, holder: Holder, grace_s: float) -> Wish:
    """Return the wish to end the session of a face without ids of sessions."""
    return Wish(lift, holder, "end", more="its session" + (f" in {grace_s:g} s" if grace_s > 0 else ""))


def handing_over(lift: str, holder: Holder, to: Holder) -> Wish:
    """Return the wish to give it to another caller."""
    return Wish(lift, holder, "hand over", more=f"its session to {to}")


def within(request: SessionRequest) -> Wish:
    """Return the wish of a request within a session."""
    if request.do is Do.GO_TO:
        hold = "and hold the door there" if request.hold_door else "and hold no door"
        return Wish(request.lift, request.holder, request.do, request.floor, hold)
    return Wish(request.lift, request.holder, request.do, more="" if request.side is None else str(request.side))
