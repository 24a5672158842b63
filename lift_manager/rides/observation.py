"""What a ride sees of its lift at one moment, and what that means: may its robot go through the door, and if not, why not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import timedelta

from drivers.model import FloorName
from lift_manager.lift.commands import SessionInfo
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.observation import Moment, RobotDoor
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.queue import Queue
from lift_manager.lift.refusals import how_to_acknowledge, how_to_end_drain, how_to_end_lockout
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.rides.record import RESTORED_FOR_S, RideRecord
from register_maps.words import ROBOT_FORBIDDEN_MODES, Door, Motion


@dataclass(frozen=True, slots=True)
class LiftView:
    """One lift of the site, as rides see it."""

    config: LiftConfig
    state: LiftState
    queue: Queue


Lifts = Mapping[str, LiftView]
"""Every lift of the site by name, in the site's order, as it is now."""


@dataclass(frozen=True, slots=True)
class RideInDoubt:
    """Another ride of the same holder whose robot may be in a car."""

    ride: str
    lift: str
    since: float
    """When that ride gave up; infinity while it lasts."""

    @property
    def goes_on(self) -> bool:
        """Whether that ride is not over."""
        return math.isinf(self.since)


@dataclass(frozen=True, slots=True, kw_only=True)
class RideObservation:
    """What a ride sees of its lift at one moment (`rides.observe`)."""

    state: LiftState
    clear_s: float
    """From the withdrawal of OPEN to the release of a held door."""
    session: SessionInfo | None = None
    """The ride's session, over or not; None if it has none."""
    gone: str = ""
    """Why the lift no longer knows the ride's session; empty otherwise."""
    ahead: int = 0
    """How many wait in the queue before the ride."""
    busy: str = ""
    """Which other ride holds the lift, in words; empty if none does."""
    doubt: RideInDoubt | None = None
    """What forbids the ride to start, unless its robot has reported since."""

    @property
    def robot(self) -> Occupancy:
        """Where the session's robot is, as far as the lift knows."""
        return self.session.robot if self.session is not None else Occupancy.OUTSIDE

    @property
    def may_have_boarded(self) -> bool:
        """Whether the robot may have gone in."""
        return self.robot in (Occupancy.MAY_BOARD, Occupancy.ABOARD)

    def is_held_by_another(self, holder: Holder) -> bool:
        """Whether somebody else holds the lift."""
        return self.state.holder not in (None, holder)


def is_live(state: LiftState) -> bool:
    """Whether the state may be acted on."""
    return state.quality is Quality.LIVE


# -- the door


def stands_open(record: RideRecord, observed: RideObservation, floor: FloorName | None) -> bool:
    """Whether the lift's published door stands open at a floor for the robot of this ride, held by its session."""
    state, session = observed.state, observed.session
    if session is None or session.over is not None or state.holder != record.holder:
        return False
    is_held = session.floor == floor and session.arrived and session.door_held
    return is_held and is_live(state) and state.standing and state.floor == floor and state.robot_door is RobotDoor.OPEN


def may_enter(record: RideRecord, observed: RideObservation) -> bool:
    """Whether the robot is to drive in now; a lift that has a permission to enter has to give it."""
    return stands_open(record, observed, record.request.start) and observed.state.permissions.get("may_enter", True)


def remember_observed(record: RideRecord, observed: RideObservation, moment: Moment) -> RideRecord:
    """Return the record with what is remembered of the observation.

    That is since when the lift is offline, where the car stands, and where a robot inside could exit.
    """
    state = observed.state
    if not is_live(state):
        return replace(record, stands=None, offline_since=record.offline_since or _last_read(state, moment))
    at, exit_at = state.floor, record.could_exit_at
    is_open = any(door is Door.OPEN for door in state.doors.values())
    if (at is not None and exit_at != at) or _is_under_way(state):
        exit_at = None
    if record.maybe_aboard and state.standing and at is not None and is_open:
        exit_at = at
    is_stopped = state.standing and at is not None and state.motion in (Motion.STOPPED, Motion.UNKNOWN)
    stands = record.stands
    if not is_stopped or at is None:
        stands = None
    elif stands is None or stands[0] != at:
        stands = (at, moment.now)
    return replace(record, could_exit_at=exit_at, stands=stands, offline_since="")


def _is_under_way(state: LiftState) -> bool:
    """Whether the car moves with its doors shut: nobody gets out of it, whatever floor it reports."""
    is_shut = bool(state.doors) and all(door is Door.CLOSED for door in state.doors.values())
    moves = state.motion in (Motion.UP, Motion.DOWN, Motion.MOVING)
    return is_shut and (moves or (state.motion is Motion.UNKNOWN and state.floor is None))


def _last_read(state: LiftState, moment: Moment) -> str:
    """Return the time of day of the last reading; empty if there never was one."""
    if state.age_s is None:
        return ""
    at = moment.clock - timedelta(seconds=state.age_s)
    shown = "%H:%M:%S" if at.date() == moment.clock.date() else "%Y-%m-%d %H:%M:%S"
    return f"{at:{shown}}"


# -- why the door does not invite the robot

_WAITS_FOR_ROBOT = "waits for a report of the robot: it has to send `here`"
"""After a restart of the manager, and where a remote caller began the ride."""


def why_not_open(record: RideRecord, observed: RideObservation, floor: FloorName | None) -> str:
    """Return why the door does not invite the robot at a floor; empty while it does."""
    state, session = observed.state, observed.session
    if not is_live(state):
        return _offline_text(record, observed)
    if record.silent_since is not None and not stands_open(record, observed, floor):
        return _WAITS_FOR_ROBOT
    if session is None or session.over is not None:
        return "the ride has no session yet"
    if state.holder != record.holder:
        return f"{state.lift} is held by {state.holder or 'nobody'}"
    return _why_not_there(record, session, floor) or _why_shut(state, session, floor)


