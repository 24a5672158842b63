"""One word to the lift about its passenger, from the wish to the outcome. Nothing here waits."""

from __future__ import annotations

from asyncio import Future

from drivers.model import Capabilities, Command, CommandKind, FloorName, Outcome, Result
from lift_manager.core.calling import Press
from lift_manager.core.outputs import Permit
from lift_manager.domain import call as calls
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.following import Told, how_far


class Acknowledgement:
    """One word to the lift about its passenger. It follows the rules of a call: pressed once, and again after a pause."""

    def __init__(self, kind: CommandKind, able: Capabilities) -> None:
        self.command = Command(kind)
        self.known = self.command.name in able.commands
        self.is_level = self.command.name in able.levels
        self._call: Call | None = None
        self._pressed: Future[Outcome] | None = None
        self._outcome: Outcome | None = None

    @property
    def failed_once(self) -> bool:
        """Whether it failed for the first time."""
        return self._call is not None and self._call.phase is CallPhase.FAILED and self._call.failures == 1

    @property
    def pending(self) -> bool:
        """Whether it is to be pressed, or on its way."""
        return self._call is not None and self._call.phase in (CallPhase.WANTED, CallPhase.PRESSED)

    @property
    def wanted(self) -> bool:
        """Whether it is to be pressed."""
        return self._call is not None and self._call.phase is CallPhase.WANTED

    @property
    def owed(self) -> bool:
        """Whether it was wanted, and the lift has not taken it."""
        return self._call is not None and self._call.phase is not CallPhase.CONFIRMED

    @property
    def late(self) -> bool:
        """Whether it is owed after it failed, or from before a restart."""
        return (
            self.owed and self._call is not None and (self._call.phase is CallPhase.FAILED or self._call.failures > 0)
        )

    @property
    def taken(self) -> bool:
        """Whether the lift has taken it; a lift that has no such command needs none."""
        return not self.known or (self._call is not None and self._call.phase is CallPhase.CONFIRMED)

    def told(self, now: float) -> Told:
        """Return how far it is."""
        return how_far(self._call, self._outcome, now)

    def restore(self, floor: FloorName, now: float, *, taken: bool) -> None:
        """Go on after a restart: it was taken, or it may be given again at once."""
        if self.known:
            self._call = calls.restored(floor, pressed=taken, now=now)

    def want(self, floor: FloorName, now: float) -> None:
        """Want it given; after a failure only once its pause is over (`calls.BACKOFF_S`)."""
        if self.known:
            self._call = calls.want(self._call, self._call.floor if self._call is not None else floor, now)

    def again(self, now: float) -> None:
        """Want it given again if it failed and its pause is over."""
        if self._call is not None:
            self.want(self._call.floor, now)

    def forget(self) -> None:
        """Want it no longer."""
        self._call = None

    def give(self, press: Press, permit: Permit, now: float) -> None:
        """Press it, if it is wanted."""
        if self._call is not None and self.wanted:
            self._call = calls.pressed(self._call, now)
            self._pressed = press(self.command, permit)

    def ended(self, future: Future[Outcome], outcome: Outcome, now: float) -> bool:
        """Take the outcome, if it is that of the newest press."""
        if self._call is None or future is not self._pressed:
            return False
        self._outcome = outcome
        if outcome.result is Result.CONFIRMED:
            self._call = calls.ended(self._call, outcome, now)
        else:
            self._call = calls.failed(self._call, outcome.reason, now)
        return True
