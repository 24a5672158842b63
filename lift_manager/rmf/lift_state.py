"""The state of a lift for RMF, and when it is published. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from lift_manager.plain.client_aging import age_s, is_too_old
from lift_manager.plain.rmf import LiftView
from lift_manager.rmf.lift_sessions import LiftSessions
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
MIN_GAP_S = 0.02
"""Between two messages about changes of one lift, so that simultaneous changes share a message. Chosen."""

NO_CLOCK_S = 5.0
"""How long /clock may be missing in simulated time before a warning is logged; `lift_time` is 0 until it arrives."""

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
"""RMF's only mode for a lift that people have reserved for themselves is HUMAN."""


def make_state(sessions: LiftSessions, sent_at: float, now: float, ros_time: float) -> LiftState:
    """Return the state of a lift as RMF may see it now.

    `sent_at` is when the request for the view was sent, `ros_time` RMF's clock in seconds. `lift_time` is that clock
    minus the age of the data, or 0 before the first reading.
    """
    view = sessions.view
    age = age_s(view.age_s, sent_at, now)
    live = not sessions.manager_lost and view.live and not is_too_old(age, view.max_age_s)
    floor = _floor(sessions, view) if live else ""
    return LiftState(
        lift_time=Time() if age is None else Time.of(ros_time - age),
        lift_name=view.name,
        available_floors=tuple(view.floors.values()),
        current_floor=floor,
        destination_floor=_destination(sessions, floor),
        door_state=_door(sessions, view, now) if live else DOOR_MOVING,
        motion_state=_MOTIONS.get(view.motion, MOTION_UNKNOWN) if live else MOTION_UNKNOWN,
        available_modes=AVAILABLE_MODES,
        current_mode=_mode(sessions, view) if live else MODE_OFFLINE,
        session_id=_session(sessions, now),
    )


def stale_at(view: LiftView, sent_at: float) -> float:
    """Return when a view goes stale; infinite if it is stale already."""
    return math.inf if not view.live or view.age_s is None else sent_at + view.max_age_s - view.age_s


def as_offline(state: LiftState) -> LiftState:
    """Return a state as it is published when no further one will follow."""
    return replace(
        state,
        current_floor="",
        destination_floor=state.destination_floor if state.session_id else "",
        door_state=DOOR_MOVING,
        motion_state=MOTION_UNKNOWN,
        current_mode=MODE_OFFLINE,
    )


def equal_except_time(one: LiftState, other: LiftState) -> bool:
    """Whether two states differ in nothing but their time."""
    return _fields_except_time(one) == _fields_except_time(other)


def _fields_except_time(state: LiftState) -> tuple[object, ...]:
    """Return every field but the first. `replace` takes ten times as long, and this runs for every lift at every change."""
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
    """When the next state of a lift is due: twice a second, staggered over the lifts, and at once after a change."""

    def __init__(self, index: int, count: int, now: float) -> None:
        """`index` of `count` lifts: some readers keep one message only (open-rmf 1.3)."""
        self._due_at = now + PERIOD_S * index / count
        self._change_sent_at = -math.inf
        self._sent_state: LiftState | None = None

    def is_due(self, state: LiftState, now: float) -> bool:
        """Whether this state is to be published now."""
        if now >= self._due_at:
            return True
        return self._is_change(state) and now >= self._change_sent_at + MIN_GAP_S

    def mark_sent(self, state: LiftState, now: float) -> None:
        """Record that it was published. A change in between does not shift the regular times."""
        if self._is_change(state):
            self._sent_state, self._change_sent_at = state, now
        if now >= self._due_at:
            self._due_at += PERIOD_S * (1 + math.floor((now - self._due_at) / PERIOD_S))

    def next_at(self, state: LiftState) -> float:
        """Return when the next state is due if nothing changes."""
        return min(self._due_at, self._change_sent_at + MIN_GAP_S) if self._is_change(state) else self._due_at

    def _is_change(self, state: LiftState) -> bool:
        return self._sent_state is None or not equal_except_time(state, self._sent_state)


def _floor(sessions: LiftSessions, view: LiftView) -> str:
    """Return where the car is, but not the demanded floor while the car is still passing it.

    Iron takes its destination in `current_floor` for the arrival, whatever the door state is (open-rmf 1.6.3), and the manager hides
    the floor only for demands that it knows already.
    """
    is_passing = (
        sessions.is_granted
        and sessions.demand is not None
        and sessions.demand.floor == view.floor
        and not view.standing
    )
    return "" if is_passing or view.floor is None else view.floors.get(view.floor, "")


def _door(sessions: LiftSessions, view: LiftView, now: float) -> int:
    """Return OPEN, on which a robot drives, only if the lift is held for the published session, or if no session is published."""
    if view.door == "closed":
        return DOOR_CLOSED
    unheld = not sessions.is_granted and sessions.foreign_holder is None and not sessions.undelivered_session(now)
    return DOOR_OPEN if view.door == "open" and (unheld or sessions.is_settled) else DOOR_MOVING


def _session(sessions: LiftSessions, now: float) -> str:
    if sessions.is_granted:
        return sessions.session
    if session := sessions.undelivered_session(now):
        return session
    return "" if sessions.foreign_holder is None else str(sessions.foreign_holder)


def _destination(sessions: LiftSessions, floor: str) -> str:
    """Return the demanded floor: a supervisor repeats its request for as long as it reads another one (open-rmf 1.6.4)."""
    floors = sessions.view.floors
    if sessions.is_granted and sessions.demand is not None:
        return floors.get(sessions.demand.floor, "")
    destination = sessions.view.destination
    held = sessions.is_granted or sessions.foreign_holder is not None
    return floors.get(destination, floor) if held and destination is not None else floor


def _mode(sessions: LiftSessions, view: LiftView) -> int:
    """Return the requested mode for a lift in normal mode that RMF holds: in AGV mode its door is open whenever it has stopped."""
    if view.mode == "normal" and sessions.is_settled and view.robot_mode_on is not False:
        return MODE_HUMAN if sessions.human_mode else MODE_AGV
    return _MODES.get(view.mode, MODE_UNKNOWN)