def _why_not_there(record: RideRecord, session: SessionInfo, floor: FloorName | None) -> str:
    if record.failure and not (session.floor == floor and session.arrived and session.door_held):
        return record.failure
    if session.waiting_for:
        return f"waits for {session.waiting_for}"
    return "" if session.floor == floor and session.arrived else f"the car is on its way to {floor}"


def _why_shut(state: LiftState, session: SessionInfo, floor: FloorName | None) -> str:
    if state.floor != floor or not state.standing:
        return f"the car does not stand at {floor}"
    doors = ", ".join(f"{side} {door}" for side, door in sorted(state.doors.items()))
    if state.robot_door is not RobotDoor.OPEN:
        if session.releasing and session.door_held and session.releases_in_s is not None:
            return f"the door at {floor} is released in {session.releases_in_s:.0f} s: do not set out; on the sill, finish crossing"
        if doors and all(door is Door.OPEN for door in state.doors.values()):
            if not session.door_held:
                return f"the door at {floor} is open, and is not held yet: waits for the hold"
            return _why_not_passable(state, session, floor)
        return f"the door at {floor} is not open for the robot ({doors or 'not known'})"
    if not session.door_held:
        return f"the door at {floor} is open, and is not held yet: waits for the hold"
    if not state.permissions.get("may_enter", True):
        return "the lift does not give `may_enter`"
    return ""


def _why_not_passable(state: LiftState, session: SessionInfo, floor: FloorName | None) -> str:
    """Return what keeps a robot from entering or leaving through an open door that is held for it."""
    permission = "may_leave" if session.robot is Occupancy.ABOARD else "may_enter"
    if not state.permissions.get(permission, True):
        return f"the door at {floor} is open, and the lift does not give `{permission}`"
    if state.restrictions.lockout:
        return f"the door at {floor} is open, and robots are locked out"
    if state.mode in ROBOT_FORBIDDEN_MODES:
        return f"the door at {floor} is open, and the lift is not in a mode for robots (its mode is {state.mode})"
    return f"the door at {floor} is open; waits for a reading that confirms it"


def _offline_text(record: RideRecord, observed: RideObservation) -> str:
    since = f"since {record.offline_since}" if record.offline_since else "and was never read"
    return f"{observed.state.lift} is offline {since}"


# -- why the lift is not taken


def why_not_taken(record: RideRecord, observed: RideObservation, moment: Moment) -> str:
    """Return what a queued ride waits for, as far as is known without a request; empty where the lift may be requested."""
    state = observed.state
    why = _why_silent(record, moment.now) or _why_kept_out(record, observed) or _why_doubted(record, observed)
    if why:
        return why
    if observed.is_held_by_another(record.holder):
        return f"{state.lift} is held by {state.holder}"
    if observed.busy:
        return observed.busy
    may_be_in_car = state.holder is None and state.restrictions.maybe_aboard == record.holder
    # everybody in the queue waits for the robot that is inside
    return f"{observed.ahead} wait before it" if observed.ahead and not may_be_in_car else ""


def _why_silent(record: RideRecord, now: float) -> str:
    if record.silent_since is None:
        return ""
    remaining_s = record.silent_since + RESTORED_FOR_S - now
    if remaining_s > 0:
        return f"{_WAITS_FOR_ROBOT} within {remaining_s:.0f} s to keep its place"
    return f"{_WAITS_FOR_ROBOT}; it has lost its place in the queue"


def _why_doubted(record: RideRecord, observed: RideObservation) -> str:
    """Return why another ride of the same holder blocks this one: only the robot knows where it is."""
    doubt = observed.doubt
    if doubt is None or record.present_at >= doubt.since:
        return ""
    caller, where = record.request.caller, f"in the car of {doubt.lift}"
    if record.request.robot:
        return (
            f"your robot may be {where}: send `left` for ride {doubt.ride}, or begin another ride from inside, or send `here` for"
            " this one"
        )
    unnamed = "robots without names cannot be distinguished: give each its name with `robot`"
    if doubt.goes_on:
        return (
            f"the robot of ride {doubt.ride} of {caller} may be {where}, and {unnamed}; waits until that ride is over"
        )
    return (
        f"a robot of {caller} may be {where}, and {unnamed}; send `left` for ride {doubt.ride}, or `here` for this one if its"
        " robot is inside"
    )


def _why_kept_out(record: RideRecord, observed: RideObservation) -> str:
    state, restrictions = observed.state, observed.state.restrictions
    if not is_live(state):
        return _offline_text(record, observed)
    if restrictions.lockout:
        return (
            f"{state.lift} is locked out {restrictions.lockout}; a person ends it with {how_to_end_lockout(state.lift)}"
        )
    if restrictions.fire_latched:
        return f"there was a fire; a person must check {state.lift}: {how_to_acknowledge(state.lift)}"
    if state.mode in ROBOT_FORBIDDEN_MODES:
        return f"the mode of {state.lift} is {state.mode}"
    if restrictions.drain and restrictions.maybe_aboard != record.holder:
        return f"no new session begins on {state.lift}: drain {restrictions.drain}; a person ends it with {how_to_end_drain(state.lift)}"
    if restrictions.distrusted:
        return f"the signals of {state.lift} are distrusted: {restrictions.distrusted}"
    if restrictions.maybe_aboard not in (None, record.holder, state.holder):
        return (
            f"a robot of {restrictions.maybe_aboard} may be in the car; it has to report that it left, or a person must look:"
            f" {how_to_acknowledge(state.lift)}"
        )
    return ""
