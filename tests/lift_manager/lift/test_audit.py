"""Rows: how events and requests are worded, what has a row of its own, and what is only counted."""

from dataclasses import fields, replace
from typing import get_args

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from drivers.rate_limits import CALLERS, SUMMARY_EVERY_S
from lift_manager.lift.audit import REQUEST_ROWS, RequestRows, row_of, words_of
from lift_manager.lift.commands import CommandRequest, CommandState, CommandStatus, CommandType
from lift_manager.lift.events import (
    Acknowledged,
    Advised,
    Alarm,
    Cause,
    CommandEnded,
    CommandFollowed,
    Event,
    ForceReleased,
    HandedOver,
    Restriction,
    RestrictionBegun,
    RestrictionEnded,
    RestrictionKind,
    SessionEnded,
    SessionOpened,
    SessionRestored,
)
from lift_manager.lift.inputs import CloseSession, GiveCommand, LiftRequest, Request
from lift_manager.lift.journal import Row, RowKind
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Advice, EndReason, Holder
from tests.lift_manager.lift.paper import NOON, ROBOT
from tests.support.rows import each_row

HELD = Refused(Refusal.HELD, "held by r2")


def asked(floor: str = "L2", holder: Holder = ROBOT) -> LiftRequest:
    return LiftRequest(holder, floor, hold_door=True)


def taken(
    rows: RequestRows, request: Request, now: float, refused: Refused | None = None, *, known: bool = True
) -> tuple[RequestRows, list[str]]:
    after, made = rows.take(words_of(request), refused, now, known=known)
    return after, [row.text for row in made]


def test_a_request_and_its_refusal_have_rows() -> None:
    rows, made = taken(RequestRows("lift"), asked(), 0.0)
    assert made == ["requests L2, hold the door there"]
    _, made = taken(rows, asked("L3"), 1.0, HELD)
    assert made == ["requests L3, hold the door there", "refused: held by r2"]


def test_repeats_are_counted_and_told_once_a_minute() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    for second in range(1, round(SUMMARY_EVERY_S) + 1):
        rows, made = taken(rows, asked(), float(second))
        assert made == []
    _, made = taken(rows, asked(), SUMMARY_EVERY_S + 1)
    assert made == ["requests L2 again, 61 times within 60 s, with the same answer"]


def test_what_two_callers_repeat_in_turn_is_counted_for_each() -> None:
    rows, texts = RequestRows("lift"), list[str]()
    for second in range(30):
        for request, refused in ((asked(), None), (asked("L1", AMR), HELD)):
            rows, made = taken(rows, request, float(second), refused)
            texts += made
    assert texts == ["requests L2, hold the door there", "requests L1, hold the door there", "refused: held by r2"]


def test_a_repeat_with_another_answer_has_a_row() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    _, made = taken(rows, asked(), 1.0, HELD)
    assert made == ["requests L2, hold the door there", "refused: held by r2"]


def test_a_press_tells_what_was_only_counted_before() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    rows, _ = taken(rows, asked(), 1.0)
    rows, made = rows.report(ROBOT, 2.0)
    assert [row.text for row in made] == ["requests L2 again, once within 1 s, with the same answer"]
    assert rows.report_due(100.0, end=True)[1] == ()


@each_row(
    ("more", "text"), [(1, "once more within 1 s: 1 accepted"), (4, "4 more times within 1 s: 2 accepted, 2 held")]
)
def test_more_than_its_share_of_a_minute_is_counted_by_answer(more: int, text: str) -> None:
    rows = RequestRows("lift")
    for number in range(REQUEST_ROWS + more):
        rows, _ = taken(rows, asked(f"L{number}"), 1.0, HELD if number % 2 else None)
    _, made = rows.report_due(2.0, end=True)
    assert [row.text for row in made] == [f"requests {text}"]


def test_floors_that_the_lift_does_not_have_are_one_request() -> None:
    rows, _ = taken(RequestRows("lift"), asked("x" * 100), 0.0, HELD, known=False)
    _, made = taken(rows, asked("y"), 1.0, HELD, known=False)
    assert made == []


def test_the_caller_that_was_silent_for_longest_is_forgotten_with_a_row() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    rows, _ = taken(rows, asked(), 0.5)
    made: list[str] = []
    for number in range(CALLERS):
        rows, made = taken(rows, asked(holder=Holder("api", f"r{number}")), 1.0)
    assert made[0] == "requests L2 again, once within 0 s, with the same answer"
    assert ROBOT not in rows.callers


def test_requests_are_written_down_without_ids_and_keys() -> None:
    command = CommandRequest(session="secret", holder=ROBOT, kind=CommandType.GO_TO, floor="L2", key="secret")
    closing = CloseSession("secret", ROBOT, RobotWord.LEFT)
    texts = [words_of(GiveCommand(command)).text, words_of(closing).text]
    assert texts == ["go_to L2 and hold the door there", "close its session, robot left"]


# -- events

