"""Seeded minutes of every map under faults, people and robots: the second half, for the other processor."""

import pytest

from tests.campaigns.truth import AT_A_TIME, report, run
from tests.campaigns.wiring import FalseAlarms

SECOND_HALF = range(101, 201, AT_A_TIME)


@pytest.mark.parametrize("first", SECOND_HALF)
def test_nothing_that_must_never_happen_happens_in_the_second_half(first: int) -> None:
    alarms = FalseAlarms()
    tally = run(range(first, first + AT_A_TIME), alarms.watch)
    assert not tally.failed, "\n".join(report(tally, 0.0))
    assert tally.invitations > 100
    assert tally.rides > 5
    assert alarms.watched > 15
    assert alarms.raised == [], "no other fault raises the alarm of a contradiction"
