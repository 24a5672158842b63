"""What becomes of each request within a session: every way in which it goes on, and every end."""

from dataclasses import replace
from typing import Any

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.domain.call import Call, CallPhase
from lift_manager.domain.following import (
    DOOR_WITHIN_S,
    TAKEN,
    Pending,
    Told,
    Verdict,
    View,
    broken_off,
    how_far,
    judge,
    takes_place_of,
)
from lift_manager.domain.session_requests import Do, Status

NOW = 100.0
ANY = Command(CommandKind.CLOSE_DOOR)
LAMP = Outcome(ANY, Result.CONFIRMED, proof=Proof.LAMP)
NO = Outcome(ANY, Result.REJECTED, "the controller said no")
SILENT = Outcome(ANY, Result.UNCONFIRMED, "nothing came back")
NOT_SENT = Outcome(ANY, Result.REJECTED, "may not be pressed", not_granted=True)
IDLE = View(
    floor="L1",
    call=Told(),
    door_held=False,
    door_given=False,
    door_free=False,
    hold_spent=False,
    in_place=Told(),
    left=Told(),
    close=Told(),
    waits="",
)
THERE = Told(CallPhase.ARRIVED)
TELLING = [(Do.GO_TO, "call"), (Do.ROBOT_IN_PLACE, "in_place"), (Do.ROBOT_LEFT, "left"), (Do.CLOSE_DOOR, "close")]
"""Requests for which something is pressed, and where a view has it."""
WHAT = {
    Do.GO_TO: "the call to L1",
    Do.ROBOT_IN_PLACE: "robot_in_place",
    Do.ROBOT_LEFT: "robot_left",
    Do.CLOSE_DOOR: "the close button",
}
telling = pytest.mark.parametrize(("do", "what"), TELLING)


def judged(do: Do, *, pressed: bool = False, due_since: float | None = None, **seen: Any) -> Pending | Verdict:
    return judge(Pending(do, "L1", pressed=pressed, due_since=due_since), replace(IDLE, **seen), NOW)


def goes_on(do: Do, **seen: Any) -> Pending:
    after = judged(do, **seen)
    assert isinstance(after, Pending), after
    return after


@telling
def test_what_is_not_pressed_yet_waits_for_what_the_session_waits_for(do: Do, what: str) -> None:
    wanted: dict[str, Any] = {what: Told(CallPhase.WANTED)}
    assert goes_on(do, **wanted, waits="people").waits == "people"
    assert goes_on(do, **wanted).waits == "its button to be pressed"
    assert not goes_on(do, **wanted).pressed


@telling
def test_what_is_pressed_waits_for_the_lift(do: Do, what: str) -> None:
    after = goes_on(do, **{what: Told(CallPhase.PRESSED)})
    assert (after.pressed, after.waits) == (True, "the lift to show that it has taken it")


@telling
@pytest.mark.parametrize(("outcome", "pressed"), [(None, True), (SILENT, True), (NOT_SENT, False)])
def test_what_is_wanted_once_more_was_pressed_unless_nothing_was_sent(
    do: Do, what: str, outcome: Outcome | None, pressed: bool
) -> None:
    seen: dict[str, Any] = {"pressed": True, what: Told(CallPhase.WANTED, outcome=outcome)}
    assert goes_on(do, **seen).pressed is pressed


@telling
@pytest.mark.parametrize(("outcome", "proof"), [(LAMP, Proof.LAMP), (None, Proof.NONE), (SILENT, Proof.NONE)])
def test_what_the_lift_has_taken_is_confirmed_by_its_own_proof(
    do: Do, what: str, outcome: Outcome | None, proof: Proof
) -> None:
    told: dict[str, Any] = {what: Told(CallPhase.CONFIRMED, outcome=outcome)}
    assert judged(do, **told) == Verdict(Status.CONFIRMED, proof=proof)


@telling
@pytest.mark.parametrize(("again_in_s", "pause"), [(0.0, ""), (2.5, "; it may be pressed again in 2.5 s")])
def test_what_failed_before_it_was_pressed_is_rejected(do: Do, what: str, again_in_s: float, pause: str) -> None:
    told: dict[str, Any] = {what: Told(CallPhase.FAILED, "the mode is fire", again_in_s)}
    assert judged(do, **told) == Verdict(Status.REJECTED, f"{WHAT[do]} is not pressed: the mode is fire{pause}")


