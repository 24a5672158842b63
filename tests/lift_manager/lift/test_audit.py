"""Rows of requests: what has a row of its own, and what is only counted."""

from lift_manager.lift.audit import CALLERS, COUNTED_FOR_S, REQUEST_ROWS, RequestRows, row_of, words_of
from lift_manager.lift.commands import CommandRequest, CommandType
from lift_manager.lift.events import Alarm, Restriction, RestrictionBegun, RestrictionKind
from lift_manager.lift.inputs import CloseSession, GiveCommand, LiftRequest, Request
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal, Refused
from lift_manager.lift.session import Holder
from tests.lift_manager.lift.paper import NOON, ROBOT

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
    assert made == ["asks for L2, hold the door there"]
    _, made = taken(rows, asked("L3"), 1.0, HELD)
    assert made == ["asks for L3, hold the door there", "refused: held by r2"]


def test_repeats_are_counted_and_told_once_a_minute() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    for second in range(1, round(COUNTED_FOR_S) + 1):
        rows, made = taken(rows, asked(), float(second))
        assert made == []
    _, made = taken(rows, asked(), COUNTED_FOR_S + 1)
    assert made == ["asks for L2 again, 61 times within 60 s, with the same answer"]


def test_a_repeat_with_another_answer_has_a_row() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    _, made = taken(rows, asked(), 1.0, HELD)
    assert made == ["asks for L2, hold the door there", "refused: held by r2"]


def test_a_press_tells_what_was_only_counted_before() -> None:
    rows, _ = taken(RequestRows("lift"), asked(), 0.0)
    rows, _ = taken(rows, asked(), 1.0)
    rows, made = rows.tell(ROBOT, 2.0)
    assert [row.text for row in made] == ["asks for L2 again, 1 times within 1 s, with the same answer"]
    assert rows.tell_due(100.0, end=True)[1] == ()


def test_more_than_its_share_of_a_minute_is_counted_by_answer() -> None:
    rows = RequestRows("lift")
    for number in range(REQUEST_ROWS + 4):
        rows, _ = taken(rows, asked(f"L{number}"), 1.0, HELD if number % 2 else None)
    _, made = rows.tell_due(2.0, end=True)
    assert [row.text for row in made] == ["asks 4 times more within 1 s: 2 accepted, 2 held"]


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
    assert made[0] == "asks for L2 again, 1 times within 0 s, with the same answer"
    assert ROBOT not in rows.callers


def test_requests_are_written_down_without_ids_and_keys() -> None:
    command = CommandRequest(session="secret", holder=ROBOT, kind=CommandType.GO_TO, floor="L2", key="secret")
    closing = CloseSession("secret", ROBOT, RobotWord.LEFT)
    texts = [words_of(GiveCommand(command)).text, words_of(closing).text]
    assert texts == ["go_to L2 and hold the door there", "close its session, robot left"]


def test_events_have_rows_in_words() -> None:
    begun = RestrictionBegun("lift", Restriction(RestrictionKind.DRAIN, "ann", "moving", NOON))
    rows = [row_of(begun), row_of(Alarm("lift", "fire", ROBOT))]
    assert [row.text for row in rows if row is not None] == ["drain begun by ann: moving", "fire"]
