"""A ride with the engine of today and with the pure rides; `python -m tests.campaigns.shadow_rides` plays more."""

from tests.campaigns.shadow_rides import compare, main_of


def test_both_engines_do_the_same_for_a_ride_that_is_disturbed() -> None:
    lines, difference = compare(main_of(2))
    assert lines > 100
    assert difference == ""
