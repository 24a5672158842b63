"""Decides on what callers request: who gets the lift, what it is to do, and what is refused.

A face that knows no sessions names a floor, and the session follows from it (`request_lift`); others open a session and give
commands within it (`open_session`, `give_command`). Both are admitted by the same inhibits and have the same effects; what differs
is the `SessionPolicy`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.model import FloorName
from drivers.rate_limits import CALLERS
from lift_manager.lift import call_output, doors, handshake, history, queue
from lift_manager.lift.advance import advance
from lift_manager.lift.call import CallPhase, call_after_restart, call_holds_door, request_call, request_call_again
from lift_manager.lift.commands import (
    SessionInfo,
    SessionOver,
)
from lift_manager.lift.draft import Draft
from lift_manager.lift.endings import contest, end_after_grace, release_session, session_of
from lift_manager.lift.events import HandedOver, SessionOpened
from lift_manager.lift.freshness import is_fresh
from lift_manager.lift.inhibits import (
    command_refusal,
    held_by_another,
    not_recorded,
    over_soon,
    robot_of_another,
    robot_words_needed,
    unknown_floor,
    unreachable_floor,
)
from lift_manager.lift.inputs import (
    CloseSession,
    EndSession,
    HandOver,
    LiftRequest,
    OpenSession,
    RenewSession,
)
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import STOPPING, Accepted, Refusal, Refused
from lift_manager.lift.session import (
    EndReason,
    Holder,
    Session,
    hand_session_over,
    hold_again,
    policy_for,
    renew,
    set_target,
)
from lift_manager.lift.state import reported_floor

RECENT_FLOOR_S = 3.0
"""How long a client may act on a floor that we reported: the workshop adapter polls every 0.5 s, publishes every 1 s and waits 1 s for
an answer (open-rmf 2.1), so its idea of the floor may be 2.5 s old."""

TURNS, TURN_EVERY_S = 30, 3.0
"""How often one caller may begin a session or change its floor: `TURNS` at once, then one in so many seconds. Chosen: a ride takes
longer, and a caller that requests another floor 900 times a second wears out neither the lift nor the journal."""

PASSING = frozenset({Refusal.OFFLINE, Refusal.OCCUPANCY_UNKNOWN, Refusal.TOO_OFTEN})
"""Why a request may be refused that is taken when it is repeated a little later."""


@dataclass(frozen=True, slots=True)
class SessionBegun:
    """The reply to `OpenSession`."""

    session: SessionInfo
    is_new: bool
    """False where the idempotency key gave an existing one."""


# -- faces that know no sessions


def request_lift(draft: Draft, request: LiftRequest) -> Accepted | Refused:
    """Decide on a request that names a floor. Acceptance is not arrival."""
    config, record = draft.config, draft.record
    is_release = not request.hold_door and not request.stays and _is_release(draft, request)
    if not is_release and (refused := not_recorded(config, record, draft.moment)) is not None:
        return refused
    is_new_request = not is_release and is_new(draft, request.holder, request.floor, hold_door=request.hold_door)
    refused = too_often(draft, request.holder) if is_new_request else None
    reply = refused or _take_request(draft, request, is_release=is_release)
    if isinstance(reply, Refused):
        _forgive_end(draft, request, reply)
    elif is_new_request:
        take_turn(draft, request.holder)
    return reply


def end_own_session(draft: Draft, request: EndSession) -> Accepted | Refused:
    """End the session at its holder's request, after the grace; one that is over already stays over."""
    if draft.record.is_stopping:
        return STOPPING
    if (session := draft.session) is None:
        return Accepted()
    if session.holder != request.holder:
        return held_by_another(session, draft.moment)
    end_after_grace(draft, session, request.grace_s)
    advance(draft)
    return Accepted()


def _take_request(draft: Draft, request: LiftRequest, *, is_release: bool) -> Accepted | Refused:
    """Decide on a request and act on it."""
    now, needs_lift = draft.now, (request.hold_door or request.stays) and not is_release
    reply = _admit(draft, request, is_release=is_release, needs_lift=needs_lift)
    if isinstance(reply, Refused) and needs_lift:
        draft.change(queue=queue.join_if_refused(draft.record.queue, request.holder, reply, now))
    if not isinstance(reply, Session):
        return reply
    refused = handshake.take_request(draft, draft.session, request.holder, request.floor, request.robot)
    if refused is not None:
        return refused
    draft.change(queue=queue.leave(draft.record.queue, request.holder))
    go_on_with(draft, reply)
    if draft.observation is None:
        _leave_call(draft)
    return Accepted()