@telling
@pytest.mark.parametrize(
    ("outcome", "status", "reason"),
    [
        (NO, Status.REJECTED, "the controller said no"),
        (SILENT, Status.UNCONFIRMED, "nothing came back"),
        (None, Status.UNCONFIRMED, "nobody came"),
    ],
)
def test_what_failed_after_it_was_pressed_ends_as_its_press_did(
    do: Do, what: str, outcome: Outcome | None, status: Status, reason: str
) -> None:
    told: dict[str, Any] = {what: Told(CallPhase.FAILED, "nobody came", outcome=outcome)}
    assert judged(do, pressed=True, **told) == Verdict(status, reason)


@pytest.mark.parametrize("do", [Do.GO_TO, Do.CLOSE_DOOR])
@pytest.mark.parametrize(("pressed", "status"), [(False, Status.REJECTED), (True, Status.UNCONFIRMED)])
def test_what_nobody_wants_any_more_is_over(do: Do, pressed: bool, status: Status) -> None:
    assert judged(do, pressed=pressed) == Verdict(status, f"{WHAT[do]} is no longer wanted")


@pytest.mark.parametrize("do", [Do.ROBOT_IN_PLACE, Do.ROBOT_LEFT])
def test_a_word_that_the_lift_need_not_hear_is_confirmed_without_a_proof(do: Do) -> None:
    assert judged(do) == Verdict(Status.CONFIRMED, proof=Proof.NONE)


@pytest.mark.parametrize(("outcome", "proof"), [(LAMP, Proof.LAMP), (None, Proof.EFFECT), (SILENT, Proof.EFFECT)])
def test_a_car_that_is_there_confirms_the_call(outcome: Outcome | None, proof: Proof) -> None:
    assert judged(Do.GO_TO, call=replace(THERE, outcome=outcome)) == Verdict(Status.CONFIRMED, proof=proof)


def test_a_call_that_the_word_of_the_robot_sent_on_has_the_proof_of_that_word() -> None:
    seen: dict[str, Any] = {"call": Told(CallPhase.CONFIRMED), "in_place": Told(CallPhase.CONFIRMED, outcome=LAMP)}
    assert judged(Do.GO_TO, **seen) == Verdict(Status.CONFIRMED, proof=Proof.LAMP)


@pytest.mark.parametrize("do", [Do.GO_TO, Do.HOLD_DOOR])
@pytest.mark.parametrize(("pressed", "status"), [(False, Status.REJECTED), (True, Status.UNCONFIRMED)])
def test_a_request_for_a_floor_is_over_when_the_session_goes_elsewhere(do: Do, pressed: bool, status: Status) -> None:
    assert judged(do, floor="L2", pressed=pressed, call=THERE) == Verdict(status, TAKEN)


def test_a_hold_waits_for_the_car() -> None:
    wanted = Told(CallPhase.WANTED)
    assert goes_on(Do.HOLD_DOOR, call=wanted).waits == "the car to stand at L1"
    assert goes_on(Do.HOLD_DOOR, call=wanted, waits="people", due_since=1.0) == Pending(Do.HOLD_DOOR, "L1", "people")


def test_a_hold_fails_with_its_call() -> None:
    said = "the call to L1 failed: it is locked"
    assert judged(Do.HOLD_DOOR, call=Told(CallPhase.FAILED, "it is locked")) == Verdict(Status.REJECTED, said)


def test_a_hold_that_is_spent_is_over() -> None:
    after = judged(Do.HOLD_DOOR, call=THERE, hold_spent=True, door_held=True, pressed=True)
    assert isinstance(after, Verdict)
    assert (after.status, "as long as the site allows" in after.reason) == (Status.UNCONFIRMED, True)


def test_a_hold_that_is_seen_on_is_confirmed() -> None:
    assert judged(Do.HOLD_DOOR, call=THERE, door_held=True) == Verdict(Status.CONFIRMED, proof=Proof.READBACK)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("waits", ["", "people"])
