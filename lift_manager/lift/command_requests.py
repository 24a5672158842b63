"""Decides on what the holder of a session commands within it: each command is admitted like any request, and then followed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from drivers.model import FloorName
from lift_manager.lift import doors, handshake, history
from lift_manager.lift.advance import advance
from lift_manager.lift.commands import (
    ROBOT_WORDS,
    CommandRequest,
    CommandStatus,
    CommandType,
    PendingCommand,
)
from lift_manager.lift.draft import Draft
from lift_manager.lift.inhibits import command_refusal, over_soon, unknown_floor, why_no_close
from lift_manager.lift.inputs import GiveCommand
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.requests import go_on_with, is_new, live_session, take_turn, too_often
from lift_manager.lift.session import Session, may_hold_again, renew, set_target
from register_maps.words import Side

_RELEASES = frozenset({CommandType.RELEASE_DOOR, CommandType.ROBOT_LEFT})
"""The commands that the holder of a session may still give after its end was announced."""


def give_command(draft: Draft, request: GiveCommand) -> CommandStatus | Refused:
    """Decide on a command of a session's holder and act on it."""
    config, command = draft.config, request.request
    if (known := known_command(draft, command)) is not None:
        return known
    is_change = _changes_session(draft, command)
    if is_change and (refused := too_often(draft, command.holder)) is not None:
        return refused
    session = live_session(draft, command.session, command.holder)
    if isinstance(session, Refused):
        return session
    session = session.having(contacted_at=draft.now)
    draft.change(session=session)
    history.judge_commands(draft)
    is_given = command.kind is CommandType.RELEASE_DOOR and _door_is_given(draft, session)
    over = None if command.kind in _RELEASES else over_soon(session, draft.moment)
    refused = over or _COMMANDS[command.kind](draft, session, command)
    if refused is not None:
        return refused
    if is_change:
        take_turn(draft, command.holder)
    floor = command.floor if command.kind is CommandType.GO_TO else session.floor
    pending = PendingCommand(command.kind, floor, pressed=is_given)
    history.take_command(draft, command, pending, request.new_id, is_recorded=request.is_recorded)
    advance(draft)
    return history.read_command(config, draft.record, command.session, command.holder, request.new_id, draft.moment)


def known_command(draft: Draft, command: CommandRequest) -> CommandStatus | Refused | None:
    """Return the command that the holder has given with this key before; refuse another one with it."""
    found = history.find_session(draft.config, draft.record, command.session, command.holder, draft.moment)
    return None if isinstance(found, Refused) else history.command_by_key(draft.record, command, draft.moment)


def _go_to(draft: Draft, session: Session, command: CommandRequest) -> Refused | None:
    floor = command.floor or ""
    refused = unknown_floor(draft.config, floor)
    return refused or _request_floor(draft, session, floor, command.kind, hold_door=command.hold_door)


def _hold_door(draft: Draft, session: Session, command: CommandRequest) -> Refused | None:
    config = draft.config
    if session.floor is None:
        return _not_now(draft, "no floor was requested yet: request one with go_to, and hold_door with it")
    if session.hold_spent and not may_hold_again(session, config, draft.now):
        limit = config.hold_limit
        return _not_now(
            draft,
            f"the door was held at {session.floor} for {limit.seconds:g} s, as long as {limit.set_by} allows; it is held"
            f" again once it has been shut for {config.between_sessions_s:g} s",
        )
    if (why := doors.why_no_hold(config, session.floor)) is not None:
        return Refused(Refusal.NOT_POSSIBLE, f"{config.name}: {why}")
    return _request_floor(draft, session, session.floor, command.kind, hold_door=True)


def _end_door_hold(draft: Draft, session: Session, command: CommandRequest) -> Refused | None:
    # a release: nothing forbids it, and nothing is called by it
    _release_door(draft, session, command.kind)
    return None


