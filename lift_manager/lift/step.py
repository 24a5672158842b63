"""One input, one step: the next record of a lift, what to do because of it, and the reply.

The only entrance to the rules. Nothing here waits, requests anything, or knows what time it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from drivers.model import LiftReading, Outcome, OutputState, PressId, Result
from lift_manager.lift import command_requests, doors, endings, handshake, operator_actions, queue, requests, restart
from lift_manager.lift.advance import advance
from lift_manager.lift.call import call_answered, changes_of_call
from lift_manager.lift.commands import DOOR_WITHIN_S, CommandStatus, SessionInfo
from lift_manager.lift.config import ROBOT_MODE, LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.events import Acknowledged, CommandEnded, Event, ForceReleased, Restriction, RestrictionEnded
from lift_manager.lift.freshness import fresh_until, is_fresh
from lift_manager.lift.inhibits import blocking_values
from lift_manager.lift.inputs import (
    Acknowledge,
    Action,
    AnnounceStop,
    CloseSession,
    CommitFailed,
    Committed,
    EndSession,
    ForceRelease,
    GiveCommand,
    HandOver,
    Input,
    JoinQueue,
    LeaveQueue,
    LiftRequest,
    News,
    OpenSession,
    OperatorAction,
    OutputChanged,
    Outputs,
    PressEnded,
    ReadFailed,
    Reading,
    RenewSession,
    Request,
    Restrict,
    Stop,
    Tick,
    Unrestrict,
)
from lift_manager.lift.lease import longest_until, releases_at
from lift_manager.lift.observation import Moment, Observation, observe
from lift_manager.lift.outputs import outputs
from lift_manager.lift.record import DurableRecord, LiftRecord
from lift_manager.lift.refusals import Accepted, Refused
from lift_manager.lift.requests import SessionBegun
from lift_manager.lift.robot_door import invites_until, was_read_while_held
from lift_manager.lift.session import Session
from lift_manager.lift.trust import OPEN_FOR_S, OwnCommands, judge

Reply = (
    Accepted
    | Refused
    | SessionBegun
    | SessionInfo
    | CommandStatus
    | Restriction
    | RestrictionEnded
    | ForceReleased
    | Acknowledged
)

PAST_S = 0.001
"""How long after its longest age a reading is examined: the difference of two times is only approximately what it should be."""

RENEWED_EVERY_S, RENEWED_SHARE = 1.0, 0.1
"""While readings only repeat each other, holds are renewed this often, or after this share of the shortest of them if that is sooner.
Chosen: one step a second costs little beside the polls, and a lift that is not read any more loses a tenth of its hold at most."""

_ON = (OutputState.ON, OutputState.HELD)


@dataclass(frozen=True, slots=True)
class Step:
    """The result of an input."""

    record: LiftRecord
    actions: tuple[Action, ...] = ()
    """In this order. A press leaves only once everything of its step is on the disk."""
    reply: Reply | None = None
    """None if nobody waits for one."""
    events: tuple[Event, ...] = ()
    """Published before the holds of this record are declared: robots learn of a fire first."""
    wake_at: float = math.inf
    """The next moment at which anything changes without another input; a `Tick` is due then."""
    steady_until: float = -math.inf
    """Until then a reading that repeats the observation of `record` need not be stepped; minus infinity if the next one has to be."""


def start(config: LiftConfig, durable: DurableRecord, moment: Moment) -> Step:
    """Return the first record of a process, from what outlived the one before. Called before the lift is read."""
    draft = Draft(config, LiftRecord(durable=durable), moment)
    restart.restore(draft)
    return _finish(draft, LiftRecord(durable=durable), None, is_read=False)


def step(config: LiftConfig, record: LiftRecord, happened: Input, moment: Moment) -> Step:
    """Return what one input changes. For a `Reading`, `moment.read_at` is that of the reading before it."""
    if isinstance(happened, Committed):
        return _note_commit(config, record, happened, moment)
    draft = Draft(config, record, moment)
    reply = _take(draft, happened)
    if isinstance(reply, Refused):
        reply = blocking_values(config, record, reply, moment)
    return _finish(draft, record, reply, is_read=isinstance(happened, Reading))


def is_repetition(
    config: LiftConfig,
    known: Observation | None,
    reading: LiftReading,
    *,
    steady_until: float,
    read_at: float,
    now: float,
) -> bool:
    """Whether a reading repeats what is `known`, in time: it need not be stepped. Most do, and every poll calls this.

    `steady_until` is that of the newest step, and `read_at` that of the reading before.
    """
    if known is None or now >= steady_until or reading.values is not known.values:
        return False
    if reading.epoch != known.epoch or reading.notices:
        return False
    capabilities = config.capabilities
    return reading.at <= fresh_until(capabilities, read_at) and now <= fresh_until(capabilities, reading.at)


def note_outputs(config: LiftConfig, record: LiftRecord, outputs: Outputs, moment: Moment) -> LiftRecord:
    """Return the record with the driver's states of the outputs; nothing is done because of it."""
    mode = record.robot_mode
    status = outputs.get(ROBOT_MODE.name, OutputState.AT_REST)
    if mode.is_requested and not mode.was_pressed and status in (OutputState.ON, OutputState.HELD):
        mode = replace(mode, was_pressed=True)
    return _note_door_held(config, record.having(outputs=outputs, robot_mode=mode), moment)


