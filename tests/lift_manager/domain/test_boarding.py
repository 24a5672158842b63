"""Who is aboard: the robot's word, or what may be inferred from what its caller asks."""

from dataclasses import replace

import pytest

from lift_manager.domain import boarding as boardings
from lift_manager.domain.asking import Ask, RobotWord
from lift_manager.domain.boarding import Boarding, Rules, Stop, Who
from lift_manager.domain.state import Holder
from tests.lift_manager.domain.test_call import ABLE

HOLDER = Holder("rmf", "fleet/robot1")
TOLD = Rules(matters=True, infer=False, board_min_s=5.0)
INFERRED = replace(TOLD, infer=True)
BLIND = replace(TOLD, matters=False)
OPEN = Stop("L1", arrived=True, open=True)
UNDER_WAY = Stop("L1", arrived=False, open=False)
MAY_BOARD = boardings.open_to_enter(Boarding(), 10.0)
ABOARD = Boarding(Who.ABOARD)


def ask(floor: str, robot: RobotWord | None = None, *, hold: bool = True) -> Ask:
    return Ask("lift", HOLDER, floor, hold, robot)


def test_a_robot_may_board_once_the_car_has_stood_open_for_it() -> None:
    assert Boarding(Who.MAY_BOARD, open_since=10.0) == MAY_BOARD
    assert boardings.open_to_enter(MAY_BOARD, 20.0) is MAY_BOARD


@pytest.mark.parametrize("boarding", [ABOARD, Boarding(Who.LEFT)])
def test_an_open_door_makes_no_robot_board_that_is_aboard_or_has_just_left(boarding: Boarding) -> None:
    assert boardings.open_to_enter(boarding, 20.0) is boarding


def test_another_floor_while_the_empty_car_is_under_way_leaves_it_empty() -> None:
    assert boardings.hear(Boarding(), ask("L3"), UNDER_WAY, TOLD, 3.0) == Boarding()


def test_a_repeat_of_the_same_floor_settles_nothing() -> None:
    assert boardings.hear(MAY_BOARD, ask("L1"), OPEN, INFERRED, 100.0) is MAY_BOARD


def test_the_robots_word_settles_it_at_once() -> None:
    assert boardings.hear(MAY_BOARD, ask("L3", RobotWord.IN_PLACE), OPEN, TOLD, 10.0) == ABOARD
    assert boardings.hear(MAY_BOARD, ask("L1", RobotWord.IN_PLACE), OPEN, TOLD, 10.0) == ABOARD


def test_a_robot_inside_is_believed_even_if_the_door_has_shut_behind_it() -> None:
    assert boardings.hear(MAY_BOARD, ask("L3", RobotWord.IN_PLACE), UNDER_WAY, TOLD, 90.0) == ABOARD


def test_a_robot_cannot_be_in_place_before_the_car_came() -> None:
    heard = boardings.hear(Boarding(), ask("L3", RobotWord.IN_PLACE), UNDER_WAY, TOLD, 3.0)
    assert "has not arrived at L1" in str(heard)


def test_a_robot_that_says_it_is_in_place_when_it_asks_for_the_lift_is_aboard() -> None:
    assert boardings.hear(Boarding(), ask("L3", RobotWord.IN_PLACE), None, TOLD, 3.0) == ABOARD


def test_without_a_word_another_floor_says_nothing_unless_the_site_allows_to_infer() -> None:
    heard = boardings.hear(MAY_BOARD, ask("L3"), OPEN, TOLD, 100.0)
    assert "say that the robot is in place" in str(heard)
    assert "infer_occupancy" in str(heard)


def test_another_floor_asked_long_enough_after_the_door_opened_means_boarded() -> None:
    assert "4.9 s" in str(boardings.hear(MAY_BOARD, ask("L3"), OPEN, INFERRED, 14.9))
    assert boardings.hear(MAY_BOARD, ask("L3"), OPEN, INFERRED, 15.0) == ABOARD


@pytest.mark.parametrize("stop", [replace(OPEN, open=False), UNDER_WAY])
def test_nothing_is_inferred_while_the_car_does_not_stand_open(stop: Stop) -> None:
    assert "does not stand open" in str(boardings.hear(MAY_BOARD, ask("L3"), stop, INFERRED, 100.0))


def test_a_lift_that_does_not_care_who_is_aboard_goes_wherever_it_is_sent() -> None:
    assert boardings.hear(MAY_BOARD, ask("L3"), OPEN, BLIND, 10.1) == Boarding(sent_on=True)
    assert boardings.aboard(Boarding(), BLIND) is None
    assert boardings.aboard(MAY_BOARD, BLIND) is None
    assert boardings.aboard(ABOARD, BLIND) is True
    assert boardings.aboard(Boarding(Who.LEFT), BLIND) is False


