"""The session as its holder sees it, the commands within it, and the sessions before it."""

from __future__ import annotations

import math
from dataclasses import replace

from drivers.model import FloorName, Proof
from lift_manager.lift import call_output, doors
from lift_manager.lift.commands import (
    COMMANDS,
    REPLACED,
    SESSIONS,
    SESSIONS_FOR_S,
    CommandEntry,
    CommandRequest,
    CommandState,
    CommandStatus,
    CommandType,
    PastSession,
    PendingCommand,
    SessionInfo,
    SessionOnLift,
    SessionOver,
    Verdict,
    broken_off,
    ended_entry,
    judge_command,
    progress_of,
    replaces,
)
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.events import CommandFollowed
from lift_manager.lift.inhibits import waits_for
from lift_manager.lift.inputs import OpenSession
from lift_manager.lift.lease import hold_ends_at, lease_ends_at, longest_until, releases_at
from lift_manager.lift.observation import Moment
from lift_manager.lift.occupancy import Occupancy
from lift_manager.lift.record import LiftRecord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.robot_door import invites_until
from lift_manager.lift.session import EndReason, Holder, Session


def session_info(config: LiftConfig, record: LiftRecord, session: Session, moment: Moment) -> SessionInfo:
    """Return a session that goes on, as its holder sees it."""
    now, floor = moment.now, session.floor
    lease_ends, hold_ends = lease_ends_at(session, config), hold_ends_at(session, config)
    can_hold = floor is not None and floor in config.floors and doors.why_no_hold(config, floor) is None
    is_held = session.hold_door and can_hold and record.call_has_arrived and doors.door_is_held(config, record)
    return SessionInfo(
        id=session.id,
        lift=config.name,
        holder=session.holder,
        floor=floor,
        hold_door=session.hold_door,
        opened_at=session.opened_clock,
        lease_ends_in_s=None if math.isinf(lease_ends) else max(0.0, lease_ends - now),
        ends_in_s=max(0.0, longest_until(session, config) - now),
        hold_ends_in_s=max(0.0, hold_ends - now) if session.hold_door and not math.isinf(hold_ends) else None,
        releases_in_s=max(0.0, releases_at(session, config) - now),
        releasing=now >= invites_until(session, config),
        arrived=record.call_has_arrived,
        door_held=is_held,
        robot=record.boarding.reported,
        waiting_for=waits_for(config, record, moment),
        restored=session.is_restored,
    )


# -- queries


def find_session(
    config: LiftConfig, record: LiftRecord, session_id: str, holder: Holder | None, moment: Moment
) -> Session | SessionInfo | Refused:
    """Return a session by its id, as it is or as it ended; `holder` None finds those of all holders."""
    live = record.session
    if live is not None and live.id == session_id and holder in (None, live.holder):
        return live
    past = _past(record, session_id, moment.now)
    if past is None or holder not in (None, past.info.holder):
        text = f"{config.name} has no session of that id for you; one that was over an hour ago, or before a restart, is forgotten"
        return Refused(Refusal.NO_SUCH_SESSION, text)
    info, in_car = past.info, record.robot_in_car
    is_in_doubt = in_car is not None and in_car[0] == info.holder
    cleared = info.robot in (Occupancy.MAY_BOARD, Occupancy.ABOARD) and not is_in_doubt
    return replace(info, robot=Occupancy.EXITED) if cleared else info


def read_session(
    config: LiftConfig, record: LiftRecord, session_id: str, holder: Holder | None, moment: Moment
) -> SessionInfo | Refused:
    """Return a session as its holder sees it now."""
    found = find_session(config, record, session_id, holder, moment)
    return session_info(config, record, found, moment) if isinstance(found, Session) else found


def read_command(
    config: LiftConfig, record: LiftRecord, session_id: str, holder: Holder | None, command_id: str, moment: Moment
) -> CommandStatus | Refused:
    """Return a command within a session as it is now."""
    found = find_session(config, record, session_id, holder, moment)
    if isinstance(found, Refused):
        return found
    for entry in _entries(record, session_id, moment.now):
        if entry.status.id == command_id:
            return entry.status
    text = "the session has no request of that id; of many, and of those before a restart, it is forgotten"
    return Refused(Refusal.NO_SUCH_COMMAND, text)


def command_by_key(record: LiftRecord, request: CommandRequest, moment: Moment) -> CommandStatus | Refused | None:
    """Return the command of a session that was made with this key; refuse another command with it."""
    if not request.key:
        return None
    entries = _entries(record, request.session, moment.now)
    entry = next((one for one in entries if one.request.key == request.key), None)
    if entry is None or entry.request == request:
        return None if entry is None else entry.status
    text = f"this idempotency key was used for {_in_words(entry.request)}; another request needs another key"
    return Refused(Refusal.KEY_REUSED, text)


def past_session_by_key(record: LiftRecord, request: OpenSession, moment: Moment) -> SessionInfo | Refused | None:
    """Return the newest session of a holder that was opened with this key and is over; refuse another lease with it."""
    found = [past for past in record.past_sessions if (past.info.holder, past.key) == (request.holder, request.key)]
    if not request.key or not found or _past(record, found[-1].info.id, moment.now) is None:
        return None
    return key_reused(request, found[-1].key_ttl_s) or found[-1].info


def key_reused(request: OpenSession, ttl_s: float | None) -> Refused | None:
    """Refuse to open with a key that stands for a session with another lease; `ttl_s` is what was requested then."""
    if request.ttl_s == ttl_s:
        return None
    lease = "without `ttl_s`" if ttl_s is None else f"with `ttl_s` {ttl_s:g}"
    text = f"this idempotency key was used to open a session {lease}; another request needs another key"
    return Refused(Refusal.KEY_REUSED, text)


