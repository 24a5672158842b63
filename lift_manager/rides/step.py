"""One input, one step: the next record of a ride, what to do because of it, and what to publish.

The only entrance to the rules of a ride under way. Nothing here waits, requests anything by itself, or knows what time it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from lift_manager.lift.commands import REPLACED, CommandState, CommandStatus, CommandType
from lift_manager.lift.events import Advised, Alarm, CommandFollowed
from lift_manager.lift.inputs import CloseSession, GiveCommand, LiftRequest, OpenSession, RenewSession
from lift_manager.lift.observation import Moment
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal, Refused, how_to_acknowledge
from lift_manager.lift.requests import SessionBegun
from lift_manager.rides.inputs import (
    Action,
    BeginAgain,
    CancelRide,
    Event,
    FoundOutside,
    Input,
    LiftAction,
    LiftReply,
    RideChanged,
    RobotReport,
    SettleOthers,
    TakeLift,
    Tick,
)
from lift_manager.rides.observation import RideObservation, is_live
from lift_manager.rides.phases import (
    Progress,
    begin_clearing,
    clearing_text,
    close,
    end_outside,
    enter_phase,
    give_up,
    go_on,
)
from lift_manager.rides.record import Clearing, RideRecord, differs_in_public, differs_on_disk, published
from lift_manager.rides.ride import Guidance, Phase, Ride, RideRequest, RideWord

TICK_S = 1.0
"""How often a ride is stepped although nothing happens: limits, leases, repeats, its place in the queue, the age of its
observation."""

NOT_OF_THE_LIFT = frozenset({Refusal.HELD, Refusal.QUEUED, Refusal.STOPPING})
"""Refusals that do not concern the lift itself."""

_SECONDS = re.compile(r"\d+(?:\.\d+)? s\b")


@dataclass(frozen=True, slots=True)
class Step:
    """The result of an input."""

    record: RideRecord
    actions: tuple[Action, ...] = ()
    """In this order; the first one that is refused drops the rest."""
    reply: Refused | None = None
    """Why the input is not taken; None if it is, or if nobody waits for a reply."""
    events: tuple[Event, ...] = ()
    """Published before anything is done."""
    saves: tuple[str, ...] = ()
    """The lifts with which other rides outlive the manager now (`rides.saved`)."""
    lift_refusal: str = ""
    """Why the lift refused the ride, if that is the lift's own reason: for a while rides prefer others."""
    wake_at: float = math.inf
    """When a `Tick` is due at the latest."""


def begin(request: RideRequest, lift: str, ride_id: str, moment: Moment, *, is_remote: bool = False) -> Step:
    """Return the first step of a ride: it waits for the lift that was chosen.

    The caller reports for its robot, unless it is remote: then nothing is requested before the robot reports by itself, as after a restart.
    """
    knows_robot = bool(request.robot) and not is_remote
    record = RideRecord(
        id=ride_id,
        request=request,
        lift=lift,
        phase_since=moment.now,
        begun_at=moment.clock,
        changed_at=moment.clock,
        reason="begun through the hub" if is_remote else "",
        silent_since=moment.now if is_remote else None,
        # a robot that has a name knows how its earlier rides ended
        present_at=moment.now if knows_robot else -math.inf,
    )
    return _finish(None, Progress(record), moment)


def step(record: RideRecord, happened: Input, observed: RideObservation, moment: Moment) -> Step:
    """Return what one input changes."""
    taken = _take(record, happened, observed, moment)
    if isinstance(taken, Refused):
        # whatever a robot reports, it has reported
        return replace(_finish(record, Progress(replace(record, silent_since=None)), moment), reply=taken)
    return replace(_finish(record, taken, moment), lift_refusal=_lift_refusal(happened))


def at_moment(record: RideRecord, observed: RideObservation, moment: Moment) -> Ride:
    """Return a ride as it is shown now: with the seconds of this moment, and with news that has not been stepped yet."""
    after = go_on(record, observed, moment).record
    return published(replace(_dated(record, after, moment), reason=after.reason), moment.now)


def _take(record: RideRecord, happened: Input, observed: RideObservation, moment: Moment) -> Progress | Refused:
    match happened:
        case Tick():
            return _dated_progress(record, go_on(record, observed, moment), moment)
        case RobotReport(word):
            taken = _REPORTS[word](replace(record, silent_since=None), observed, moment)
            return taken if isinstance(taken, Refused) else _dated_progress(record, taken, moment)
        case BeginAgain():
            return Progress(replace(record, silent_since=None))
        case CancelRide():
            return _dated_progress(record, _cancel(record, happened, observed, moment), moment)
        case LiftReply():
            return _take_reply(record, happened, observed, moment)
        case _:
            return Progress(_take_news(record, happened, observed, moment))