def _admit(draft: Draft, request: LiftRequest, *, is_release: bool, needs_lift: bool) -> Session | Accepted | Refused:
    """Return the session as it continues with a request, or why it is not taken; a release is done here."""
    config, now = draft.config, draft.now
    if draft.record.is_stopping:
        return STOPPING
    if (unknown := unknown_floor(config, request.floor)) is not None:
        return unknown
    session = draft.session
    if session is not None and session.holder == request.holder:
        draft.change(session=session.having(contacted_at=now))
    elif session is not None and needs_lift and (refused := _contest(draft, request)) is not None:
        return refused
    session = draft.session
    if session is not None and session.holder != request.holder:
        return held_by_another(session, draft.moment)
    if is_release:
        release_session(draft, request.holder, request.floor, request.robot)
        return Accepted()
    if session is not None and _only_releases_door(request, session):
        doors.release_door_at_request(draft)
        session = session.having(holding_since=None)
    elif (refused := _why_not_admitted(draft, request, session)) is not None:
        return refused
    if session is None:
        new = _new_session(draft, request.holder, request.new_id, stays=request.stays)
        return new.having(floor=request.floor, hold_door=request.hold_door)
    after = set_target(session, request.floor, now, hold_door=request.hold_door)
    stays = after.policy.stays or request.stays
    return after if stays == after.policy.stays else after.having(policy=policy_for(config, after.holder, stays=stays))


def _why_not_admitted(draft: Draft, request: LiftRequest, session: Session | None) -> Refused | None:
    """Return what forbids a request for a lift that nobody else holds."""
    config, record, moment = draft.config, draft.record, draft.moment
    if (over := over_soon(session, moment)) is not None:
        return over
    goes_on = session is not None or handshake.may_go_on(record, request.holder)
    refused = command_refusal(config, record, moment, goes_on=goes_on)
    if refused is not None and session is not None and session.is_ending and refused.code is Refusal.OFFLINE:
        # it continues in its grace and keeps what is on; nothing is pressed for it before the lift is read
        return None
    if refused is not None or goes_on:
        return refused
    without_words = robot_words_needed(config) if request.stays else None
    return without_words or queue.why_not_yet(config.name, record.queue, request.holder, moment.now)


def _contest(draft: Draft, request: LiftRequest) -> Refused | None:
    """End another caller's session that has to give way to this request, if it has to."""
    config, record = draft.config, draft.record
    refusal = command_refusal(config, record, draft.moment, goes_on=False) or unreachable_floor(
        config, request.floor, aboard=request.robot is RobotWord.IN_PLACE
    )
    queued = queue.ahead_of(record.queue, request.holder, draft.now) > 0
    return contest(draft, request.holder, refusal, queued=queued)


def _only_releases_door(request: LiftRequest, session: Session) -> bool:
    """Whether a request only ends the door hold of the session: nothing forbids that."""
    is_here = request.floor == session.floor
    return request.stays and not request.hold_door and session.hold_door and is_here


def _is_release(draft: Draft, request: LiftRequest) -> bool:
    """Whether the requested floor is the one that this lift reports, so that a request not to hold the door there is a release.

    An idle lift that people move is not called back to a floor that a slow client still believes in. Of a lift that is offline,
    clients know the last floor. Where only the open door shows the floor, the target counts once the door has stood open there.
    """
    if request.robot is not None:
        return request.robot is RobotWord.LEFT
    record, session = draft.record, draft.session
    reported = reported_floor(draft.config, record, draft.moment)
    if record.observation is not None and not is_fresh(draft.config.capabilities, draft.moment):
        reported = record.observation.floor
    elif reported is None and draft.config.capabilities.evidence == "door_limit":
        reported = session.floor if session is not None and session.opened_at_target else None
    if request.floor == reported:
        return True
    departed_at = record.departed_at.get(request.floor, -math.inf)
    return session is None and draft.now - departed_at <= RECENT_FLOOR_S


def _forgive_end(draft: Draft, request: LiftRequest, refused: Refused) -> None:
    """Continue a session whose holder sends a request within its grace, where nothing but time forbids the request.

    What is on stays on for it, and a call that its end kept back waits for a request that is taken.
    """
    session = draft.session
    if session is None or not session.ended_by_holder or not request.stays or session.holder != request.holder:
        return
    config, record = draft.config, draft.record
    others = (unknown_floor(config, request.floor), command_refusal(config, record, draft.moment, goes_on=True))
    if all(reason is None or reason.code in PASSING for reason in (refused, *others)):
        _leave_call(draft)
        go_on_with(draft, session.having(contacted_at=draft.now, end=None), is_requested=False)


