"""How a ride goes on: from what it was, what is seen and the time to what it is and what is to be done. Pure.

The ride engine carries the actions out and comes back with what became of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from drivers.model import FloorName
from lift_manager.domain import ride_sight as sight
from lift_manager.domain.boarding import Who
from lift_manager.domain.ride import Guidance, Phase
from lift_manager.domain.ride_record import (
    Action,
    Clearing,
    Close,
    GoTo,
    InPlace,
    Open,
    Renew,
    RideRecord,
    RideSight,
    Step,
    Warn,
)
from lift_manager.domain.seconds import without_seconds
from lift_manager.domain.service import Advice, EndReason, advise, how_to_acknowledge
from register_maps.words import Motion

REPEAT_S = 5.0
"""How often a floor is asked for again while the car is not there or its door is not held: a press that came to nothing is tried
again only when it is asked for again. Chosen: twice the shortest pause of a call that failed (DESIGN section 7)."""

RENEW_S = 10.0
"""How often a lease is renewed; a shorter one is renewed in the middle. Chosen: as often as it is written down."""

STANDS_S = 1.0
"""So long the car is seen to stand at a floor before a robot is let out there. Chosen: some lifts report each floor they pass."""


def step(record: RideRecord, seen: RideSight) -> Step:
    """Return the ride as it is at this sight, and what is to be done for it; one that is over stays as it is."""
    return dated(record, _gone_on(record, seen), seen)


def read(record: RideRecord, seen: RideSight) -> RideRecord:
    """Return the ride as whoever reads it at this moment is told it: with the seconds of this moment."""
    after = _gone_on(record, seen)
    return replace(dated(record, after, seen).record, reason=after.record.reason)


def _gone_on(record: RideRecord, seen: RideSight) -> Step:
    if record.over:
        return Step(record)
    possible = replace(record, maybe_aboard=True) if sight.boarding_possible(seen) else record
    now = sight.looked(possible, seen)
    if (over := _without_session(now, seen)) is not None:
        return over
    handlers = _LATE if seen.now >= now.ends_at else _PHASES
    return handlers[now.phase](now, seen)


def opened(record: RideRecord, session: str, seen: RideSight) -> RideRecord:
    """Take it that the lift is the ride's own."""
    why = f"the car is called to {record.wish.start}"
    called = _phase(replace(record, session=session, trouble="", ahead=None, reason=why), Phase.CALLED, seen)
    return dated(record, Step(called), seen).record


def asked(record: RideRecord, trouble: str, seen: RideSight) -> RideRecord:
    """Take what became of the newest request; `trouble` is why it was refused, empty where it was not."""
    return replace(record, asked_at=seen.now, trouble=trouble)


def gave_up(record: RideRecord, seen: RideSight, why: str, advice: Advice | None = None) -> RideRecord:
    """End a ride that cannot go on."""
    if advice is None and record.maybe_aboard:
        advice = advise(seen.state.doors if sight.is_live(seen.state) else None, may_be_aboard=True)
    ended = _phase(record, Phase.GAVE_UP, seen)
    return replace(ended, guidance=Guidance.GAVE_UP, reason=why, advice=advice)


def ended(record: RideRecord, phase: Phase, seen: RideSight, why: str = "") -> RideRecord:
    """End a ride with its robot outside."""
    if phase is Phase.GAVE_UP:
        return gave_up(replace(record, maybe_aboard=False), seen, why)
    return replace(_phase(record, phase, seen), guidance=Guidance.DONE, reason=why, maybe_aboard=False)


def cleared(record: RideRecord, clearing: Clearing, seen: RideSight) -> Step:
    """Begin to let a robot out that may be inside."""
    return _clear(replace(_phase(record, Phase.CLEARING, seen), clearing=clearing, maybe_aboard=True), seen)


def letting_out(record: RideRecord) -> str:
    """Say what is done for a robot inside."""
    if record.unheard_since is not None:
        return "nothing is pressed before the robot is heard: look into the car"
    return "it is being let out"


def dated(before: RideRecord, after: Step, seen: RideSight) -> Step:
    """Note the time of a change; words that differ in their seconds only are none."""
    record = after.record
    if without_seconds(record.reason) == without_seconds(before.reason):
        record = replace(record, reason=before.reason)
    if _told(record) != _told(before):
        record = replace(record, changed_at=seen.at)
    if record.over and record.ended_at is None:
        record = replace(record, ended_at=seen.now)
    return Step(record, after.actions)


