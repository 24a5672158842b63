"""How a session ends: by its holder, its time, its lift, another caller, a person, a fire, or because the manager stops.

The end of a session never moves the car. What may be in the doorway is given time: the end is announced, and the door is released
`clear_s` later.
"""

from __future__ import annotations

import math
from dataclasses import replace

from drivers.model import FloorName
from lift_manager.lift import call_output, doors, handshake, history, robot_mode_output
from lift_manager.lift.commands import SessionOver
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.events import (
    Advised,
    SessionEnded,
    abandoned_text,
    fire_text,
    maybe_occupied_text,
    silent_text,
    stopping_text,
    unclaimed_text,
)
from lift_manager.lift.inhibits import held_by_another
from lift_manager.lift.lease import time_is_over
from lift_manager.lift.modes import is_on_fire, robots_forbidden
from lift_manager.lift.observation import Observation, has_no_open_door, may_be_moving
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.record import Silence
from lift_manager.lift.refusals import STOPPING, Refusal, Refused, how_to_acknowledge
from lift_manager.lift.session import (
    BY_HOLDER,
    SILENT_S,
    STOPPING_TEXT,
    Advice,
    EndReason,
    Holder,
    Session,
    advise,
    announce_end,
    end_by_holder,
)
from register_maps.words import Mode

_MOST_CALLERS = 100
"""Beyond this many callers, people are not alerted to a silent holder for each of them: a client may use another name each time."""

Release = tuple[FloorName, RobotWord | None]
"""A holder's own report that its session is over: the floor it was given for, and what it reports of its robot."""


def end_session(draft: Draft, reason: EndReason, text: str, *, release: Release | None = None) -> None:
    """End the session, if there is one. `release` is its holder's report."""
    session, config = draft.session, draft.config
    if session is None:
        return
    holder, advice = session.holder, advice_now(draft)
    release = release or release_given(config, session)
    info = history.session_info(config, draft.record, session, draft.moment)
    by_holder = reason in BY_HOLDER
    is_open = draft.record.released_open or doors.is_left_open(config, draft.record, is_taken=not by_holder)
    draft.change(session=None, fire_release_at=None, released_open=is_open, call=None, waiting_for="")
    doors.forget_closing(draft)
    doors.release_doors(draft)
    handshake.end_session_part(draft, session, release, arrived=reason is EndReason.ARRIVED)
    _alarm_about_robot(draft, holder, reason, text)
    is_used = session.number == draft.record.used_by
    if is_used:
        give_people_their_turn(draft)
    if draft.record.durable.fire_since is not None or draft.record.is_stopping:
        robot_mode_output.drop_robot_mode(draft)
    elif is_used:
        robot_mode_output.keep_after_session(draft)
    over = SessionOver(reason, text, None if by_holder else advice, draft.moment.clock)
    info = info.ended(history.ended_robot(draft.record, info.robot), over)
    history.archive_session(draft, session, info, over)
    draft.emit(SessionEnded(config.name, holder, reason, text, over.advice))
    robot_mode_output.settle(draft)


def release_given(config: LiftConfig, session: Session | None) -> Release | None:
    """Return the release that its holder has given already; None for a session that goes on."""
    if session is None or not session.ended_by_holder:
        return None
    return session.floor or config.floors[0], None


def give_people_their_turn(draft: Draft) -> None:
    """Give people the lift for a while after a robot."""
    draft.change(people_until=draft.now + draft.config.between_sessions_s)


def advice_now(draft: Draft) -> Advice:
    """Return the best course for the robot of the session."""
    observation = draft.observation
    in_car = draft.record.robot_in_car is not None
    return advise(observation.doors if observation is not None else None, may_be_aboard=in_car)


def alarm_of_robot(lift: str, holder: Holder, reason: EndReason, text: str, *, is_aboard: bool) -> str:
    """Return the alarm about a robot that is, or may be, in the car although its session is over; empty if there is none."""
    if reason is EndReason.STOPPING:
        return stopping_text(holder)
    if is_aboard:
        return abandoned_text(holder, text)
    return "" if reason is EndReason.ARRIVED else maybe_occupied_text(lift, holder, text)