def _past(record: LiftRecord, session_id: str, now: float) -> PastSession | None:
    found = next((past for past in record.past_sessions if past.info.id == session_id), None)
    return None if found is None or now - found.over_at > SESSIONS_FOR_S else found


def _entries(record: LiftRecord, session_id: str, now: float) -> tuple[CommandEntry, ...]:
    if record.session is not None and record.session.id == session_id:
        return record.commands
    past = _past(record, session_id, now)
    return () if past is None else past.commands


def _in_words(request: CommandRequest) -> str:
    to = "" if request.floor is None else f" {request.floor}"
    hold = " without `hold_door`" if request.kind is CommandType.GO_TO and not request.hold_door else ""
    side = "" if request.side is None else f" of the {request.side} door"
    return f"{request.kind}{to}{hold}{side}"


# -- commands


def take_command(
    draft: Draft, request: CommandRequest, pending: PendingCommand, command_id: str, *, is_recorded: bool
) -> None:
    """Follow a command of the session that goes on."""
    status = CommandStatus(
        id=command_id,
        lift=draft.config.name,
        holder=request.holder,
        kind=request.kind,
        floor=request.floor,
        state=CommandState.PENDING,
        reason=pending.waiting_for,
        proof=Proof.NONE,
        requested_at=draft.moment.clock,
        ended_at=None,
    )
    entries = (*draft.record.commands, CommandEntry(request, status, pending, is_recorded))
    if len(entries) > COMMANDS:
        oldest, *rest = entries
        entries = tuple(rest)
        if oldest.pending is not None:
            _end(draft, oldest, broken_off(oldest.pending, f"more than {COMMANDS} requests came after it"))
    draft.change(commands=entries)
    draft.emit(CommandFollowed(draft.config.name, status, is_recorded))


def replace_commands(draft: Draft, kind: CommandType, floor: FloorName | None, *, hold_door: bool) -> None:
    """End the commands that a new one replaces; `floor` and `hold_door` are the session's with it."""

    def after(entry: CommandEntry, pending: PendingCommand) -> CommandEntry:
        if not replaces(kind, floor, pending, hold_door=hold_door):
            return entry
        return _end(draft, entry, broken_off(pending, REPLACED))

    entries = (one if one.pending is None else after(one, one.pending) for one in draft.record.commands)
    draft.change(commands=tuple(entries))


def judge_commands(draft: Draft) -> None:
    """Find the outcome of the commands that have not ended."""
    if draft.session is None or all(entry.pending is None for entry in draft.record.commands):
        return
    lift = session_on_lift(draft.config, draft.record, draft.session, draft.moment)
    entries: list[CommandEntry] = []
    for entry in draft.record.commands:
        after = entry
        if entry.pending is not None:
            judged = judge_command(entry.pending, lift, draft.now)
            if isinstance(judged, Verdict):
                after = _end(draft, entry, judged)
            elif judged != entry.pending:
                after = replace(entry, pending=judged, status=replace(entry.status, reason=judged.waiting_for))
        entries.append(after)
    if tuple(entries) != draft.record.commands:
        draft.change(commands=tuple(entries))


def session_on_lift(config: LiftConfig, record: LiftRecord, session: Session, moment: Moment) -> SessionOnLift:
    """Return what the session has on the lift."""
    call_is_on = call_output.call_is_on_at_floor(record)
    now = moment.now
    return SessionOnLift(
        floor=session.floor,
        call=progress_of(record.call, now),
        door_is_held=doors.door_is_held(config, record),
        door_is_given=doors.door_is_given(config, record) or call_is_on,
        door_is_free=doors.doors_at_rest(config, record) and not call_is_on,
        hold_spent=session.hold_spent,
        hold_limited_by=config.hold_limit.set_by,
        in_place=progress_of(record.in_place.call, now),
        robot_left=progress_of(record.robot_left.call, now),
        close=record.closing.progress,
        waiting_for=waits_for(config, record, moment),
    )


def archive_session(draft: Draft, session: Session, info: SessionInfo, over: SessionOver) -> None:
    """Remember a session that is over, as it was. Whatever is pending in it ends with it."""
    entries = tuple(
        entry if entry.pending is None else _end(draft, entry, _over_with_session(entry.pending, over))
        for entry in draft.record.commands
    )
    past = PastSession(info, session.key, session.key_ttl_s, draft.now, entries)
    others = tuple(one for one in draft.record.past_sessions if one.info.id != info.id)
    draft.change(commands=(), past_sessions=(*others, past)[-SESSIONS:])


def ended_robot(record: LiftRecord, robot: Occupancy) -> Occupancy:
    """Return where the robot of a session that has just ended is reported to be."""
    in_doubt = record.robot_in_car is not None
    return Occupancy.EXITED if not in_doubt and robot in (Occupancy.MAY_BOARD, Occupancy.ABOARD) else robot


def _end(draft: Draft, entry: CommandEntry, verdict: Verdict) -> CommandEntry:
    after = ended_entry(entry, verdict, draft.moment.clock)
    draft.emit(CommandFollowed(draft.config.name, after.status, entry.is_recorded))
    return after


def _over_with_session(pending: PendingCommand, over: SessionOver) -> Verdict:
    if over.reason is not EndReason.STOPPING:
        return broken_off(pending, f"the session is over: {over.text}")
    sent = (
        "it was sent to the lift, and nobody watches what comes of it" if pending.pressed else "nothing was sent for it"
    )
    text = (
        f"the manager is stopping: {sent}; the session continues when the manager has started again, then send it again"
    )
    return broken_off(pending, text)
