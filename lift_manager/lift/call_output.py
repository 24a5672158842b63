"""When the button of the session's call is pressed, held and released. Two calls are never on together."""

from __future__ import annotations

from dataclasses import replace

from drivers.model import OutputState
from lift_manager.lift.call import (
    Call,
    CallOutput,
    CallPhase,
    call_command,
    call_failed,
    call_found_off,
    call_holds_door,
    call_without_press,
    ends_call,
    follow_call,
    press_call,
)
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.observation import Observation
from lift_manager.lift.occupancy import Occupancy, is_aboard
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.session import Session

_NO_LONGER_HELD = "the controller no longer holds the call"


def robot_is_aboard(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether the session's robot counts as aboard."""
    return is_aboard(record.boarding, config.capabilities) is True


def held_call_ends_at(record: LiftRecord) -> str:
    """Return what ends the held call that is on; empty for a pulse, or if none is on."""
    return "" if record.call_output is None else record.call_output.until


def call_keeps_door(record: LiftRecord) -> bool:
    """Whether the newest call keeps the door open, and nothing has ended it."""
    return record.call_output is not None and record.call_output.keeps_door


def call_is_lost(record: LiftRecord) -> bool:
    """Whether a held call should be on, and the controller no longer holds it."""
    output = record.call_output
    if output is None or not output.until:
        return False
    return output.interrupted or not record.is_given(output.command)


def no_call_keeps_door(record: LiftRecord) -> bool:
    """Whether no call keeps the door open, and that is verified."""
    if call_keeps_door(record):
        return False
    return record.door_call is None or record.status(record.door_call) is OutputState.AT_REST


def call_is_on_at_floor(record: LiftRecord) -> bool:
    """Whether the car has arrived by a call that keeps the door open and is not seen to be released."""
    return record.call_has_arrived and not no_call_keeps_door(record)


def only_call_holds_door(config: LiftConfig, record: LiftRecord, session: Session) -> bool:
    """Whether nothing but the call to the session's floor keeps the door open there."""
    floor = session.floor
    if floor is None or all(config.has(hold) for hold in config.door_holds(floor)):
        return False
    return call_holds_door(config, floor, aboard=robot_is_aboard(config, record))


def call_must_be_on(config: LiftConfig, record: LiftRecord, session: Session) -> bool:
    """Whether the call is missed while it is off: it keeps the door open, and the robot has not reported that it left."""
    is_requested = session.hold_door and not session.hold_spent and only_call_holds_door(config, record, session)
    return is_requested and record.boarding.occupancy is not Occupancy.EXITED


def follow(draft: Draft, call: Call, observation: Observation, *, is_hold: bool) -> Call:
    """Take a fresh reading. `is_hold` means that nothing but this call keeps the door open."""
    capabilities, now = draft.config.capabilities, draft.now
    after = follow_call(call, observation, capabilities, now, is_hold=is_hold)
    holds = after.phase is CallPhase.ARRIVED and is_hold and call_keeps_door(draft.record) and after.is_answered
    if (holds or after.phase is CallPhase.CONFIRMED) and call_is_lost(draft.record):
        lost = call_found_off if after.press is None else call_failed
        after = lost(after, _NO_LONGER_HELD, now)
    draft.change(call=after)
    return after


def press(draft: Draft, call: Call) -> None:
    """Press the button that brings the car; another call that is on is released first."""
    config, now = draft.config, draft.now
    aboard = robot_is_aboard(config, draft.record)
    command = call_command(config, call.floor, aboard=aboard)
    if command is None:
        # where no call moves the occupied car, the report that a robot is in place has started it
        draft.change(call=call_without_press(call, now))
        return
    output = draft.record.call_output
    if output is not None and output.command != command:
        release_call(draft)
    press_id = draft.press(command)
    take_call_output(draft, CallOutput(command, ends_call(config, command, aboard=aboard), press_id, now))
    used_by = draft.record.used_by if draft.session is None else draft.session.number
    draft.change(call=press_call(call, press_id, now), used_by=used_by)


def take_call_output(draft: Draft, output: CallOutput) -> None:
    """Continue with this call as the one that is on."""
    draft.change(call_output=output)
    if output.keeps_door:
        draft.change(door_call=output.command)


def release_call(draft: Draft) -> None:
    """Release the call, if one is on; one that was not pressed yet is not pressed."""
    output = draft.record.call_output
    if output is not None:
        draft.cancel(output.command, output.press)
        draft.change(call_output=None)


def release_call_at(draft: Draft, end: str) -> None:
    """Release the call if this is what ends it."""
    if held_call_ends_at(draft.record) == end:
        release_call(draft)


def release_call_of_door(draft: Draft) -> None:
    """Release a call that keeps the door open."""
    if call_keeps_door(draft.record):
        release_call(draft)


def interrupt_call(draft: Draft) -> None:
    """Release a call that keeps the door open, and count it as lost from now on."""
    output = draft.record.call_output
    if output is not None and output.keeps_door and not output.interrupted:
        draft.cancel(output.command, output.press)
        draft.change(call_output=replace(output, interrupted=True))


def renew_call(draft: Draft) -> None:
    """Keep a call on that keeps the door open, unless the controller lost it."""
    output = draft.record.call_output
    if output is not None and output.keeps_door and not call_is_lost(draft.record):
        draft.change(call_output=replace(output, renewed_at=draft.now))
