"""What every face publishes of a lift, and what stays unpublished."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum, unique
from operator import attrgetter

from drivers.model import FloorName, SignalValue
from lift_manager.lift import queue
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.freshness import age_s, fresh
from lift_manager.lift.inhibits import clock_text, offline_reason, restriction_text, waits_for
from lift_manager.lift.lease import releases_at
from lift_manager.lift.observation import (
    Moment,
    Observation,
    RobotDoor,
    is_shut,
    may_be_moving,
)
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.refusals import how_to_acknowledge
from lift_manager.lift.robot_door import robot_door
from lift_manager.lift.session import Holder
from lift_manager.lift.trust import TRIPS
from register_maps.words import Door, Mode, Motion, Side

PERMISSIONS = ("may_enter", "may_leave", "robot_mode_on", "robots_allowed", "ready")
"""Flags of a lift that show what a robot may do."""


@unique
class Quality(StrEnum):
    """Whether the state may be acted on."""

    LIVE = "live"
    OFFLINE = "offline"
    """No reading younger than `max_age_s`: floor, door and motion are not known."""


@dataclass(frozen=True, slots=True)
class Restrictions:
    """What keeps robots off a lift, or makes them wait, beside the lift's own signals."""

    fire_latched: bool = False
    """There was a fire, and no person has acknowledged it."""
    lockout: str = ""
    """Who locked the lift out, since when and why; empty if nobody did."""
    drain: str = ""
    """Who drains the lift, since when and why; empty if nobody does."""
    maybe_aboard: Holder | None = None
    """Whose robot may be in the car; others are refused while it holds no session."""
    distrusted: str = ""
    """Which of its signals contradicted each other, and what ends that; no door counts as open meanwhile. Empty if none did."""
    waiting_for: str = ""
    """What the session waits for before anything is pressed; empty when it does not."""


@dataclass(frozen=True, slots=True)
class LiftState:
    """One lift at one moment, as every face shows it."""

    lift: str
    floors: tuple[FloorName, ...]
    quality: Quality
    reason: str
    """Why it is offline; empty while live."""
    age_s: float | None
    """Age of the last whole reading; None if there never was one."""
    floor: FloorName | None
    """The floor the car stands at or passes; None if none is reported. Never the destination before arrival."""
    standing: bool
    """By the map's evidence the car stands at `floor`."""
    destination: FloorName | None
    """The session's target, else the current floor."""
    robot_door: RobotDoor
    doors: Mapping[Side, Door]
    motion: Motion
    mode: Mode
    holder: Holder | None
    held_since_s: float | None
    """Seconds since the session began."""
    not_visible: Mapping[str, str]
    """Safety signals this lift's interface does not show, with the reason."""
    restrictions: Restrictions = Restrictions()
    permissions: Mapping[str, bool] = field(default_factory=dict)
    """The permissions that the lift reports: those of `PERMISSIONS` that it has."""
    waiting: int = 0
    """How many rides and faces wait for the lift."""
    ending: bool = False
    """The holder has ended its session and may still change its mind; door and robot mode stay until it is over."""
    releases_in_s: float | None = None
    """Seconds until the manager releases the door by itself at the earliest, as far as it knows; None while nobody holds the lift."""
    releases_at: float | None = None
    """The same as monotonic seconds of the event loop, which only a renewal moves."""


@dataclass(frozen=True, slots=True)
class LiftSignals:
    """Every signal of a lift as it was read last."""

    lift: str
    age_s: float | None
    """Age of the last whole reading; None if there never was one."""
    max_age_s: float
    """Older than this, nothing of it may be acted on."""
    signals: tuple[SignalValue, ...]


_PASSING = ("age_s", "held_since_s", "releases_in_s", "releases_at", "reason")
_LASTING = attrgetter(*(one.name for one in fields(LiftState) if one.name not in _PASSING))
_SECONDS = re.compile(r"\d+(?:\.\d+)? s\b")


