"""What the sight of a lift means for a ride: whether its door invites the robot, and why not. Pure."""

from __future__ import annotations

from dataclasses import replace

from drivers.model import FloorName
from lift_manager.domain.boarding import Who
from lift_manager.domain.ride_record import UNHEARD_S, RideRecord, RideSight
from lift_manager.domain.service import how_to_acknowledge, how_to_end_drain, how_to_end_lockout
from lift_manager.domain.session_requests import SessionInfo
from lift_manager.domain.state import LiftState, Quality, RobotDoor
from register_maps.words import ROBOT_FORBIDDEN_MODES, Door, Motion


def is_live(state: LiftState) -> bool:
    """Whether the state may be acted on."""
    return state.quality is Quality.LIVE


def stands_open(record: RideRecord, seen: RideSight, floor: FloorName | None) -> bool:
    """Whether the lift's published door stands open at a floor for the robot of this ride, held by its session."""
    state, session = seen.state, seen.session
    if session is None or session.over is not None or state.holder != record.holder:
        return False
    held = session.floor == floor and session.arrived and session.door_held
    return held and is_live(state) and state.standing and state.floor == floor and state.robot_door is RobotDoor.OPEN


def may_enter(record: RideRecord, seen: RideSight) -> bool:
    """Whether the robot is to drive in now; a lift that tells of the permission has to give it."""
    return stands_open(record, seen, record.wish.start) and seen.state.permissions.get("may_enter", True)


def boarding_possible(seen: RideSight) -> bool:
    """Whether the robot may have gone in."""
    return seen.robot in (Who.MAY_BOARD, Who.ABOARD)


def looked(record: RideRecord, seen: RideSight) -> RideRecord:
    """Take what is remembered of what is seen: where the car stands, and where a robot inside could leave it."""
    state = seen.state
    if not is_live(state):
        return replace(record, stands=None)
    at, floor = state.floor, record.could_leave_at
    is_open = any(door is Door.OPEN for door in state.doors.values())
    if (at is not None and floor != at) or _under_way(state):
        floor = None
    if record.maybe_aboard and state.standing and at is not None and is_open:
        floor = at
    stopped = state.standing and at is not None and state.motion in (Motion.STOPPED, Motion.UNKNOWN)
    stands = record.stands
    if not stopped or at is None:
        stands = None
    elif stands is None or stands[0] != at:
        stands = (at, seen.now)
    return replace(record, could_leave_at=floor, stands=stands)


def _under_way(state: LiftState) -> bool:
    """Whether the car moves with its doors shut: nobody gets out of it, whatever floor it reports."""
    is_shut = bool(state.doors) and all(door is Door.CLOSED for door in state.doors.values())
    moves = state.motion in (Motion.UP, Motion.DOWN, Motion.MOVING)
    return is_shut and (moves or (state.motion is Motion.UNKNOWN and state.floor is None))


def why_not_open(record: RideRecord, seen: RideSight, floor: FloorName | None) -> str:
    """Say why the door does not invite the robot at a floor; empty while it does."""
    state, session = seen.state, seen.session
    if not is_live(state):
        return offline_text(seen)
    if record.unheard_since is not None and not stands_open(record, seen, floor):
        return "waits to hear the robot after a restart of the manager: it has to say `here`"
    if session is None or session.over is not None:
        return "the session is not taken up yet"
    if state.holder != record.holder:
        return f"{state.lift} is held by {state.holder or 'nobody'}"
    return _awaited(record, session, floor) or _why_shut(state, session, floor)


def _awaited(record: RideRecord, session: SessionInfo, floor: FloorName | None) -> str:
    if record.trouble and not (session.floor == floor and session.arrived and session.door_held):
        return record.trouble
    if session.waiting_for:
        return f"waits for {session.waiting_for}"
    return "" if session.floor == floor and session.arrived else f"the car is on its way to {floor}"


def _why_shut(state: LiftState, session: SessionInfo, floor: FloorName | None) -> str:
    if state.floor != floor or not state.standing:
        return f"the car does not stand at {floor}"
    told = ", ".join(f"{side} {door}" for side, door in sorted(state.doors.items()))
    if state.robot_door is not RobotDoor.OPEN:
        if session.releasing and session.door_held and session.releases_in_s is not None:
            return f"the door at {floor} is released in {session.releases_in_s:.0f} s: do not set out; on the sill, finish crossing"
        if told and all(door is Door.OPEN for door in state.doors.values()):
            if not session.door_held:
                return f"the door at {floor} is open, and is not held yet: waits for the hold"
            return _why_not_through(state, session, floor)
        return f"the door at {floor} is not open for the robot ({told or 'not known'})"
    if not session.door_held:
        return f"the door at {floor} is open, and is not held yet: waits for the hold"
    if not state.permissions.get("may_enter", True):
        return "the lift does not give `may_enter`"
    return ""


