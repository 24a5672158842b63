"""Five kills of a real manager; two hundred are one command, see README.md beside this."""

from tests.campaigns.crash import MAPS, campaign


def test_a_manager_that_is_killed_at_random_moments_loses_no_row_no_session_and_presses_nothing_when_it_starts() -> (
    None
):
    tally = campaign(5, 2, MAPS[:2], forked=True)
    assert tally.findings == []
    assert tally.kills == 5
    assert tally.presses
    assert tally.restored
