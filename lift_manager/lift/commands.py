"""The commands of a session's holder, and their outcomes.

A command is judged again whenever there is news, until it has ended; it never ends better than the lift shows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum, unique

from drivers.model import FloorName, Outcome, Proof, Result
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.occupancy import Occupancy, RobotWord
from lift_manager.lift.session import Advice, EndReason, Holder
from register_maps.words import Side

DOOR_WITHIN_S = 10.0
"""How long the hold of a door may take to be seen on, or off. Chosen: three times what a map may take to confirm a write, and less
than a robot waits before it repeats its request."""
COMMANDS = 64
"""How many commands of one session are remembered, the newest. Chosen: a ride needs ten."""
SESSIONS, SESSIONS_FOR_S = 32, 3600.0
"""How many sessions are remembered once they are over, and for how long. Chosen: a caller that lost its reply repeats the request
within minutes, and a busy lift has thirty sessions an hour."""

SAVED_COMMANDS, SAVED_SESSIONS = 16, 8
"""How many commands of a session, and how many ended sessions, keep their idempotency keys over a restart. Chosen: a ride needs
ten commands, and a caller that lost its reply over a restart repeats the request within minutes."""

REPLACED = "another request took its place"
RESTARTED = "the manager was restarted, and nobody watches what comes of it; send it again"


@unique
class CommandType(StrEnum):
    """What the holder may command within a session."""

    GO_TO = "go_to"
    """Bring the car to a floor: the empty car to the robot, or the robot along."""
    HOLD_DOOR = "hold_door"
    """Hold the door open at the session's floor, or once the car is there; bounded by the site."""
    RELEASE_DOOR = "let_go_door"
    CLOSE_DOOR = "close_door"
    """Press the close button. The caller guarantees that nothing stands in the doorway; refused while a robot may be there."""
    ROBOT_IN_PLACE = "robot_in_place"
    ROBOT_LEFT = "robot_left"


ROBOT_WORDS: Mapping[CommandType, RobotWord] = {
    CommandType.ROBOT_IN_PLACE: RobotWord.IN_PLACE,
    CommandType.ROBOT_LEFT: RobotWord.LEFT,
}
_DOOR_COMMANDS = (CommandType.HOLD_DOOR, CommandType.RELEASE_DOOR, CommandType.CLOSE_DOOR)


@unique
class CommandState(StrEnum):
    """How far a command is. Acknowledged is not done."""

    PENDING = "pending"
    CONFIRMED = "confirmed"
    """The lift shows that it has taken it; for `go_to` that it has the call or the car is there, which is not arrival."""
    REJECTED = "rejected"
    """It was not carried out: nothing was sent, the controller refused it, or another command replaced it before it was pressed."""
    UNCONFIRMED = "unconfirmed"
    """It was sent, or may have been, and nothing shows that it took effect."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandRequest:
    """One thing commanded within a session."""

    session: str = field(repr=False)
    """Its id."""
    holder: Holder
    kind: CommandType
    floor: FloorName | None = None
    """With `go_to`, and only there."""
    hold_door: bool = True
    """With `go_to`: hold the door once the car is there."""
    side: Side | None = None
    """With `close_door`: one door; None means all doors of the floor."""
    key: str = field(default="", repr=False)
    """Idempotency key: the same one of the same session gives the same command; empty for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandStatus:
    """A command within a session, and its outcome."""

    id: str
    lift: str
    holder: Holder
    kind: CommandType
    floor: FloorName | None
    state: CommandState
    reason: str
    """Why it was rejected or is unconfirmed; while pending, what it waits for; empty otherwise."""
    proof: Proof
    """What confirmed it; `none` if the lift need not know, because its map has no signal for it or it is so already."""
    requested_at: datetime
    ended_at: datetime | None


