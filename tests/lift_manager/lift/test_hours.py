"""When robots may begin: the clock on the wall, over midnight, over the week, and when it is set forward or back."""

from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import pytest

from lift_manager.lift.hours import RobotHours, read_hours, superfluous, wall_clock
from tests.support.rows import each_row

BERLIN = ZoneInfo("Europe/Berlin")
NIGHTS = RobotHours((read_hours("Mon-Fri 20:00-06:00"), read_hours("Sat-Sun 00:00-24:00")))
OFFICE = RobotHours((read_hours("Tue 09:00-17:30"),))
MONDAY = 2
"""2026-03-02 is a Monday."""


def at(day: int, hour: int, minute: int = 0) -> datetime:
    return datetime(2026, 3, day, hour, minute, tzinfo=BERLIN)


@each_row(
    ("local", "is_open"),
    [
        (at(MONDAY, 19, 59), False),
        (at(MONDAY, 20), True),
        (at(MONDAY, 23, 59), True),
        (at(MONDAY + 1, 0), True),
        (at(MONDAY + 1, 5, 59), True),
        (at(MONDAY + 1, 6), False),
        (at(MONDAY + 4, 23), True),  # Friday
        (at(MONDAY + 5, 12), True),  # Saturday
        (at(MONDAY + 6, 23, 59), True),  # Sunday
        (at(MONDAY + 7, 0), False),  # Monday again: its own night has not begun
    ],
)
def test_nights_and_weekends_are_open_and_working_days_are_not(local: datetime, *, is_open: bool) -> None:
    assert NIGHTS.now_open(local) is is_open


@each_row(
    ("local", "begins"),
    [
        (at(MONDAY, 12), "Mon 20:00"),
        (at(MONDAY, 20), "Tue 20:00"),
        (at(MONDAY + 1, 6), "Tue 20:00"),
        (at(MONDAY + 4, 21), "Sat 00:00"),
        (at(MONDAY + 6, 1), "Mon 20:00"),
    ],
)
def test_the_next_begin_is_said_as_the_wall_clock_will_show_it(local: datetime, begins: str) -> None:
    assert NIGHTS.next_begin(local) == begins


def test_the_next_begin_may_be_a_week_away() -> None:
    assert OFFICE.next_begin(at(MONDAY + 1, 9)) == "Tue 09:00"
    assert OFFICE.next_begin(at(MONDAY + 1, 8, 59)) == "Tue 09:00"


def test_days_may_run_over_the_end_of_the_week_and_a_night_into_the_next() -> None:
    hours = RobotHours((read_hours("sat-mon 22:00-02:00"),))
    assert hours.now_open(at(MONDAY + 6, 23))
    assert hours.now_open(at(MONDAY, 1))
    assert hours.now_open(at(MONDAY + 1, 1))
    assert not hours.now_open(at(MONDAY + 2, 1))
    assert not hours.now_open(at(MONDAY + 5, 1))


def test_a_skipped_hour_never_comes_and_hours_that_begin_in_it_begin_after_it() -> None:
    hours = RobotHours((read_hours("Sun 02:30-04:00"),))
    one_to_go = datetime(2026, 3, 29, 0, 59, tzinfo=UTC).astimezone(BERLIN)
    gone_by = datetime(2026, 3, 29, 1, 0, tzinfo=UTC).astimezone(BERLIN)
    assert (wall_clock(one_to_go), hours.now_open(one_to_go)) == ("Sun 01:59", False)
    assert (wall_clock(gone_by), hours.now_open(gone_by)) == ("Sun 03:00", True)


def test_an_hour_that_the_clock_shows_twice_is_inside_both_times() -> None:
    hours = RobotHours((read_hours("Sun 02:15-02:45"),))
    first = datetime(2026, 10, 25, 0, 30, tzinfo=UTC).astimezone(BERLIN)
    second = datetime(2026, 10, 25, 1, 30, tzinfo=UTC).astimezone(BERLIN)
    between = datetime(2026, 10, 25, 0, 50, tzinfo=UTC).astimezone(BERLIN)
    assert wall_clock(first) == wall_clock(second) == "Sun 02:30"
    assert [hours.now_open(local) for local in (first, between, second)] == [True, False, True]


@each_row(
    ("text", "wrong"),
    [
        ("Mon-Fri 20-6", "names no hours"),
        ("Mon,Tue 20:00-06:00", "names no hours"),
        ("20:00-06:00", "names no hours"),
        ("Mon 20:00-06:00 Tue", "names no hours"),
        ("Mon \uff120:00-06:00", "names no hours"),
        ("Foo 20:00-06:00", "no day 'Foo'"),
        ("Mon-Bar 20:00-06:00", "no day 'Bar'"),
        ("Mon 24:00-06:00", "the end of a day"),
        ("Mon 20:60-22:00", "no time 20:60"),
        ("Mon 20:00-24:01", "no time 24:01"),
        ("Mon 20:00-20:00", "ends when it begins"),
    ],
)
def test_what_names_no_hours_is_refused_with_what_is_wrong(text: str, wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        read_hours(text)


@each_row("text", ["Mon-Fri 20-6", "Foo 20:00-06:00", "Mon 24:00-06:00"])
def test_the_refusal_shows_the_form_that_is_right(text: str) -> None:
    with pytest.raises(ValueError, match="write `Mon-Fri 20:00-06:00`"):
        read_hours(text)


@each_row(
    ("lines", "found"),
    [
        (["Mon-Fri 20:00-06:00", "Sat-Sun 00:00-24:00"], []),
        (["Mon 08:00-12:00", "Mon 10:00-14:00"], []),
        (["Mon 08:00-12:00", "Mon 09:00-10:00"], [(1, "Mon 08:00-12:00")]),
        (["Mon 09:00-10:00", "Mon 08:00-12:00"], [(0, "Mon 08:00-12:00")]),
        (["Mon 08:00-12:00", "mon  08:00-12:00"], [(1, "Mon 08:00-12:00")]),
        (["Mon 08:00-11:00", "Mon 09:00-12:00", "Mon 10:00-14:00"], [(1, "Mon 08:00-11:00, Mon 10:00-14:00")]),
    ],
)
def test_a_line_that_adds_nothing_is_found_and_an_overlap_as_such_is_not(
    lines: list[str], found: list[tuple[int, str]]
) -> None:
    assert list(superfluous([read_hours(line) for line in lines])) == found
