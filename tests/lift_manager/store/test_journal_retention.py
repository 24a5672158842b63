"""What a journal lets go of: the oldest rows behind an anchor, never many at a time, and the file shrinks."""

import asyncio
import json
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lift_manager.lift.journal import Row, RowKind
from lift_manager.store.committer import Committer
from lift_manager.store.retention import MAX_DAYS_PER_CUT, STEP_ROWS, Limits
from lift_manager.store.sqlite import SqliteStore
from lift_manager.store.store import PendingRow, UpkeepStep
from tests.lift_manager.store.journal_disk import SITE, journal, opened_raw, press, stored, writing

START = datetime(2026, 3, 2, tzinfo=UTC)
DAY = timedelta(days=1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "site.db"


def micros(at: datetime) -> int:
    return round(at.timestamp()) * 1_000_000


def fill(path: Path, ats: list[datetime], text: str = "said") -> None:
    store = SqliteStore(path, SITE, Limits(10_000, 10_000))
    store.commit({}, [PendingRow(micros(at), Row(RowKind.REQUEST, text, "east")) for at in ats])
    store.close()


def tended(path: Path, limits: Limits, now: datetime) -> list[UpkeepStep]:
    """Do everything that one check finds to do."""
    store = SqliteStore(path, SITE, limits)
    done = [store.do_upkeep(micros(now), check=True)]
    while done[-1].more:
        done.append(store.do_upkeep(micros(now), check=False))
    store.close()
    return done


def ages(path: Path, now: datetime) -> list[int]:
    return [(now - datetime.fromtimestamp(row.at / 1e6, UTC)).days for row in stored(path) if row.kind == "request"]


def test_rows_go_by_age_and_those_that_stay_verify_from_the_anchor(path: Path) -> None:
    fill(path, [START + number * DAY / 4 for number in range(40)])
    tended(path, Limits(9, 500), START + 10 * DAY)
    assert max(ages(path, START + 10 * DAY)) == 9
    rows = stored(path)
    assert (rows[0].seq, rows[-1].kind) == (5, "anchor")
    assert rows[-1].text == "rows 1 to 4 removed: they are too old"
    said = json.loads(rows[-1].data)
    assert (said["from"], said["through"], said["rows"]) == (1, 4, 4)


def test_nothing_goes_where_nothing_is_too_old_or_too_much(path: Path) -> None:
    fill(path, [START + number * DAY for number in range(9)])
    tended(path, Limits(9, 500), START + 9 * DAY)
    assert [row.kind for row in stored(path)] == ["request"] * 9


def test_a_clock_that_runs_wild_takes_a_bite_and_no_more_however_often_the_manager_starts(path: Path) -> None:
    fill(path, [START + number * DAY / 4 for number in range(80)])
    wild = START.replace(year=2099)
    for seconds in range(0, 20, 2):  # as systemd starts it
        tended(path, Limits(400, 500), wild + timedelta(seconds=seconds))
        assert stored(path)[0].seq == 1 + 4 * MAX_DAYS_PER_CUT
    tended(path, Limits(400, 500), wild + timedelta(hours=21))
    assert stored(path)[0].seq == 1 + 8 * MAX_DAYS_PER_CUT


def test_a_clock_that_is_before_the_newest_row_is_not_believed(path: Path) -> None:
    fill(path, [START - 500 * DAY, START, START + DAY])
    tended(path, Limits(400, 500), START)
    assert stored(path)[0].seq == 1
    tended(path, Limits(400, 500), START + DAY)
    assert stored(path)[0].seq == 2


def test_after_a_clock_that_ran_wild_was_set_right_rows_go_by_age_as_before(path: Path) -> None:
    fill(path, [START + number * DAY for number in range(20)])
    tended(path, Limits(400, 500), START.replace(year=2099))
    first = stored(path)[0].seq
    right = START + 401 * DAY
    fill(path, [right])
    for after, goes in ((timedelta(hours=1), 0), (timedelta(hours=21), 1)):
        tended(path, Limits(397, 500), right + after)
        assert (stored(path)[0].seq > first) is bool(goes)


def test_rows_that_went_by_size_keep_none_from_going_by_age(path: Path) -> None:
    fill(path, [START] * 3_000, "x" * 1_000)
    fill(path, [START + 20 * DAY])
    tended(path, Limits(400, 1), START + 20 * DAY)
    assert stored(path)[-1].text.endswith("too large")
    tended(path, Limits(19, 500), START + 20 * DAY)
    assert stored(path)[-1].text.endswith("too old")


def test_rows_from_before_the_clock_was_set_right_keep_nothing_from_going(path: Path) -> None:
    dead_battery = datetime(1970, 1, 1, tzinfo=UTC)
    fill(path, [dead_battery, dead_battery, *(START + number * DAY for number in range(5))])
    tended(path, Limits(400, 500), START + 5 * DAY)
    assert stored(path)[0].seq == 3


def test_the_newest_row_always_stays(path: Path) -> None:
    fill(path, [START])
    tended(path, Limits(1, 500), START + 100 * DAY)
    assert len(stored(path)) == 1


def test_rows_go_by_size_and_the_file_shrinks(path: Path) -> None:
    fill(path, [START] * 3_000, "x" * 1_000)
    before = path.stat().st_size
    assert before > 3_000_000
    steps = tended(path, Limits(400, 1), START)
    assert path.stat().st_size < 1_050_000
    rows = stored(path)
    assert 600 < len(rows) < 1_000
    assert len(steps) < 60
    assert rows[-1].text.endswith("removed: the journal is too large")
    assert max(json.loads(row.data)["rows"] for row in rows if row.kind == "anchor") == STEP_ROWS
    with opened_raw(path) as connection:
        assert connection.execute("PRAGMA freelist_count").fetchone() == (0,)


def test_a_crash_after_any_step_of_a_cut_costs_nothing(path: Path) -> None:
    """After each step of a cut the journal verifies, and the next start goes on with it."""
    fill(path, [START] * 3_000, "x" * 1_000)
    seen = []
    more = True
    while more:
        store = SqliteStore(path, SITE, Limits(400, 1))
        store.do_upkeep(micros(START), check=True)  # the first step after a start carries the log over
        step = store.do_upkeep(micros(START), check=True)
        store.close()
        seen.append(stored(path)[0].seq)
        more = step.more
    assert seen == sorted(seen)
    assert len(set(seen)) > 1
    assert path.stat().st_size < 1_050_000


def test_it_is_done_at_the_start_and_every_hour_while_rows_are_written(path: Path) -> None:
    fill(path, [START + number * DAY / 100 for number in range(3_000)])

    async def main() -> Committer:
        kept = journal(path, keep_days=29, clock=lambda: START + 30 * DAY)
        async with writing(kept):
            number = 0
            while first_row(path) == 1:
                assert await kept.commit_now(press(number)) is None
                number += 1
            await kept.settled()
        return kept

    assert asyncio.run(main()).trouble == ""
    assert stored(path)[0].seq == 101


def first_row(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        (seq,) = connection.execute("SELECT min(seq) FROM rows").fetchone()
    return int(seq)