def _note_commit(config: LiftConfig, record: LiftRecord, commit: Committed, moment: Moment) -> Step:
    """Take the answer of the store. Nothing follows from it but that what waited for it may leave, which is in a hurry."""
    after = record.having(committed=max(record.committed, commit.sequence), disk_trouble="")
    steady_until = _steady_until(config, record, after, moment, is_read=False)
    return Step(after, wake_at=next_change(config, after, moment), steady_until=steady_until)


def _take(draft: Draft, happened: Request | OperatorAction | News) -> Reply | None:
    """Take one input; return the reply to whoever made it."""
    match happened:
        case (
            LiftRequest() | EndSession() | OpenSession() | RenewSession() | CloseSession() | HandOver() | GiveCommand()
        ):
            return _take_request(draft, happened)
        case Restrict():
            return operator_actions.restrict(draft, happened)
        case Unrestrict():
            return operator_actions.unrestrict(draft, happened)
        case ForceRelease():
            return operator_actions.force_release(draft, happened)
        case Acknowledge():
            return operator_actions.acknowledge(draft, happened)
        case _:
            _take_news(draft, happened)
            return None


def _take_request(draft: Draft, request: Request) -> Reply:
    """Take what a caller requests."""
    match request:
        case LiftRequest():
            return requests.request_lift(draft, request)
        case EndSession():
            return requests.end_own_session(draft, request)
        case OpenSession():
            return requests.open_session(draft, request)
        case RenewSession():
            return requests.renew_session(draft, request)
        case CloseSession():
            return requests.close_session(draft, request)
        case HandOver():
            return requests.hand_over(draft, request)
        case GiveCommand():
            return command_requests.give_command(draft, request)


def _take_news(draft: Draft, happened: News) -> None:
    """Take what the driver, the store, the rides and the runtime report."""
    match happened:
        case JoinQueue(holder):
            draft.change(queue=queue.join(draft.record.queue, holder, draft.now))
        case LeaveQueue(holder):
            draft.change(queue=queue.leave(draft.record.queue, holder))
        case AnnounceStop(clear_s):
            endings.announce_stop(draft, clear_s)
        case Stop():
            endings.stop(draft)
        case _:
            _take_change(draft, happened)
            advance(draft)


def _take_change(
    draft: Draft, happened: Reading | ReadFailed | OutputChanged | PressEnded | CommitFailed | Tick
) -> None:
    """Take what may change which outputs are pressed and held."""
    match happened:
        case Reading(reading, outputs):
            _note(draft, outputs)
            _take_reading(draft, reading)
        case ReadFailed(fault):
            draft.change(fault=fault)
        case OutputChanged(outputs):
            _note(draft, outputs)
        case PressEnded(press, outcome):
            _take_outcome(draft, press, outcome)
        case CommitFailed(reason):
            _take_commit_failure(draft, reason)
        case Tick():
            pass


def _finish(draft: Draft, before: LiftRecord, reply: Reply | None, *, is_read: bool) -> Step:
    restart.save(draft)
    config, record = draft.config, _note_door_held(draft.config, draft.record, draft.moment)
    if record.queue.requested_at:
        record = record.having(queue=queue.lapse(record.queue, draft.now))
    if record.durable is not before.durable or draft.actions or draft.events:
        record = record.having(sequence=record.sequence + 1)
    wake_at = next_change(config, record, draft.moment)
    steady_until = _steady_until(config, before, record, draft.moment, is_read=is_read)
    return Step(record, tuple(draft.actions), reply, tuple(draft.events), wake_at, steady_until)


# -- readings