@dataclass(frozen=True, slots=True)
class SessionOver:
    """Why a session is over."""

    reason: EndReason
    text: str
    """The reason in words."""
    advice: Advice | None
    """The robot's best course; None where the holder ended the session."""
    at: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionInfo:
    """A session as its holder sees it."""

    id: str = field(repr=False)
    """A secret of the holder: in no event, no log line and no row of the journal."""
    lift: str
    holder: Holder
    floor: FloorName | None
    """Where the car is wanted; None before the first request for a floor."""
    hold_door: bool
    opened_at: datetime
    lease_ends_in_s: float | None
    """None for faces without a lease, and for one that is over."""
    ends_in_s: float | None
    """Seconds until the session is over however often it is renewed (`max_session_s`); None for one that is over."""
    hold_ends_in_s: float | None
    """Seconds until the door is released whatever the holder requests; None while it is not held."""
    releases_in_s: float | None = None
    """Seconds until the manager releases the door at the earliest, as far as it knows; None for a session that is over."""
    releasing: bool = False
    """That is so soon that the door no longer counts as open for a robot."""
    arrived: bool
    """The car is there for it."""
    door_held: bool
    robot: Occupancy
    """Where its robot is, as far as that is known."""
    waiting_for: str
    """What it waits for before anything is pressed; empty when it does not."""
    restored: bool
    """It is from before a restart, and its holder has sent no request since."""
    over: SessionOver | None = None
    """None while the session lasts."""

    def ended(self, robot: Occupancy, over: SessionOver) -> SessionInfo:
        """Return it as it is once it is over. Nothing of it is left on the lift."""
        return replace(
            self,
            hold_door=False,
            lease_ends_in_s=None,
            ends_in_s=None,
            hold_ends_in_s=None,
            releases_in_s=None,
            releasing=False,
            arrived=False,
            door_held=False,
            robot=robot,
            waiting_for="",
            restored=False,
            over=over,
        )


@dataclass(frozen=True, slots=True)
class CommandProgress:
    """How far the exchange with the controller is: the call, a report about the robot, the close button."""

    phase: CallPhase | None = None
    """None if the lift need not know: its map has no signal for it, or it is so already."""
    reason: str = ""
    """Why it failed."""
    again_in_s: float = 0.0
    """Until it may be pressed again after a failure."""
    outcome: Outcome | None = None
    """Of its newest press; None where it was not pressed, or has none yet."""


def progress_of(call: Call | None, now: float) -> CommandProgress:
    """Return how far a call is, or a word that follows its rules."""
    if call is None:
        return CommandProgress()
    return CommandProgress(call.phase, call.reason, max(0.0, call.not_before - now), call.outcome)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionOnLift:
    """What of a session is on its lift at one moment."""

    floor: FloorName | None
    call: CommandProgress
    door_is_held: bool
    """Everything that holds the doors of the session's floor is on and verified."""
    door_is_given: bool
    """Something that holds a door is on, or requested."""
    door_is_free: bool
    """Nothing of ours holds a door, and that is verified."""
    hold_spent: bool
    hold_limited_by: str
    """Who limits the hold of a door, for messages."""
    in_place: CommandProgress
    robot_left: CommandProgress
    close: CommandProgress
    waiting_for: str
    """What the session waits for."""


@dataclass(frozen=True, slots=True)
class PendingCommand:
    """A command that has not ended."""

    kind: CommandType
    floor: FloorName | None
    """The target of the session that it was made for."""
    waiting_for: str = ""
    pressed: bool = False
    """Something was given to the lift for it, or was on already."""
    due_since: float | None = None
    """Since when only the door itself is awaited."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The end of a command."""

    state: CommandState
    reason: str = ""
    proof: Proof = Proof.NONE


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """One command of a session as it is remembered."""

    request: CommandRequest
    status: CommandStatus
    pending: PendingCommand | None
    is_recorded: bool
    """It has a row of its own in the journal, and so its end has."""


@dataclass(frozen=True, slots=True)
class PastSession:
    """A session that is over, as it is remembered."""

    info: SessionInfo
    key: str = field(repr=False)
    key_ttl_s: float | None
    over_at: float
    commands: tuple[CommandEntry, ...]


@dataclass(frozen=True, slots=True)
class SavedCommand:
    """A command that was given with an idempotency key, as it outlives the manager."""

    request: CommandRequest
    status: CommandStatus
    pressed: bool
    """Something was given to the lift for it, or may have been."""


@dataclass(frozen=True, slots=True)
class SavedPast:
    """A session that is over and was opened with an idempotency key, as it outlives the manager."""

    info: SessionInfo
    key: str = field(repr=False)
    key_ttl_s: float | None
    commands: tuple[SavedCommand, ...]


