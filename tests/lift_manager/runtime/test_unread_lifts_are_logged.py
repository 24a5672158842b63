"""A lift that is not read is told about: once when it begins, once more a minute later, and never in a flood."""

import logging
from itertools import cycle

import pytest

from lift_manager.runtime.journal import CHANGES, READ_WITHIN_S, LiftJournal
from lift_manager.runtime.recorder import MemoryRecorder
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

LOGGER = "lift_manager.runtime.journal"


def logged(caplog: pytest.LogCaptureFixture, level: int = logging.WARNING) -> list[str]:
    return [record.getMessage() for record in caplog.records if (record.name, record.levelno) == (LOGGER, level)]


def silent(made: Bench) -> None:
    made.driver.silent = True


def late(made: Bench) -> None:
    made.driver.takes_s = 1.3


def test_a_lift_that_was_never_read_is_logged_once_and_a_minute_later_once_more(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def check(made: Bench) -> None:
        await elapse(1.5)
        assert logged(caplog) == []  # a start may take a little
        await elapse(300.0)
        assert logged(caplog) == ["lift: no answer", "lift: still not read: no answer"]

    on_bench(check, PLAIN, at_once=silent)


def test_a_lift_that_is_read_at_last_says_so(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def check(made: Bench) -> None:
        await elapse(READ_WITHIN_S + 5)
        made.driver.silent = False
        await elapse(10.0)

    on_bench(check, PLAIN, at_once=silent)
    assert (logged(caplog), logged(caplog, logging.INFO)) == (["lift: no answer"], ["lift: reading by hand"])


def test_a_lift_whose_readings_are_too_old_when_they_come_is_logged_and_is_not_said_to_be_silent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    reasons: set[str] = set()

    async def check(made: Bench) -> None:
        await elapse(5.0)
        assert made.state.reason == ""
        made.driver.takes_s = 1.3
        await elapse(3.0)
        for _ in range(200):
            await elapse(0.25)
            reasons.add(made.state.reason)
        await elapse(140.0)

    on_bench(check, PLAIN, poll_s=0.2)
    late = "by hand answers too late: its last poll took 1.3 s, and a reading counts for 1 s (max_age_s); look for what slows it down, or allow a longer `max_age_s` for this lift"
    assert logged(caplog) == [f"lift: {late}", f"lift: still not read: {late}"]
    assert reasons == {f"nothing newer within 1 s: {late}"}


def test_a_lift_whose_answers_come_in_time_again_is_live_again(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def check(made: Bench) -> None:
        await elapse(8.0)
        made.driver.takes_s = 0.0
        await elapse(2.0)
        assert made.state.reason == ""
        await elapse(10.0)

    on_bench(check, PLAIN, at_once=late)
    assert len(logged(caplog)) == 1
    assert logged(caplog, logging.INFO) == ["lift: reading by hand"]


def test_a_lift_that_flaps_has_as_many_lines_in_the_log_as_rows_in_the_journal(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    recorder = MemoryRecorder()
    journal, faults = LiftJournal("east", "plc", recorder), cycle(["", "no answer"])
    for number in range(600):
        journal.link(next(faults), number / 2)
        journal.report(number / 2 + 0.5)
    lines = [record.getMessage() for record in caplog.records if record.name == LOGGER]
    assert lines == [f"east: {row.text}" for row in recorder.rows]
    assert len(lines) < CHANGES + 12


def test_another_reason_of_a_controller_that_answers_is_news_and_another_number_of_seconds_is_none(
    caplog: pytest.LogCaptureFixture,
) -> None:
    journal = LiftJournal("east", "plc", MemoryRecorder())
    journal.link("", 0.0)
    journal.link("no connection for 1.0 s: refused", 0.0)
    journal.link("no connection for 2.0 s: refused", 0.0)
    journal.link("exception 02: fire (discrete:3)", 0.0, answers=True)
    journal.link("exception 02: fire (discrete:3)", 0.0, answers=True)
    journal.link("its last poll took 1.3 s", 0.0, answers=True)
    journal.link("its last poll took 1.4 s", 0.0, answers=True)
    assert logged(caplog) == [
        "east: no connection for 1.0 s: refused",
        "east: exception 02: fire (discrete:3)",
        "east: its last poll took 1.3 s",
    ]
