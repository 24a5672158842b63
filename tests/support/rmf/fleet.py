"""One robot of Open-RMF's fleet adapter at one lift, with what differs by distribution. Written from open-rmf.md 1.5 alone.

It steps by message and by time: what each method returns is published on `adapter_lift_requests`, in that order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum, unique

from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_OPEN,
    END_SESSION,
    LiftRequest,
    LiftState,
    Time,
)

Published = list[LiftRequest]

CROWDED_WAIT_S = 10.0
"""Between the END for a crowded lift and the next request (`RobotUpdateHandle.hpp:590`)."""
TIMER_S = 1.0
"""Humble's wall timer in RequestLift and EndLiftSession."""


@unique
class Replan(StrEnum):
    """What lets an outside RequestLift be over before it has seen anything."""

    NEVER = "never"
    ARRIVED = "after a full match for the same floor"
    FLOOR = "with the destination as current_floor, whatever the door"
    DESTINATION = "with the same destination as before"


@dataclass(frozen=True)
class Traits:
    """What one distribution's fleet adapter does in its own way."""

    timer: bool = False
    """Asks once a second while a phase lasts, and not on a LiftState; silent while the robot drives. Every END is of EndLiftSession, which
    a cancelled or crowded RequestLift makes, too (humble 621dfc9c, `RequestLift.cpp` L172-184 and L226-235)."""
    any_lift: bool = False
    """Asks again on the LiftState of any lift, not only of its own."""
    replan: Replan = Replan.ARRIVED
    ends_with_floor: bool = False
    """`release_lift` also publishes an END with the destination at once."""
    busy_release_s: float = 30.0
    """Auto release of a robot that is outside, and nobody holds the claim."""
    idle_release_s: float = 10.0
    """The same for one without a task."""


TRAITS: Mapping[str, Traits] = {
    "humble": Traits(timer=True, replan=Replan.NEVER),
    "iron": Traits(any_lift=True, replan=Replan.FLOOR),
    "jazzy": Traits(
        any_lift=True, replan=Replan.DESTINATION, ends_with_floor=True, busy_release_s=0.0, idle_release_s=2.0
    ),
    "kilted": Traits(),
}
"""By distribution; rolling and main are as kilted."""


@unique
class Phase(StrEnum):
    """What the task of the robot waits for."""

    NONE = "none"
    REQUEST = "RequestLift"
    CROWDED = "waiting, the lift is crowded"
    END = "EndLiftSession"


def _clear() -> bool:
    return False


