"""When a door is held, released and closed for the session; and whether what holds it is seen to be on."""

from __future__ import annotations

from dataclasses import replace

from drivers.model import Command, CommandKind, FloorName, Outcome, OutputState, PressId, Proof, Result
from lift_manager.lift import call_output, handshake
from lift_manager.lift.call import Call, CallPhase, call_holds_door
from lift_manager.lift.commands import DOOR_WITHIN_S, CommandProgress
from lift_manager.lift.config import LiftConfig, door_hold
from lift_manager.lift.draft import Draft
from lift_manager.lift.events import hold_spent_text
from lift_manager.lift.inhibits import barred_by, why_no_close, why_no_press
from lift_manager.lift.lease import hold_ends_at, releases_at
from lift_manager.lift.observation import (
    Observation,
    has_departed,
    has_no_open_door,
    is_closing,
    robot_mode_granted,
)
from lift_manager.lift.record import DoorClosing, DoorHold, LiftRecord
from lift_manager.lift.session import EndReason, Session, door_opened_at_target
from register_maps.words import Door, Side

UNGRANTED_S = 30.0
"""How long a door is held although the lift does not grant robot mode. Chosen: longer than a robot that saw it open takes through
it, and than a controller takes to grant the mode again."""

_UNFINISHED = (CallPhase.REQUESTED, CallPhase.PRESSED)


# -- whether a door is held


def why_no_hold(config: LiftConfig, floor: FloorName) -> str | None:
    """Return why the door at a floor cannot be held; None where it can."""
    has_holds = all(config.has(hold) for hold in config.door_holds(floor))
    if has_holds or any(call_holds_door(config, floor, aboard=aboard) for aboard in (False, True)):
        return None
    return f"its map {config.capabilities.map_name} has no hold for every door at {floor}"


