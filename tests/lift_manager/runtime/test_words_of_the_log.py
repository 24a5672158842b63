"""What the log says of one lift: no stale reasons, no trailing blanks, nothing that did not happen."""

import logging
from datetime import UTC, datetime

import pytest

from drivers.model import Command, CommandKind, Outcome, Proof, Result
from lift_manager.lift.events import CommandEnded
from lift_manager.runtime.journal import LiftJournal
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.scripted import PERMITTING, PLAIN, Bench, boarded, on_bench
from tests.support.virtual_time import elapse

GO_TO = Command(CommandKind.GO_TO, "L1")
AT = datetime(2026, 3, 2, 21, 30, tzinfo=UTC)


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.name == "lift_manager.runtime.journal"]


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
    LiftJournal("east", "by hand", MemoryRecorder()).event(CommandEnded("east", outcome), "boot-1")
    assert said(caplog) == [line]


@pytest.mark.parametrize(
    ("control", "line"),
    [
        (True, "lift: fire: everything is released, robots are refused until a person has checked the lift"),
        (False, "lift: fire: this lift is only watched; robots are refused until a person has checked the lift"),
    ],
)
def test_of_a_lift_that_is_only_watched_nothing_is_said_to_be_let_go(
    caplog: pytest.LogCaptureFixture, control: bool, line: str
) -> None:
    async def check(made: Bench) -> None:
        await made.mode(Mode.FIRE)

    on_bench(check, PLAIN, control=control)
    assert said(caplog) == [line]


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
    lines = [line for line in said(caplog) if "call to L3" in line]
    assert lines[-1] == "lift: call to L3: arrived"
    assert all(line == line.rstrip() for line in lines)


def test_what_people_decide_is_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    async def check(made: Bench) -> None:
        made.site.lock_out("lift", "M. Weber", "new ropes")
        made.site.end_lockout("lift", "A. Beck")
        made.site.begin_drain("lift", "M. Weber", "cleaning")
        made.site.end_drain("lift", "A. Beck")
        await made.mode(Mode.FIRE)
        await made.mode(Mode.NORMAL)
        made.site.acknowledge("lift", "A. Beck")

    on_bench(check, PLAIN, clock=lambda: AT)
    assert [line for line in said(caplog) if "there is a fire" not in line and ": fire:" not in line] == [
        "lift: locked out by M. Weber: new ropes",
        "lift: the lockout by M. Weber since 2026-03-02 21:30: new ropes is ended by A. Beck",
        "lift: no new session begins: drain by M. Weber: cleaning",
        "lift: the drain by M. Weber since 2026-03-02 21:30: cleaning is ended by A. Beck",
        "lift: fire acknowledged by A. Beck",
    ]


def test_a_start_says_what_keeps_robots_off_since_before(caplog: pytest.LogCaptureFixture) -> None:
    memory = MemoryRecorder()

    async def before(made: Bench) -> None:
        await boarded(made)
        made.site.begin_drain("lift", "M. Weber", "night")
        made.site.lock_out("lift", "M. Weber", "new ropes", at_once=True)
        await made.mode(Mode.FIRE)

    async def after(made: Bench) -> None:
        pass

    on_bench(before, PERMITTING, recorder=memory, clock=lambda: AT)
    caplog.clear()
    on_bench(after, PERMITTING, recorder=memory, clock=lambda: AT)
    assert said(caplog)[0] == (
        "lift: from before this start: a fire at 2026-03-02 21:30 that nobody has acknowledged;"
        " locked out by M. Weber since 2026-03-02 21:30: new ropes; drain by M. Weber since 2026-03-02 21:30: night;"
        " a robot of api:fleet/robot1 that may be in the car"
    )


def test_a_start_after_which_nothing_keeps_robots_off_says_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async def check(made: Bench) -> None:
        pass

    on_bench(check, PLAIN)
    assert said(caplog) == []
