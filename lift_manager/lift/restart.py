"""What of a lift outlives the manager: saved after every step, and restored at the next start. A start presses nothing."""

from __future__ import annotations

import math
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from operator import attrgetter
from typing import Any

from lift_manager.lift import handshake, history
from lift_manager.lift.call import CallOutput, call_after_restart, call_command, ends_call
from lift_manager.lift.call_output import robot_is_aboard, take_call_output
from lift_manager.lift.commands import (
    SAVED_SESSIONS,
    PastSession,
    SavedPast,
    SessionOver,
    restored_commands,
    saved_commands,
)
from lift_manager.lift.config import ROBOT_LEFT, ROBOT_MODE, LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.endings import advice_now, alarm_of_robot, give_people_their_turn, release_given
from lift_manager.lift.events import RestrictionKind, SessionEnded, SessionRestored
from lift_manager.lift.inhibits import restriction_text
from lift_manager.lift.lease import lease_ends_at, lease_of
from lift_manager.lift.occupancy import Occupancy, OccupancyAtEnd, SavedBoarding
from lift_manager.lift.record import DoorHold, DurableRecord, LiftRecord, Occupied, RobotModeHold, SavedSession
from lift_manager.lift.robot_mode_output import kept_after
from lift_manager.lift.session import BY_HOLDER, EndReason, Holder, Session, SessionEnd, policy_for

RENEWED_EVERY_S = 10.0
"""A lease that is merely renewed is saved at most so often, and four times in its length, but never more than once a second: a
caller may renew it several times a second, and a memory card wears out. Chosen: after a restart a lease ends at most that much early."""

_LASTING = attrgetter(*(one.name for one in fields(Session) if one.name not in ("lease_from", "contacted_at")))


# -- saving


def save(draft: Draft) -> None:
    """Bring the durable part of the record up to date with the rest.

    The session of a manager that stops stays on the disk as it was: it is kept for the next start.
    """
    durable = draft.record.durable
    occupied, owed = _left_behind(draft)
    clock = draft.moment.clock
    after: dict[str, Any] = {"occupied": _occupied(durable, occupied, clock)}
    if owed is not (durable.robot_left_pending_since is not None):
        after["robot_left_pending_since"] = clock if owed else None
    if not draft.record.is_stopping:
        after |= {
            "robot_mode_until": _robot_mode_until(draft, durable),
            "session": _saved(draft, durable),
            "commands": saved_commands(draft.record.commands),
            "past_sessions": _saved_past(draft.record),
        }
    draft.change_durable(**after)


def _saved_past(record: LiftRecord) -> tuple[SavedPast, ...]:
    keyed = [past for past in record.past_sessions if past.key][-SAVED_SESSIONS:]
    return tuple(SavedPast(past.info, past.key, past.key_ttl_s, saved_commands(past.commands)) for past in keyed)


def _left_behind(draft: Draft) -> tuple[tuple[Holder, bool] | None, bool]:
    """Return whose robot may be in the car, and whether the lift has still to learn that one left, if the manager ended now.

    A session that its holder has ended counts as over.
    """
    config, record, session = draft.config, draft.record, draft.session
    release = release_given(config, session)
    if session is None or release is None or record.abandoned_by is not None:
        return record.robot_in_car, record.has_robot_left_pending
    parting = handshake.parting_of(config, record, session, release, arrived=False)
    aboard = record.boarding.occupancy is Occupancy.ABOARD
    exited = parting is OccupancyAtEnd.EXITED and config.has(ROBOT_LEFT)
    return (
        session.holder,
        aboard,
    ) if parting is OccupancyAtEnd.DOUBT else None, record.has_robot_left_pending or exited


def _occupied(durable: DurableRecord, by: tuple[Holder, bool] | None, clock: datetime) -> Occupied | None:
    known = durable.occupied
    if by is None or (known is not None and (known.holder, known.aboard) == by):
        return None if by is None else known
    return Occupied(*by, known.since if known is not None and known.holder == by[0] else clock)


def _robot_mode_until(draft: Draft, durable: DurableRecord) -> datetime | None:
    """Return until when robot mode would be kept at most, if the session were over."""
    session, record = draft.session, draft.record
    until = record.robot_mode.kept_until
    if session is not None and session.end is not None:
        until = kept_after(draft.config, record, session.end.at)
    if until is None:
        return None
    at, known = _utc(draft.moment.clock) + timedelta(seconds=until - draft.now), durable.robot_mode_until
    is_same = known is not None and abs((at - known).total_seconds()) < 1.0
    return known if is_same else at


