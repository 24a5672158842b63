"""What the log says of one lift: no stale reasons, no trailing blanks, nothing that did not happen."""

import logging

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.core.announce import Announcer
from lift_manager.domain.events import Event
from lift_manager.domain.service import Advice
from lift_manager.runtime.bus import Bus
from register_maps.words import Door
from tests.lift_manager.core.scripted import PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

GO_TO = Command(CommandKind.GO_TO, "L1")


def said(caplog: pytest.LogCaptureFixture, logger: str) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.name == logger]


@pytest.mark.parametrize(
    ("outcome", "line"),
    [
        (Outcome(GO_TO, Result.CONFIRMED, "", Proof.LAMP), "east: go_to L1 confirmed, seen by lamp"),
        (Outcome(GO_TO, Result.CONFIRMED, ""), "east: go_to L1 confirmed"),
        (Outcome(GO_TO, Result.REJECTED, "the lift is on fire"), "east: go_to L1 rejected: the lift is on fire"),
    ],
)
def test_an_outcome_is_one_sentence(caplog: pytest.LogCaptureFixture, outcome: Outcome, line: str) -> None:
    caplog.set_level(logging.INFO)
    Announcer("east", Bus[Event](), control=True).outcome(outcome, None)
    assert said(caplog, "lift_manager.core.announce") == [line]


@pytest.mark.parametrize(
    ("control", "line"),
    [
        (True, "east: fire: everything is let go, robots are refused until a person has checked the lift"),
        (False, "east: fire: this lift is only watched; robots are refused until a person has checked the lift"),
    ],
)
def test_of_a_lift_that_is_only_watched_nothing_is_said_to_be_let_go(
    caplog: pytest.LogCaptureFixture, control: bool, line: str
) -> None:
    Announcer("east", Bus[Event](), control=control).fire(None, Advice.CLEAR_DOORWAY)
    assert said(caplog, "lift_manager.core.announce") == [line]


def test_a_call_that_failed_and_then_arrived_has_its_reason_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def check(made: Bench) -> None:
        made.driver.answers["go_to"] = Result.UNCONFIRMED
        made.accept("L3")
        await elapse(1.0)
        del made.driver.answers["go_to"]
        await elapse(5.0)
        made.accept("L3")
        await elapse(1.0)
        await made.car(None, Door.CLOSED)
        await elapse(30.0)
        await made.car("L3", Door.OPEN, enter=True)
        await elapse(3.0)

    on_bench(check, PLAIN)
    lines = [line for line in said(caplog, "lift_manager.core.session_call") if "call to L3" in line]
    assert lines[-1] == "lift: call to L3: arrived"
    assert all(line == line.rstrip() for line in lines)
