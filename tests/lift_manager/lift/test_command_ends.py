"""What becomes of each command within a session: every way in which it goes on, and every end."""

from dataclasses import replace
from typing import Any

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.lift.call import Call, CallPhase
from lift_manager.lift.commands import (
    DOOR_WITHIN_S,
    REPLACED,
    CommandProgress,
    CommandState,
    CommandType,
    PendingCommand,
    SessionOnLift,
    Verdict,
    broken_off,
    judge_command,
    progress_of,
    replaces,
)
from tests.support.rows import each_row

NOW = 100.0
ANY = Command(CommandKind.CLOSE_DOOR)
LAMP = Outcome(ANY, Result.CONFIRMED, proof=Proof.LAMP)
NO = Outcome(ANY, Result.REJECTED, "the controller said no")
SILENT = Outcome(ANY, Result.UNCONFIRMED, "nothing came back")
NOT_SENT = Outcome(ANY, Result.REJECTED, "may not be pressed", grant_missing=True)
IDLE = SessionOnLift(
    floor="L1",
    call=CommandProgress(),
    door_is_held=False,
    door_is_given=False,
    door_is_free=False,
    hold_spent=False,
    hold_limited_by="the site",
    in_place=CommandProgress(),
    robot_left=CommandProgress(),
    close=CommandProgress(),
    waiting_for="",
)
THERE = CommandProgress(CallPhase.ARRIVED)
PRESSED_FOR = [
    (CommandType.GO_TO, "call"),
    (CommandType.ROBOT_IN_PLACE, "in_place"),
    (CommandType.ROBOT_LEFT, "robot_left"),
    (CommandType.CLOSE_DOOR, "close"),
]
"""Commands for which something is pressed, and where a session has it."""
WHAT = {
    CommandType.GO_TO: "the call to L1",
    CommandType.ROBOT_IN_PLACE: "robot_in_place",
    CommandType.ROBOT_LEFT: "robot_left",
    CommandType.CLOSE_DOOR: "the close button",
}
pressed_for = each_row(("kind", "what"), PRESSED_FOR)


def judged(
    kind: CommandType, *, pressed: bool = False, due_since: float | None = None, **seen: Any
) -> PendingCommand | Verdict:
    return judge_command(PendingCommand(kind, "L1", pressed=pressed, due_since=due_since), replace(IDLE, **seen), NOW)


def goes_on(kind: CommandType, **seen: Any) -> PendingCommand:
    after = judged(kind, **seen)
    assert isinstance(after, PendingCommand), after
    return after


@pressed_for
def test_what_is_not_pressed_yet_waits_for_what_the_session_waits_for(kind: CommandType, what: str) -> None:
    wanted: dict[str, Any] = {what: CommandProgress(CallPhase.REQUESTED)}
    assert goes_on(kind, **wanted, waiting_for="people").waiting_for == "people"
    assert goes_on(kind, **wanted).waiting_for == "its button to be pressed"
    assert not goes_on(kind, **wanted).pressed


@pressed_for
def test_what_is_pressed_waits_for_the_lift(kind: CommandType, what: str) -> None:
    after = goes_on(kind, **{what: CommandProgress(CallPhase.PRESSED)})
    assert (after.pressed, after.waiting_for) == (True, "the lift to show that it has taken it")


@pressed_for
@each_row(("outcome", "pressed"), [(None, True), (SILENT, True), (NOT_SENT, False)])
def test_what_is_wanted_once_more_was_pressed_unless_nothing_was_sent(
    kind: CommandType, what: str, outcome: Outcome | None, pressed: bool
) -> None:
    seen: dict[str, Any] = {"pressed": True, what: CommandProgress(CallPhase.REQUESTED, outcome=outcome)}
    assert goes_on(kind, **seen).pressed is pressed


@pressed_for
@each_row(("outcome", "proof"), [(LAMP, Proof.LAMP), (None, Proof.NONE), (SILENT, Proof.NONE)])
def test_what_the_lift_has_taken_is_confirmed_by_its_own_proof(
    kind: CommandType, what: str, outcome: Outcome | None, proof: Proof
) -> None:
    told: dict[str, Any] = {what: CommandProgress(CallPhase.CONFIRMED, outcome=outcome)}
    assert judged(kind, **told) == Verdict(CommandState.CONFIRMED, proof=proof)