def _close_door(draft: Draft, session: Session, command: CommandRequest) -> Refused | None:
    config, floor, name = draft.config, session.floor, draft.config.name
    here = config.doors_at.get(floor, ()) if floor is not None else ()
    sides = here if command.side is None else (command.side,)
    missing = [side for side in sides if not config.has(doors.close_command(side))]
    has_button = any(config.has(doors.close_command(side)) for side in Side)
    if missing or not has_button:
        which = f"close_door.{missing[0]}" if has_button else "close_door"
        return Refused(Refusal.NOT_POSSIBLE, f"{name} has no {which}: its map has no such button")
    if floor is not None and command.side not in (None, *here):
        return Refused(Refusal.NOT_POSSIBLE, f"{name} has no {command.side} door at {floor}")
    if (refused := command_refusal(config, draft.record, draft.moment, goes_on=True)) is not None:
        return refused
    if (why_not := why_no_close(config, draft.record, draft.moment, hold_door=False)) is not None:
        return _not_now(draft, why_not)
    _release_door(draft, session, command.kind)
    doors.request_closing(draft, sides)
    return None


def _robot_word(draft: Draft, session: Session, command: CommandRequest) -> Refused | None:
    config, observation, word = draft.config, draft.observation, ROBOT_WORDS[command.kind]
    refused = command_refusal(config, draft.record, draft.moment, goes_on=True)
    # a report that the robot left needs nothing of the lift: only the robot's own history can forbid it
    if refused is not None and word is RobotWord.IN_PLACE:
        return refused
    here = observation.floor if observation is not None else None
    floor = session.floor or here or config.floors[0]
    if (refused := handshake.take_request(draft, session, session.holder, floor, word)) is not None:
        return refused
    history.replace_commands(draft, command.kind, session.floor, hold_door=session.hold_door)
    go_on_with(draft, renew(session, draft.now), is_requested=session.is_restored)
    return None


def _request_floor(
    draft: Draft, session: Session, floor: FloorName, kind: CommandType, *, hold_door: bool
) -> Refused | None:
    """Request a floor as a face without sessions does."""
    refused = command_refusal(draft.config, draft.record, draft.moment, goes_on=True)
    refused = refused or handshake.take_request(draft, session, session.holder, floor, None)
    if refused is None:
        after = set_target(session, floor, draft.now, hold_door=hold_door)
        history.replace_commands(draft, kind, after.floor, hold_door=after.hold_door)
        go_on_with(draft, after)
    return refused


def _release_door(draft: Draft, session: Session, kind: CommandType) -> None:
    after = renew(session, draft.now).having(hold_door=False, holding_since=None)
    history.replace_commands(draft, kind, after.floor, hold_door=after.hold_door)
    draft.change(session=after)
    doors.release_door_at_request(draft)


def _door_is_given(draft: Draft, session: Session) -> bool:
    return history.session_on_lift(draft.config, draft.record, session, draft.moment).door_is_given


def _not_now(draft: Draft, why: str) -> Refused:
    return Refused(Refusal.NOT_NOW, f"{draft.config.name}: {why}")


_COMMANDS: Mapping[CommandType, Callable[[Draft, Session, CommandRequest], Refused | None]] = {
    CommandType.GO_TO: _go_to,
    CommandType.HOLD_DOOR: _hold_door,
    CommandType.RELEASE_DOOR: _end_door_hold,
    CommandType.CLOSE_DOOR: _close_door,
    CommandType.ROBOT_IN_PLACE: _robot_word,
    CommandType.ROBOT_LEFT: _robot_word,
}


def _changes_session(draft: Draft, command: CommandRequest) -> bool:
    """Whether a command changes what is requested. A release is always allowed."""
    session = draft.session
    if session is None or session.id != command.session or session.holder != command.holder:
        return False
    if command.kind is CommandType.GO_TO:
        return is_new(draft, command.holder, command.floor, hold_door=command.hold_door)
    holds = command.kind is CommandType.HOLD_DOOR and not session.hold_door
    return command.kind is CommandType.CLOSE_DOOR or holds