def _saved(draft: Draft, durable: DurableRecord) -> SavedSession | None:
    """Return the session as it is saved.

    One that its holder has ended is over for a restart: it would come back for as long as a session may last.
    """
    session, record, now = draft.session, draft.record, draft.now
    if session is None or session.ended_by_holder:
        if record.saved_as is not None:
            draft.change(saved_as=None)
        return None
    boarding = SavedBoarding(
        occupancy=record.boarding.occupancy,
        sent_on=record.boarding.sent_on,
        may_leave_at=record.boarding.may_leave_at,
        in_place_taken=record.in_place.call is not None and not record.in_place.is_unacknowledged,
    )
    saved_as = (session, boarding, record.call is not None and record.call.was_pressed)
    every_s = _saved_every_s(session, draft.config)
    before = record.saved_as
    is_same = before is not None and before[1:] == saved_as[1:] and _LASTING(before[0]) == _LASTING(session)
    if is_same and before is not None and session.lease_from - before[0].lease_from < every_s:
        return durable.session
    draft.change(saved_as=saved_as)
    # in a zone, arithmetic is that of the hands of the clock, and wrong by an hour around a change of the clock
    clock = _utc(draft.moment.clock)

    def wall(at: float) -> datetime:
        return clock + timedelta(seconds=at - now)

    return SavedSession(
        holder=session.holder,
        floor=session.floor,
        hold_door=session.hold_door,
        opened_at=wall(session.opened_at),
        lease_from=wall(session.lease_from),
        holding_since=None if session.holding_since is None else wall(session.holding_since),
        saved_at=clock,
        opened_at_target=session.opened_at_target,
        hold_spent=session.hold_spent,
        pressed=saved_as[2],
        boarding=boarding,
        id=session.id,
        stays=session.policy.stays,
        lease_s=session.lease_s,
        key=session.key,
        key_ttl_s=session.key_ttl_s,
        ends_at=None if session.end is None else wall(session.end.at),
        ends_for=None if session.end is None else (session.end.reason, session.end.text),
    )


def _saved_every_s(session: Session, config: LiftConfig) -> float:
    """Return how often the renewal of a lease is saved: what is on the disk may be that much older than the newest one."""
    return min(RENEWED_EVERY_S, max(1.0, lease_of(session, config) / 4))


# -- the next start


def restore(draft: Draft) -> None:
    """Continue with what was saved, before the lift is read for the first time.

    Nothing is pressed by it: what is found on is kept on, and what is found off waits for the holder's next request, because
    somebody may have released it meanwhile, and a holder that still needs it sends a request within seconds.
    """
    handshake.restore_occupied(draft)
    draft.change(past_sessions=tuple(_past(draft, past) for past in draft.record.durable.past_sessions))
    saved = draft.record.durable.session
    session = None if saved is None else _restored(draft.config, saved, draft)
    over = None if session is None else _why_not_restored(draft, session)
    if session is None or saved is None or over is not None:
        _keep_robot_mode(draft, had_session=saved is not None)
        if session is not None and saved is not None and over is not None:
            _end_unrestored(draft, session, *over)
            if saved.pressed or saved.holding_since is not None:
                # when it was over, nobody knows: what was renewed last may not be on the disk
                give_people_their_turn(draft)
        return
    session = _with_time_to_clear(session, draft)
    commands = restored_commands(draft.record.durable.commands, draft.moment.clock)
    draft.change(session=session, sessions_opened=session.number, used_by=session.number, commands=commands)
    if session.floor is not None:
        _restore_outputs(draft, session, saved, session.floor)
    if draft.config.has(ROBOT_MODE):
        draft.change(robot_mode=RobotModeHold(is_requested=True, was_pressed=True, renewed_at=draft.now))
    call = "its call is followed" if saved.pressed else "its call was not pressed, and waits for its next request"
    text = f"to {session.floor}, {call}; what is found off stays off until it sends another request"
    text = text if session.floor is not None else "without a requested floor"
    draft.emit(SessionRestored(draft.config.name, session.holder, session.floor, text))


def _past(draft: Draft, saved: SavedPast) -> PastSession:
    """Return a session that was over before this start, as old as the wall clock shows."""
    over = saved.info.over
    gone_s = 0.0 if over is None else max(0.0, (_utc(draft.moment.clock) - _utc(over.at)).total_seconds())
    commands = restored_commands(saved.commands, draft.moment.clock)
    return PastSession(saved.info, saved.key, saved.key_ttl_s, draft.now - gone_s, commands)


def _restored(config: LiftConfig, saved: SavedSession, draft: Draft) -> Session:
    """Return a saved session at this moment.

    What had passed by `saved_at` is known, whatever the clocks do. What has passed since is the difference of two readings of the
    wall clock: a clock that went back counts as no time at all, so that a lease starts again at most; one that jumped forward ends
    a lease early, and never makes it longer.
    """
    now, saved_at = draft.now, _utc(saved.saved_at)
    gone_s = max(0.0, (_utc(draft.moment.clock) - saved_at).total_seconds())

    def monotonic(at: datetime) -> float:
        return now - gone_s - max(0.0, (saved_at - _utc(at)).total_seconds())

    end = None
    if saved.ends_at is not None and saved.ends_for is not None:
        ends_at = now - gone_s + (_utc(saved.ends_at) - saved_at).total_seconds()
        end = SessionEnd(*saved.ends_for, at=ends_at, is_announced=True)
    return Session(
        number=draft.record.sessions_opened + 1,
        holder=saved.holder,
        policy=policy_for(config, saved.holder, stays=saved.stays),
        floor=saved.floor,
        hold_door=saved.hold_door,
        opened_at=monotonic(saved.opened_at),
        opened_clock=saved.opened_at,
        lease_from=monotonic(saved.lease_from),
        # with another map an open door has shown nothing
        opened_at_target=saved.opened_at_target and draft.record.durable.trust.map_hash == config.capabilities.map_hash,
        holding_since=None if saved.holding_since is None else monotonic(saved.holding_since),
        hold_spent=saved.hold_spent,
        is_restored=True,
        restored_at=now,
        id=saved.id,
        lease_s=saved.lease_s,
        key=saved.key,
        key_ttl_s=saved.key_ttl_s,
        end=end,
    )