def _take_reading(draft: Draft, reading: LiftReading) -> None:
    """Add a reading to what is known, and continue with it."""
    config, before, at = draft.config, draft.record.observation, reading.at
    gap_s = at - draft.moment.read_at
    draft.moment = Moment(draft.now, draft.moment.clock, at)
    for notice in reading.notices:
        draft.alarm(notice, draft.session.holder if draft.session is not None else None)
    observation = observe(before, reading, config.capabilities, gap_s=gap_s, apart_s=config.readings_apart_s)
    observation, alarms = _judged(draft, observation, at)
    draft.change(
        observation=observation, fault=_late_text(config, draft.now - at), departed_at=_departed(draft, observation, at)
    )
    for alarm in alarms:
        draft.alarm(alarm, draft.session.holder if draft.session is not None else None)
    endings.forget_released_door(draft)


def _judged(draft: Draft, observation: Observation, at: float) -> tuple[Observation, tuple[str, ...]]:
    """Return an observation with the evidence against its open door, and what people should know of that."""
    config, record = draft.config, draft.record
    pressed = (record.call is not None and record.call.was_pressed) or doors.door_is_given(config, record)
    own = OwnCommands(
        record.call, pressed, door_believed=record.session is not None and record.session.opened_at_target
    )
    judged = judge(config, record.track, record.durable.trust, observation, own, at, draft.moment.clock)
    draft.change(track=judged.track)
    draft.change_durable(trust=judged.trust)
    if not (judged.doubt or judged.must_close or judged.pending):
        return observation, judged.alarms
    is_settled = observation.is_settled and not judged.pending
    after = replace(observation, doubt=judged.doubt, must_close=judged.must_close, is_settled=is_settled)
    return after, judged.alarms


def _departed(draft: Draft, observation: Observation, at: float) -> dict[str, float]:
    """Return when the car last left each floor while nobody held the lift."""
    record, before = draft.record, draft.record.observation
    if record.session is not None:
        return {}
    departed = dict(record.departed_at)
    if before is not None and before.floor is not None and before.floor != observation.floor:
        departed[before.floor] = at
    return departed


def _late_text(config: LiftConfig, took_s: float) -> str:
    """Return that a controller answers, but that its values are too old by then; empty otherwise."""
    max_age_s = config.capabilities.max_age_s
    if took_s <= max_age_s:
        return ""
    return (
        f"{config.source} answers too late: its last poll took {took_s:.1f} s, and a reading counts for {max_age_s:g} s (max_age_s); "
        "look for what slows it down, or allow a longer `max_age_s` for this lift"
    )


# -- outputs, outcomes and commits


def _note(draft: Draft, outputs: Outputs) -> None:
    draft.record = note_outputs(draft.config, draft.record, outputs, draft.moment)


def _note_door_held(config: LiftConfig, record: LiftRecord, moment: Moment) -> LiftRecord:
    """Remember since when the door is held, and since when it is seen to be."""
    on_since = doors.door_on_since(config, record, moment.now)
    if on_since != record.door_on_since:
        record = record.having(door_on_since=on_since)
    is_held = doors.door_is_held(config, record)
    if is_held is (record.door_held_since is not None):
        return record
    return record.having(door_held_since=moment.now if is_held else None)


def _take_outcome(draft: Draft, press: PressId, outcome: Outcome) -> None:
    """Take the outcome of a press."""
    record, session = draft.record, draft.session
    of = next((pending.session for pending in record.presses if pending.id == press), None)
    draft.change(presses=tuple(pending for pending in record.presses if pending.id != press))
    holder = session.holder if session is not None and of in (None, session.number) else None
    draft.emit(CommandEnded(draft.config.name, outcome, holder))
    name = outcome.command.name
    stays_on = outcome.result is Result.CONFIRMED and name in draft.config.capabilities.held_commands
    if stays_on and not draft.record.is_given(outcome.command):
        # until the driver reports otherwise
        draft.change(outputs={**draft.record.outputs, name: OutputState.ON})
    if record.call is not None and record.call.press == press:
        # one that was overtaken by the end of its holder's session has not failed
        kept_back = session is not None and session.is_ending and outcome.result is Result.REJECTED
        forgiving = replace(outcome, grant_missing=outcome.grant_missing or kept_back)
        draft.change(call=call_answered(record.call, forgiving, draft.now))
    doors.closing_answered(draft, press, outcome)
    for word_name in handshake.COMMAND_OF:
        word = record.in_place if word_name == "in_place" else record.robot_left
        if word.call is not None and word.call.press == press:
            handshake.word_answered(draft, word_name, outcome)


def _take_commit_failure(draft: Draft, reason: str) -> None:
    """Reject every press that waits for the disk: it never leaves, even if it is written down later."""
    draft.change(disk_trouble=reason)
    waiting = [pending for pending in draft.record.presses if pending.sequence > draft.record.committed]
    for pending in waiting:
        draft.cancel(pending.command)
        outcome = Outcome(pending.command, Result.REJECTED, f"not recorded: {reason}")
        _take_outcome(draft, pending.id, outcome)