def saved_commands(entries: tuple[CommandEntry, ...]) -> tuple[SavedCommand, ...]:
    """Return the newest commands that have keys: a caller that lost the reply over a restart repeats the request with the same key."""
    keyed = [entry for entry in entries if entry.request.key][-SAVED_COMMANDS:]
    return tuple(
        SavedCommand(entry.request, entry.status, entry.pending is not None and entry.pending.pressed)
        for entry in keyed
    )


def restored_commands(saved: tuple[SavedCommand, ...], at: datetime) -> tuple[CommandEntry, ...]:
    """Return saved commands at the next start; those that had not ended are not followed any more."""
    entries = []
    for one in saved:
        entry = CommandEntry(one.request, one.status, None, is_recorded=True)
        if one.status.state is CommandState.PENDING:
            pending = PendingCommand(one.request.kind, one.request.floor, pressed=one.pressed)
            entry = ended_entry(entry, broken_off(pending, RESTARTED), at)
        entries.append(entry)
    return tuple(entries)


def judge_command(pending: PendingCommand, lift: SessionOnLift, now: float) -> PendingCommand | Verdict:
    """Return how a command continues, or its end."""
    return _JUDGES[pending.kind](pending, lift, now)


def broken_off(pending: PendingCommand, reason: str) -> Verdict:
    """Return the end of a command that is no longer followed."""
    return Verdict(CommandState.UNCONFIRMED if pending.pressed else CommandState.REJECTED, reason)


def replaces(kind: CommandType, floor: FloorName | None, pending: PendingCommand, *, hold_door: bool) -> bool:
    """Whether a new command ends a pending one; the same command again does not. `floor` and `hold_door` are the session's then."""
    if pending.kind is CommandType.GO_TO:
        return kind is CommandType.GO_TO and floor != pending.floor
    if pending.kind in ROBOT_WORDS:
        return kind in ROBOT_WORDS and kind is not pending.kind
    if kind is not CommandType.GO_TO:
        return kind in _DOOR_COMMANDS and kind is not pending.kind
    is_elsewhere = floor != pending.floor
    if pending.kind is CommandType.HOLD_DOOR:
        return is_elsewhere or not hold_door
    # a car that goes elsewhere has its door released first
    return pending.kind is CommandType.CLOSE_DOOR or (hold_door and not is_elsewhere)


def ended_entry(entry: CommandEntry, verdict: Verdict, at: datetime) -> CommandEntry:
    """Return a command with its end."""
    status = replace(entry.status, state=verdict.state, reason=verdict.reason, proof=verdict.proof, ended_at=at)
    return replace(entry, status=status, pending=None)


def _go_to(pending: PendingCommand, lift: SessionOnLift, _: float) -> PendingCommand | Verdict:
    call = lift.call
    if lift.floor != pending.floor:
        return broken_off(pending, REPLACED)
    if call.phase is CallPhase.ARRIVED:
        return Verdict(CommandState.CONFIRMED, proof=_proof(call.outcome, Proof.EFFECT))
    if call.phase is CallPhase.CONFIRMED:
        # where no call moves the occupied car, the report that the robot is in place has started it
        return Verdict(CommandState.CONFIRMED, proof=_proof(call.outcome, _proof(lift.in_place.outcome, Proof.NONE)))
    return _by_progress(pending, call, lift, f"the call to {pending.floor}")