def _told(record: RideRecord) -> tuple[object, ...]:
    return record.phase, record.guidance, record.reason, record.advice


def _phase(record: RideRecord, phase: Phase, seen: RideSight) -> RideRecord:
    if phase is record.phase:
        return record
    return replace(record, phase=phase, phase_since=seen.now)


def _without_session(record: RideRecord, seen: RideSight) -> Step | None:
    """Return the end of a ride whose session somebody else ended; None where it has none yet, or has it still."""
    if not record.session:
        return None
    if seen.gone:
        return Step(gave_up(record, seen, seen.gone))
    over = seen.session.over if seen.session is not None else None
    if over is None:
        return None
    if over.reason is EndReason.STOPPING:
        return Step(replace(record, guidance=_outside_or_in(record), reason=over.text))
    return Step(gave_up(record, seen, over.text, over.advice))


def _outside_or_in(record: RideRecord) -> Guidance:
    return Guidance.STAY if record.entered else Guidance.WAIT


def _queue(record: RideRecord, seen: RideSight) -> Step:
    why = sight.why_not_taken(record, seen)
    if not why and record.trouble and seen.now - record.asked_at < REPEAT_S:
        why = record.trouble
    held = seen.state.holder not in (None, record.holder)
    told = why or record.trouble or f"its turn has come: asks for {record.lift}"
    waiting = replace(record, guidance=Guidance.WAIT, reason=told, ahead=seen.ahead + int(held))
    return Step(waiting, () if why else (Open(),))


def _call(record: RideRecord, seen: RideSight) -> Step:
    session, start = seen.session, record.wish.start
    there = seen.state.floor == start or (session is not None and session.arrived and session.floor == start)
    # one that may be inside from before its session boards as others do: once the door has stood open for it
    if there and sight.boarding_possible(seen) and record.could_leave_at == start:
        return _board(_phase(record, Phase.BOARDING, seen), seen)
    why = sight.why_not_open(record, seen, start) or f"the door at {start} is about to open for it"
    return Step(replace(record, guidance=Guidance.WAIT, reason=why), _asks(record, seen, start))


def _board(record: RideRecord, seen: RideSight) -> Step:
    start = record.wish.start
    open_now = sight.may_enter(record, seen)
    why = "" if open_now else sight.why_not_open(record, seen, start)
    told = replace(record, guidance=Guidance.ENTER if open_now else Guidance.WAIT, reason=why)
    return Step(told, _asks(record, seen, start))


def _ride(record: RideRecord, seen: RideSight) -> Step:
    if sight.stands_open(record, seen, record.wish.destination):
        return _alight(_phase(record, Phase.ALIGHTING, seen), seen)
    why = sight.why_not_open(record, seen, record.wish.destination)
    return Step(replace(record, guidance=Guidance.STAY, reason=why), _asks(record, seen, record.wish.destination))


def _alight(record: RideRecord, seen: RideSight) -> Step:
    floor = record.wish.destination
    open_now = sight.stands_open(record, seen, floor)
    why = "" if open_now else sight.why_not_open(record, seen, floor)
    told = replace(record, guidance=Guidance.LEAVE if open_now else Guidance.STAY, reason=why)
    return Step(told, _asks(record, seen, floor))


def _clear(record: RideRecord, seen: RideSight) -> Step:
    cause = record.clearing.cause if record.clearing is not None else ""
    floor = _clear_at(record, seen)
    open_now = sight.stands_open(record, seen, floor)
    why = "say `left` once the robot is outside" if open_now else sight.why_not_open(record, seen, floor)
    if not (open_now or record.entered):
        why = f"{why}; if the robot is inside, stay there until the door opens; say `entered` or `left`"
    guidance = Guidance.LEAVE if open_now else _outside_or_in(record)
    told = replace(record, clear_at=floor, guidance=guidance, reason=f"{cause}; {why}" if why else cause)
    return Step(told, _asks(told, seen, floor))


def _clear_at(record: RideRecord, seen: RideSight) -> FloorName | None:
    """Return the floor at which the robot is let out.

    One that has said nothing is let out where it may have gone in. A car under way with one inside is not turned round.
    """
    start, destination = record.wish.start, record.wish.destination
    if not record.entered:
        return start
    floor = record.clear_at or (seen.session.floor if seen.session is not None else None) or destination
    if not sight.is_live(seen.state):
        return floor
    if record.stands is not None and seen.now - record.stands[1] >= STANDS_S:
        return record.stands[0]
    gone = seen.state.floor not in (None, start) or seen.state.motion in (Motion.UP, Motion.DOWN, Motion.MOVING)
    return destination if floor == start and gone else floor


