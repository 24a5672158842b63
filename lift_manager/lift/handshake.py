"""The exchange with the controller about its passenger: robot in place, robot left; and what stays on until it has taken them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from drivers.model import Command, FloorName, Outcome, Result
from lift_manager.lift import call_output
from lift_manager.lift.call import (
    call_after_restart,
    call_answered,
    call_command,
    call_failed,
    call_found_off,
    press_call,
    request_call,
)
from lift_manager.lift.call_output import robot_is_aboard
from lift_manager.lift.config import ROBOT_IN_PLACE, ROBOT_LEFT, LiftConfig
from lift_manager.lift.draft import Draft
from lift_manager.lift.inhibits import (
    person_looks_text,
    repeated_text,
    robot_of_another,
    unreachable_floor,
    why_no_press,
    why_no_robot_left,
)
from lift_manager.lift.observation import (
    Observation,
    RobotDoor,
    door_by_signals,
    is_under_way,
    permissions_needed,
)
from lift_manager.lift.occupancy import (
    BoardingProgress,
    Occupancy,
    OccupancyAtEnd,
    RobotWord,
    Stop,
    boarding_by_request,
    boarding_without_session,
    car_observed_at,
    has_exited,
    is_aboard,
    leaves_doubt,
    occupancy_matters,
    stands_open_to_enter,
    stands_open_to_leave,
)
from lift_manager.lift.record import HandshakeWord, LiftRecord, SavedSession
from lift_manager.lift.refusals import Blocking, Refusal, Refused
from lift_manager.lift.session import Holder, Session

WordName = Literal["in_place", "robot_left"]
COMMAND_OF: dict[WordName, Command] = {"in_place": ROBOT_IN_PLACE, "robot_left": ROBOT_LEFT}


# -- what the lift knows


def in_place_is_taken(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether the lift has taken that the robot is in place; a lift without that command does not need it."""
    word = record.in_place
    return not config.has(ROBOT_IN_PLACE) or (word.call is not None and not word.is_unacknowledged)


def is_ready(config: LiftConfig, record: LiftRecord) -> bool:
    """Whether the lift knows what it must know before it takes the car on."""
    told_left = not record.robot_left.is_pending and not record.repeats_robot_left
    return told_left and (not robot_is_aboard(config, record) or in_place_is_taken(config, record))


def next_command(config: LiftConfig, record: LiftRecord, floor: FloorName) -> str:
    """Return the command that sends the car to a floor: the call, or a report about the robot that comes before it or replaces it."""
    aboard = robot_is_aboard(config, record)
    call = call_command(config, floor, aboard=aboard)
    if call is None or (aboard and not in_place_is_taken(config, record)):
        return ROBOT_IN_PLACE.name
    return call.name


def stands_open_for_robot(config: LiftConfig, record: LiftRecord, observation: Observation, floor: FloorName) -> bool:
    """Whether the car stands open at a floor for the robot where it is now, as far as the lift's own signals go."""
    needed = permissions_needed(config.capabilities, aboard=is_aboard(record.boarding, config.capabilities))
    doors = config.doors_at.get(floor, ())
    return observation.floor == floor and door_by_signals(observation, doors, needed) is RobotDoor.OPEN


# -- what the holder requests


def take_request(
    draft: Draft, session: Session | None, holder: Holder, floor: FloorName, word: RobotWord | None
) -> Refused | None:
    """Take a request of the holder that nothing else forbids, or refuse it.

    A session without a target has no part in the handshake: its first request is taken as the one that opens a session.
    """
    config, record, now, name = draft.config, draft.record, draft.now, draft.config.name
    before, stop, observation = record.boarding, None, draft.observation
    if session is not None and session.floor is None:
        session = None  # what is known of the car is as it was before the session
    if session is not None and session.floor is not None:
        is_open = observation is not None and stands_open_for_robot(config, record, observation, session.floor)
        stop = Stop(session.floor, record.call_has_arrived, is_open)
    if (refused := robot_of_another(config, record, holder)) is not None:
        return refused
    if (unknown := _why_unknown(draft, session, floor, word)) is not None:
        return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{name}: {unknown}", Blocking(holder=holder))
    after = boarding_by_request(before, floor, word, stop, config, now)
    if isinstance(after, str):
        return Refused(Refusal.OCCUPANCY_UNKNOWN, f"{name}: {after}")
    if (refused := unreachable_floor(config, floor, aboard=after.occupancy is Occupancy.ABOARD)) is not None:
        return refused
    draft.change(boarding=after, abandoned_by=None)
    _request_words(draft, before, session, stop.floor if stop is not None else floor, word)
    return None


