"""The close button: pressed once for a session, after whatever holds the door is seen to be let go. Nothing here waits."""

from __future__ import annotations

from asyncio import Future

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.core.calling import Press
from lift_manager.core.outputs import LiftOutputs, Permit
from lift_manager.domain.call import CallPhase
from lift_manager.domain.following import DOOR_WITHIN_S, Told
from register_maps.words import Side

_CLOSING = (CallPhase.WANTED, CallPhase.PRESSED)


class DoorClosing:
    """At most one wish to close, of one door or several. The controller lets go of it by itself (`drivers.modbus.endings`)."""

    def __init__(self, outputs: LiftOutputs, press: Press) -> None:
        self._outputs = outputs
        self._press = press
        self._sides: tuple[Side, ...] = ()
        self._since = 0.0
        self._told = Told()
        self._pressed: dict[Future[Outcome], Outcome | None] = {}

    @property
    def told(self) -> Told:
        """How far it is."""
        return self._told

    @property
    def known(self) -> bool:
        """Whether the map has a close button at all."""
        return bool(self._outputs.capabilities.commands & {_close(side).name for side in Side})

    def missing(self, sides: tuple[Side, ...]) -> tuple[Side, ...]:
        """Return the doors for which the map has no close button."""
        return tuple(side for side in sides if _close(side).name not in self._outputs.capabilities.commands)

    def want(self, sides: tuple[Side, ...], now: float) -> None:
        """Want these doors shut."""
        self.forget()
        self._sides, self._since, self._told = sides, now, Told(CallPhase.WANTED)

    def forget(self) -> None:
        """Want it no longer; a button that is pressed is let go."""
        if self._told.phase in _CLOSING:
            for side in self._sides:
                self._outputs.let_go(_close(side))
        self._sides, self._told, self._pressed = (), Told(), {}

    def act(self, permit: Permit, now: float, *, free: bool) -> None:
        """Press it once nothing holds the door any more, which `free` tells, and for as long as `permit` gives no reason not to."""
        if self._told.phase is not CallPhase.WANTED:
            return
        if not free:
            if now - self._since > DOOR_WITHIN_S:
                why = f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is let go"
                self._told = Told(CallPhase.FAILED, why)
            return
        if (why_not := permit()) is not None:
            self._told = Told(CallPhase.FAILED, why_not)
            return
        self._told = Told(CallPhase.PRESSED)
        self._pressed = {self._press(_close(side), permit): None for side in self._sides}

    def ended(self, future: Future[Outcome], outcome: Outcome) -> None:
        """Take the outcome of a press, if it is one of these; the worst of several is that of all."""
        if future not in self._pressed:
            return
        self._pressed[future] = outcome
        ends = [end for end in self._pressed.values() if end is not None]
        if len(ends) < len(self._pressed):
            return
        worst = max(ends, key=_badness)
        phase = CallPhase.CONFIRMED if worst.result is Result.CONFIRMED else CallPhase.FAILED
        self._told = Told(phase, worst.reason, outcome=worst)


def _badness(outcome: Outcome) -> tuple[int, int]:
    results, proofs = (
        (Result.CONFIRMED, Result.REJECTED, Result.UNCONFIRMED),
        (Proof.EFFECT, Proof.LAMP, Proof.READBACK),
    )
    return results.index(outcome.result), proofs.index(outcome.proof) if outcome.proof in proofs else len(proofs)


def _close(side: Side) -> Command:
    return Command(CommandKind.CLOSE_DOOR, side=side)