def _asks(record: RideRecord, seen: RideSight, floor: FloorName | None) -> tuple[Action, ...]:
    """Return what the session is asked for so that the car comes to a floor and stands open there."""
    session = seen.session
    if record.unheard_since is not None or session is None or session.over is not None or floor is None:
        return ()
    since_s = seen.now - record.asked_at
    lease_s = session.lease_ends_in_s
    if sight.is_live(seen.state):
        due = since_s >= REPEAT_S
        may_ask = due or not record.trouble
        words: tuple[Action, ...] = (InPlace(),) if record.entered and seen.robot is not Who.ABOARD else ()
        if may_ask and (words or session.floor != floor or not session.hold_door):
            return (*words, GoTo(floor))
        if due and not (session.arrived and session.door_held):
            return (GoTo(floor),)
    return (Renew(),) if since_s >= RENEW_S or (lease_s is not None and lease_s <= since_s) else ()


def _late_in_queue(record: RideRecord, seen: RideSight) -> Step:
    waited = _queue(record, seen).record
    return Step(
        gave_up(record, seen, f"it waited for {record.wish.limits.queued_s:g} s: {waited.reason or 'its turn'}")
    )


def _late_call(record: RideRecord, seen: RideSight) -> Step:
    limit_s, start = record.wish.limits.called_s, record.wish.start
    why = f"the car did not stand open at {start} within {limit_s:g} s: {_why_late(record, seen, start)}"
    if record.maybe_aboard:
        return cleared(record, Clearing(Phase.GAVE_UP, why), seen)
    return Step(gave_up(record, seen, why), (Close(left=False),))


def _late_boarding(record: RideRecord, seen: RideSight) -> Step:
    why = f"nobody said within {record.wish.limits.boarding_s:g} s whether the robot is inside"
    return cleared(record, Clearing(Phase.GAVE_UP, why), seen)


def _late_ride(record: RideRecord, seen: RideSight) -> Step:
    limit_s, floor = record.wish.limits.riding_s, record.wish.destination
    why = _why_late(record, seen, floor)
    return _told_people(record, f"the car did not stand open at {floor} within {limit_s:g} s: {why}", seen)


def _why_late(record: RideRecord, seen: RideSight, floor: FloorName) -> str:
    """Say what was waited for; a ride whose time ran out while the manager was not running has no reason of its own."""
    return record.reason or sight.why_not_open(record, seen, floor) or f"the door at {floor} was about to open"


def _late_alighting(record: RideRecord, seen: RideSight) -> Step:
    why = f"the robot did not say within {record.wish.limits.alighting_s:g} s that it left"
    return _told_people(record, why, seen)


def _told_people(record: RideRecord, why: str, seen: RideSight) -> Step:
    clearing = cleared(record, Clearing(Phase.GAVE_UP, why), seen)
    text = f"ride_late: a robot of {record.holder} is in the car of {record.lift}: {why}; {letting_out(record)}"
    return Step(clearing.record, (Warn(text), *clearing.actions))


def _late_clearing(record: RideRecord, seen: RideSight) -> Step:
    cause = record.clearing.cause if record.clearing is not None else ""
    waited = _clear(record, seen).record
    known = "is" if record.entered else "may be"
    text = (
        f"ride_given_up: a robot of {record.holder} {known} in the car of {record.lift} ({waited.reason}), and nobody said within"
        f" {record.wish.limits.alighting_s:g} s that it left; others are refused until it says so or a person has looked:"
        f" {how_to_acknowledge(record.lift)}"
    )
    why = f"{cause}; nobody said within {record.wish.limits.alighting_s:g} s that the robot left"
    return Step(gave_up(record, seen, why), (Warn(text), Close(left=False, clears=True)))


_Handler = Callable[[RideRecord, RideSight], Step]

_PHASES: Mapping[Phase, _Handler] = {
    Phase.QUEUED: _queue,
    Phase.CALLED: _call,
    Phase.BOARDING: _board,
    Phase.RIDING: _ride,
    Phase.ALIGHTING: _alight,
    Phase.CLEARING: _clear,
}
_LATE: Mapping[Phase, _Handler] = {
    Phase.QUEUED: _late_in_queue,
    Phase.CALLED: _late_call,
    Phase.BOARDING: _late_boarding,
    Phase.RIDING: _late_ride,
    Phase.ALIGHTING: _late_alighting,
    Phase.CLEARING: _late_clearing,
}