def may_go_on(record: LiftRecord, holder: Holder) -> bool:
    """Whether a robot of this holder may be in the car without a session: it has to get out, however many callers wait."""
    return record.abandoned_by == holder and record.boarding.may_be_in_car


def _why_unknown(draft: Draft, session: Session | None, floor: FloorName, word: RobotWord | None) -> str | None:
    """Return why nobody knows whether the holder's robot of an earlier session is in the car, where that forbids a request."""
    observation, boarding = draft.observation, draft.record.boarding
    in_doubt = session is None and boarding.occupancy is Occupancy.MAY_BOARD
    stays_here = observation is not None and observation.floor == floor
    if not in_doubt or not occupancy_matters(draft.config.capabilities) or word is not None or stays_here:
        return None
    known = observation is not None and observation.floor is not None
    here = f", request {observation.floor}, where the car is" if known and observation is not None else ""
    person = person_looks_text(draft.config.name)
    return f"your robot may have entered the car; report that it is in place or has left{here}, or {person}"


def _request_words(
    draft: Draft, before: BoardingProgress, session: Session | None, here: FloorName, word: RobotWord | None
) -> None:
    """Request the reports that follow from a request."""
    if draft.record.boarding.occupancy is Occupancy.ABOARD:
        if before.occupancy is not Occupancy.ABOARD and _is_level(draft.config, "robot_left"):
            release_word(draft, "robot_left")
        request_word(draft, "in_place", here)
    elif before.occupancy is Occupancy.ABOARD:
        report_robot_left(draft, here)
    elif session is None or word is RobotWord.LEFT:
        request_word_again(draft, "robot_left")


# -- what readings show, and what follows from them


def follow_robot(draft: Draft, observation: Observation, session: Session | None) -> None:
    """Take a fresh reading."""
    config, floor = draft.config, observation.floor
    boarding = car_observed_at(draft.record.boarding, floor, under_way=is_under_way(observation.values))
    draft.change(boarding=boarding)
    if floor is None or not stands_open_for_robot(config, draft.record, observation, floor):
        return
    boarding = stands_open_to_leave(boarding, floor)
    if session is not None and floor == session.floor:
        boarding = stands_open_to_enter(boarding, draft.now)
    draft.change(boarding=boarding)


def give_words(draft: Draft, session: Session | None) -> None:
    """Send the reports that are wanted, unless something forbids it; `session` is None while people have their turn."""
    config, may_begin = draft.config, session is None or session.may_begin
    if may_begin and draft.record.repeats_robot_left:
        request_word_again(draft, "robot_left")
    if draft.record.robot_left.is_requested:
        if why_no_robot_left(config, draft.record, draft.moment) is None:
            _give(draft, "robot_left")
        else:
            release_stay(draft)
    if session is None or not robot_is_aboard(config, draft.record) or draft.record.robot_left.is_pending:
        return
    if why_no_press(config, draft.record, draft.moment) is not None:
        return
    _give(draft, "in_place")
    if in_place_is_taken(config, draft.record):
        call_output.release_call_at(draft, "robot_in_place")
        _keep_in_place(draft)


def word_answered(draft: Draft, name: WordName, outcome: Outcome) -> None:
    """Take the outcome of the newest press of a report."""
    word, now = _word(draft, name), draft.now
    if word.call is None:
        return
    call = call_answered(word.call, outcome, now)
    if outcome.result is not Result.CONFIRMED:
        call = call_failed(replace(word.call, outcome=outcome), outcome.reason, now)
    _set(draft, name, replace(word, call=call))
    if name != "robot_left":
        return
    _after_robot_left(draft)
    if call.failures == 1 and outcome.result is not Result.CONFIRMED:
        tried = repeated_text(draft.config.name)
        draft.alarm(f"robot_left was not taken, so the lift may still count a robot aboard: {outcome.reason}; {tried}")


# -- the end of a session


