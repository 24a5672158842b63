"""What a request says, what is ignored, and what is told of it."""

from __future__ import annotations

import logging

import pytest

from lift_manager.plain.rmf import HeldBy
from lift_manager.rmf.lift_sessions import Disposition
from lift_manager.rmf.messages import (
    AGV_MODE,
    DOOR_CLOSED,
    DOOR_OPEN,
    END_SESSION,
    HUMAN_MODE,
    LiftRequest,
    Time,
)
from lift_manager.rmf.port import SessionDemand
from tests.lift_manager.rmf.bench import A, B, bench, ends, riding, wants
from tests.support.rows import each_row

REST = HeldBy("api", "amr-7")


def test_a_robot_that_waits_is_told_of_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    lift = riding()
    for _ in range(300):
        lift.receive(wants(A, "Level 2"), wants(B, "Level 3"))
        lift.step(0.5)
    assert len([text for text in caplog.messages if "requests the lift" in text]) == 1


def test_sessions_that_come_and_go_at_once_fill_no_log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    lift = bench()
    for number in range(500):
        lift.adapter.on_request(wants(f"f/{number}", "Level 2"), lift.now)
        lift.adapter.on_request(ends(f"f/{number}"), lift.now)
    assert len(caplog.messages) < 10


@pytest.mark.parametrize(
    ("bad", "cause"),
    [
        (wants(A, "Level 9"), "unknown_floor"),
        (wants(A, "L2"), "unknown_floor"),  # the site's word, not RMF's
        (wants(A, ""), "unknown_floor"),
        (wants(A, "Level 2", door_state=1), "bad_door_state"),
        (wants(A, "Level 2", door_state=255), "bad_door_state"),
        (wants(A, "Level 2", request_type=9), "bad_request_type"),
        (wants(A, "Level 2", request_type=3), "bad_request_type"),
        (wants("", "Level 2"), "bad_session_id"),
        (wants("x" * 1_000_000, "Level 2"), "bad_session_id"),
        (wants("two\nlines", "Level 2"), "bad_session_id"),
        (wants(A, "F" * 1_000_000), "unknown_floor"),
    ],
)
def test_nonsense_is_counted_and_nothing_is_asked(
    bad: LiftRequest, cause: str, caplog: pytest.LogCaptureFixture
) -> None:
    lift = bench()
    for _ in range(20):
        lift.receive(bad)
    assert lift.sent_requests == []
    assert lift.adapter.counts.requests == {("lift_rmf", cause): 20}
    lines = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(lines) == 1
    assert len(lines[0]) < 400


def test_an_unknown_lift_is_told_of_once_and_its_name_is_kept_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    """A6: it was dropped without a line."""
    lift = bench()
    for number in range(20):
        lift.receive(wants(A, "Level 2", lift=f"elevator{number}"), wants(A, "Level 2", lift="x" * 1_000_000))
    assert lift.adapter.counts.requests == {("", "unknown_lift"): 40}
    assert len([record for record in caplog.records if record.levelname == "WARNING"]) == 1


def test_the_numbers_of_a_request_are_not_those_of_a_mode() -> None:
    """QuikSync took AGV for END: request_type has AGV 1 and HUMAN 2, current_mode has them the other way round."""
    lift = bench()
    lift.receive(LiftRequest("lift_rmf", Time(), A, 1, "Level 2", 2))
    assert (AGV_MODE, HUMAN_MODE, END_SESSION) == (1, 2, 0)
    assert lift.state.session_id == A
    lift.receive(LiftRequest("lift_rmf", Time(), A, 0, "", 0))
    assert lift.state.session_id == ""


@each_row(
    ("kind", "door", "holds"),
    [
        (AGV_MODE, DOOR_OPEN, True),
        (AGV_MODE, DOOR_CLOSED, True),
        (HUMAN_MODE, DOOR_OPEN, True),
        (HUMAN_MODE, DOOR_CLOSED, False),
    ],
)
def test_in_agv_mode_the_door_is_open_and_in_human_mode_as_asked(kind: int, door: int, holds: bool) -> None:
    lift = bench()
    lift.receive(wants(A, "Level 2", request_type=kind, door_state=door))
    assert lift.sent_requests == [SessionDemand("lift", A, "L2", hold_door=holds)]


def test_what_was_done_with_a_request_has_a_word_of_its_own() -> None:
    words = [done.value for done in Disposition]
    assert len(words) == len(set(words))
    assert all(word == word.lower() and " " not in word for word in words)
