"""When robots may begin, by the clock on the building's wall. Pure.

Only what the wall clock shows counts. When it is set forward, the hour that it skips never comes; when it is set back, the
hour that it shows twice is inside or outside both times.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime

DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
FORM = "write `Mon-Fri 20:00-06:00` or `Sun 00:00-24:00`: a day or two of Mon Tue Wed Thu Fri Sat Sun, then from when to when"

_DAY = 24 * 60
_WEEK = 7 * _DAY
_SPAN = re.compile(r"([A-Za-z]{3})(?:-([A-Za-z]{3}))? +(\d\d):(\d\d)-(\d\d):(\d\d)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Hours:
    """One line of the hours: the same time of day on each of its days."""

    text: str
    minutes: frozenset[int]
    """Minutes of the week, from Monday 00:00; those after midnight belong to the next day."""
    starts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class RobotHours:
    """When robots may begin with a lift. Every time given to it is in the zone of the building."""

    hours: tuple[Hours, ...]

    def now_open(self, local: datetime) -> bool:
        """Whether a robot may begin at this moment."""
        minute = _minute_of_week(local)
        return any(minute in hours.minutes for hours in self.hours)

    def next_begin(self, local: datetime) -> str:
        """Return day and time of the next begin as the wall clock will show them, such as `Mon 20:00`."""
        minute = _minute_of_week(local)
        starts = (start for hours in self.hours for start in hours.starts)
        return _shown(min(starts, key=lambda at: (at - minute - 1) % _WEEK))

    def __str__(self) -> str:
        return ", ".join(hours.text for hours in self.hours)


def read_hours(text: str) -> Hours:
    """Read one line, such as `Mon-Fri 20:00-06:00`. Raises ValueError with what is wrong and the form that is right.

    An end before the begin is on the next day.
    """
    found = _SPAN.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"{text!r} names no hours; {FORM}")
    first, last = _day(found[1]), _day(found[2] or found[1])
    begin, end = _time(found[3], found[4]), _time(found[5], found[6])
    if begin == _DAY:
        raise ValueError(f"24:00 is the end of a day, and hours cannot begin there; {FORM}")
    if begin == end:
        raise ValueError(f"{text!r} ends when it begins; write `00:00-24:00` for a whole day")
    length = (end - begin) % _WEEK if end > begin else end + _DAY - begin
    starts = tuple((first + days) % 7 * _DAY + begin for days in range((last - first) % 7 + 1))
    minutes = frozenset((start + minute) % _WEEK for start in starts for minute in range(length))
    return Hours(text.strip(), minutes, starts)


def superfluous(every: Sequence[Hours]) -> Iterator[tuple[int, str]]:
    """Yield the lines that add nothing to the others, by index, with what covers them; overlaps as such do no harm."""
    kept = list(range(len(every)))
    for index in reversed(range(len(every))):
        others = [every[at] for at in kept if at != index and every[at].minutes & every[index].minutes]
        if every[index].minutes <= frozenset[int]().union(*(other.minutes for other in others)):
            kept.remove(index)
            yield index, ", ".join(other.text for other in others)


def wall_clock(local: datetime) -> str:
    """Return day and time as the hours write them."""
    return _shown(_minute_of_week(local))


def _shown(minute: int) -> str:
    return f"{DAYS[minute // _DAY]} {minute % _DAY // 60:02}:{minute % 60:02}"


def _minute_of_week(local: datetime) -> int:
    return local.weekday() * _DAY + local.hour * 60 + local.minute


def _day(name: str) -> int:
    try:
        return DAYS.index(name.capitalize())
    except ValueError:
        raise ValueError(f"there is no day {name!r}; {FORM}") from None


def _time(hours: str, minutes: str) -> int:
    of_day = int(hours) * 60 + int(minutes)
    if int(minutes) > 59 or of_day > _DAY:
        raise ValueError(f"there is no time {hours}:{minutes}; the first of a day is 00:00, the last is 24:00")
    return of_day