def _take_news(
    record: RideRecord,
    happened: Advised | CommandFollowed | FoundOutside | TakeLift,
    observed: RideObservation,
    moment: Moment,
) -> RideRecord:
    match happened:
        case Advised(_, _, advice, text):
            return record if record.is_over else _dated(record, give_up(record, observed, moment, text, advice), moment)
        case CommandFollowed(_, status):
            return _note_failure(record, status)
        case FoundOutside():
            return replace(record, maybe_aboard=False)
        case TakeLift(lift):
            return _take_lift(record, lift, observed, moment)


def _finish(before: RideRecord | None, taken: Progress, moment: Moment) -> Step:
    record, events, saves = taken.record, list[Event](), tuple[str, ...]()
    if before is None or differs_on_disk(record, before):
        saves = (record.lift,) if before is None or before.lift == record.lift else (record.lift, before.lift)
    if before is None or differs_in_public(record, before):
        phase = None if before is None else before.phase
        events.append(RideChanged(record.lift, published(record, moment.now), phase))
    if taken.alarm:
        events.append(Alarm(record.lift, taken.alarm, record.holder))
    wake_at = math.inf if record.is_over else moment.now + TICK_S
    return Step(record, taken.actions, events=tuple(events), saves=saves, wake_at=wake_at)


def _dated_progress(before: RideRecord, taken: Progress, moment: Moment) -> Progress:
    return replace(taken, record=_dated(before, taken.record, moment))


def _dated(before: RideRecord, record: RideRecord, moment: Moment) -> RideRecord:
    """Record the time of a change; a reason that differs in its seconds only is no change."""
    if _SECONDS.sub("", record.reason) == _SECONDS.sub("", before.reason):
        record = replace(record, reason=before.reason)
    if _words(record) != _words(before):
        record = replace(record, changed_at=moment.clock)
    if record.is_over and record.ended_at is None:
        record = replace(record, ended_at=moment.now)
    return record


def _words(record: RideRecord) -> tuple[object, ...]:
    return record.phase, record.guidance, record.reason, record.advice


def _take_lift(record: RideRecord, lift: str, observed: RideObservation, moment: Moment) -> RideRecord:
    moved = replace(record, lift=lift, failure="", offline_since="", changed_at=moment.clock)
    after = go_on(moved, observed, moment).record
    return replace(_dated(moved, after, moment), reason=after.reason)


# -- what robots report


def _report_here(record: RideRecord, _: RideObservation, moment: Moment) -> Progress | Refused:
    return _over(record) if record.is_over else Progress(replace(record, present_at=moment.now))