def _leave_call(draft: Draft) -> None:
    """Leave a call that was not pressed to the next request.

    Nobody knows how long the lift cannot be read, nor who still needs it then.
    """
    call = draft.record.call
    if call is not None and call.phase is CallPhase.REQUESTED:
        draft.change(call=call_after_restart(call.floor, draft.now, pressed=False))


# -- sessions that their holders open


def open_session(draft: Draft, request: OpenSession) -> SessionBegun | Refused:
    """Take the lift for a caller; nothing is called by it."""
    config, moment = draft.config, draft.moment
    if (known := _session_by_key(draft, request)) is not None:
        return known if isinstance(known, Refused) else SessionBegun(known, is_new=False)
    refused = not_recorded(config, draft.record, moment) or too_often(draft, request.holder)
    if refused is not None:
        return refused
    if (refused := _why_not_opened(draft, request)) is not None:
        draft.change(queue=queue.join_if_refused(draft.record.queue, request.holder, refused, draft.now))
        return refused
    draft.change(queue=queue.leave(draft.record.queue, request.holder))
    session = _new_session(draft, request.holder, request.new_id, stays=True)
    key_ttl_s = request.ttl_s if request.key else None
    lease_s = config.lease_for(request.ttl_s)
    session = session.having(lease_s=lease_s, key=request.key, key_ttl_s=key_ttl_s)
    go_on_with(draft, session)
    take_turn(draft, request.holder)
    # what continues with it may have ended it by now
    info = history.read_session(config, draft.record, session.id, None, moment)
    return info if isinstance(info, Refused) else SessionBegun(info, is_new=True)


def renew_session(draft: Draft, request: RenewSession) -> SessionInfo | Refused:
    """Begin the lease again; `ttl_s` None leaves its length. The call of a session from before a restart continues."""
    found = live_session(draft, request.session, request.holder)
    if isinstance(found, Refused):
        return found
    lease_s = found.lease_s if request.ttl_s is None else draft.config.lease_for(request.ttl_s)
    go_on_with(draft, renew(found, draft.now).having(lease_s=lease_s), is_requested=found.is_restored)
    return history.read_session(draft.config, draft.record, request.session, request.holder, draft.moment)


def close_session(draft: Draft, request: CloseSession) -> SessionInfo | Refused:
    """End a session, or take what the robot of one that is over still has to report."""
    config, holder, word = draft.config, request.holder, request.robot
    found = history.find_session(config, draft.record, request.session, holder, draft.moment)
    if isinstance(found, Refused):
        return found
    floor = found.floor or config.floors[0]
    if isinstance(found, Session) or (draft.session is None and word is RobotWord.LEFT):
        release_session(draft, holder, floor, word)
        if not isinstance(found, Session):
            advance(draft)
    return history.read_session(config, draft.record, request.session, holder, draft.moment)


def hand_over(draft: Draft, request: HandOver) -> Accepted | SessionInfo | Refused:
    """Hand a session to another caller at its holder's request, with what is known of the robot.

    Car and door stay as they are. For its holder it is over; the reply has its new id where the face knows sessions.
    """
    if request.session is None:
        found = session_of(draft, request.holder)
    else:
        found = live_session(draft, request.session, request.holder)
    if isinstance(found, Refused):
        return found
    config, record, moment = draft.config, draft.record, draft.moment
    info = history.session_info(config, record, found, moment)
    over = SessionOver(EndReason.RELEASED, f"handed over to {request.to}", None, moment.clock)
    history.archive_session(draft, found, info.ended(info.robot, over), over)
    after = hand_session_over(found, config, request.to, request.new_id, draft.now)
    abandoned_by = None if record.abandoned_by is None else request.to
    draft.change(session=after, abandoned_by=abandoned_by)
    if request.to != found.holder:
        draft.emit(HandedOver(config.name, found.holder, request.to))
    advance(draft)
    if request.session is None:
        return Accepted()
    return history.read_session(config, draft.record, request.new_id, None, moment)


def _session_by_key(draft: Draft, request: OpenSession) -> SessionInfo | Refused | None:
    """Return the session that a caller has opened with this key before; refuse another lease with it."""
    session = draft.session
    if not request.key:
        return None
    if session is not None and (session.holder, session.key) == (request.holder, request.key):
        session = session.having(contacted_at=draft.now)
        draft.change(session=session)
        info = history.session_info(draft.config, draft.record, session, draft.moment)
        return history.key_reused(request, session.key_ttl_s) or info
    return history.past_session_by_key(draft.record, request, draft.moment)


