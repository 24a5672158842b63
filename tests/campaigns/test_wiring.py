"""Wrong wires and wrong tables: no robot is invited by them, and people are told which. That nothing else raises that alarm is
seen in the schedules of `test_truth`."""

from collections.abc import Callable

import pytest

from simulator.faults import WrongFloor
from tests.campaigns.truth import quiet
from tests.campaigns.wiring import INVERTED, Seen, completed, door_map, play, shifted


@pytest.mark.parametrize("name", INVERTED)
def test_an_inverted_door_contact_invites_nobody_and_is_named(name: str) -> None:
    says, wired = (door_map(name, door) for door in INVERTED[name])
    with quiet():
        seen = play(says, wired.map, seed=1)
    assert len(seen.opened) > 3, "the lift was ridden"
    assert (seen.lies, seen.invitations) == ([], 0)
    assert len(seen.contradictions) == 1, seen.alarms
    assert seen.contradictions[0].endswith("door contact inverted?")


@pytest.mark.parametrize("name", INVERTED)
def test_the_same_lift_with_the_right_map_invites_and_raises_no_alarm(name: str) -> None:
    _, wired = (door_map(name, door) for door in INVERTED[name])
    with quiet():
        seen = play(wired, wired.map, seed=1)
    assert (seen.lies, seen.contradictions) == ([], [])
    assert seen.invitations > 10


def test_a_distrust_outlives_a_restart_and_invites_nobody_after_it() -> None:
    says, wired = (door_map("two-stop-agv", door) for door in INVERTED["two-stop-agv"])
    with quiet():
        seen = play(says, wired.map, seed=1, restart_at=90.0)
    assert (seen.lies, seen.invitations) == ([], 0)
    assert len(seen.contradictions) == 1, "what is known is not told anew"


def _shifted_table(name: str) -> Seen:
    says = completed(name)
    return play(says, shifted(says), seed=1, lasts_s=200.0)


def _shifted_lift(name: str) -> Seen:
    says = completed(name)
    return play(says, says.map, seed=1, lasts_s=300.0, asks_for_s=60, faults=(WrongFloor(),))


@pytest.mark.parametrize(
    ("play_shifted", "name"), [(_shifted_table, "generic-coils"), (_shifted_lift, "generic-registers")]
)
def test_calls_that_end_one_floor_up_are_named_after_the_second_one(
    play_shifted: Callable[[str], Seen], name: str
) -> None:
    with quiet():
        seen = play_shifted(name)
    assert seen.lies == []
    assert len(seen.contradictions) == 1, seen.alarms
    assert "go_to (" in seen.contradictions[0]
    assert seen.contradictions[0].endswith("floor codes shifted by one?")
