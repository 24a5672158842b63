"""Seeded minutes of every map under faults, people and robots: the second half, for the other processor."""

import pytest

from tests.campaigns.truth import AT_A_TIME, report, run

SECOND_HALF = range(101, 201, AT_A_TIME)


@pytest.mark.timeout(180)  # ten seconds of a whole processor; what hangs ends by the limits of virtual time
@pytest.mark.parametrize("first", SECOND_HALF)
def test_nothing_that_must_never_happen_happens_in_the_second_half(first: int) -> None:
    tally = run(range(first, first + AT_A_TIME))
    assert not tally.failed, "\n".join(report(tally, 0.0))
    assert tally.invitations > 100
    assert tally.rides > 5