def _why_not_opened(draft: Draft, request: OpenSession) -> Refused | None:
    config, record, holder = draft.config, draft.record, request.holder
    if record.is_stopping:
        return STOPPING
    goes_on = handshake.may_go_on(record, holder)
    refused = command_refusal(config, record, draft.moment, goes_on=goes_on)
    queued = None if goes_on else queue.why_not_yet(config.name, record.queue, holder, draft.now)
    if (session := record.session) is not None:
        contested = None
        if session.holder != holder:
            contested = contest(draft, holder, refused, queued=queued is not None)
        if contested is not None or draft.session is not None:
            return contested or held_by_another(session, draft.moment)
    return refused or queued or robot_of_another(config, draft.record, holder)


def live_session(draft: Draft, session_id: str, holder: Holder) -> Session | Refused:
    found = history.find_session(draft.config, draft.record, session_id, holder, draft.moment)
    if isinstance(found, SessionInfo):
        why = found.over.text if found.over is not None else "over"
        return Refused(Refusal.SESSION_OVER, f"the session on {draft.config.name} is over: {why}")
    return STOPPING if isinstance(found, Session) and draft.record.is_stopping else found


# -- what both kinds share


def go_on_with(draft: Draft, session: Session, *, is_requested: bool = True) -> None:
    """Continue with a session that was admitted; `is_requested` if its call is requested, or requested again."""
    is_new = draft.session is None
    holds_again = is_requested and session.hold_door and session.hold_spent
    if holds_again:
        session = hold_again(session, draft.config, draft.now)
    draft.change(session=session)
    if is_new:
        draft.change(sessions_opened=session.number, commands=())
        draft.emit(SessionOpened(draft.config.name, session.holder, session.floor))
    if is_requested:
        _request_target(draft, session, holds_again=holds_again and not session.hold_spent)
    advance(draft)


def _request_target(draft: Draft, session: Session, *, holds_again: bool) -> None:
    """Request the car at the target: a new call, or the same one again; `holds_again` after the hold was spent."""
    doors.forget_closing(draft)
    config, floor, now = draft.config, session.floor, draft.now
    if floor is None:
        return
    call = draft.record.call
    moves_on = call is not None and call.floor != floor
    if moves_on:
        draft.change(door_hold_found=False)
        if handshake.is_ready(config, draft.record):
            call_output.release_call(draft)
    aboard = call_output.robot_is_aboard(config, draft.record)
    if moves_on or not (session.hold_spent and call_holds_door(config, floor, aboard=aboard)):
        draft.change(call=request_call(call, floor, now))
    is_missed = (session.policy.stays or holds_again) and call_output.call_must_be_on(config, draft.record, session)
    call = draft.record.call
    if call is not None and is_missed and not call_output.call_keeps_door(draft.record):
        draft.change(call=request_call_again(call, now))


def _new_session(draft: Draft, holder: Holder, session_id: str, *, stays: bool) -> Session:
    """Return a session that begins now. Nothing is requested for it yet."""
    now = draft.now
    return Session(
        number=draft.record.sessions_opened + 1,
        holder=holder,
        policy=policy_for(draft.config, holder, stays=stays),
        floor=None,
        hold_door=False,
        opened_at=now,
        opened_clock=draft.moment.clock,
        lease_from=now,
        contacted_at=now,
        id=session_id,
    )


# -- turns


def is_new(draft: Draft, holder: Holder, floor: FloorName | None, *, hold_door: bool) -> bool:
    """Whether a request changes what is requested already."""
    session = draft.session
    return session is None or (session.holder, session.floor, session.hold_door) != (holder, floor, hold_door)


def too_often(draft: Draft, holder: Holder) -> Refused | None:
    """Refuse a caller that has used up its turns."""
    wait_s = max(0.0, (_turns_used(draft, holder) - (TURNS - 1)) * TURN_EVERY_S)
    if wait_s <= 0:
        return None
    text = f"{draft.config.name} was requested at another floor too often by {holder}; send another request in {wait_s:.1f} s"
    return Refused(Refusal.TOO_OFTEN, text)


def take_turn(draft: Draft, holder: Holder) -> None:
    """Count a turn of a caller; of more than `CALLERS` the one that was silent for longest is forgotten."""
    used = _turns_used(draft, holder) + 1
    turns = {other: turn for other, turn in draft.record.turns.items() if other != holder}
    turns[holder] = (used, draft.now)
    draft.change(turns=dict(tuple(turns.items())[-CALLERS:]))


def _turns_used(draft: Draft, holder: Holder) -> float:
    used, at = draft.record.turns.get(holder, (0.0, draft.now))
    return max(0.0, used - (draft.now - at) / TURN_EVERY_S)