def _why_not_through(state: LiftState, session: SessionInfo, floor: FloorName | None) -> str:
    """Say what keeps a robot from an open door that is held for it."""
    permission = "may_leave" if session.robot is Who.ABOARD else "may_enter"
    if not state.permissions.get(permission, True):
        return f"the door at {floor} is open, and the lift does not give `{permission}`"
    if state.restrictions.lockout:
        return f"the door at {floor} is open, and robots are locked out"
    return f"the door at {floor} is open, and the lift is not in a mode for robots (its mode is {state.mode})"


def offline_text(seen: RideSight) -> str:
    """Say since when nothing is known of the lift."""
    since = f"since {seen.offline_since}" if seen.offline_since else "and was never read"
    return f"{seen.state.lift} is offline {since}"


def why_not_taken(record: RideRecord, seen: RideSight) -> str:
    """Say what a queued ride waits for, as far as is known without asking the lift; empty where it may be asked."""
    state = seen.state
    why = _why_unheard(record, seen) or _why_kept_out(record, seen) or _why_doubted(record, seen)
    if why:
        return why
    if state.holder is not None and state.holder != record.holder:
        return f"{state.lift} is held by {state.holder}"
    if seen.busy:
        return seen.busy
    may_be_inside = state.holder is None and state.restrictions.maybe_aboard == record.holder
    # whoever waits, waits for the robot that is inside
    return f"{seen.ahead} wait before it" if seen.ahead and not may_be_inside else ""


def _why_unheard(record: RideRecord, seen: RideSight) -> str:
    if record.unheard_since is None:
        return ""
    heard = "waits to hear the robot after a restart of the manager: it has to say `here`"
    left_s = record.unheard_since + UNHEARD_S - seen.now
    if left_s > 0:
        return f"{heard} within {left_s:.0f} s to keep its place"
    return f"{heard}; it has lost its place in the line"


def _why_doubted(record: RideRecord, seen: RideSight) -> str:
    """Say why another ride of the same holder speaks against this one: nobody but the robot knows where it is."""
    doubt = seen.doubt
    if doubt is None or record.spoke_at >= doubt.since:
        return ""
    caller, where = record.wish.caller, f"in the car of {doubt.lift}"
    if record.wish.robot:
        return (
            f"your robot may be {where}: say `left` for ride {doubt.ride}, or begin a ride anew from inside, or say `here` for"
            " this one"
        )
    unnamed = "robots without names cannot be told apart: give each its name with `robot`"
    if doubt.goes_on:
        return (
            f"the robot of ride {doubt.ride} of {caller} may be {where}, and {unnamed}; waits until that ride is over"
        )
    return (
        f"a robot of {caller} may be {where}, and {unnamed}; say `left` for ride {doubt.ride}, or `here` for this one if its"
        " robot is inside"
    )


def _why_kept_out(record: RideRecord, seen: RideSight) -> str:
    state, told = seen.state, seen.state.restrictions
    if not is_live(state):
        return offline_text(seen)
    if told.lockout:
        return f"{state.lift} is locked out {told.lockout}; a person ends it with {how_to_end_lockout(state.lift)}"
    if told.fire_latched:
        return f"there was a fire; a person must check {state.lift}: {how_to_acknowledge(state.lift)}"
    if state.mode in ROBOT_FORBIDDEN_MODES:
        return f"the mode of {state.lift} is {state.mode}"
    if told.drain and told.maybe_aboard != record.holder:
        return f"no new session begins on {state.lift}: drain {told.drain}; a person ends it with {how_to_end_drain(state.lift)}"
    if told.distrusted:
        return f"the signals of {state.lift} are distrusted: {told.distrusted}"
    if told.maybe_aboard not in (None, record.holder, state.holder):
        return (
            f"a robot of {told.maybe_aboard} may be in the car; it has to say that it left, or a person must look:"
            f" {how_to_acknowledge(state.lift)}"
        )
    return ""
