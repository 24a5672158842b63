"""Which outputs should be on now. Nothing else in this package starts or stops a hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.model import Command
from lift_manager.lift.call import flags_missing
from lift_manager.lift.config import ROBOT_IN_PLACE, ROBOT_LEFT, ROBOT_MODE, LiftConfig
from lift_manager.lift.record import LiftRecord


@dataclass(frozen=True, slots=True)
class Hold:
    """An output that should be on. What `outputs` does not declare is released."""

    begin: bool
    """Switch it on if it is off; otherwise what is on stays on, and what is off stays off."""
    until: float
    """When it is released by itself, in monotonic seconds: a manager that hangs holds nothing for long."""


def outputs(config: LiftConfig, record: LiftRecord) -> Mapping[Command, Hold]:
    """Return the holds that should be on: doors, robot mode, and the presses that stay on until something ends them.

    How long they may stay on without a new reading is counted from the newest reading at which they were wanted. A press that
    stays on is begun by `Press` and is only kept here, so that losing it is never another press. A hold ends when the lift no
    longer shows a flag that the map requires.
    """
    holds: dict[Command, Hold] = {}
    if (mode := record.robot_mode).is_requested and config.has(ROBOT_MODE):
        until = config.held_until(ROBOT_MODE, mode.renewed_at)
        kept_until = until if mode.kept_until is None else min(until, mode.kept_until)
        holds[ROBOT_MODE] = Hold(mode.may_begin, kept_until)
    if (door := record.door_hold) is not None:
        for command in config.door_holds(door.floor):
            if config.has(command):
                holds[command] = Hold(door.may_begin, config.held_until(command, door.renewed_at))
    if (call := record.call_output) is not None and call.until and not call.interrupted:
        holds[call.command] = Hold(begin=False, until=config.held_until(call.command, call.renewed_at))
    for command, word in ((ROBOT_IN_PLACE, record.in_place), (ROBOT_LEFT, record.robot_left)):
        if word.is_on:
            holds[command] = Hold(begin=False, until=config.held_until(command, word.renewed_at))
    if (observation := record.observation) is None or not config.capabilities.requires:
        return holds
    missing = {one for one in holds if flags_missing(observation, config.capabilities, one.name)}
    return {one: hold for one, hold in holds.items() if one not in missing}
