"""A minute with the core of today and the new one side by side; `python -m tests.campaigns.shadow` plays more."""

from tests.campaigns.shadow import run


def test_both_cores_make_the_same_of_a_minute() -> None:
    (done,) = run([4])
    assert done.steps > 100
    assert done.differences == []
