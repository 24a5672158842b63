"""What is told to RMF about a lift, and when. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from lift_manager.plain.aging import age_s, is_too_old
from lift_manager.plain.rmf import LiftView
from lift_manager.rmf.contract import LiftContract
from lift_manager.rmf.messages import (
    DOOR_CLOSED,
    DOOR_MOVING,
    DOOR_OPEN,
    MODE_AGV,
    MODE_EMERGENCY,
    MODE_FIRE,
    MODE_HUMAN,
    MODE_OFFLINE,
    MODE_UNKNOWN,
    MOTION_DOWN,
    MOTION_STOPPED,
    MOTION_UNKNOWN,
    MOTION_UP,
    LiftState,
    Time,
)

PERIOD_S = 0.5
"""2 Hz: most waits in RMF last until the next LiftState, and humble's supervisor sends only in answer to one (open-rmf 1.6.10, 7)."""
AT_LEAST_S = 0.02
"""Chosen: between two messages of one lift, so that changes of one moment are one message."""

NO_CLOCK_S = 5.0
"""So long without /clock where RMF's time is simulated, and a person is told once; what is published has the time 0 until then."""

AVAILABLE_MODES = (MODE_HUMAN, MODE_AGV)
_MOTIONS: Mapping[str, int] = {"stopped": MOTION_STOPPED, "up": MOTION_UP, "down": MOTION_DOWN}
_MODES: Mapping[str, int] = {
    "normal": MODE_HUMAN,
    "robot": MODE_AGV,
    "independent": MODE_HUMAN,
    "attendant": MODE_HUMAN,
    "inspection": MODE_HUMAN,
    "fire": MODE_FIRE,
    "emergency": MODE_EMERGENCY,
    "out_of_service": MODE_OFFLINE,
}
"""RMF has no word for a lift that persons have taken for themselves but HUMAN."""


def message(contract: LiftContract, sent_at: float, now: float, ros_time: float) -> LiftState:
    """Return the state of a lift as RMF may have it now.

    `sent_at` is when the question for the contract's view left, `ros_time` RMF's clock in seconds; `lift_time` is that clock
    less the age of the data, and 0 where there never was a reading.
    """
    view = contract.view
    age = age_s(view.age_s, sent_at, now)
    live = not contract.manager_lost and view.live and not is_too_old(age, view.max_age_s)
    floor = _floor(contract, view) if live else ""
    return LiftState(
        lift_time=Time() if age is None else Time.of(ros_time - age),
        lift_name=view.name,
        available_floors=tuple(view.floors.values()),
        current_floor=floor,
        destination_floor=_destination(contract, floor),
        door_state=_door(contract, view, now) if live else DOOR_MOVING,
        motion_state=_MOTIONS.get(view.motion, MOTION_UNKNOWN) if live else MOTION_UNKNOWN,
        available_modes=AVAILABLE_MODES,
        current_mode=_mode(contract, view) if live else MODE_OFFLINE,
        session_id=_session(contract, now),
    )


def stale_at(view: LiftView, sent_at: float) -> float:
    """Return when nothing may be concluded from a view any more; infinite where nothing may already."""
    return math.inf if not view.live or view.age_s is None else sent_at + view.max_age_s - view.age_s


def offline(state: LiftState) -> LiftState:
    """Return a state as it is told when nobody will tell more."""
    return replace(
        state,
        current_floor="",
        destination_floor=state.destination_floor if state.session_id else "",
        door_state=DOOR_MOVING,
        motion_state=MOTION_UNKNOWN,
        current_mode=MODE_OFFLINE,
    )


def same_but_for_time(one: LiftState, other: LiftState) -> bool:
    """Whether two states differ in nothing but their time."""
    return _but_for_time(one) == _but_for_time(other)


def _but_for_time(state: LiftState) -> tuple[object, ...]:
    """Every field but the first: making another message of it takes ten times as long, and this is done for every lift at every change."""
    return (
        state.lift_name,
        state.available_floors,
        state.current_floor,
        state.destination_floor,
        state.door_state,
        state.motion_state,
        state.available_modes,
        state.current_mode,
        state.session_id,
    )


class Cadence:
    """When the next state of a lift is due: twice a second, each lift at another moment, and at once when something has changed."""

    def __init__(self, place: int, places: int, now: float) -> None:
        """`place` of `places` lifts: some readers keep one message only (open-rmf 1.3)."""
        self._due = now + PERIOD_S * place / places
        self._last = -math.inf
        self._sent: LiftState | None = None

    def due(self, state: LiftState, now: float) -> bool:
        """Whether this state is to be published now."""
        if now >= self._due:
            return True
        changed = self._sent is None or not same_but_for_time(state, self._sent)
        return changed and now >= self._last + AT_LEAST_S

    def sent(self, state: LiftState, now: float) -> None:
        """Note that it was published. The beat is kept: a change in between moves none of what follows."""
        self._sent, self._last = state, now
        if now >= self._due:
            self._due += PERIOD_S * (1 + math.floor((now - self._due) / PERIOD_S))

    def next(self, state: LiftState) -> float:
        """Return when to look again, if nothing happens before."""
        changed = self._sent is None or not same_but_for_time(state, self._sent)
        return min(self._due, self._last + AT_LEAST_S) if changed else self._due


def _floor(contract: LiftContract, view: LiftView) -> str:
    """Return where the car is, but not where it only passes for whoever wants to go there.

    Iron takes its destination in `current_floor` for the arrival, whatever the door says (open-rmf 1.6.3), and the manager hides
    only what it was told already.
    """
    passes = (
        contract.is_granted
        and contract.demand is not None
        and contract.demand.floor == view.floor
        and not view.standing
    )
    return "" if passes or view.floor is None else view.floors.get(view.floor, "")


def _door(contract: LiftContract, view: LiftView, now: float) -> int:
    """OPEN is what a robot drives on: only with the lift held for it and nobody else, or with no session told at all."""
    if view.door == "closed":
        return DOOR_CLOSED
    nobodys = not contract.is_granted and contract.foreign_holder is None and not contract.undelivered_session(now)
    return DOOR_OPEN if view.door == "open" and (nobodys or contract.is_settled) else DOOR_MOVING


def _session(contract: LiftContract, now: float) -> str:
    if contract.is_granted:
        return contract.session
    if session := contract.undelivered_session(now):
        return session
    return "" if contract.foreign_holder is None else str(contract.foreign_holder)


def _destination(contract: LiftContract, floor: str) -> str:
    """Return what the session wants: a supervisor repeats for ever where it reads another one (open-rmf 1.6.4)."""
    floors = contract.view.floors
    if contract.is_granted and contract.demand is not None:
        return floors.get(contract.demand.floor, "")
    wanted = contract.view.destination
    held = contract.is_granted or contract.foreign_holder is not None
    return floors.get(wanted, floor) if held and wanted is not None else floor


def _mode(contract: LiftContract, view: LiftView) -> int:
    """A lift in normal mode is in the mode that was asked for as long as RMF holds it: in AGV mode its door stands open when it has stopped."""
    if view.mode == "normal" and contract.is_settled and view.robot_mode_on is not False:
        return MODE_HUMAN if contract.human_mode else MODE_AGV
    return _MODES.get(view.mode, MODE_UNKNOWN)