@pressed_for
@each_row(("again_in_s", "pause"), [(0.0, ""), (2.5, "; it may be pressed again in 2.5 s")])
def test_what_failed_before_it_was_pressed_is_rejected(
    kind: CommandType, what: str, again_in_s: float, pause: str
) -> None:
    told: dict[str, Any] = {what: CommandProgress(CallPhase.FAILED, "the mode is fire", again_in_s)}
    assert judged(kind, **told) == Verdict(
        CommandState.REJECTED, f"{WHAT[kind]} is not pressed: the mode is fire{pause}"
    )


@pressed_for
@each_row(
    ("outcome", "status", "reason"),
    [
        (NO, CommandState.REJECTED, "the controller said no"),
        (SILENT, CommandState.UNCONFIRMED, "nothing came back"),
        (None, CommandState.UNCONFIRMED, "nobody came"),
    ],
)
def test_what_failed_after_it_was_pressed_ends_as_its_press_did(
    kind: CommandType, what: str, outcome: Outcome | None, status: CommandState, reason: str
) -> None:
    told: dict[str, Any] = {what: CommandProgress(CallPhase.FAILED, "nobody came", outcome=outcome)}
    assert judged(kind, pressed=True, **told) == Verdict(status, reason)


@each_row("kind", [CommandType.GO_TO, CommandType.CLOSE_DOOR])
@each_row(("pressed", "status"), [(False, CommandState.REJECTED), (True, CommandState.UNCONFIRMED)])
def test_what_nobody_wants_any_more_is_over(kind: CommandType, pressed: bool, status: CommandState) -> None:
    assert judged(kind, pressed=pressed) == Verdict(status, f"{WHAT[kind]} is no longer requested")


@pytest.mark.parametrize("kind", [CommandType.ROBOT_IN_PLACE, CommandType.ROBOT_LEFT])
def test_a_word_that_the_lift_need_not_hear_is_confirmed_without_a_proof(kind: CommandType) -> None:
    assert judged(kind) == Verdict(CommandState.CONFIRMED, proof=Proof.NONE)


@each_row(("outcome", "proof"), [(LAMP, Proof.LAMP), (None, Proof.EFFECT), (SILENT, Proof.EFFECT)])
def test_a_car_that_is_there_confirms_the_call(outcome: Outcome | None, proof: Proof) -> None:
    assert judged(CommandType.GO_TO, call=replace(THERE, outcome=outcome)) == Verdict(
        CommandState.CONFIRMED, proof=proof
    )


def test_a_call_that_the_word_of_the_robot_sent_on_has_the_proof_of_that_word() -> None:
    seen: dict[str, Any] = {
        "call": CommandProgress(CallPhase.CONFIRMED),
        "in_place": CommandProgress(CallPhase.CONFIRMED, outcome=LAMP),
    }
    assert judged(CommandType.GO_TO, **seen) == Verdict(CommandState.CONFIRMED, proof=Proof.LAMP)


@each_row("kind", [CommandType.GO_TO, CommandType.HOLD_DOOR])
@each_row(("pressed", "status"), [(False, CommandState.REJECTED), (True, CommandState.UNCONFIRMED)])
def test_a_command_for_a_floor_is_over_when_the_session_goes_elsewhere(
    kind: CommandType, pressed: bool, status: CommandState
) -> None:
    assert judged(kind, floor="L2", pressed=pressed, call=THERE) == Verdict(status, REPLACED)


def test_a_hold_waits_for_the_car() -> None:
    wanted = CommandProgress(CallPhase.REQUESTED)
    assert goes_on(CommandType.HOLD_DOOR, call=wanted).waiting_for == "the car to stand at L1"
    assert goes_on(CommandType.HOLD_DOOR, call=wanted, waiting_for="people", due_since=1.0) == PendingCommand(
        CommandType.HOLD_DOOR, "L1", "people"
    )


def test_a_hold_fails_with_its_call() -> None:
    said = "the call to L1 failed: it is locked"
    assert judged(CommandType.HOLD_DOOR, call=CommandProgress(CallPhase.FAILED, "it is locked")) == Verdict(
        CommandState.REJECTED, said
    )


def test_a_hold_that_is_spent_is_over() -> None:
    after = judged(CommandType.HOLD_DOOR, call=THERE, hold_spent=True, door_is_held=True, pressed=True)
    assert isinstance(after, Verdict)
    assert (after.state, "as long as the site allows" in after.reason) == (CommandState.UNCONFIRMED, True)


def test_a_hold_that_is_seen_on_is_confirmed() -> None:
    assert judged(CommandType.HOLD_DOOR, call=THERE, door_is_held=True) == Verdict(
        CommandState.CONFIRMED, proof=Proof.READBACK
    )


