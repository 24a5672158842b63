"""What one lift's keeper tells whoever listens, and the log."""

from __future__ import annotations

import logging

from drivers.model import Outcome, Result
from lift_manager.domain.events import (
    Advised,
    Alarm,
    CommandEnded,
    Event,
    HandedOver,
    ReleasedByPerson,
    RequestFollowed,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.domain.service import (
    ITS_OWN_WORD,
    Advice,
    EndReason,
    ForceReleased,
    abandoned_text,
    maybe_occupied_text,
    stopping_text,
)
from lift_manager.domain.session import Session
from lift_manager.domain.session_requests import Followed
from lift_manager.domain.state import Holder
from lift_manager.runtime.bus import Bus

_log = logging.getLogger(__name__)


class Announcer:
    """Puts the events of one lift on the bus, a line of the log each."""

    def __init__(self, lift: str, bus: Bus[Event], *, control: bool) -> None:
        """`control` tells whether the lift may be commanded: nothing is ever held of one that is only watched."""
        self._lift = lift
        self._control = control
        self._bus = bus
        self._rejected = ""
        """Why the last command was not pressed; empty if it was."""

    def alarm(self, text: str, holder: Holder | None = None) -> None:
        """Tell people of something they should know."""
        said = self._publish(Alarm(self._lift, text, holder))
        _log.warning("%s: %s", self._lift, text, extra=said)

    def fire(self, holder: Holder | None, advice: Advice) -> None:
        """Tell the robot what to do, and people that there is a fire; everything is let go only after this."""
        if holder is not None:
            said = self._publish(Advised(self._lift, holder, advice, "there is a fire"))
            _log.warning("%s: there is a fire; %s is told: %s", self._lift, holder, advice, extra=said)
        done = (
            "everything is let go, robots are refused"
            if self._control
            else "this lift is only watched; robots are refused"
        )
        self.alarm(f"fire: {done} until a person has checked the lift", holder)

    def outcome(self, outcome: Outcome, holder: Holder | None) -> None:
        """Tell what became of a command."""
        proof = f", seen by {outcome.proof}" if outcome.proof != "none" else ""
        rejected = outcome.reason if outcome.result is Result.REJECTED else ""
        # a robot goes on asking, and the disk that the log is on may be the reason
        level = logging.DEBUG if rejected and rejected == self._rejected else logging.INFO
        self._rejected = rejected
        said = self._publish(CommandEnded(self._lift, outcome, holder))
        why = f": {outcome.reason}" if outcome.reason else ""
        _log.log(level, "%s: %s %s%s%s", self._lift, outcome.command, outcome.result, proof, why, extra=said)

    def opened(self, session: Session) -> None:
        """Tell who holds the lift."""
        said = self._publish(SessionOpened(self._lift, session.holder, session.floor or ""))
        to = "" if session.floor is None else f", to {session.floor}"
        _log.info("%s: %s holds the lift%s", self._lift, session.holder, to, extra=said)

    def restored(self, session: Session, *, pressed: bool) -> None:
        """Tell who holds the lift from before a restart."""
        call = "its call is followed" if pressed else "its call was not pressed, and waits for its next request"
        text = f"to {session.floor}, {call}; what is found off stays off until it asks again"
        if session.floor is None:
            text = "and asked for no floor yet"
        said = self._publish(SessionRestored(self._lift, session.holder, session.floor or "", text))
        _log.info("%s: %s holds the lift from before a restart, %s", self._lift, session.holder, text, extra=said)

    def handed_over(self, holder: Holder, to: Holder) -> None:
        """Tell that a session goes on with another holder."""
        said = self._publish(HandedOver(self._lift, holder, to))
        _log.info("%s: %s hands the lift over to %s", self._lift, holder, to, extra=said)

    def released(self, released: ForceReleased) -> None:
        """Tell that a person took the lift from its holder."""
        said = self._publish(ReleasedByPerson(self._lift, released))
        words = (self._lift, released.text(self._lift), released.by, released.reason)
        _log.warning("%s: %s (released by %s: %s)", *words, extra=said)

    def ended(self, holder: Holder, reason: EndReason, text: str, advice: Advice) -> None:
        """Tell that the lift is free; a holder that wanted it so needs no advice."""
        told = None if reason in ITS_OWN_WORD else advice
        said = self._publish(SessionEnded(self._lift, holder, reason, text, told))
        _log.info("%s: session of %s over: %s", self._lift, holder, text, extra=said)

    def followed(self, followed: Followed, *, noted: bool) -> None:
        """Tell that a request within a session was taken, or has ended; `noted` says that the journal has its row."""
        event = RequestFollowed(self._lift, followed)
        said = self._publish(event) if noted else {"event": self._bus.hand_out(event), "lift": self._lift}
        what = f"{followed.do} {followed.floor}" if followed.floor else followed.do
        why = f": {followed.reason}" if followed.reason else ""
        _log.debug("%s: %s: %s is %s%s", self._lift, followed.holder, what, followed.status, why, extra=said)

    def hold_spent(self, holder: Holder, limit_s: float) -> None:
        """Tell that a door was held for as long as the site allows."""
        self.alarm(f"the door was held for {limit_s:g} s; it is let go, {holder} keeps the lift", holder)

    def doubt(self, holder: Holder, reason: EndReason, text: str, in_car: tuple[Holder, bool] | None) -> None:
        """Tell people of a robot that is, or may be, in the car although its session is over.

        `in_car` says whose it is, and whether it is known to be there.
        """
        if in_car is None:
            return
        if reason is EndReason.STOPPING:
            self.alarm(stopping_text(holder), holder)
        elif in_car[1]:
            self.alarm(abandoned_text(holder, text), holder)
        elif reason is not EndReason.ARRIVED:
            self.alarm(maybe_occupied_text(self._lift, holder, text), holder)

    def _publish(self, event: Event) -> dict[str, str]:
        """Publish it; returns what its line in the log says beside the text."""
        return {"event": self._bus.publish(event), "lift": self._lift}
