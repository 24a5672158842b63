"""Wrong wires and wrong tables: no robot is invited by them, and people are told which. That nothing else raises that alarm is
seen in the schedules of `test_truth`. All maps are one command, see README.md beside this."""

from collections.abc import Iterator

import pytest

from tests.campaigns.truth import quiet
from tests.campaigns.wiring import STORIES, Story, inverted, right

HOW_A_DOOR_IS_TOLD = pytest.mark.parametrize("name", ["two-stop-agv", "robotnik-il-eth"])
"""By a contact, and by two words in a register."""


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    with quiet():
        yield


@HOW_A_DOOR_IS_TOLD
def test_an_inverted_door_contact_invites_nobody_and_is_named(name: str) -> None:
    assert inverted(name, lasts_s=100.0) == []


@HOW_A_DOOR_IS_TOLD
def test_the_same_lift_with_the_right_map_invites_and_raises_no_alarm(name: str) -> None:
    assert right(name, lasts_s=60.0) == []


def test_a_distrust_outlives_a_restart_invites_nobody_after_it_and_is_not_told_anew() -> None:
    assert inverted("two-stop-agv", lasts_s=100.0, restart_at=50.0) == []


@pytest.mark.parametrize(("shifted", "name"), [one for one in STORIES if one[0] not in (inverted, right)])
def test_calls_that_end_one_floor_up_are_named_after_the_second_one(shifted: Story, name: str) -> None:
    assert shifted(name) == []