def state(config: LiftConfig, record: LiftRecord, moment: Moment) -> LiftState:
    """Return what is published of a lift now."""
    observation, session, now = fresh(config, record, moment), record.session, moment.now
    floor = reported_floor(config, record, moment)
    values = None if observation is None else observation.values
    released_at = None if session is None else releases_at(session, config)
    flags = {} if values is None else values.flags
    kept_off = restrictions(config, record, moment)
    door = RobotDoor.MOVING
    if observation is not None:
        door = robot_door(config, record, moment, observation, waits=bool(kept_off.waiting_for))
    return LiftState(
        lift=config.name,
        floors=config.floors,
        quality=Quality.OFFLINE if observation is None else Quality.LIVE,
        reason=offline_reason(config, record) if observation is None else "",
        age_s=age_s(record, moment),
        floor=floor,
        standing=observation is not None and observation.is_standing,
        destination=floor if session is None or session.floor is None else session.floor,
        robot_door=door,
        doors={} if observation is None else observation.doors,
        motion=Motion.UNKNOWN if observation is None else _motion(observation),
        mode=Mode.UNKNOWN if values is None else values.mode,
        holder=None if session is None else session.holder,
        held_since_s=None if session is None else now - session.opened_at,
        permissions={name: flags[name] for name in PERMISSIONS if name in flags},
        not_visible=config.capabilities.not_visible,
        restrictions=kept_off,
        waiting=len(queue.waiting(record.queue, now)),
        ending=session is not None and session.ended_by_holder,
        releases_at=released_at,
        releases_in_s=None if released_at is None else max(0.0, released_at - now),
    )


def reported_floor(config: LiftConfig, record: LiftRecord, moment: Moment) -> FloorName | None:
    """Return the floor, unless the car is still travelling to it: that must not pass for an arrival."""
    observation, session = fresh(config, record, moment), record.session
    if observation is None or observation.is_standing:
        return None if observation is None else observation.floor
    floor = observation.floor
    if session is not None and floor == session.floor and not record.call_has_arrived:
        return None
    return None if may_be_moving(observation) and floor == observation.values.destination else floor


def restrictions(config: LiftConfig, record: LiftRecord, moment: Moment) -> Restrictions:
    """Return what keeps robots off, and what the session waits for."""
    occupied = record.durable.occupied
    return Restrictions(
        fire_latched=record.durable.fire_since is not None,
        lockout=restriction_text(record, RestrictionKind.LOCKOUT, moment),
        drain=restriction_text(record, RestrictionKind.DRAIN, moment),
        maybe_aboard=None if occupied is None else occupied.holder,
        distrusted=_distrusted(config, record, moment),
        waiting_for=waits_for(config, record, moment),
    )


def same_but_for_time(one: LiftState, other: LiftState) -> bool:
    """Whether two states differ in nothing but the passing of time; some reasons say for how many seconds."""
    if one.reason != other.reason and _SECONDS.sub("", one.reason) != _SECONDS.sub("", other.reason):
        return False
    same: bool = _LASTING(one) == _LASTING(other)  # twice a poll of each lift: a copy of each costs four times as much
    return same


def _distrusted(config: LiftConfig, record: LiftRecord, moment: Moment) -> str:
    distrust = record.durable.trust.distrust
    if not distrust:
        return ""
    said = "; ".join(f"{one.text} (since {clock_text(one.since, moment)})" for one in distrust)
    how = how_to_acknowledge(config.name)
    return (
        f"{said}. No door counts as open for robots until {TRIPS} trips in a row agree, or a person has looked: {how}"
    )


def _motion(observation: Observation) -> Motion:
    """Return the motion that the lift reports.

    Where it reports none, a car is known to stand only by its evidence and an open door. Behind shut doors it may have set out:
    its floor contact, or its level flag, stays made for a moment.
    """
    if observation.values.motion is not None:
        return observation.values.motion
    stands = observation.is_standing and not is_shut(observation.values)
    return Motion.STOPPED if stands else Motion.UNKNOWN
