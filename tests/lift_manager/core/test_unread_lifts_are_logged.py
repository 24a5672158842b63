"""A lift that is not read is told about: once when it begins, once more a minute later, and never in a flood."""

import asyncio
import logging
from itertools import cycle

import pytest

from drivers.model import LiftValues
from lift_manager.core.journal import ShortJournal
from lift_manager.core.lift import LiftTask
from lift_manager.core.memory import ShortMemory
from lift_manager.core.options import LiftOptions
from lift_manager.core.recording import CHANGES, READ_WITHIN_S, LiftLog
from lift_manager.domain.events import Event
from lift_manager.runtime.bus import Bus
from register_maps.words import Door, Mode, Side
from tests.lift_manager.core.scripted import PLAIN, ScriptedDriver
from tests.support.virtual_time import elapse, run_virtual

LOGGER = "lift_manager.core.recording"


def logged(caplog: pytest.LogCaptureFixture, level: int = logging.WARNING) -> list[str]:
    return [record.getMessage() for record in caplog.records if (record.name, record.levelno) == (LOGGER, level)]


async def watch(task: LiftTask, for_s: float) -> None:
    """Run one lift, and sum up as the manager does."""
    running = asyncio.ensure_future(task.run())
    for _ in range(round(for_s)):
        await elapse(1.0)
        task.tell()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def scripted(**how: object) -> tuple[ScriptedDriver, LiftTask]:
    values = LiftValues(floor="L1", mode=Mode.NORMAL, doors={Side.FRONT: Door.CLOSED})
    driver = ScriptedDriver(PLAIN, values, **how)  # type: ignore[arg-type]  # of its fields
    options = LiftOptions(
        name="east", floors=("L1", "L2"), doors_at=dict.fromkeys(("L1", "L2"), (Side.FRONT,)), control=True
    )
    return driver, LiftTask(driver, options, Bus[Event]())


def test_a_lift_that_was_never_read_is_logged_once_and_a_minute_later_once_more(
    caplog: pytest.LogCaptureFixture,
) -> None:
    _, task = scripted(silent=True)
    run_virtual(lambda: watch(task, 2.0), limit_s=100)
    assert logged(caplog) == []  # a start may take a little
    run_virtual(lambda: watch(scripted(silent=True)[1], 300.0), limit_s=400)
    assert logged(caplog) == ["east: no answer", "east: still not read: no answer"]


def test_a_lift_that_is_read_at_last_says_so(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    driver, task = scripted(silent=True)

    async def main() -> None:
        running = asyncio.ensure_future(watch(task, 20.0))
        await elapse(READ_WITHIN_S + 5)
        driver.silent = False
        await running

    run_virtual(main, limit_s=100)
    assert (logged(caplog), logged(caplog, logging.INFO)) == (["east: no answer"], ["east: reading by hand"])


def test_a_lift_whose_readings_are_too_old_when_they_come_is_logged_and_is_not_said_to_be_silent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    driver, task = scripted()
    reasons: set[str] = set()

    async def main() -> None:
        running = asyncio.ensure_future(watch(task, 200.0))
        await elapse(5.0)
        assert task.state().reason == ""
        driver.takes_s = 1.3
        await elapse(3.0)
        for _ in range(200):
            await elapse(0.25)
            reasons.add(task.state().reason)
        await running

    run_virtual(main, limit_s=300)
    late = "by hand answers too late: its last poll took 1.3 s, and a reading counts for 1 s (max_age_s); look for what slows it down, or allow a longer `max_age_s` for this lift"
    assert logged(caplog) == [f"east: {late}", f"east: still not read: {late}"]
    assert reasons == {f"nothing newer within 1 s: {late}"}


def test_a_lift_whose_answers_come_in_time_again_is_live_again(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    driver, task = scripted(takes_s=1.3)

    async def main() -> None:
        running = asyncio.ensure_future(watch(task, 20.0))
        await elapse(8.0)
        driver.takes_s = 0.0
        await elapse(2.0)
        assert task.state().reason == ""
        await running

    run_virtual(main, limit_s=100)
    assert len(logged(caplog)) == 1
    assert logged(caplog, logging.INFO) == ["east: reading by hand"]


def test_a_lift_that_flaps_has_as_many_lines_in_the_log_as_rows_in_the_journal(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    journal = ShortJournal(keep=100_000)

    async def main() -> None:
        log, troubles = LiftLog("east", journal, ShortMemory()), cycle(["", "no answer"])
        for _ in range(600):
            log.link("plc", next(troubles))
            await elapse(0.5)
            log.tell()

    run_virtual(main, limit_s=400)
    lines = [record.getMessage() for record in caplog.records if record.name == LOGGER]
    assert lines == [f"east: {row.text}" for row in journal.rows]
    assert len(lines) < CHANGES + 12


def test_another_reason_of_a_controller_that_answers_is_news_and_another_number_of_seconds_is_none(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        log = LiftLog("east", ShortJournal(), ShortMemory())
        log.link("plc", "")
        log.link("plc", "no connection for 1.0 s: refused")
        log.link("plc", "no connection for 2.0 s: refused")
        log.link("plc", "exception 02: fire (discrete:3)", answers=True)
        log.link("plc", "exception 02: fire (discrete:3)", answers=True)
        log.link("plc", "its last poll took 1.3 s", answers=True)
        log.link("plc", "its last poll took 1.4 s", answers=True)

    run_virtual(main)
    assert logged(caplog) == [
        "east: no connection for 1.0 s: refused",
        "east: exception 02: fire (discrete:3)",
        "east: its last poll took 1.3 s",
    ]
