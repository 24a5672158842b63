"""Seeded minutes of every map under faults, people and robots: the first half of what every test run plays."""

import os
import subprocess
import sys

from tests.campaigns.playing import play, still_fails
from tests.campaigns.schedules import Asks, draw, shrink
from tests.campaigns.truth import ROOT, Tally, maps, quiet, report, run
from tests.campaigns.wiring import FalseAlarms

FIRST_HALF = range(1, 13)


def test_nothing_that_must_never_happen_happens() -> None:
    alarms = FalseAlarms()
    tally = run(FIRST_HALF, alarms.watch)
    assert not tally.failed, "\n".join(report(tally, 0.0))
    assert tally.invitations > 100  # a manager that never says open would break no rule either
    assert tally.rides > 1
    assert alarms.watched > 5
    assert alarms.raised == [], "no other fault raises the alarm of a contradiction"


def test_a_seed_is_the_same_schedule_every_time() -> None:
    assert draw(7, maps()) == draw(7, maps())
    assert draw(7, maps()) != draw(8, maps())


def summary(seed: int) -> str:
    with quiet():
        played = play(draw(seed, maps()))
    return str((played.judged, played.invitations, played.rides, sorted(played.excused.items())))


def test_a_seed_replays_exactly_in_another_process_whatever_the_order_of_its_sets() -> None:
    code = "from tests.campaigns.test_truth import summary; print(summary(3))"
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    there = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONHASHSEED": other},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert there == f"{summary(3)}\n"


def test_a_failure_shrinks_to_the_event_that_makes_it() -> None:
    schedule = draw(11, maps())
    guilty = next(event for event in schedule.events)

    def fails(candidate: object) -> bool:
        return guilty in candidate.events  # type: ignore[attr-defined]  # a schedule

    assert shrink(schedule, fails).events == (guilty,)


def test_a_crash_of_the_manager_is_a_finding_and_ends_nothing_else() -> None:
    schedule = draw(1, maps())
    broken = Asks(at=1.0, holder="workshop", floor="no number", hold=True)  # type: ignore[arg-type]  # that is the point
    played = play(type(schedule)(**{**vars(schedule), "events": (broken,)}))
    assert [finding.rule for finding in played.findings] == ["crash"]
    assert still_fails(played.findings[0])(played.schedule)


def test_the_report_names_every_failure_with_its_seed() -> None:
    tally = Tally(schedules=2, failed=[(42, "something")])
    assert "FAILED seed 42: something" in report(tally, 1.0)