def _hold_door(pending: PendingCommand, lift: SessionOnLift, now: float) -> PendingCommand | Verdict:
    if lift.floor != pending.floor:
        return broken_off(pending, REPLACED)
    if lift.hold_spent:
        return broken_off(
            pending, f"the door was held for as long as {lift.hold_limited_by} allows in one stop, and is released"
        )
    call = lift.call
    if call.phase is CallPhase.FAILED:
        return broken_off(pending, f"the call to {pending.floor} failed: {call.reason}")
    if call.phase is not CallPhase.ARRIVED:
        waiting_for = lift.waiting_for or f"the car to stand at {pending.floor}"
        return replace(pending, waiting_for=waiting_for, due_since=None)
    if lift.door_is_held:
        return Verdict(CommandState.CONFIRMED, proof=Proof.READBACK)
    since = _due_since(pending, now)
    after = replace(pending, pressed=pending.pressed or lift.door_is_given, due_since=since)
    if now - since <= DOOR_WITHIN_S:
        return replace(after, waiting_for=lift.waiting_for or "the lift to show that the door is held")
    why = f": the session waits for {lift.waiting_for}" if lift.waiting_for else ""
    return broken_off(after, f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is held{why}")


def _end_door_hold(pending: PendingCommand, lift: SessionOnLift, now: float) -> PendingCommand | Verdict:
    if lift.door_is_free:
        return Verdict(CommandState.CONFIRMED, proof=Proof.READBACK if pending.pressed else Proof.NONE)
    since = _due_since(pending, now)
    if now - since <= DOOR_WITHIN_S:
        waiting_for = "the lift to show that the door is released"
        return replace(pending, waiting_for=waiting_for, pressed=True, due_since=since)
    why = f"the lift did not show within {DOOR_WITHIN_S:g} s that the door is released; the release is repeated until it does"
    return Verdict(CommandState.UNCONFIRMED, why)


def _close_door(pending: PendingCommand, lift: SessionOnLift, _: float) -> PendingCommand | Verdict:
    if lift.close.phase is CallPhase.CONFIRMED:
        return Verdict(CommandState.CONFIRMED, proof=_proof(lift.close.outcome, Proof.NONE))
    return _by_progress(pending, lift.close, lift, "the close button")


def _robot_in_place(pending: PendingCommand, lift: SessionOnLift, _: float) -> PendingCommand | Verdict:
    return _robot_word(pending, lift.in_place, lift)


def _robot_left(pending: PendingCommand, lift: SessionOnLift, _: float) -> PendingCommand | Verdict:
    return _robot_word(pending, lift.robot_left, lift)


def _robot_word(pending: PendingCommand, word: CommandProgress, lift: SessionOnLift) -> PendingCommand | Verdict:
    if word.phase is None:
        return Verdict(CommandState.CONFIRMED)
    if word.phase is CallPhase.CONFIRMED:
        return Verdict(CommandState.CONFIRMED, proof=_proof(word.outcome, Proof.NONE))
    return _by_progress(pending, word, lift, pending.kind)


def _by_progress(
    pending: PendingCommand, progress: CommandProgress, lift: SessionOnLift, what: str
) -> PendingCommand | Verdict:
    """Judge a command that the lift has not taken and that is not superfluous."""
    outcome = progress.outcome
    if progress.phase is CallPhase.PRESSED:
        return replace(pending, pressed=True, waiting_for="the lift to show that it has taken it")
    if progress.phase is CallPhase.REQUESTED:
        not_sent = outcome is not None and outcome.grant_missing
        waiting_for = lift.waiting_for or "its button to be pressed"
        return replace(pending, waiting_for=waiting_for, pressed=pending.pressed and not not_sent)
    if progress.phase is None:
        return broken_off(pending, f"{what} is no longer requested")
    if not pending.pressed:
        pause = f"; it may be pressed again in {progress.again_in_s:.1f} s" if progress.again_in_s > 0 else ""
        return Verdict(CommandState.REJECTED, f"{what} is not pressed: {progress.reason}{pause}")
    if outcome is not None and outcome.result is Result.REJECTED:
        return Verdict(CommandState.REJECTED, outcome.reason)
    return Verdict(CommandState.UNCONFIRMED, outcome.reason if outcome is not None else progress.reason)


def _due_since(pending: PendingCommand, now: float) -> float:
    return now if pending.due_since is None else pending.due_since


def _proof(outcome: Outcome | None, otherwise: Proof) -> Proof:
    return outcome.proof if outcome is not None and outcome.result is Result.CONFIRMED else otherwise


_JUDGES: Mapping[CommandType, Callable[[PendingCommand, SessionOnLift, float], PendingCommand | Verdict]] = {
    CommandType.GO_TO: _go_to,
    CommandType.HOLD_DOOR: _hold_door,
    CommandType.RELEASE_DOOR: _end_door_hold,
    CommandType.CLOSE_DOOR: _close_door,
    CommandType.ROBOT_IN_PLACE: _robot_in_place,
    CommandType.ROBOT_LEFT: _robot_left,
}