def _alarm_about_robot(draft: Draft, holder: Holder, reason: EndReason, text: str) -> None:
    if (in_car := draft.record.robot_in_car) is not None:
        alarm = alarm_of_robot(draft.config.name, holder, reason, text, is_aboard=in_car[1])
        if alarm:
            draft.alarm(alarm, holder)


# -- by its holder


def release_session(draft: Draft, holder: Holder, floor: FloorName, word: RobotWord | None) -> None:
    """End the session at its holder's request, or take what its holder still reports of one that is over."""
    if draft.session is None:
        handshake.release_without_session(draft, holder, floor, word)
    else:
        end_session(draft, EndReason.RELEASED, "released", release=(floor, word))


def end_after_grace(draft: Draft, session: Session, grace_s: float) -> None:
    """Take its holder's report that the session is over.

    Until the grace is over what is on stays on, in case the holder changes its mind.
    """
    draft.change(session=end_by_holder(session, grace_s, draft.now))


def session_of(draft: Draft, holder: Holder | None) -> Session | Refused:
    """Return the session if it is this holder's, or anybody's if none is named."""
    record, session, name = draft.record, draft.session, draft.config.name
    if record.is_stopping:
        return STOPPING
    if session is None:
        in_car = record.robot_in_car
        robot = "" if in_car is None else f"; a robot of {in_car[0]} may be in its car: {how_to_acknowledge(name)}"
        return Refused(Refusal.NOT_HELD, f"nobody holds {name}{robot}")
    return session if holder in (None, session.holder) else held_by_another(session, draft.moment)


# -- by its time and by its lift


def end_what_is_over(draft: Draft) -> None:
    """End a session whose time is over."""
    session = draft.session
    if session is not None and session.end is not None and draft.now >= session.end.at:
        _end_at_once(draft, session.end.reason, session.end.text)


def forget_released_door(draft: Draft) -> None:
    """Forget a door that was released open once a later reading shows it shut: one that is still opening as it is released stands open."""
    observation = draft.observation
    if draft.record.released_open and observation is not None and has_no_open_door(observation.doors):
        draft.change(released_open=False)


def end_by_time(draft: Draft) -> None:
    """End a session whose lease or longest time is over, once no robot may be under way in the car."""
    session, observation = draft.session, draft.observation
    if session is None:
        return
    under_way = observation is None or may_be_moving(observation)
    rides = under_way and draft.record.robot_in_car is not None
    if (over := time_is_over(session, draft.config, draft.now, rides=rides)) is not None:
        end_session(draft, *over)


def obey_mode(draft: Draft, observation: Observation) -> None:
    """Latch a fire, inform the robot of it first, and release everything; end the session in any other mode without robots."""
    session, mode = draft.session, observation.values.mode
    if is_on_fire(observation.values) and draft.record.durable.fire_since is None:
        delay_s = draft.config.fire_release_delay_s if session is not None and mode is Mode.FIRE else 0.0
        draft.change_durable(fire_since=draft.moment.clock)
        draft.change(fire_release_at=draft.now + delay_s)
        holder = None if session is None else session.holder
        if holder is not None:
            draft.emit(Advised(draft.config.name, holder, advice_now(draft), "there is a fire"))
        draft.alarm(fire_text(control=draft.config.control), holder)
    if not robots_forbidden(mode) or mode is Mode.UNKNOWN:
        return
    if draft.record.fire_release_at is None:
        handshake.release_all(draft)
        end_session(draft, EndReason.MODE, f"the mode is {mode}")
    elif mode is not Mode.FIRE:
        draft.change(fire_release_at=draft.now)


def release_in_fire(draft: Draft) -> bool:
    """Release everything once the robot has had its time; return whether a fire prevents everything else."""
    release_at = draft.record.fire_release_at
    if release_at is None:
        return False
    if draft.now >= release_at:
        robot_mode_output.drop_robot_mode(draft)
        handshake.release_all(draft)
        draft.change(fire_release_at=None)
        end_session(draft, EndReason.FIRE, "there is a fire")
    return True


# -- by another caller


def contest(draft: Draft, caller: Holder, refusal: Refused | None, *, queued: bool) -> Refused | None:
    """End the session where it has to give way to another caller; `refusal` is what else forbids the request of that one.

    A robot of the holder that may be in the car keeps the session: nobody else would get the lift then. A request that would be
    refused whoever holds the lift ends no session, nor does one that would wait behind others.
    """
    session = draft.session
    if session is None or refusal is not None:
        return None
    over = _why_contested(draft, session, caller)
    if over is None or isinstance(over, Refused):
        return over
    if not queued:
        end_session(draft, *over)
    return None