class FleetRobot:
    """A robot and the lift that it uses."""

    def __init__(self, session: str, lift: str, traits: Traits, *, crowded: Callable[[], bool] = _clear) -> None:
        """`session` is `<fleet>/<robot>`; `crowded` answers LiftClearance, asked outside after arrival."""
        self.session = session
        self.lift = lift
        self.floor: str | None = None
        """The lift destination: it is asked for as long as it is there, and not only while a phase lasts."""
        self.phase = Phase.NONE
        self.due = math.inf
        """When `tick` has something to do."""
        self.saw_it = False
        """The last RequestLift was over because of a LiftState, and not let through."""
        self._traits = traits
        self._crowded = crowded
        self._inside = False
        self._last_floor = ""
        self._arrived = False
        """Main: there was a full match for this destination. Iron: the last state had it as current_floor."""
        self._release_at = math.inf
        self._ends = False
        """An EndLiftSession with a timer goes on, in its phase or while the robot waits before a crowded lift."""
        self._crowded_until = math.inf

    # -- the task of the robot

    def request_lift(self, floor: str, *, inside: bool, now: float) -> Published:
        """Begin RequestLift; it is over at once where a replan is let through without a look at the lift."""
        same, arrived = self.floor == floor, self._arrived and self.floor == floor
        self._set(floor)
        self._inside, self._arrived, self._release_at = inside, arrived, math.inf
        self.phase, self.saw_it, self._ends = Phase.REQUEST, False, False
        if not inside and self._let_through(same=same, arrived=arrived):
            self.phase = Phase.NONE
        return self._ask(now)

    def end_lift_session(self, now: float) -> Published:
        """Begin EndLiftSession: `release_lift`, then wait for a LiftState with another session."""
        self.phase = Phase.END
        return self._release(now)

    def abandon(self, *, idle: bool, now: float) -> None:
        """Leave the task, outside of the lift: the session is released by itself some time later."""
        self.phase = Phase.NONE
        self._release_at = now + (self._traits.idle_release_s if idle else self._traits.busy_release_s)
        self._set_due(now)

    # -- what it hears

    def heard(self, state: LiftState, now: float) -> Published:
        """Take a LiftState of any lift."""
        sent: Published = []
        own = state.lift_name == self.lift
        if own and self.floor is not None and self._traits.replan is Replan.FLOOR:
            self._arrived = state.current_floor == self.floor
        if not self._traits.timer:
            if self.floor is not None and (own or self._traits.any_lift):
                sent += self._ask(now)
            elif self.floor is None and own and state.session_id == self.session:
                sent.append(self._end("", now))
        if own:
            sent += self._looked(state, now)
        return sent

    def tick(self, now: float) -> Published:
        """Do what is due by now."""
        if now < self.due:
            return []
        sent: Published = []
        if now >= self._release_at:
            self._release_at = math.inf
            sent += self._release(now)
        elif self.phase is Phase.CROWDED and now >= self._crowded_until:
            self._set(self._last_floor)
            self.phase, self._ends = Phase.REQUEST, False
            sent += self._ask(now)
        elif self._ends:
            sent.append(self._end(self._last_floor, now))
        elif self.phase is Phase.REQUEST:
            sent += self._ask(now)
        self._set_due(now)
        return sent

    # -- steps

    def _looked(self, state: LiftState, now: float) -> Published:
        if state.session_id != self.session:
            self._ends = False
            if self.phase is Phase.END:
                self.phase = Phase.NONE
        matches = (state.current_floor, state.door_state, state.session_id) == (self.floor, DOOR_OPEN, self.session)
        if self.phase is not Phase.REQUEST or not matches:
            return []
        if not self._inside and self._crowded():
            self.phase, self._crowded_until = Phase.CROWDED, now + CROWDED_WAIT_S
            return self._release(now)
        self._arrived = self.saw_it = True
        self.phase = Phase.NONE
        return []

    def _let_through(self, *, same: bool, arrived: bool) -> bool:
        match self._traits.replan:
            case Replan.ARRIVED | Replan.FLOOR:
                return arrived
            case Replan.DESTINATION:
                return same
            case Replan.NEVER:
                return False

    def _set(self, floor: str) -> None:
        self.floor = self._last_floor = floor

    def _ask(self, now: float) -> Published:
        self._set_due(now)
        if self.floor is None:
            return []
        return [LiftRequest(self.lift, Time.of(now), self.session, AGV_MODE, self.floor, DOOR_OPEN)]

    def _release(self, now: float) -> Published:
        had, self.floor, self._arrived = self.floor, None, False
        self._ends = self._traits.timer and had is not None
        self._set_due(now)
        if had is None or not (self._traits.timer or self._traits.ends_with_floor):
            return []  # the END goes out on the next LiftState that has its session
        return [self._end(had, now)]

    def _end(self, floor: str, now: float) -> LiftRequest:
        return LiftRequest(self.lift, Time.of(now), self.session, END_SESSION, floor, DOOR_CLOSED)

    def _set_due(self, now: float) -> None:
        timed = self._ends or (self._traits.timer and self.phase is Phase.REQUEST)
        crowded_until = self._crowded_until if self.phase is Phase.CROWDED else math.inf
        self.due = min(now + TIMER_S if timed else math.inf, self._release_at, crowded_until)
