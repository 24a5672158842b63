"""How a ride continues in each phase: what it requests of its lift, and what ends it.

Every function returns a `Progress`: the record, what to do, and what people should know.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from drivers.model import FloorName
from lift_manager.lift.commands import CommandRequest, CommandType
from lift_manager.lift.inputs import CloseSession, EndSession, GiveCommand, OpenSession, RenewSession
from lift_manager.lift.observation import Moment
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.refusals import how_to_acknowledge
from lift_manager.lift.session import Advice, EndReason, advise
from lift_manager.rides.inputs import Action, LiftAction, RideRequestToLift
from lift_manager.rides.observation import (
    RideObservation,
    is_live,
    may_enter,
    remember_observed,
    stands_open,
    why_not_open,
    why_not_taken,
)
from lift_manager.rides.record import Clearing, RideRecord
from lift_manager.rides.ride import Guidance, Phase
from register_maps.words import Motion

REPEAT_S = 5.0
"""How often a floor is requested again while the car is not there or its door is not held: a failed press is repeated only for a
new request. Chosen: twice the shortest pause of a call that failed (DESIGN section 7)."""

RENEW_S = 10.0
"""How often a lease is renewed; a shorter one is renewed in the middle. Chosen: as often as it is written down."""

STANDS_S = 1.0
"""How long the car must be seen to stand at a floor before a robot is let out there. Chosen: some lifts report each floor they
pass."""


@dataclass(frozen=True, slots=True)
class Progress:
    """A ride as it continues, and what is to be done for it, in this order."""

    record: RideRecord
    actions: tuple[Action, ...] = ()
    alarm: str = ""
    """What a person should know; empty for nothing."""


def go_on(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    """Return how a ride continues at this moment; one that is over stays as it is."""
    if record.is_over:
        return Progress(record)
    noted = replace(record, maybe_aboard=True) if observed.may_have_boarded else record
    noted = remember_observed(noted, observed, moment)
    if (over := _without_session(noted, observed, moment)) is not None:
        return over
    phases = _LATE if moment.now >= noted.ends_at else _PHASES
    return phases[noted.phase](noted, observed, moment)


def enter_phase(record: RideRecord, phase: Phase, moment: Moment) -> RideRecord:
    """Return the ride in a phase, which begins now unless the ride is in it already."""
    return record if phase is record.phase else replace(record, phase=phase, phase_since=moment.now)


# -- ends


def give_up(
    record: RideRecord, observed: RideObservation, moment: Moment, why: str, advice: Advice | None = None
) -> RideRecord:
    """End a ride that cannot continue."""
    if advice is None and record.maybe_aboard:
        advice = advise(observed.state.doors if is_live(observed.state) else None, may_be_aboard=True)
    ended = enter_phase(record, Phase.GAVE_UP, moment)
    return replace(ended, guidance=Guidance.GAVE_UP, reason=why, advice=advice)


def end_outside(
    record: RideRecord, phase: Phase, observed: RideObservation, moment: Moment, why: str = ""
) -> RideRecord:
    """End a ride with its robot outside."""
    outside = replace(record, maybe_aboard=False)
    if phase is Phase.GAVE_UP:
        return give_up(outside, observed, moment, why)
    return replace(enter_phase(outside, phase, moment), guidance=Guidance.DONE, reason=why)


def begin_clearing(record: RideRecord, clearing: Clearing, observed: RideObservation, moment: Moment) -> Progress:
    """Start to let out a robot that may be inside."""
    record = replace(enter_phase(record, Phase.CLEARING, moment), clearing=clearing, maybe_aboard=True)
    return _clear(record, observed, moment)


def clearing_text(record: RideRecord) -> str:
    """Return what is done for a robot inside."""
    if record.silent_since is not None:
        return "nothing is pressed before the robot sends a report: look into the car"
    return "it is being let out"


def _without_session(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress | None:
    """Return the end of a ride whose session was ended by somebody else; None if it has no session yet, or still has it."""
    if not record.session:
        return None
    if observed.gone:
        return Progress(give_up(record, observed, moment, observed.gone))
    over = observed.session.over if observed.session is not None else None
    if over is None:
        return None
    if over.reason is EndReason.STOPPING:
        return Progress(replace(record, guidance=_wait_or_stay(record), reason=over.text))
    return Progress(give_up(record, observed, moment, over.text, over.advice))


def _wait_or_stay(record: RideRecord) -> Guidance:
    return Guidance.STAY if record.has_entered else Guidance.WAIT


# -- phases


def _queue(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    why = why_not_taken(record, observed, moment)
    if not why and record.failure and moment.now - record.requested_at < REPEAT_S:
        why = record.failure
    reason = why or record.failure or f"its turn has come: requests {record.lift}"
    ahead = observed.ahead + int(observed.is_held_by_another(record.holder))
    waiting = replace(record, guidance=Guidance.WAIT, reason=reason, ahead=ahead)
    return Progress(waiting, () if why else (_to_lift(record, OpenSession(record.holder, key=record.id)),))


def _call(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    session, start = observed.session, record.request.start
    is_there = observed.state.floor == start or (session is not None and session.arrived and session.floor == start)
    # one that may be inside from before its session boards as others do: once the door has stood open for it
    if is_there and observed.may_have_boarded and record.could_exit_at == start:
        return _board(enter_phase(record, Phase.BOARDING, moment), observed, moment)
    why = why_not_open(record, observed, start) or f"the door at {start} is about to open for it"
    waiting = replace(record, guidance=Guidance.WAIT, reason=why)
    return Progress(waiting, _request_open(record, observed, moment, start))


def _board(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    start = record.request.start
    is_open = may_enter(record, observed)
    why = "" if is_open else why_not_open(record, observed, start)
    boarding = replace(record, guidance=Guidance.ENTER if is_open else Guidance.WAIT, reason=why)
    return Progress(boarding, _request_open(record, observed, moment, start))


def _ride(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    floor = record.request.destination
    if stands_open(record, observed, floor):
        return _alight(enter_phase(record, Phase.ALIGHTING, moment), observed, moment)
    riding = replace(record, guidance=Guidance.STAY, reason=why_not_open(record, observed, floor))
    return Progress(riding, _request_open(record, observed, moment, floor))


def _alight(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    floor = record.request.destination
    is_open = stands_open(record, observed, floor)
    why = "" if is_open else why_not_open(record, observed, floor)
    alighting = replace(record, guidance=Guidance.LEAVE if is_open else Guidance.STAY, reason=why)
    return Progress(alighting, _request_open(record, observed, moment, floor))


def _clear(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    cause, floor = _cause(record), _clearing_floor(record, observed, moment)
    is_open = stands_open(record, observed, floor)
    why = "send `left` once the robot is outside" if is_open else why_not_open(record, observed, floor)
    if not (is_open or record.has_entered):
        why = f"{why}; if the robot is inside, stay there until the door opens; send `entered` or `left`"
    guidance = Guidance.LEAVE if is_open else _wait_or_stay(record)
    clearing = replace(record, clear_at=floor, guidance=guidance, reason=f"{cause}; {why}" if why else cause)
    return Progress(clearing, _request_open(clearing, observed, moment, floor))


def _cause(record: RideRecord) -> str:
    return record.clearing.cause if record.clearing is not None else ""


def _clearing_floor(record: RideRecord, observed: RideObservation, moment: Moment) -> FloorName:
    """Return the floor at which the robot is let out.

    One that has reported nothing is let out where it may have gone in. A car under way with one inside is not turned round.
    """
    start, destination = record.request.start, record.request.destination
    if not record.has_entered:
        return start
    floor = record.clear_at or (observed.session.floor if observed.session is not None else None) or destination
    if not is_live(observed.state):
        return floor
    if record.stands is not None and moment.now - record.stands[1] >= STANDS_S:
        return record.stands[0]
    moves = observed.state.motion in (Motion.UP, Motion.DOWN, Motion.MOVING)
    has_departed = observed.state.floor not in (None, start) or moves
    return destination if floor == start and has_departed else floor


# -- requests


def _request_open(
    record: RideRecord, observed: RideObservation, moment: Moment, floor: FloorName
) -> tuple[Action, ...]:
    """Return what is requested of the session so that the car comes to a floor and stands open there."""
    session = observed.session
    if record.silent_since is not None or session is None or session.over is not None:
        return ()
    since_s, lease_s = moment.now - record.requested_at, session.lease_ends_in_s
    if is_live(observed.state):
        is_due = since_s >= REPEAT_S
        in_place = record.has_entered and observed.robot is not Occupancy.ABOARD
        if record.phase is Phase.CLEARING and stands_open(record, observed, floor):
            in_place = False  # some lifts shut the door and go once a robot is in place: this one has to get out
        is_elsewhere = session.floor != floor or not session.hold_door
        if (is_due or not record.failure) and (in_place or is_elsewhere):
            first = (_command(record, CommandType.ROBOT_IN_PLACE),) if in_place else ()
            return (*first, _command(record, CommandType.GO_TO, floor))
        if is_due and not (session.arrived and session.door_held):
            return (_command(record, CommandType.GO_TO, floor),)
    if since_s >= RENEW_S or (lease_s is not None and lease_s <= since_s):
        return (_to_lift(record, RenewSession(record.session, record.holder)),)
    return ()


def close(record: RideRecord, robot: RobotWord | None = None) -> LiftAction:
    """Return the request that ends the session of a ride; `robot` where its robot has reported that it left."""
    return _to_lift(record, CloseSession(record.session, record.holder, robot))


def _command(record: RideRecord, kind: CommandType, floor: FloorName | None = None) -> LiftAction:
    request = CommandRequest(session=record.session, holder=record.holder, kind=kind, floor=floor)
    return _to_lift(record, GiveCommand(request))


def _to_lift(record: RideRecord, request: RideRequestToLift) -> LiftAction:
    return LiftAction(record.lift, request)


# -- limits


def _late_in_queue(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    waited = _queue(record, observed, moment).record
    why = f"it waited for {record.request.limits.queued_s:g} s: {waited.reason or 'its turn'}"
    return Progress(give_up(record, observed, moment, why))


def _late_call(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    limit_s, start = record.request.limits.called_s, record.request.start
    why = f"the car did not stand open at {start} within {limit_s:g} s: {_why_late(record, observed, start)}"
    if record.maybe_aboard:
        return begin_clearing(record, Clearing(Phase.GAVE_UP, why), observed, moment)
    return Progress(give_up(record, observed, moment, why), (close(record),))


def _late_boarding(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    why = f"nobody reported within {record.request.limits.boarding_s:g} s whether the robot is inside"
    return begin_clearing(record, Clearing(Phase.GAVE_UP, why), observed, moment)


def _late_ride(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    limit_s, floor = record.request.limits.riding_s, record.request.destination
    why = f"the car did not stand open at {floor} within {limit_s:g} s: {_why_late(record, observed, floor)}"
    return _clear_with_alarm(record, why, observed, moment)


def _why_late(record: RideRecord, observed: RideObservation, floor: FloorName) -> str:
    """Return what was waited for; empty for a ride whose time ran out while the manager was not running."""
    return record.reason or why_not_open(record, observed, floor) or f"the door at {floor} was about to open"


def _late_alighting(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    why = f"the robot did not report within {record.request.limits.alighting_s:g} s that it left"
    return _clear_with_alarm(record, why, observed, moment)


def _clear_with_alarm(record: RideRecord, why: str, observed: RideObservation, moment: Moment) -> Progress:
    clearing = begin_clearing(record, Clearing(Phase.GAVE_UP, why), observed, moment)
    text = f"ride_late: a robot of {record.holder} is in the car of {record.lift}: {why}; {clearing_text(record)}"
    return replace(clearing, alarm=text)


def _late_clearing(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress:
    limit_s, waited = record.request.limits.alighting_s, _clear(record, observed, moment).record
    known = "is" if record.has_entered else "may be"
    text = (
        f"ride_given_up: a robot of {record.holder} {known} in the car of {record.lift} ({waited.reason}), and nobody reported within"
        f" {limit_s:g} s that it left; others are refused until it does or a person has looked:"
        f" {how_to_acknowledge(record.lift)}"
    )
    why = f"{_cause(record)}; nobody reported within {limit_s:g} s that the robot left"
    # the robot may be on its way through the door: it stays open for a moment, and invites nobody
    end = _to_lift(record, EndSession(record.holder, observed.clear_s))
    return Progress(give_up(record, observed, moment, why), (end,), text)


_Phase = Callable[[RideRecord, RideObservation, Moment], Progress]

_PHASES: Mapping[Phase, _Phase] = {
    Phase.QUEUED: _queue,
    Phase.CALLED: _call,
    Phase.BOARDING: _board,
    Phase.RIDING: _ride,
    Phase.ALIGHTING: _alight,
    Phase.CLEARING: _clear,
}
_LATE: Mapping[Phase, _Phase] = {
    Phase.QUEUED: _late_in_queue,
    Phase.CALLED: _late_call,
    Phase.BOARDING: _late_boarding,
    Phase.RIDING: _late_ride,
    Phase.ALIGHTING: _late_alighting,
    Phase.CLEARING: _late_clearing,
}
