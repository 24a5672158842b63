"""From what is known of a lift to what is published about it. Pure; every face shows this and nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from operator import attrgetter

from drivers.model import Capabilities, FloorName
from lift_manager.domain.seconds import without_seconds
from lift_manager.domain.session import Session
from lift_manager.domain.sight import Sight, moving, permissions, robot_door, shut
from lift_manager.domain.state import PERMISSIONS, LiftState, Quality, Restrictions, RobotDoor
from register_maps.words import Mode, Motion, Side


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """Everything the manager knows about one lift at one moment."""

    lift: str
    floors: tuple[FloorName, ...]
    doors_at: Mapping[FloorName, tuple[Side, ...]]
    able: Capabilities
    sight: Sight | None
    age_s: float | None
    """Age of the newest reading; None when there never was one."""
    fault: str
    """Why the last poll failed, or came to nothing; empty when it did not."""
    source: str
    session: Session | None
    arrived: bool
    """The session's call is fulfilled."""
    door_held: bool
    """Our hold of every door at the session's floor is on and verified, where the map has one."""
    aboard: bool | None
    """Whether the session's robot is in the car; None where nobody knows."""
    restrictions: Restrictions
    waiting: int = 0
    """How many wait for the lift."""
    releases_at: float | None = None
    """When the manager releases the door of the session by itself; None without a session."""
    invites_until: float = math.inf
    """From this time on an open door invites nobody, because it is released soon."""


def lift_state(seen: Seen, now: float) -> LiftState:
    """Return the state to publish at `now`."""
    sight, session, age_s = seen.sight, seen.session, seen.age_s
    wanted = session.floor if session is not None else None
    if sight is None or age_s is None or age_s > seen.able.max_age_s:
        sight = None
    floor = None if sight is None else _reported_floor(seen, sight)
    values = None if sight is None else sight.values
    return LiftState(
        lift=seen.lift,
        floors=seen.floors,
        quality=Quality.OFFLINE if sight is None else Quality.LIVE,
        reason=_offline(seen) if sight is None else "",
        age_s=age_s,
        floor=floor,
        standing=sight is not None and sight.standing,
        destination=floor if wanted is None else wanted,
        robot_door=RobotDoor.MOVING if sight is None else _door_for_robots(seen, sight, now),
        doors={} if sight is None else sight.doors,
        motion=Motion.UNKNOWN if sight is None else _motion(sight),
        mode=Mode.UNKNOWN if values is None else values.mode,
        holder=session.holder if session is not None else None,
        held_since_s=now - session.opened_at if session is not None else None,
        permissions={} if values is None else {n: values.flags[n] for n in PERMISSIONS if n in values.flags},
        not_visible=seen.able.not_visible,
        restrictions=seen.restrictions,
        waiting=seen.waiting,
        ending=session is not None and session.ending and session.closing is None,
        releases_at=seen.releases_at,
        releases_in_s=None if seen.releases_at is None else max(0.0, seen.releases_at - now),
    )


_PASSING = ("age_s", "held_since_s", "releases_in_s", "releases_at", "reason")
_LASTING = attrgetter(*(one.name for one in fields(LiftState) if one.name not in _PASSING))


def same_but_for_time(one: LiftState, other: LiftState) -> bool:
    """Whether two states differ in nothing but the passing of time; some reasons say for how many seconds."""
    if one.reason != other.reason and without_seconds(one.reason) != without_seconds(other.reason):
        return False
    same: bool = _LASTING(one) == _LASTING(other)  # twice a poll of each lift: a copy of each costs four times as much
    return same


def late_text(source: str, took_s: float, max_age_s: float) -> str:
    """Say that a controller answers, and that what it says is too old by then."""
    return (
        f"{source} answers too late: its last poll took {took_s:.1f} s, and a reading counts for {max_age_s:g} s (max_age_s); "
        "look for what slows it down, or allow a longer `max_age_s` for this lift"
    )


def _offline(seen: Seen) -> str:
    why = seen.fault or f"{seen.source} has not answered since"
    return f"nothing newer within {seen.able.max_age_s:g} s: {why}"


def _reported_floor(seen: Seen, sight: Sight) -> FloorName | None:
    """Return the floor, unless that is where the car is still travelling to: nobody may take it for arrived."""
    floor = sight.floor
    if sight.standing:
        return floor
    if seen.session is not None and floor == seen.session.floor and not seen.arrived:
        return None
    if moving(sight) and floor == sight.values.destination:
        return None
    return floor


def _door_for_robots(seen: Seen, sight: Sight, now: float) -> RobotDoor:
    """Return the door word; OPEN means that a robot may drive, and while a session holds the lift, that its robot may.

    Behind a lockout or a fire that nobody has acknowledged it invites nobody, nor a session that still waits for its lift, nor
    one whose door is released soon.
    """
    here = seen.doors_at.get(sight.floor, ()) if sight.floor is not None else ()
    door = robot_door(sight, here, permissions(seen.able, aboard=seen.aboard))
    told = seen.restrictions
    kept_out = told.lockout or told.fire_latched or told.waiting_for
    if door is RobotDoor.OPEN and (kept_out or now >= seen.invites_until):
        return RobotDoor.MOVING
    if door is not RobotDoor.OPEN or seen.session is None:
        return door
    granted = "robot_mode_on" not in seen.able.signals or sight.values.flags.get("robot_mode_on", False)
    held = seen.door_held and sight.floor == seen.session.floor
    return RobotDoor.OPEN if granted and held else RobotDoor.MOVING


def _motion(sight: Sight) -> Motion:
    """Return the motion the lift tells. Where it tells none, a car is known to stand only by its evidence and an open door.

    Behind shut doors it may have set out: its floor contact, or its level flag, stays made for a moment.
    """
    if sight.values.motion is not None:
        return sight.values.motion
    return Motion.STOPPED if sight.standing and not shut(sight.values) else Motion.UNKNOWN