@each_row("given", [False, True])
@each_row("waits", ["", "people"])
def test_a_hold_that_is_not_seen_on_is_given_up(given: bool, waits: str) -> None:
    seen: dict[str, Any] = {"call": THERE, "door_is_given": given, "waiting_for": waits}
    first = goes_on(CommandType.HOLD_DOOR, **seen)
    assert first == PendingCommand(
        CommandType.HOLD_DOOR, "L1", waits or "the lift to show that the door is held", given, NOW
    )
    assert goes_on(CommandType.HOLD_DOOR, due_since=NOW - DOOR_WITHIN_S, **seen).due_since == NOW - DOOR_WITHIN_S
    said = "the lift did not show within 10 s that the door is held" + (
        ": the session waits for people" if waits else ""
    )
    status = CommandState.UNCONFIRMED if given else CommandState.REJECTED
    assert judged(CommandType.HOLD_DOOR, due_since=NOW - DOOR_WITHIN_S - 0.1, **seen) == Verdict(status, said)


@pytest.mark.parametrize(("pressed", "proof"), [(False, Proof.NONE), (True, Proof.READBACK)])
def test_a_door_that_nothing_holds_is_let_go(pressed: bool, proof: Proof) -> None:
    assert judged(CommandType.RELEASE_DOOR, pressed=pressed, door_is_free=True) == Verdict(
        CommandState.CONFIRMED, proof=proof
    )


def test_a_door_that_is_not_seen_let_go_is_unconfirmed() -> None:
    first = goes_on(CommandType.RELEASE_DOOR)
    assert first == PendingCommand(
        CommandType.RELEASE_DOOR, "L1", "the lift to show that the door is released", pressed=True, due_since=NOW
    )
    assert isinstance(judged(CommandType.RELEASE_DOOR, due_since=NOW - DOOR_WITHIN_S), PendingCommand)
    over = judged(CommandType.RELEASE_DOOR, due_since=NOW - DOOR_WITHIN_S - 0.1)
    assert isinstance(over, Verdict)
    assert (over.state, "not show within 10 s that the door is released" in over.reason) == (
        CommandState.UNCONFIRMED,
        True,
    )


@each_row("kind", CommandType)
def test_what_is_broken_off_is_unconfirmed_only_if_it_may_have_been_sent(kind: CommandType) -> None:
    assert broken_off(PendingCommand(kind, "L1"), "why") == Verdict(CommandState.REJECTED, "why")
    assert broken_off(PendingCommand(kind, "L1", pressed=True), "why") == Verdict(CommandState.UNCONFIRMED, "why")


PLACE: list[tuple[CommandType, str, bool, set[CommandType]]] = [
    (CommandType.GO_TO, "L1", True, {CommandType.RELEASE_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.GO_TO, "L1", False, {CommandType.HOLD_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.GO_TO, "L2", True, {CommandType.GO_TO, CommandType.HOLD_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.GO_TO, "L2", False, {CommandType.GO_TO, CommandType.HOLD_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.HOLD_DOOR, "L1", True, {CommandType.RELEASE_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.RELEASE_DOOR, "L1", False, {CommandType.HOLD_DOOR, CommandType.CLOSE_DOOR}),
    (CommandType.CLOSE_DOOR, "L1", False, {CommandType.HOLD_DOOR, CommandType.RELEASE_DOOR}),
    (CommandType.ROBOT_IN_PLACE, "L1", True, {CommandType.ROBOT_LEFT}),
    (CommandType.ROBOT_LEFT, "L1", True, {CommandType.ROBOT_IN_PLACE}),
]


@each_row(("kind", "floor", "hold", "displaced"), PLACE)
def test_a_command_takes_the_place_of_what_it_contradicts(
    kind: CommandType, floor: str, hold: bool, displaced: set[CommandType]
) -> None:
    pending = {other: PendingCommand(other, "L1") for other in CommandType}
    assert {other for other, one in pending.items() if replaces(kind, floor, one, hold_door=hold)} == displaced


def test_how_far_a_call_is_says_when_it_may_be_pressed_again() -> None:
    assert progress_of(None, NOW) == CommandProgress()
    failed = Call("L1", CallPhase.FAILED, since=90.0, not_before=104.0, reason="why", outcome=SILENT)
    assert progress_of(failed, NOW) == CommandProgress(CallPhase.FAILED, "why", 4.0, SILENT)
    assert progress_of(failed, 105.0).again_in_s == 0.0