def parting_of(
    config: LiftConfig,
    record: LiftRecord,
    session: Session,
    release: tuple[FloorName, RobotWord | None] | None,
    *,
    arrived: bool,
) -> OccupancyAtEnd:
    """Return how robot and lift part if the session ends now.

    `release` is the holder's own: the floor, and what the robot reported.
    """
    boarding, policy = record.boarding, session.policy
    let_out = session.opened_at_target or policy.has_robot_words or not policy.stays
    word = None if release is None else release[1]
    if release is not None:
        target = session.floor if let_out else None
        if has_exited(boarding, release[0], word, target, config):
            return OccupancyAtEnd.EXITED
    doubt = leaves_doubt(
        boarding,
        released=release is not None,
        word=word,
        arrived=arrived,
        has_words=policy.has_robot_words,
        let_out=let_out,
    )
    return OccupancyAtEnd.DOUBT if doubt else OccupancyAtEnd.DONE


def end_session_part(
    draft: Draft, session: Session, release: tuple[FloorName, RobotWord | None] | None, *, arrived: bool
) -> None:
    """End the session's part in the handshake.

    `release` is the holder's own report that it is over; so is a session that only wanted to be where it has `arrived`.
    """
    if draft.record.abandoned_by is not None:
        # it was never given a target: the car is as the previous session left it
        if release is not None:
            release_without_session(draft, session.holder, *release)
        return
    parting = parting_of(draft.config, draft.record, session, release, arrived=arrived)
    boarding = draft.record.boarding
    draft.change(boarding=BoardingProgress())
    if parting is OccupancyAtEnd.EXITED and release is not None:
        report_robot_left(draft, release[0])
        # what is on stays on until the lift knows that the robot left
        call_output.renew_call(draft)
        _set(draft, "in_place", replace(draft.record.in_place, renewed_at=draft.now))
        return
    release_stay(draft)
    if parting is OccupancyAtEnd.DOUBT:
        draft.change(abandoned_by=session.holder, boarding=boarding)
    is_taken = in_place_is_taken(draft.config, draft.record)
    if boarding.occupancy is Occupancy.ABOARD and (_is_level(draft.config, "in_place") or not is_taken):
        _forget(draft, "in_place")


def release_without_session(draft: Draft, holder: Holder, floor: FloorName, word: RobotWord | None) -> None:
    """Take a release that finds no session: reports of an earlier one that the lift has not taken are sent again.

    Only the report that the robot left ends a doubt: an idle client posts bare releases once a second.
    """
    record = draft.record
    is_mine = holder == record.abandoned_by and word is RobotWord.LEFT
    if is_mine and record.boarding.occupancy is not Occupancy.ABOARD:
        found_empty(draft)
    elif is_mine and record.boarding.may_leave_at is not None:
        draft.change(boarding=BoardingProgress(), abandoned_by=None)
        report_robot_left(draft, floor)
    elif record.abandoned_by is None:
        request_word_again(draft, "robot_left")


def found_empty(draft: Draft) -> None:
    """Record that no robot of an earlier session is in the car; report that to a lift that may still count one."""
    was_aboard = draft.record.boarding.occupancy is Occupancy.ABOARD
    draft.change(abandoned_by=None, boarding=BoardingProgress())
    if was_aboard:
        report_robot_left(draft, draft.config.floors[0])
    else:
        _forget(draft, "in_place")


def give_up_robot_left(draft: Draft) -> None:
    """Stop reporting that a robot left: a person has seen to it."""
    _forget(draft, "robot_left")
    release_word(draft, "robot_left")
    _after_robot_left(draft)


def release_all(draft: Draft) -> None:
    """Release at once what is on for a robot, and both reports."""
    release_stay(draft)
    release_word(draft, "robot_left")


def release_stay(draft: Draft) -> None:
    """Release what is on for a robot that boards, rides or leaves."""
    call_output.release_call(draft)
    release_word(draft, "in_place")


# -- a restart


def restore_occupied(draft: Draft) -> None:
    """Continue with what a session before this start left behind in the car."""
    durable = draft.record.durable
    if (occupied := durable.occupied) is not None:
        draft.change(abandoned_by=occupied.holder, boarding=boarding_without_session(aboard=occupied.aboard))
    if durable.robot_left_pending_since is not None:
        _after_restart(draft, "robot_left", draft.config.floors[0], taken=False)