def _report_entered(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress | Refused:
    if record.is_over:
        return _over(record)
    if record.has_entered:
        return Progress(record)
    inside = replace(
        record,
        has_entered=True,
        maybe_aboard=True,
        could_exit_at=None,
        guidance=Guidance.STAY,
        reason="",
        failure="",
    )
    if record.phase is Phase.CLEARING:
        return Progress(inside)
    if record.session and (record.maybe_aboard or observed.may_have_boarded):
        return Progress(replace(inside, phase=Phase.RIDING, phase_since=moment.now))
    start = record.request.start
    text = f"the door has not stood open for the robot at {start} yet; send `entered` once it has gone in there"
    return Refused(Refusal.NOT_NOW, text)


def _report_left(record: RideRecord, observed: RideObservation, moment: Moment) -> Progress | Refused:
    if record.is_over:
        if not record.maybe_aboard:
            # whether it was recorded is known from the answer alone, so its repetition has one
            return Progress(record) if record.phase is Phase.DONE else _over(record)
        return Progress(replace(record, maybe_aboard=False), (close(record, RobotWord.LEFT),))
    if not record.maybe_aboard:
        text = f"the ride is {record.phase}, and the robot cannot have been inside; to end the ride, cancel it"
        return Refused(Refusal.NOT_NOW, text)
    if record.has_entered and record.could_exit_at is None and is_live(observed.state):
        text = "the door has not stood open since the robot reported that it is inside; send `left` once it is outside"
        return Refused(Refusal.NOT_NOW, text)
    return Progress(_exit(record, observed, moment), (close(record, RobotWord.LEFT),))


def _exit(record: RideRecord, observed: RideObservation, moment: Moment) -> RideRecord:
    """Return the ride as it ends with its robot outside."""
    where, destination = record.could_exit_at, record.request.destination
    if record.phase is Phase.CLEARING and record.clearing is not None:
        return end_outside(record, record.clearing.ending, observed, moment, record.clearing.cause)
    if not record.has_entered:
        why = "the robot reported that it is outside, before it reported that it went in"
        return end_outside(record, Phase.CANCELLED, observed, moment, why)
    if where == destination:
        return end_outside(record, Phase.DONE, observed, moment)
    at = f"at {where}" if where is not None else "where nobody could see the lift"
    why = f"the robot left {at}, and not at {destination}"
    return end_outside(record, Phase.GAVE_UP, observed, moment, why)


def _over(record: RideRecord) -> Refused:
    why = f": {record.reason}" if record.reason else ""
    return Refused(Refusal.NOT_NOW, f"the ride is over, it is {record.phase}{why}")


_Report = Callable[[RideRecord, RideObservation, Moment], Progress | Refused]

_REPORTS: Mapping[RideWord, _Report] = {
    RideWord.HERE: _report_here,
    RideWord.ENTERED: _report_entered,
    RideWord.LEFT: _report_left,
}


# -- what callers and people decide


def _cancel(record: RideRecord, cancel: CancelRide, observed: RideObservation, moment: Moment) -> Progress:
    if record.is_over or record.phase is Phase.CLEARING:
        return Progress(record)
    if not cancel.by_operator:
        # the caller reports for its robot
        record = replace(record, silent_since=None)
    why = f"withdrawn by {'an operator' if cancel.by_operator else 'its caller'}: {cancel.reason}"
    if not (record.maybe_aboard or observed.may_have_boarded):
        ended = end_outside(record, Phase.CANCELLED, observed, moment, why)
        return Progress(ended, (close(record),) if record.session else ())
    clearing = begin_clearing(record, Clearing(Phase.CANCELLED, why), observed, moment)
    if not (cancel.by_operator and record.has_entered):
        return clearing
    text = (
        f"ride_cancelled: a robot of {record.holder} is in the car of {record.lift}, and its ride was {why};"
        f" {clearing_text(record)}"
    )
    return replace(clearing, alarm=text)


# -- how requests ended


def _take_reply(record: RideRecord, happened: LiftReply, observed: RideObservation, moment: Moment) -> Progress:
    request, reply = happened.request, happened.reply
    failure = reply.message if isinstance(reply, Refused) else ""
    match request:
        case OpenSession() if isinstance(reply, SessionBegun):
            return Progress(_dated(record, _open(record, reply.session.id, moment), moment))
        case OpenSession() | GiveCommand():
            return Progress(replace(record, requested_at=moment.now, failure=failure))
        case RenewSession():
            return Progress(replace(record, requested_at=moment.now, failure=failure or record.failure))
        case LiftRequest() | CloseSession(robot=RobotWord.LEFT):
            return _take_exit(record, request, observed)
        case _:
            return Progress(record)


def _open(record: RideRecord, session: str, moment: Moment) -> RideRecord:
    why = f"the car is called to {record.request.start}"
    opened = replace(record, session=session, failure="", ahead=None, reason=why)
    return enter_phase(opened, Phase.CALLED, moment)


def _take_exit(record: RideRecord, request: LiftRequest | CloseSession, observed: RideObservation) -> Progress:
    """Continue after the lift has learnt that the robot left.

    A ride that did not see how its robot got out keeps its doubt until a person has looked.
    """
    state = observed.state
    if state.restrictions.maybe_aboard != record.holder:
        return Progress(record, (SettleOthers(),))
    if isinstance(request, CloseSession) and state.holder is None:
        floor = state.floor or record.request.destination
        left = LiftRequest(record.holder, floor, hold_door=False, robot=RobotWord.LEFT)
        return Progress(record, (LiftAction(record.lift, left),))
    doubt = f"the lift has not shown how the robot got out; a person must look: {how_to_acknowledge(record.lift)}"
    reason = f"{record.reason}; {doubt}" if record.reason else doubt
    return Progress(replace(record, maybe_aboard=True, reason=reason))


def _lift_refusal(happened: Input) -> str:
    match happened:
        case LiftReply(OpenSession(), Refused(code, message)) if code not in NOT_OF_THE_LIFT:
            return message
        case _:
            return ""


def _note_failure(record: RideRecord, status: CommandStatus) -> RideRecord:
    """Record that a command of the ride failed after it was taken."""
    has_failed = status.state in (CommandState.REJECTED, CommandState.UNCONFIRMED) and status.reason != REPLACED
    if not has_failed or status.kind not in (CommandType.GO_TO, CommandType.ROBOT_IN_PLACE):
        return record
    return replace(record, failure=f"{status.kind} {status.state}: {status.reason}")