def _why_not_restored(draft: Draft, session: Session) -> tuple[EndReason, str] | None:
    """Return why a session from before this start is over by now."""
    config, record = draft.config, draft.record
    if not config.control:
        return EndReason.NOT_RESTORED, "the site file no longer says `access: control`"
    if session.floor is not None and session.floor not in config.floors:
        return EndReason.NOT_RESTORED, f"the site file no longer has its floor {session.floor}"
    lockout = restriction_text(record, RestrictionKind.LOCKOUT, draft.moment)
    if lockout and session.end is None:
        return EndReason.LOCKOUT, f"the lift is locked out {lockout}"
    if record.durable.fire_since is not None:
        return EndReason.FIRE, "there was a fire"
    if session.end is not None:
        # a lockout releases only then: its robot may be in the doorway
        return None if draft.now < session.end.at else (session.end.reason, session.end.text)
    if draft.now >= lease_ends_at(session, config) + _saved_every_s(session, config):
        return (
            EndReason.LEASE,
            f"the lease of {lease_of(session, config):g} s ran out while the manager was not running",
        )
    return None


def _with_time_to_clear(session: Session, draft: Draft) -> Session:
    """Let the lease last for `clear_s` at least.

    The robot may have been invited until the restart, by a renewal that was not saved.
    """
    missing_s = draft.now + session.policy.clear_s - lease_ends_at(session, draft.config)
    return session if missing_s <= 0 else session.having(lease_from=session.lease_from + missing_s)


def _restore_outputs(draft: Draft, session: Session, saved: SavedSession, floor: str) -> None:
    """Keep on what is found on: the call, the report that a robot is in place, and the hold of the doors."""
    config, now = draft.config, draft.now
    draft.change(call=call_after_restart(floor, now, pressed=saved.pressed))
    handshake.restore_session(draft, saved, floor)
    aboard = robot_is_aboard(config, draft.record)
    command = call_command(config, floor, aboard=aboard)
    if saved.pressed and command is not None and command.name in config.capabilities.until:
        until = ends_call(config, command, aboard=aboard)
        if until != "arrived" or saved.holding_since is None:  # the door has been held there, so the car had arrived
            take_call_output(draft, CallOutput(command, until, None, now))
    if saved.holding_since is not None and session.hold_door:
        draft.change(door_hold=DoorHold(floor, may_begin=False, renewed_at=now), door_hold_found=True)


def _keep_robot_mode(draft: Draft, *, had_session: bool) -> None:
    """Keep robot mode from before this start for as long as a car may be under way, if its session does not continue."""
    config, durable = draft.config, draft.record.durable
    longest_s, until = config.capabilities.arrive_within_s, durable.robot_mode_until
    if not config.has(ROBOT_MODE) or not config.control or durable.fire_since is not None:
        return
    rest_s = longest_s if had_session else -math.inf
    if until is not None and not had_session:
        rest_s = (_utc(until) - _utc(draft.moment.clock)).total_seconds()
    if rest_s > 0:
        kept_until = draft.now + min(rest_s, longest_s)
        mode = RobotModeHold(is_requested=True, was_pressed=True, kept_until=kept_until, renewed_at=draft.now)
        draft.change(robot_mode=mode)


def _end_unrestored(draft: Draft, session: Session, reason: EndReason, text: str) -> None:
    """Remember a session from before this start that is over: its holder may ask for its outcome."""
    advice = advice_now(draft)
    info = history.session_info(draft.config, draft.record, session, draft.moment)
    over = SessionOver(reason, text, None if reason in BY_HOLDER else advice, draft.moment.clock)
    info = info.ended(history.ended_robot(draft.record, info.robot), over)
    history.archive_session(draft, session, info, over)
    if (in_car := draft.record.robot_in_car) is not None:
        alarm = alarm_of_robot(draft.config.name, session.holder, reason, text, is_aboard=in_car[1])
        if alarm:
            draft.alarm(alarm, session.holder)
    draft.emit(SessionEnded(draft.config.name, session.holder, reason, text, over.advice))


def _utc(at: datetime) -> datetime:
    return at.astimezone(UTC)
