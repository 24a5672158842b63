"""The call that belongs to a session: wanted, pressed, followed until the car is there."""

from __future__ import annotations

import logging
from asyncio import Future
from dataclasses import replace

from drivers.model import Capabilities, FloorName, Outcome
from lift_manager.core.calling import CallButton
from lift_manager.core.outputs import Permit
from lift_manager.domain import call as calls
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.following import Told, how_far
from lift_manager.domain.sight import Sight

_log = logging.getLogger(__name__)


class SessionCall:
    """At most one call, and its newest press."""

    def __init__(self, lift: str, able: Capabilities, button: CallButton) -> None:
        self._lift = lift
        self._able = able
        self._button = button
        self._pressed: Future[Outcome] | None = None
        self._outcome: Outcome | None = None
        self.now: Call | None = None
        """Where it is; None without a session."""

    @property
    def arrived(self) -> bool:
        """Whether it is fulfilled, or was and the car has not left since."""
        return self.now is not None and (self.now.phase is CallPhase.ARRIVED or self.now.reached)

    @property
    def told(self) -> bool:
        """Whether the newest press has its outcome; True where this process has not pressed."""
        return self._pressed is None or self._pressed.done()

    def elsewhere(self, floor: FloorName) -> bool:
        """Whether it is for another floor than this."""
        return self.now is not None and self.now.floor != floor

    def want(self, floor: FloorName, now: float) -> None:
        """Want the car at a floor; a repeat presses nothing while the call is pending or fulfilled."""
        if self.now is None or self.elsewhere(floor):
            self._outcome = None
        self.now = calls.want(self.now, floor, now)

    def want_again(self, now: float) -> None:
        """Want a fulfilled call to be pressed once more: it is what holds the door, and was let go."""
        if self.now is not None and self.now.phase is CallPhase.ARRIVED:
            self.now = replace(self.now, phase=CallPhase.WANTED, since=now, missing=0, shut_since=None)

    def progress(self, now: float) -> Told:
        """Return how far it is."""
        return how_far(self.now, self._outcome, now)

    def restore(self, floor: FloorName, *, pressed: bool, now: float) -> None:
        """Go on after a restart: follow a call that was pressed, and leave another one to the next request."""
        self.now = calls.restored(floor, pressed=pressed, now=now)

    @property
    def pressed(self) -> bool:
        """Whether it was given to the lift, or may have been, and has not failed."""
        return self.now is not None and self.now.phase not in (CallPhase.WANTED, CallPhase.FAILED)

    def wait(self, now: float) -> None:
        """Let no time count that it has to wait for others."""
        if self.now is not None:
            self.now = calls.waited(self.now, now)

    def forget(self) -> None:
        """Want nothing any more."""
        self.now = None

    def seen(self, call: Call, sight: Sight, now: float, *, is_hold: bool) -> Call:
        """Take a fresh reading. `is_hold` says that nothing but this call keeps the door open."""
        after = calls.seen(call, sight, self._able, now, is_hold=is_hold)
        holds = after.phase is CallPhase.ARRIVED and is_hold and self._button.keeps_door and self.told
        if (holds or after.phase is CallPhase.CONFIRMED) and self._button.forgotten:
            fails = calls.off if self._pressed is None else calls.failed
            after = fails(after, "the controller no longer holds the call", now)
        if after.phase is not call.phase:
            why = f": {after.reason}" if after.reason else ""
            _log.info("%s: call to %s: %s%s", self._lift, call.floor, after.phase, why)
        self.now = after
        return after

    def press(self, call: Call, permit: Permit, *, aboard: bool, now: float) -> None:
        """Press the button that brings the car."""
        pressed = self._button.press(call.floor, permit, aboard=aboard)
        if pressed is None:
            # where no call moves the occupied car, the word that a robot is in place has sent it on
            self.now = calls.unpressed(call, now)
        else:
            self.now, self._pressed, self._outcome = calls.pressed(call, now), pressed, None

    def ended(self, future: Future[Outcome], outcome: Outcome, now: float) -> None:
        """Take the outcome of a press, if it is that of the newest one."""
        if self.now is not None and future is self._pressed:
            self._outcome = outcome
            self.now = calls.ended(self.now, outcome, now)
