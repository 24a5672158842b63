"""Whether a robot may go through the door: the state OPEN, and until when a session's robot reads it."""

from __future__ import annotations

import math

from lift_manager.lift import doors
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.events import RestrictionKind
from lift_manager.lift.lease import releases_at
from lift_manager.lift.observation import (
    Moment,
    Observation,
    RobotDoor,
    door_by_signals,
    permissions_needed,
    robot_mode_granted,
)
from lift_manager.lift.occupancy import is_aboard
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.session import Session

OBEYS_WITHIN_S = 0.15
"""From the moment an output reads back as on until the lift acts on it. Chosen: longer than a scan of a slow PLC (0.1 s); a relay
takes a tenth of that."""


def robot_door(
    config: LiftConfig, record: LiftRecord, moment: Moment, observation: Observation, *, waits: bool
) -> RobotDoor:
    """Return the door state; OPEN means that a robot may drive and, while a session holds the lift, that its robot may.

    Behind a lockout or an unacknowledged fire it invites nobody, nor a session that `waits` for something before anything is
    pressed, nor one whose door is released soon.
    """
    session = record.session
    here = config.doors_at.get(observation.floor, ()) if observation.floor is not None else ()
    aboard = None if session is None else is_aboard(record.boarding, config.capabilities)
    door = door_by_signals(observation, here, permissions_needed(config.capabilities, aboard=aboard))
    if door is not RobotDoor.OPEN:
        return door
    is_kept_out = record.durable.fire_since is not None or record.restriction(RestrictionKind.LOCKOUT) is not None
    if is_kept_out or waits or moment.now >= _invites_until(config, record):
        return RobotDoor.MOVING
    if session is None:
        return door
    is_read = was_read_while_held(record, moment)
    is_held = observation.floor == session.floor and is_read and doors.door_is_held(config, record)
    is_granted = robot_mode_granted(observation, config.capabilities)
    return RobotDoor.OPEN if is_granted and is_held else RobotDoor.MOVING


def invites_until(session: Session, config: LiftConfig) -> float:
    """Return from when on the door invites nobody any more, although it is held for `clear_s` longer."""
    return -math.inf if session.is_ending else releases_at(session, config) - session.policy.clear_s


def _invites_until(config: LiftConfig, record: LiftRecord) -> float:
    """Return from when on an open door invites nobody, because it is released soon."""
    session = record.session
    if session is None:
        return -math.inf if record.released_open else math.inf
    return -math.inf if record.is_stopping else invites_until(session, config)


def was_read_while_held(record: LiftRecord, moment: Moment) -> bool:
    """Whether the lift was read after its door was seen to be held, and had had time to obey.

    A door that was read open may have begun to close by its own timer before the hold reached the lift, and goes on closing until
    the lift obeys: "open" in that reading would let a robot drive at it.
    """
    since = record.door_held_since
    return since is not None and moment.read_at > since + OBEYS_WITHIN_S
