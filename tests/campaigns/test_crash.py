"""Five kills of a real manager; two hundred are one command, see README.md beside this."""

from itertools import count

from tests.campaigns.crash import MAPS, campaign


def test_a_manager_that_is_killed_at_random_moments_loses_no_row_no_session_and_presses_nothing_when_it_starts() -> (
    None
):
    for seed in count(7):
        tally = campaign(5, seed, MAPS[:2], forked=True)
        assert tally.findings == []
        assert tally.kills == 5
        # on a busy computer a manager may be killed five times before it has pressed anything
        if tally.presses and tally.restored:
            return