def door_is_held(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether the hold of the door at the target is on and verified, where the map has one.

    The hold of a door that is seen shut or closing does not count: a controller whose watchdog released it may go on reading as
    on.
    """
    session, observation = record.session, record.observation
    if session is None or session.floor is None or session.floor not in config.floors:
        return False
    declared = _declared_holds(config, record)
    for hold in config.door_holds(session.floor):
        if config.has(hold) and not (hold in declared and record.status(hold) is OutputState.HELD):
            return False
    if observation is not None and is_closing(observation, config.doors_at[session.floor]):
        return False
    if not call_output.only_call_holds_door(config, record, session):
        return True
    answered = record.call is None or record.call.is_answered
    return answered and call_output.call_keeps_door(record) and not call_output.call_is_lost(record)


def may_be_crossed(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether a robot may be on its way through the door that is held for the session, or about to be.

    A hold whose refresh was not answered no longer counts as held, and one that a restart found on may be at a floor that is not
    known yet: a robot may be in its door all the same.
    """
    if record.session is None or not (record.call_has_arrived or record.door_hold_found):
        return False
    return door_is_given(config, record) or call_output.call_is_on_at_floor(record)


def is_left_open(config: LiftConfig, record: LiftRecord, *, is_taken: bool) -> bool:
    """Whether ending the session now leaves a door behind that its robot may think is open for it.

    That is one that is held, also by a call whose outcome is still to come. Where the lift `is_taken` from its holder, who may
    not know of it yet, it is every door that was not read shut.
    """
    if is_taken and record.observation is not None and not has_no_open_door(record.observation.doors):
        return True
    kept_by_call = call_output.call_keeps_door(record) and not call_output.call_is_lost(record)
    return may_be_crossed(config, record) or (record.call_has_arrived and kept_by_call)


def is_clearing(config: LiftConfig, record: LiftRecord, observation: Observation | None, now: float) -> bool:
    """Whether the door of a session whose end was announced is held for a robot in it; never on a lift that cannot be read."""
    session = record.session
    announced = session is not None and session.end_is_announced
    return announced and session is not None and now < releases_at(session, config) and observation is not None


def door_is_given(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether the hold of any door is on or on its way."""
    return any(record.is_given(hold) for hold in _declared_holds(config, record))


def doors_at_rest(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether every door is released, and that is verified."""
    if record.door_hold is not None:
        return False
    holds = (door_hold(side) for side in config.capabilities.doors)
    return all(record.status(hold) is OutputState.AT_REST for hold in holds)


def door_on_since(config: LiftConfig, record: LiftRecord, now: float) -> float | None:
    """Return since when a door has been held, or was to be, without all of them seen at rest; None if nothing limits that."""
    if not config.capabilities.released_after_s or doors_at_rest(config, record):
        return None
    return now if record.door_on_since is None else record.door_on_since


def _declared_holds(config: LiftConfig, record: LiftRecord) -> tuple[Command, ...]:
    return () if record.door_hold is None else config.door_holds(record.door_hold.floor)


# -- holding


def hold_doors(draft: Draft, session: Session, observation: Observation, floor: FloorName, *, begin: bool) -> Session:
    """Hold the doors that serve a floor, and the call that keeps them open, for as long as site and controller allow.

    After a restart, what is found off stays off until the holder's next request.
    """
    config = draft.config
    session = spend_hold(draft, session)
    is_barred = barred_by(observation.values, config.capabilities) is not None
    # no robot was invited here, and none will be while our hold keeps the door from closing
    must_close = observation.must_close and floor == session.floor and not session.may_have_invited(draft.now)
    if session.hold_spent or is_barred or must_close or _is_for_nobody(draft, session, observation, floor):
        release_doors(draft)
        if not session.hold_spent:
            call_output.interrupt_call(draft)
            return session
        call_output.release_call_of_door(draft)
        return _note_shut(draft, session, observation, floor)
    if session.holding_since is None:
        # a hold from before the restart that never came to rest continues, as far as the controller knows
        since = draft.now if draft.record.door_on_since is None else draft.record.door_on_since
        session = session.having(holding_since=since)
    draft.change(session=session, used_by=session.number)
    call_output.renew_call(draft)
    _declare(draft, floor, may_begin=begin and session.may_begin and not observation.must_close)
    return session


def keep_found(draft: Draft, session: Session, call: Call, observation: Observation) -> Session:
    """Keep a hold that a restart found on, as long as nothing says that the car has left; release any other one."""
    is_kept = draft.record.door_hold_found and session.hold_door
    departed = has_departed(observation, call.floor)
    if not is_kept or departed:
        release_doors(draft)
        # once the car has left, a hold begins from the beginning
        return session.having(holding_since=None) if departed and session.holding_since is not None else session
    return hold_doors(draft, session, observation, call.floor, begin=False)


def stay_at_target(
    draft: Draft, session: Session, call: Call, observation: Observation
) -> Session | tuple[EndReason, str]:
    """Hold the door at the target, or end a session that only wanted to get there.

    A robot aboard keeps its session: it still has to get out.
    """
    aboard = call_output.robot_is_aboard(draft.config, draft.record)
    if not session.hold_door and not session.policy.stays and not aboard:
        return EndReason.ARRIVED, "arrived"
    if handshake.stands_open_for_robot(draft.config, draft.record, observation, call.floor):
        session = door_opened_at_target(session, draft.now)
    if session.hold_door:
        return hold_doors(draft, session, observation, call.floor, begin=True)
    if not session.policy.stays:
        # what is on from before stays on for a robot aboard, but no longer than any hold
        session = spend_hold(draft, session)
        if not session.hold_spent:
            return session
    release_doors(draft)
    call_output.release_call_of_door(draft)
    return session


def hold_unread(draft: Draft, session: Session) -> None:
    """Release the doors once the limit of a hold has come: that needs no reading."""
    after = spend_hold(draft, session)
    if after is not session:
        draft.change(session=after)
        release_doors(draft)
        call_output.release_call_of_door(draft)


def spend_hold(draft: Draft, session: Session) -> Session:
    """End a hold that has lasted for as long as site and controller allow."""
    if session.hold_spent or draft.now < hold_ends_at(session, draft.config):
        return session
    draft.alarm(hold_spent_text(session.holder, draft.config.hold_limit), session.holder)
    return session.having(hold_spent=True, holding_since=None)


def release_doors(draft: Draft) -> None:
    """Release every door."""
    draft.change(door_hold=None, door_hold_found=False)


def release_door_at_request(draft: Draft) -> None:
    """Release what holds the door; a call under way stays, though it may keep the door open at its destination."""
    forget_closing(draft)
    release_doors(draft)
    if draft.record.call_has_arrived:
        call_output.release_call_of_door(draft)


def _declare(draft: Draft, floor: FloorName, *, may_begin: bool) -> None:
    """Want the doors of a floor held; where that may not begin, only what is on is kept."""
    if may_begin or draft.record.door_hold is not None:
        draft.change(door_hold=DoorHold(floor, may_begin, draft.moment.read_at))


def _note_shut(draft: Draft, session: Session, observation: Observation, floor: FloorName) -> Session:
    """Note when the door is seen shut after its hold was spent: from then on people have their turn."""
    if not (doors_at_rest(draft.config, draft.record) and call_output.no_call_keeps_door(draft.record)):
        return session
    doors, here = observation.values.doors, draft.config.doors_at.get(floor, ())
    is_shut = has_departed(observation, floor) or (bool(here) and all(doors.get(side) is Door.CLOSED for side in here))
    return session.having(shut_at=draft.now) if is_shut and session.shut_at is None else session


def _is_for_nobody(draft: Draft, session: Session, observation: Observation, floor: FloorName) -> bool:
    """Whether a held door has invited no robot for long, because the lift has no robot mode.

    It would keep the lift from people, and from the mode: a controller that grants it once its calls are served waits for the
    door.
    """
    if robot_mode_granted(observation, draft.config.capabilities):
        draft.change(ungranted=None)
        return False
    ungranted = draft.record.ungranted
    if ungranted is None or ungranted[:2] != (session.number, floor):
        ungranted = (session.number, floor, draft.now)
        draft.change(ungranted=ungranted)
    if draft.now - ungranted[2] <= UNGRANTED_S:
        return False
    draft.change(
        waiting_for=f"robot_mode_on, which the lift has not granted for {UNGRANTED_S:g} s; its door is not held meanwhile"
    )
    return True


# -- the close button


def close_command(side: Side) -> Command:
    """Return the close button of one door."""
    return Command(CommandKind.CLOSE_DOOR, side=side)


def request_closing(draft: Draft, sides: tuple[Side, ...]) -> None:
    """Want these doors shut."""
    forget_closing(draft)
    draft.change(closing=DoorClosing(sides, draft.now, CommandProgress(CallPhase.REQUESTED)))


def forget_closing(draft: Draft) -> None:
    """Stop closing doors; a button that is pressed is released."""
    closing = draft.record.closing
    if closing.progress.phase in _UNFINISHED:
        for side in closing.sides:
            draft.cancel(close_command(side))
    if closing != DoorClosing():
        draft.change(closing=DoorClosing())


def press_close(draft: Draft) -> None:
    """Press the close button where that is wanted, once nothing of ours holds the door."""
    closing, config = draft.record.closing, draft.config
    if closing.progress.phase is not CallPhase.REQUESTED or draft.session is None:
        return
    is_free = doors_at_rest(config, draft.record) and call_output.no_call_keeps_door(draft.record)
    why_not = why_no_press(config, draft.record, draft.moment) or why_no_close(
        config, draft.record, draft.moment, hold_door=draft.session.hold_door
    )
    if not is_free:
        if draft.now - closing.since <= DOOR_WITHIN_S:
            return
        why_not = f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is released"
    if why_not is not None:
        draft.change(closing=replace(closing, progress=CommandProgress(CallPhase.FAILED, why_not)))
        return
    presses = tuple(draft.press(close_command(side)) for side in closing.sides)
    draft.change(used_by=draft.session.number)
    draft.change(closing=replace(closing, presses=presses, progress=CommandProgress(CallPhase.PRESSED)))


def closing_answered(draft: Draft, press: PressId, outcome: Outcome) -> None:
    """Take the outcome of a close button; the worst of several is that of all."""
    closing = draft.record.closing
    if press not in closing.presses:
        return
    worst = closing.progress.outcome
    if worst is None or _badness(outcome) >= _badness(worst):
        worst = outcome
    presses = tuple(other for other in closing.presses if other != press)
    phase = CallPhase.PRESSED
    if not presses:
        phase = CallPhase.CONFIRMED if worst.result is Result.CONFIRMED else CallPhase.FAILED
    reason = "" if presses else worst.reason
    draft.change(closing=replace(closing, presses=presses, progress=CommandProgress(phase, reason, outcome=worst)))


def _badness(outcome: Outcome) -> tuple[int, int]:
    results = (Result.CONFIRMED, Result.REJECTED, Result.UNCONFIRMED)
    proofs = (Proof.EFFECT, Proof.LAMP, Proof.READBACK)
    return results.index(outcome.result), proofs.index(outcome.proof) if outcome.proof in proofs else len(proofs)
