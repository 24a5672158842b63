"""What authorised people decide about a lift: keep robots off, admit them again, end a session, acknowledge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from lift_manager.lift import handshake
from lift_manager.lift.advance import advance
from lift_manager.lift.draft import Draft
from lift_manager.lift.endings import end_for_person, session_of
from lift_manager.lift.events import (
    Acknowledged,
    Cause,
    ForceReleased,
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
)
from lift_manager.lift.inhibits import draining, restriction_text, too_early_to_acknowledge
from lift_manager.lift.inputs import Acknowledge, ForceRelease, Restrict, Unrestrict
from lift_manager.lift.refusals import Refusal, Refused, how_to_end_lockout, how_to_release
from lift_manager.lift.session import EndReason


def restrict(draft: Draft, action: Restrict) -> Restriction | Refused:
    """Keep robots off until a person ends that; a second restriction of a kind does not replace the first."""
    config, record, kind = draft.config, draft.record, action.kind
    shown = restriction_text(record, kind, draft.moment)
    if kind is RestrictionKind.DRAIN and (refused := draining(config, record, draft.moment)) is not None:
        return refused
    if shown:
        text = f"{config.name} is locked out {shown}; end that one first: {how_to_end_lockout(config.name)}"
        return Refused(Refusal.LOCKED_OUT, text)
    restriction = Restriction(kind, action.by, action.reason, draft.moment.clock)
    draft.change_durable(restrictions=(*record.durable.restrictions, restriction))
    draft.emit(RestrictionBegun(config.name, restriction))
    if kind is RestrictionKind.LOCKOUT:
        text = f"locked out by {action.by}: {action.reason}"
        end_for_person(draft, EndReason.LOCKOUT, text, at_once=action.at_once)
        advance(draft)
    return restriction


def unrestrict(draft: Draft, action: Unrestrict) -> RestrictionEnded | Refused:
    """End a restriction: robots may command the lift again."""
    name, record, kind = draft.config.name, draft.record, action.kind
    if (restriction := record.restriction(kind)) is None:
        if kind is RestrictionKind.LOCKOUT:
            return Refused(Refusal.NOT_LOCKED_OUT, f"{name} is not locked out")
        return Refused(Refusal.NOT_DRAINING, f"there is no drain of {name}")
    others = tuple(one for one in record.durable.restrictions if one is not restriction)
    draft.change_durable(restrictions=others)
    ended = RestrictionEnded(name, action.by, draft.moment.clock, restriction)
    draft.emit(ended)
    return ended


def force_release(draft: Draft, action: ForceRelease) -> ForceReleased | Refused:
    """End the session for a person, as a lockout ends it. What is known of the car's contents is kept."""
    if isinstance(session := session_of(draft, None), Refused):
        return session
    text = f"released by {action.by}: {action.reason}"
    clear_s = end_for_person(draft, EndReason.FORCED, text, at_once=action.at_once)
    advance(draft)
    in_car = draft.record.robot_in_car is not None
    at = draft.moment.clock
    released = ForceReleased(draft.config.name, action.by, at, action.reason, session.holder, in_car, clear_s)
    draft.emit(released)
    return released


def acknowledge(draft: Draft, action: Acknowledge) -> Acknowledged | Refused:
    """Record that a person has checked the lift after a fire or a contradiction, or found no robot in its car."""
    config, durable, session = draft.config, draft.record.durable, draft.session
    if (refused := too_early_to_acknowledge(config, draft.record, draft.moment)) is not None:
        return refused
    seen_to = _needs_a_person(draft)
    given = {
        Cause.FIRE: durable.fire_since is not None,
        Cause.OCCUPIED: seen_to is not None,
        Cause.CONTRADICTION: bool(durable.trust.distrust),
    }
    causes = tuple(cause for cause, is_given in given.items() if is_given)
    if not causes:
        name = config.name
        text = (
            f"{name} has nothing to acknowledge: there was no fire, no robot was left in the car, and its signals agree"
        )
        if session is not None:
            text += f"; {session.holder} holds it, and a person ends that session with {how_to_release(name)}"
        return Refused(Refusal.NOTHING_TO_ACKNOWLEDGE, text)
    acknowledged = Acknowledged(config.name, action.by, draft.moment.clock, causes)
    trust = replace(durable.trust, distrust=())
    draft.change_durable(fire_since=None, trust=trust, acknowledged=acknowledged)
    if (observation := draft.record.observation) is not None:
        # the next reading is judged by the trust of this moment
        draft.change(observation=replace(observation, is_settled=False))
    draft.emit(acknowledged)
    if seen_to is not None:
        seen_to(draft)
        advance(draft)
    return acknowledged


def _needs_a_person(draft: Draft) -> Callable[[Draft], None] | None:
    """Return what is done once a person has seen to the car and the lift; None if nothing of ours needs one.

    After a fire, and behind a robot that may be in the car, it is reported to the lift once more that an earlier one left. A
    report that is on its way for the first time needs nobody: a lift that never took it would take no robot any more.
    """
    record = draft.record
    if record.session is None and record.robot_in_car is not None:
        return handshake.found_empty
    is_late = record.has_robot_left_pending and record.robot_left.is_late
    return handshake.give_up_robot_left if is_late and record.durable.fire_since is None else None
