"""A few sites and a hub that is killed; a thousand are one command, see README.md beside this."""

from tests.campaigns.sites import arguments, campaign


def test_every_row_reaches_a_reader_once_and_in_order_though_the_hub_is_killed() -> None:
    words = "--sites 4 --lifts 2 --minutes 0.02 --rate 100 --away-s 0 --parts kill"
    given = arguments(words.split())
    given.forked = True
    tally = campaign(given)
    assert tally.findings == []
    assert tally.rows > 100