@pytest.mark.parametrize(("who", "aboard"), [(who, who is Who.ABOARD) for who in Who])
def test_on_a_lift_that_cares_a_robot_is_aboard_only_once_that_is_known(who: Who, *, aboard: bool) -> None:
    assert boardings.aboard(Boarding(who), TOLD) is aboard


def test_a_robot_aboard_stays_aboard_when_the_floor_changes() -> None:
    heard = boardings.hear(Boarding(Who.ABOARD, may_leave_at="L1"), ask("L3"), OPEN, TOLD, 50.0)
    assert heard == ABOARD


def test_a_robot_that_drove_out_again_leaves_the_car_empty() -> None:
    assert boardings.hear(MAY_BOARD, ask("L1", RobotWord.LEFT), OPEN, TOLD, 12.0) == Boarding(Who.LEFT)
    assert boardings.hear(MAY_BOARD, ask("L3", RobotWord.LEFT), OPEN, TOLD, 12.0) == Boarding()


def test_a_robot_aboard_cannot_have_left_through_a_door_that_was_never_open_for_it() -> None:
    heard = boardings.hear(ABOARD, ask("L1", RobotWord.LEFT), OPEN, TOLD, 12.0)
    assert "has not stood open" in str(heard)
    opened = boardings.open_to_leave(ABOARD, "L1")
    assert boardings.hear(opened, ask("L1", RobotWord.LEFT), OPEN, TOLD, 12.0) == Boarding(Who.LEFT)


def test_where_the_door_stood_open_counts_until_the_car_is_seen_elsewhere() -> None:
    opened = boardings.open_to_leave(ABOARD, "L3")
    assert boardings.car_seen_at(opened, None) is opened
    assert boardings.car_seen_at(opened, "L3") is opened
    assert boardings.car_seen_at(opened, "L2") == ABOARD


def test_only_a_robot_aboard_can_leave() -> None:
    assert boardings.open_to_leave(MAY_BOARD, "L1") is MAY_BOARD
    left = ask("L1", RobotWord.LEFT, hold=False)
    assert not boardings.has_left(replace(MAY_BOARD, may_leave_at="L1"), left, "L1", INFERRED)


def test_a_release_without_a_word_means_left_only_at_the_destination_and_only_where_the_site_allows() -> None:
    opened = boardings.open_to_leave(ABOARD, "L3")
    release = ask("L3", hold=False)
    assert boardings.has_left(opened, release, "L3", INFERRED)
    assert not boardings.has_left(opened, release, "L3", TOLD)
    assert not boardings.has_left(opened, release, "L4", INFERRED)
    assert not boardings.has_left(ABOARD, release, "L3", INFERRED)


def test_a_release_with_the_word_means_left_wherever_the_door_stood_open() -> None:
    opened = boardings.open_to_leave(ABOARD, "L1")
    assert boardings.has_left(opened, ask("L1", RobotWord.LEFT, hold=False), "L3", TOLD)
    assert not boardings.has_left(ABOARD, ask("L1", RobotWord.LEFT, hold=False), "L3", TOLD)


@pytest.mark.parametrize("command", ["call", "go", "robot_in_place", "robot_left"])
def test_each_command_of_the_handshake_makes_it_matter_who_is_aboard(command: str) -> None:
    assert boardings.matters(replace(ABLE, commands=frozenset({"go_to", command})))
    assert boardings.matters(replace(ABLE, needs_occupancy=True))
    assert not boardings.matters(ABLE)


SENT_ON = Boarding(sent_on=True)


@pytest.mark.parametrize(
    ("boarding", "let_out", "doubt"),
    [
        (Boarding(), False, False),
        (MAY_BOARD, False, False),
        (SENT_ON, False, True),
        (SENT_ON, True, False),
        (replace(MAY_BOARD, sent_on=True), False, True),
        (replace(MAY_BOARD, sent_on=True), True, False),
        (ABOARD, True, True),
        (Boarding(Who.LEFT), False, False),
    ],
)
def test_the_end_of_a_holder_without_words_leaves_a_doubt_until_the_door_stood_open_for_a_robot_that_was_sent_on(
    boarding: Boarding, *, let_out: bool, doubt: bool
) -> None:
    release = ask("L1", hold=False)
    leaves = boardings.leaves_doubt(boarding, release, arrived=False, has_words=False, let_out=let_out)
    assert leaves is doubt


@pytest.mark.parametrize("let_out", [False, True])
def test_the_word_left_of_a_holder_with_words_leaves_no_doubt_and_its_silence_does(*, let_out: bool) -> None:
    for word, doubt in ((None, True), (RobotWord.LEFT, False)):
        release = ask("L1", word, hold=False)
        assert boardings.leaves_doubt(MAY_BOARD, release, arrived=False, has_words=True, let_out=let_out) is doubt
