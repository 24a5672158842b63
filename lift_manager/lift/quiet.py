"""Whether anything is under way on a lift, so that the manager may be restarted with another configuration only between it."""

from __future__ import annotations

from lift_manager.lift import queue
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.freshness import fresh
from lift_manager.lift.modes import is_on_fire
from lift_manager.lift.observation import Moment
from lift_manager.lift.record import LiftRecord


def under_way(config: LiftConfig, record: LiftRecord, moment: Moment) -> str:
    """Return what is under way on a lift, for people; empty if there is nothing. Of a lift that cannot be read, what is remembered."""
    durable, observation = record.durable, fresh(config, record, moment)
    if durable.fire_since is not None or (observation is not None and is_on_fire(observation.values)):
        return "a fire"
    if durable.occupied is not None or record.boarding.may_be_in_car:
        return "a robot may be in the car"
    if record.session is not None or durable.session is not None:
        return "a session"
    if durable.robot_left_pending_since is not None or record.has_robot_left_pending:
        return "the report that a robot has left"
    if record.presses or record.in_place.is_pending or record.robot_left.is_pending:
        return "a command"
    if record.door_hold is not None or record.robot_mode.kept_until is not None or durable.robot_mode_until is not None:
        return "an output that is still on"
    if queue.waiting(record.queue, moment.now):
        return "callers that wait"
    return ""