# -- when the next input is due


def next_change(config: LiftConfig, record: LiftRecord, moment: Moment) -> float:
    """Return the first time after `moment` at which something changes without an input; infinite for none.

    A reading that repeats the one before (`is_repetition`) moves it without a step.
    """
    times, now = [*_changes(config, record), *_changes_of_reading(config, record, moment)], moment.now
    return min([at for at in times if at > now], default=math.inf)


def _changes(config: LiftConfig, record: LiftRecord) -> list[float]:
    """Return when anything changes, whatever the newest reading is."""
    times = [queue.next_lapse(record.queue)]
    if record.fire_release_at is not None:
        times.append(record.fire_release_at)
    if record.robot_mode.kept_until is not None:
        times.append(record.robot_mode.kept_until)
    if record.repeats_robot_left and record.robot_left.call is not None:
        times.append(record.robot_left.call.not_before)
    if record.session is not None:
        times += _changes_of_session(config, record, record.session)
    return times


def _changes_of_reading(config: LiftConfig, record: LiftRecord, moment: Moment) -> list[float]:
    observation, capabilities = record.observation, config.capabilities
    if observation is None or not is_fresh(capabilities, moment):
        return []
    times = [
        fresh_until(capabilities, moment.read_at) + PAST_S,
        observation.floor_since + capabilities.evidence_for_s,
    ]
    times += [since + capabilities.door_closes_within_s for since in observation.not_open_since.values()]
    if record.track.opened_at is not None:
        times.append(record.track.opened_at + OPEN_FOR_S)
    return times


def _changes_of_session(config: LiftConfig, record: LiftRecord, session: Session) -> list[float]:
    capabilities, call = config.capabilities, record.call
    times = [
        record.people_until,
        releases_at(session, config),
        invites_until(session, config),
        longest_until(session, config) + capabilities.arrive_within_s,
        record.closing.since + DOOR_WITHIN_S,
    ]
    if call is not None:
        times += (call.since + capabilities.arrive_within_s, call.since + capabilities.granted_within_s)
    if record.ungranted is not None:
        times.append(record.ungranted[2] + doors.UNGRANTED_S)
    for entry in record.commands:
        if entry.pending is not None and entry.pending.due_since is not None:
            times.append(entry.pending.due_since + DOOR_WITHIN_S)
    return times


# -- how long readings may repeat each other


def _steady_until(config: LiftConfig, before: LiftRecord, after: LiftRecord, moment: Moment, *, is_read: bool) -> float:
    """Return until when readings that repeat the newest one need not be stepped. `is_read` means that a reading led from `before`.

    An idle lift is steady for as long as they do. One that is held is if the step of its reading has changed nothing but how long
    its holds last: then the next one would do no more, until time changes something or the holds have to be renewed.
    """
    observation = after.observation
    if observation is None or not observation.is_settled or after.fault:
        return -math.inf
    if not after.is_busy:
        return math.inf
    if not is_read or not _only_waits(after, moment) or after.renewed(0.0) != before.renewed(0.0):
        return -math.inf
    holds = outputs(config, after)
    if not all(after.status(command) in _ON for command in holds):
        return -math.inf  # one that is off may be tried again with every declaration
    shortest_s = min((config.capabilities.max_hold_s.get(one.name, math.inf) for one in holds), default=math.inf)
    times = [*_changes(config, after), *_changes_at_reading(config, after), *(hold.until for hold in holds.values())]
    renewed_by = moment.read_at + min(RENEWED_EVERY_S, RENEWED_SHARE * shortest_s)
    # a rule may apply only after its moment, and not at it
    return min([renewed_by, *(at for at in times if at >= moment.now - PAST_S)])


def _only_waits(record: LiftRecord, moment: Moment) -> bool:
    """Whether the session only waits for its holder, or for the lift to do what it has taken."""
    session, call = record.session, record.call
    if session is None or session.is_ending or record.is_stopping or record.fire_release_at is not None:
        return False
    # what is not pressed may wait for the disk, and that the disk is well again is noticed with a step
    if record.presses or record.disk_trouble or call is None or not call.was_pressed:
        return False
    # a door that is held invites the robot with the first reading from after that
    return record.door_held_since is None or was_read_while_held(record, moment)


def _changes_at_reading(config: LiftConfig, record: LiftRecord) -> list[float]:
    """Return when a reading changes something that the same reading did not change before."""
    session, call = record.session, record.call
    times = [] if call is None else changes_of_call(call, config.capabilities)
    if session is not None and session.restored_at is not None:
        times.append(session.restored_at + session.policy.clear_s)
    return times
