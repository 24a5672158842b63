"""What happens to a lift after every input: what ends, what is pressed and held for the session, and what is left to do afterwards."""

from __future__ import annotations

from lift_manager.lift import call_output, doors, handshake, history, robot_mode_output
from lift_manager.lift.call import Call, CallPhase, flags_missing, may_press_call, postpone
from lift_manager.lift.config import ROBOT_MODE
from lift_manager.lift.draft import Draft
from lift_manager.lift.endings import (
    end_by_time,
    end_session,
    end_what_is_over,
    give_people_their_turn,
    obey_mode,
    release_in_fire,
)
from lift_manager.lift.inhibits import people_have_their_turn
from lift_manager.lift.observation import Observation
from lift_manager.lift.session import EndReason, Session

Over = tuple[EndReason, str]
"""Why a session is over, as a code and in words."""


def advance(draft: Draft) -> None:
    """Reconcile what is requested with the newest observation."""
    _advance(draft)
    history.judge_commands(draft)


def _advance(draft: Draft) -> None:
    end_what_is_over(draft)
    if (last := draft.record.observation) is not None:
        # a release needs no fresh reading: a poll may take longer than a reading counts
        obey_mode(draft, last)
    if release_in_fire(draft):
        return
    end_by_time(draft)
    if draft.record.robot_mode.kept_until is not None:
        # a lift that is still in robot mode is not available to people
        give_people_their_turn(draft)
    if draft.session is None or people_have_their_turn(draft.record, draft.moment):
        _rest(draft)
    elif (observation := draft.observation) is not None:
        _serve(draft, draft.session, observation)
    else:
        doors.hold_unread(draft, draft.session)


def _rest(draft: Draft) -> None:
    """Finish what the last session left to do. A session that waits for people to have their turn loses no time by it."""
    if (observation := draft.observation) is not None:
        handshake.follow_robot(draft, observation, None)
    handshake.give_words(draft, None)
    robot_mode_output.settle(draft)
    if draft.session is not None:
        draft.change(session=draft.session.having(lease_from=draft.now))
    if (call := draft.record.call) is not None:
        draft.change(call=postpone(call, draft.now))


def _serve(draft: Draft, session: Session, observation: Observation) -> None:
    """Press, hold and release for the session, as far as a fresh reading allows."""
    if draft.config.has(ROBOT_MODE):
        draft.change(used_by=session.number)
    robot_mode_output.hold_robot_mode(draft, may_begin=session.may_begin)
    handshake.give_words(draft, session)
    after = _serve_call(draft, session, observation)
    if isinstance(after, Session):
        draft.change(session=after)
        doors.press_close(draft)
    else:
        end_session(draft, *after)


def _serve_call(draft: Draft, session: Session, observation: Observation) -> Session | Over:
    """Return the session as it continues after a reading, or why it is over."""
    config, now, call = draft.config, draft.now, draft.record.call
    if call is None:
        handshake.follow_robot(draft, observation, None)
        return session
    is_hold = call_output.call_must_be_on(config, draft.record, session)
    call = call_output.follow(draft, call, observation, is_hold=is_hold)
    draft.change(waiting_for=_holder_has_to(session, call, is_hold=is_hold))
    handshake.follow_robot(draft, observation, session)
    if call.phase is CallPhase.REQUESTED:
        command = handshake.next_command(config, draft.record, call.floor)
        if missing := flags_missing(observation, config.capabilities, command):
            draft.change(door_hold=None)
            return _await_grant(draft, session, call, f"{', '.join(sorted(missing))} for {command}")
        if not handshake.is_ready(config, draft.record):
            return _await_word(draft, session, observation)
        if is_hold and observation.floor == call.floor and observation.must_close:
            doors.release_doors(draft)
            return session
        if not session.is_ending and may_press_call(call, observation, config.capabilities, now, is_hold=is_hold):
            doors.release_doors(draft)
            call_output.press(draft, call)
            return session
    if call.phase is CallPhase.ARRIVED:
        call_output.release_call_at(draft, "arrived")
        draft.change(door_hold_found=False)
        return doors.stay_at_target(draft, session, call, observation)
    if call.phase is CallPhase.FAILED and call_output.held_call_ends_at(draft.record):
        call_output.release_call(draft)
    return doors.keep_found(draft, session, call, observation)


def _holder_has_to(session: Session, call: Call, *, is_hold: bool) -> str:
    """Return what the holder has to do; empty where nothing waits for it."""
    if call.phase is not CallPhase.FAILED:
        return ""
    if session.is_restored:
        return f"{session.holder} to send another request after a restart of the manager"
    if is_hold and call.reached:
        return f"{session.holder} to send another request, because the call that keeps the door open is off"
    return ""


def _await_grant(draft: Draft, session: Session, call: Call, what: str) -> Session | Over:
    """Stop the lease while the lift has not granted what is needed, such as robot mode, but not indefinitely."""
    within_s = draft.config.capabilities.granted_within_s
    draft.change(waiting_for=f"{what}, which the lift has not granted yet")
    if draft.now - call.since > within_s:
        return EndReason.NOT_GRANTED, f"{what} was not granted within {within_s:g} s"
    return session.having(lease_from=draft.now)


def _await_word(draft: Draft, session: Session, observation: Observation) -> Session:
    """Keep the door open for a robot aboard until the lift knows of it; a robot on its way out needs nothing more."""
    aboard = call_output.robot_is_aboard(draft.config, draft.record)
    if aboard and observation.floor is not None and observation.is_standing:
        return doors.hold_doors(draft, session, observation, observation.floor, begin=True)
    draft.change(door_hold=None)
    return session
