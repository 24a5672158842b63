"""When a lift counts as still polled, and how long one poll may take."""

from lift_manager.runtime.progress import Progress, patience_s


def test_a_lift_whose_polls_stand_still_for_longer_than_its_patience_is_stuck() -> None:
    progress = Progress({"east": 10.0}, now=100.0)
    assert progress.stuck({"east": 0}, 110.0) == ()
    assert progress.stuck({"east": 0}, 110.1) == ("east",)


def test_every_poll_that_ends_starts_the_time_again() -> None:
    progress = Progress({"east": 10.0}, now=0.0)
    assert progress.stuck({"east": 1}, 9.0) == ()
    assert progress.stuck({"east": 1}, 19.0) == ()
    assert progress.stuck({"east": 2}, 19.5) == ()
    assert progress.stuck({"east": 2}, 30.0) == ("east",)


def test_a_lift_that_polls_again_is_stuck_no_more() -> None:
    progress = Progress({"east": 1.0}, now=0.0)
    assert progress.stuck({"east": 0}, 5.0) == ("east",)
    assert progress.stuck({"east": 1}, 6.0) == ()


def test_each_lift_has_its_own_patience_and_none_stands_in_for_another() -> None:
    progress = Progress({"east": 1.0, "slow": 60.0, "west": 1.0}, now=0.0)
    assert progress.stuck({"east": 9, "slow": 0, "west": 0}, 5.0) == ("west",)


def test_a_poll_may_ask_for_each_address_and_wait_for_the_other_lifts_and_three_commands_each_time() -> None:
    assert patience_s(poll_s=0.2, addresses=8, lifts=1, answer_s=2.0, gap_s=0.0) == 0.2 + 8 * 4 * 2.0
    assert patience_s(poll_s=1.0, addresses=3, lifts=4, answer_s=0.5, gap_s=0.1) == 1.0 + 3 * 7 * 0.6