def restore_session(draft: Draft, saved: SavedSession, floor: FloorName) -> None:
    """Continue with the robot of a session from before a restart. What the lift has taken is not reported again."""
    kept = saved.boarding
    boarding = BoardingProgress(kept.occupancy, may_leave_at=kept.may_leave_at, sent_on=kept.sent_on)
    draft.change(abandoned_by=None, boarding=boarding)
    if kept.in_place_taken:
        # the moment of the start: a report counts as taken from then on
        _after_restart(draft, "in_place", floor, taken=True)
        if _is_level(draft.config, "in_place") and kept.occupancy is Occupancy.ABOARD:
            _set(draft, "in_place", replace(draft.record.in_place, is_on=True, renewed_at=draft.now))


# -- reports about the robot


def request_word(draft: Draft, name: WordName, floor: FloorName) -> None:
    """Request a report; after a failure only once its pause is over."""
    word = _word(draft, name)
    if draft.config.has(COMMAND_OF[name]):
        place = word.call.floor if word.call is not None else floor
        _set(draft, name, replace(word, call=request_call(word.call, place, draft.now)))


def request_word_again(draft: Draft, name: WordName) -> None:
    """Request a report again if it failed and its pause is over."""
    if (call := _word(draft, name).call) is not None:
        request_word(draft, name, call.floor)


def release_word(draft: Draft, name: WordName) -> None:
    """Release a report that is on; one that was not pressed yet is not pressed."""
    call = _word(draft, name).call
    draft.cancel(COMMAND_OF[name], None if call is None else call.press)
    _set(draft, name, replace(_word(draft, name), is_on=False))


def report_robot_left(draft: Draft, floor: FloorName) -> None:
    """Report to the lift that the robot left. What stays on until then is released once the lift has taken it."""
    if not in_place_is_taken(draft.config, draft.record):
        release_word(draft, "in_place")
    _forget(draft, "in_place")
    _forget(draft, "robot_left")
    request_word(draft, "robot_left", floor)
    if call_output.held_call_ends_at(draft.record) != "robot_left":
        call_output.release_call(draft)
    if not draft.record.robot_left.is_pending:
        _after_robot_left(draft)


def _after_robot_left(draft: Draft) -> None:
    """Release what was on for the robot aboard."""
    call_output.release_call_at(draft, "robot_left")
    if _is_level(draft.config, "in_place"):
        release_word(draft, "in_place")


def _give(draft: Draft, name: WordName) -> None:
    word = _word(draft, name)
    if word.call is not None and word.is_requested:
        press = draft.press(COMMAND_OF[name])
        call = press_call(word.call, press, draft.now)
        _set(draft, name, HandshakeWord(call, is_on=_is_level(draft.config, name), renewed_at=draft.now))
        if name == "in_place" and (session := draft.session) is not None:
            draft.change(used_by=session.number)


def _keep_in_place(draft: Draft) -> None:
    """Keep the level on that reports a robot in place. One that the controller lost waits for the holder's next request."""
    word = draft.record.in_place
    if word.call is None or not word.is_on:
        return
    if draft.record.is_given(ROBOT_IN_PLACE):
        draft.change(in_place=replace(word, renewed_at=draft.now))
    elif word.call.is_answered:
        lost = call_found_off(word.call, "the controller no longer holds robot_in_place", draft.now)
        draft.change(in_place=replace(word, call=lost, is_on=False))


def _after_restart(draft: Draft, name: WordName, floor: FloorName, *, taken: bool) -> None:
    if draft.config.has(COMMAND_OF[name]):
        since = draft.now if taken else 0.0
        _set(draft, name, HandshakeWord(call_after_restart(floor, since, pressed=taken)))


def _forget(draft: Draft, name: WordName) -> None:
    _set(draft, name, replace(_word(draft, name), call=None))


def _is_level(config: LiftConfig, name: WordName) -> bool:
    return COMMAND_OF[name].name in config.capabilities.held_commands


def _word(draft: Draft, name: WordName) -> HandshakeWord:
    return draft.record.in_place if name == "in_place" else draft.record.robot_left


def _set(draft: Draft, name: WordName, word: HandshakeWord) -> None:
    if word != _word(draft, name):
        draft.change(**{name: word})
