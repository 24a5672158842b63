"""A few rides of the campaign, and that it would find a lie."""

from tests.campaigns.ride_truth import draw, run


def test_no_robot_is_told_a_lie_in_any_of_three_rides() -> None:
    tally = run((1008, 1010, 1012))
    assert tally.failed == []
    assert tally.judged > 2000
    assert len(tally.ended) == 3, "rides that are done, cancelled and given up"


def test_a_seed_is_always_the_same_ride() -> None:
    assert [draw(seed) for seed in range(20)] == [draw(seed) for seed in range(20)]
