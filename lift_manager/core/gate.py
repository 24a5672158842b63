"""What is asked of every caller of one lift before anything is decided, and what a refusal says in values. Nothing here waits."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TypeVar

from drivers.model import FloorName
from drivers.sparing import Turns
from lift_manager.core.keeper import SessionKeeper
from lift_manager.core.options import LiftOptions
from lift_manager.core.recording import LiftLog
from lift_manager.domain.asking import Blocking, Refusal, Refused
from lift_manager.domain.state import Holder, LiftState
from register_maps.words import Mode

Answer = TypeVar("Answer")


class Gate:
    """The gate of one lift."""

    def __init__(self, options: LiftOptions, keeper: SessionKeeper, log: LiftLog) -> None:
        self._name = options.name
        self._keeper = keeper
        self._people = keeper.people
        self._log = log
        self._turns = Turns()
        self._mode: Mode | None = None
        self._mode_since = 0.0

    def takes_nobody(self) -> Refused | None:
        """Refuse to begin while nothing can be written down. One that has begun keeps its session: its robot may be in the car."""
        if not (trouble := self._log.trouble) or self._keeper.session is not None:
            return None
        text = f"{self._name} takes no robots now: {trouble}"
        return self._people.locked_out() or Refused(Refusal.NOT_RECORDED, text)

    def is_anew(self, holder: Holder, floor: FloorName | None, *, hold_door: bool) -> bool:
        """Whether this is another wish than the one that goes on."""
        session = self._keeper.session
        return session is None or (session.holder, session.floor, session.hold_door) != (holder, floor, hold_door)

    def too_often(self, holder: Holder) -> Refused | None:
        """Refuse a caller that has used up its turns."""
        if (wait_s := self._turns.wait_s(holder, _now())) <= 0:
            return None
        text = f"{self._name} was asked for another floor too often by {holder}; ask again in {wait_s:.1f} s"
        return Refused(Refusal.TOO_OFTEN, text)

    def took_a_turn(self, holder: Holder) -> None:
        """Count a turn of a caller."""
        self._turns.take(holder, _now())

    def mode(self, mode: Mode, at: float) -> None:
        """Hear the mode of a reading, taken at the monotonic time `at`."""
        if mode is not self._mode:
            self._mode, self._mode_since = mode, at

    def told(self, answer: Answer | Refused, state: LiftState) -> Answer | Refused:
        """Return an answer; a no with what stands in the way, as values."""
        if not isinstance(answer, Refused) or answer.blocking is not None:
            return answer
        return replace(answer, blocking=self._blocking(answer.code, state))

    def offline(self, state: LiftState) -> str:
        """Say why the lift is offline, should it be."""
        since = "never read yet" if state.age_s is None else f"last reading {state.age_s:.1f} s ago"
        return f"{state.lift} is offline, {since}: {state.reason}"

    def _blocking(self, code: Refusal, state: LiftState) -> Blocking | None:
        if code is Refusal.OFFLINE:
            return Blocking(age_s=state.age_s)
        if code not in (Refusal.MODE, Refusal.FIRE_LATCHED, Refusal.FIRE_ACTIVE):
            return None
        since_s = None if self._mode is None else max(0.0, _now() - self._mode_since)
        if code is Refusal.FIRE_LATCHED and (fire := self._people.remembered.fire_since) is not None:
            since_s = max(0.0, (self._people.clock() - fire).total_seconds())
        return Blocking(mode=state.mode, since_s=since_s)


def _now() -> float:
    return asyncio.get_running_loop().time()
