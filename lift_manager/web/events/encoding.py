"""Converts events of the site for the event stream. Pure. It never reveals ids of sessions or of the requests within them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import assert_never

from lift_manager.api.events import (
    AdviceEvent,
    AlarmEvent,
    CommandEvent,
    PersonEvent,
    PersonWord,
    RequestEvent,
    RideEvent,
    SessionEvent,
    StateEvent,
)
from lift_manager.api.lifts import Lift
from lift_manager.api.rides import Ride
from lift_manager.lift.events import (
    Acknowledged,
    Advised,
    Alarm,
    CommandEnded,
    CommandFollowed,
    ForceReleased,
    HandedOver,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.session import Holder
from lift_manager.lift.state import LiftState, Quality
from lift_manager.rides import ride as rides
from lift_manager.rides.inputs import RideChanged
from lift_manager.runtime.bus import Event, StateChanged

StreamData = (
    StateEvent | SessionEvent | AdviceEvent | CommandEvent | RequestEvent | RideEvent | AlarmEvent | PersonEvent
)

_SAFE_GUIDANCE = {rides.Guidance.ENTER: rides.Guidance.WAIT, rides.Guidance.LEAVE: rides.Guidance.STAY}
"""What a robot does while it may not act on an invitation."""


def encode_event(event: Event, max_age_s: float, by_s: float = 0.0) -> StreamData:
    """Return an event as streamed `by_s` seconds after it was published; if it is too old for its lift, it invites no robot."""
    is_old = by_s > actionable_for_s(event, max_age_s)
    match aged(event, by_s):
        case StateChanged(_, state):
            lift = Lift.of(state, max_age_s=max_age_s)
            return StateEvent(lift=lift.unread(lift.age_s, _too_old_text(max_age_s)) if is_old else lift)
        case SessionOpened() | SessionRestored() | HandedOver() | SessionEnded() as change:
            return _session_event(change)
        case RestrictionBegun() | RestrictionEnded() | Acknowledged() | ForceReleased() as change:
            return _person_event(change)
        case Advised(lift, holder, advice, text):
            return AdviceEvent(lift=lift, holder=str(holder), advice=advice, text=text)
        case CommandEnded() | CommandFollowed() as change:
            return _command_event(change)
        case Alarm(lift, text, holder):
            return AlarmEvent(lift=lift, text=text, holder=_name(holder))
        case RideChanged(_, ride):
            return RideEvent(ride=Ride.of(_without_invitation(ride, by_s) if is_old else ride), age_s=by_s)
        case other:
            assert_never(other)


def actionable_for_s(event: Event, max_age_s: float) -> float:
    """Return for how many seconds after its publication a robot may act on an event; infinite if it is not an invitation."""
    match event:
        case StateChanged(_, state) if state.quality is Quality.LIVE:
            return max_age_s - (state.age_s or 0.0)
        case RideChanged(_, ride) if ride.guidance in _SAFE_GUIDANCE:
            return max_age_s
        case _:
            return math.inf


def has_ages(event: Event) -> bool:
    """Whether an event contains an age or a remaining time."""
    return isinstance(event, StateChanged | RideChanged)


def aged(event: Event, by_s: float) -> Event:
    """Return an event with its ages and remaining times after `by_s` seconds."""
    match event:
        case StateChanged(lift, state):
            return StateChanged(lift, _aged_state(state, by_s))
        case RideChanged(lift, ride) if ride.phase_ends_in_s is not None:
            return RideChanged(lift, replace(ride, phase_ends_in_s=max(0.0, ride.phase_ends_in_s - by_s)))
        case _:
            return event


def _aged_state(state: LiftState, by_s: float) -> LiftState:
    age_s = None if state.age_s is None else state.age_s + by_s
    held_s = None if state.held_since_s is None else state.held_since_s + by_s
    releases_in_s = None if state.releases_in_s is None else max(0.0, state.releases_in_s - by_s)
    return replace(state, age_s=age_s, held_since_s=held_s, releases_in_s=releases_in_s)


def _too_old_text(max_age_s: float) -> str:
    return f"nothing newer within {max_age_s:g} s in this event; GET /api/v1/lifts has its present state"


def _without_invitation(ride: rides.Ride, by_s: float) -> rides.Ride:
    reason = f"`{ride.guidance}` was given {by_s:.1f} s ago; GET /api/v1/rides/{ride.id} has what holds now"
    return replace(ride, guidance=_SAFE_GUIDANCE[ride.guidance], reason=reason)


def _session_event(event: SessionOpened | SessionRestored | HandedOver | SessionEnded) -> SessionEvent:
    lift, holder = event.lift, str(event.holder)
    match event:
        case SessionOpened(_, _, floor):
            return SessionEvent(lift=lift, what="opened", holder=holder, to=floor or None)
        case SessionRestored(_, _, floor, text):
            return SessionEvent(lift=lift, what="restored", holder=holder, to=floor or None, text=text)
        case HandedOver(_, _, to):
            return SessionEvent(lift=lift, what="handed_over", holder=holder, to=str(to))
        case SessionEnded(_, _, reason, text, advice):
            return SessionEvent(lift=lift, what="ended", holder=holder, reason=reason, text=text, advice=advice)
        case _:
            assert_never(event)


def _person_event(event: RestrictionBegun | RestrictionEnded | Acknowledged | ForceReleased) -> PersonEvent:
    match event:
        case RestrictionBegun(lift, restriction):
            what: PersonWord = "locked_out" if restriction.kind is RestrictionKind.LOCKOUT else "drain_begun"
            return PersonEvent(lift=lift, what=what, by=restriction.by, text=restriction.reason, at=restriction.since)
        case RestrictionEnded(lift, by, at, restriction):
            what = "lockout_over" if restriction.kind is RestrictionKind.LOCKOUT else "drain_over"
            text = f"the {restriction.kind} by {restriction.by}: {restriction.reason}"
            return PersonEvent(lift=lift, what=what, by=by, text=text, at=at)
        case Acknowledged(lift, by, at, causes):
            return PersonEvent(lift=lift, what="acknowledged", by=by, text=" and ".join(causes), at=at)
        case ForceReleased(lift, by, at, reason, holder):
            return PersonEvent(lift=lift, what="released", by=by, text=f"{holder}: {reason}", at=at)
        case _:
            assert_never(event)


def _command_event(event: CommandEnded | CommandFollowed) -> CommandEvent | RequestEvent:
    match event:
        case CommandEnded(lift, outcome, holder):
            return CommandEvent(
                lift=lift,
                command=str(outcome.command),
                holder=_name(holder),
                result=outcome.result,
                proof=outcome.proof,
                reason=outcome.reason,
            )
        case CommandFollowed(lift, status):
            return RequestEvent(
                lift=lift,
                holder=str(status.holder),
                do=status.kind,
                floor=status.floor,
                status=status.state,
                reason=status.reason,
            )
        case _:
            assert_never(event)


def _name(holder: Holder | None) -> str | None:
    return None if holder is None else str(holder)