WORKSHOP, AMR = Holder("workshop", "workshop"), Holder("rmf", "fleet/r1")
LOCKOUT = Restriction(RestrictionKind.LOCKOUT, "M. Weber", "door operator is replaced", NOON)
DRAIN = Restriction(RestrictionKind.DRAIN, "M. Weber", "door is serviced", NOON)
COMMAND = CommandStatus(
    id="unsaid",
    lift="east",
    holder=Holder("api", "amr-7"),
    kind=CommandType.GO_TO,
    floor="L2",
    state=CommandState.UNCONFIRMED,
    reason="the lamp did not light",
    proof=Proof.NONE,
    requested_at=NOON,
    ended_at=NOON,
)
EVENTS: list[tuple[Event, RowKind, str, str]] = [
    (SessionOpened("east", WORKSHOP, "L2"), RowKind.SESSION, "workshop", "workshop holds the lift, to L2"),
    (SessionOpened("east", WORKSHOP, None), RowKind.SESSION, "workshop", "workshop holds the lift"),
    (
        SessionEnded("east", WORKSHOP, EndReason.FIRE, "there is a fire", Advice.STAY_ABOARD),
        RowKind.SESSION,
        "workshop",
        "the session of workshop is over: there is a fire",
    ),
    (
        SessionRestored("east", WORKSHOP, "L2", "its door was held"),
        RowKind.SESSION,
        "workshop",
        "workshop holds the lift as before the restart, to L2: its door was held",
    ),
    (
        HandedOver("east", AMR, WORKSHOP),
        RowKind.SESSION,
        "rmf:fleet/r1",
        "rmf:fleet/r1 hands the lift over to workshop",
    ),
    (
        ForceReleased("east", "A. Novak", NOON, "robot is stuck", AMR, maybe_aboard=True),
        RowKind.PERSON,
        "A. Novak",
        "A. Novak took the lift from rmf:fleet/r1: robot is stuck",
    ),
    (
        Advised("east", AMR, Advice.CLEAR_DOORWAY, "there is a fire"),
        RowKind.SESSION,
        "rmf:fleet/r1",
        "rmf:fleet/r1 is advised clear_doorway: there is a fire",
    ),
    (
        RestrictionBegun("east", LOCKOUT),
        RowKind.PERSON,
        "M. Weber",
        "locked out by M. Weber: door operator is replaced",
    ),
    (
        RestrictionEnded("east", "A. Novak", NOON, LOCKOUT),
        RowKind.PERSON,
        "A. Novak",
        "the lockout by M. Weber is ended by A. Novak",
    ),
    (RestrictionBegun("east", DRAIN), RowKind.PERSON, "M. Weber", "drain begun by M. Weber: door is serviced"),
    (
        RestrictionEnded("east", "A. Novak", NOON, DRAIN),
        RowKind.PERSON,
        "A. Novak",
        "the drain by M. Weber is ended by A. Novak",
    ),
    (
        Acknowledged("east", "A. Novak", NOON, (Cause.FIRE, Cause.OCCUPIED)),
        RowKind.PERSON,
        "A. Novak",
        "fire and occupied acknowledged by A. Novak",
    ),
    (
        CommandEnded("east", Outcome(Command(CommandKind.GO_TO, "L2"), Result.REJECTED, "exception 04"), AMR),
        RowKind.OUTCOME,
        "rmf:fleet/r1",
        "go_to L2 rejected: exception 04",
    ),
    (
        CommandFollowed("east", COMMAND, is_recorded=True),
        RowKind.REQUEST,
        "api:amr-7",
        "go_to L2 unconfirmed: the lamp did not light",
    ),
    (Alarm("east", "the door was held for 900 s", WORKSHOP), RowKind.ALARM, "workshop", "the door was held for 900 s"),
    (Alarm("east", "fire"), RowKind.ALARM, "", "fire"),
]


@each_row(("event", "kind", "caller", "text"), EVENTS)
def test_an_event_has_a_row_with_lift_caller_and_words(event: Event, kind: RowKind, caller: str, text: str) -> None:
    row = row_of(event)
    assert row is not None
    assert (row.kind, row.lift, row.caller, row.text) == (kind, "east", caller, text)
    assert "unsaid" not in f"{row.data}"
    assert "\n" not in row.text


def test_every_kind_of_event_is_among_them() -> None:
    assert {type(event) for event, *_ in EVENTS} == set(get_args(Event))


@pytest.mark.parametrize(
    "event",
    [
        CommandFollowed("east", COMMAND, is_recorded=False),
        CommandFollowed("east", replace(COMMAND, state=CommandState.PENDING), is_recorded=True),
    ],
)
def test_a_command_that_is_pending_or_was_only_counted_has_no_row(event: Event) -> None:
    assert row_of(event) is None


def test_rows_are_plain_values() -> None:
    assert {field.name for field in fields(Row)} == {"kind", "text", "lift", "caller", "data", "event"}