def test_a_hold_that_is_not_seen_on_is_given_up(given: bool, waits: str) -> None:
    seen: dict[str, Any] = {"call": THERE, "door_given": given, "waits": waits}
    first = goes_on(Do.HOLD_DOOR, **seen)
    assert first == Pending(Do.HOLD_DOOR, "L1", waits or "the lift to show that the door is held", given, NOW)
    assert goes_on(Do.HOLD_DOOR, due_since=NOW - DOOR_WITHIN_S, **seen).due_since == NOW - DOOR_WITHIN_S
    said = "the lift did not show within 10 s that the door is held" + (
        ": the session waits for people" if waits else ""
    )
    status = Status.UNCONFIRMED if given else Status.REJECTED
    assert judged(Do.HOLD_DOOR, due_since=NOW - DOOR_WITHIN_S - 0.1, **seen) == Verdict(status, said)


@pytest.mark.parametrize(("pressed", "proof"), [(False, Proof.NONE), (True, Proof.READBACK)])
def test_a_door_that_nothing_holds_is_let_go(pressed: bool, proof: Proof) -> None:
    assert judged(Do.LET_GO_DOOR, pressed=pressed, door_free=True) == Verdict(Status.CONFIRMED, proof=proof)


def test_a_door_that_is_not_seen_let_go_is_unconfirmed() -> None:
    first = goes_on(Do.LET_GO_DOOR)
    assert first == Pending(
        Do.LET_GO_DOOR, "L1", "the lift to show that the door is let go", pressed=True, due_since=NOW
    )
    assert isinstance(judged(Do.LET_GO_DOOR, due_since=NOW - DOOR_WITHIN_S), Pending)
    over = judged(Do.LET_GO_DOOR, due_since=NOW - DOOR_WITHIN_S - 0.1)
    assert isinstance(over, Verdict)
    assert (over.status, "not show within 10 s that the door is let go" in over.reason) == (Status.UNCONFIRMED, True)


@pytest.mark.parametrize("do", Do)
def test_what_is_broken_off_is_unconfirmed_only_if_it_may_have_been_sent(do: Do) -> None:
    assert broken_off(Pending(do, "L1"), "why") == Verdict(Status.REJECTED, "why")
    assert broken_off(Pending(do, "L1", pressed=True), "why") == Verdict(Status.UNCONFIRMED, "why")


PLACE: list[tuple[Do, str, bool, set[Do]]] = [
    (Do.GO_TO, "L1", True, {Do.LET_GO_DOOR, Do.CLOSE_DOOR}),
    (Do.GO_TO, "L1", False, {Do.HOLD_DOOR, Do.CLOSE_DOOR}),
    (Do.GO_TO, "L2", True, {Do.GO_TO, Do.HOLD_DOOR, Do.CLOSE_DOOR}),
    (Do.GO_TO, "L2", False, {Do.GO_TO, Do.HOLD_DOOR, Do.CLOSE_DOOR}),
    (Do.HOLD_DOOR, "L1", True, {Do.LET_GO_DOOR, Do.CLOSE_DOOR}),
    (Do.LET_GO_DOOR, "L1", False, {Do.HOLD_DOOR, Do.CLOSE_DOOR}),
    (Do.CLOSE_DOOR, "L1", False, {Do.HOLD_DOOR, Do.LET_GO_DOOR}),
    (Do.ROBOT_IN_PLACE, "L1", True, {Do.ROBOT_LEFT}),
    (Do.ROBOT_LEFT, "L1", True, {Do.ROBOT_IN_PLACE}),
]


@pytest.mark.parametrize(("do", "floor", "hold", "displaced"), PLACE)
def test_a_request_takes_the_place_of_what_it_contradicts(do: Do, floor: str, hold: bool, displaced: set[Do]) -> None:
    pending = {other: Pending(other, "L1") for other in Do}
    assert {other for other, one in pending.items() if takes_place_of(do, floor, one, hold_door=hold)} == displaced


def test_how_far_a_call_is_says_when_it_may_be_pressed_again() -> None:
    assert how_far(None, LAMP, NOW) == Told()
    failed = Call("L1", CallPhase.FAILED, since=90.0, not_before=104.0, reason="why")
    assert how_far(failed, SILENT, NOW) == Told(CallPhase.FAILED, "why", 4.0, SILENT)
    assert how_far(failed, None, 105.0).again_in_s == 0.0