def _why_contested(draft: Draft, session: Session, caller: Holder) -> tuple[EndReason, str] | Refused | None:
    config, is_occupied, silent_s = draft.config, draft.record.robot_in_car is not None, session.silent_for(draft.now)
    # what it was invited to immediately before the restart may not be on the disk
    is_crossed = session.is_just_restored(draft.now) and doors.may_be_crossed(config, draft.record)
    if session.is_unclaimed and not (is_occupied or is_crossed):
        return EndReason.UNCLAIMED, f"{caller} sent the first request after a restart of the manager"
    if silent_s >= SILENT_S:
        _alarm_about_silence(draft, session, caller, silent_s)
    if session.is_unclaimed:
        held = held_by_another(session, draft.moment)
        where = "car" if is_occupied else "door"
        return replace(held, message=f"{held.message}; {unclaimed_text(config.name, where)}")
    allowed_s = config.takeover_after_s
    if allowed_s is None or silent_s < allowed_s or is_occupied:
        return None
    return EndReason.TAKEN_OVER, f"{session.holder} sent nothing for {silent_s:.0f} s, and {caller} requested the lift"


def _alarm_about_silence(draft: Draft, session: Session, caller: Holder, silent_s: float) -> None:
    """Alert people once for each caller to a holder that is silent."""
    silence = Silence(session.number, session.holder, session.contacted_at)
    before = draft.record.silence
    known = before.callers if before is not None and replace(before, callers=frozenset()) == silence else frozenset()
    if caller not in known and len(known) < _MOST_CALLERS:
        known |= {caller}
        draft.alarm(silent_text(draft.config.name, session.holder, caller, silent_s), session.holder)
    draft.change(silence=replace(silence, callers=known))


# -- by a person, and when the manager stops


def end_for_person(draft: Draft, reason: EndReason, text: str, *, at_once: bool) -> float:
    """End the session for a person; return in how many seconds.

    OPEN is withdrawn now. While a robot may be in the doorway the door is released only `clear_s` later, unless `at_once`.
    """
    session = draft.session
    waits = session is not None and not at_once and not session.ended_by_holder
    if session is None or not waits or not doors.may_be_crossed(draft.config, draft.record):
        _end_at_once(draft, reason, text)
        return 0.0
    # a second request neither shortens nor restarts the time of a robot in the doorway
    end_at = math.inf if session.end is None else session.end.at
    clear_s = max(0.0, min(session.policy.clear_s, end_at - draft.now))
    draft.change(session=announce_end(session, reason, text, draft.now + clear_s))
    return clear_s


def announce_stop(draft: Draft, clear_s: float) -> None:
    """Refuse everything from now on, and withdraw OPEN; a door that a robot may be in is held for `clear_s` more."""
    session, crossed = draft.session, doors.may_be_crossed(draft.config, draft.record)
    draft.change(is_stopping=True)
    if session is None:
        return
    if session.end is not None and session.end.is_announced:
        # a person has ended it: the process does not live as long as its robot was given
        left_s = min(clear_s, session.end.at - draft.now) if crossed else 0.0
        end = replace(session.end, at=draft.now + left_s)
        draft.change(session=session.having(end=end))
    elif crossed and not session.is_ending:
        draft.change(session=announce_end(session, EndReason.STOPPING, STOPPING_TEXT, draft.now + clear_s))


def stop(draft: Draft) -> None:
    """Release everything, and keep the session for the next start."""
    draft.change(is_stopping=True)
    if draft.session is not None and draft.session.ended_by_holder:
        end_session(draft, EndReason.RELEASED, "released")
    end_session(draft, EndReason.STOPPING, STOPPING_TEXT)
    robot_mode_output.drop_robot_mode(draft)
    handshake.release_all(draft)
    call_output.release_call(draft)


def _end_at_once(draft: Draft, reason: EndReason, text: str) -> None:
    end_session(draft, reason, text)
    if reason is EndReason.LOCKOUT:
        handshake.release_all(draft)
