"""Seeded minutes of every map under faults, people and robots: the second half, for the other processor."""

from tests.campaigns.truth import report, run
from tests.campaigns.wiring import FalseAlarms

SECOND_HALF = (42, 136, 168, 221, *range(101, 109))
"""The first four find mistakes of `mutants.py` that most schedules do not: no release retry, no key switch, one reading
instead of two, and no robot mode under way."""


def test_nothing_that_must_never_happen_happens_in_the_second_half() -> None:
    alarms = FalseAlarms()
    tally = run(SECOND_HALF, alarms.watch)
    assert not tally.failed, "\n".join(report(tally, 0.0))
    assert tally.invitations > 100
    assert tally.rides > 1
    assert alarms.watched > 5
    assert alarms.raised == [], "no other fault raises the alarm of a contradiction"
