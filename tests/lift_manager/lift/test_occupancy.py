"""Where a session's robot is: its word, or what may be inferred from what its caller requests."""

from dataclasses import replace

from drivers.model import Capabilities
from lift_manager.lift import occupancy
from lift_manager.lift.config import LiftConfig
from lift_manager.lift.occupancy import BoardingProgress, Occupancy, RobotWord, Stop
from tests.lift_manager.lift.paper import HANDSHAKE, PLAIN, PaperLift
from tests.support.rows import each_row

IN_PLACE, LEFT = RobotWord.IN_PLACE, RobotWord.LEFT


def config(able: Capabilities, *, infer: bool = False) -> LiftConfig:
    return PaperLift(able, site={"infer_occupancy": infer, "board_min_s": 5.0}).config


SPOKEN, INFERRED, BLIND = config(HANDSHAKE), config(HANDSHAKE, infer=True), config(PLAIN)
"""A lift that has to know who is aboard, told in words only; the same where it may be inferred; and one that need not know."""
OPEN = Stop("L1", has_arrived=True, is_open=True)
UNDER_WAY = Stop("L1", has_arrived=False, is_open=False)
OUTSIDE, ABOARD, EXITED = BoardingProgress(), BoardingProgress(Occupancy.ABOARD), BoardingProgress(Occupancy.EXITED)
MAY_BOARD = BoardingProgress(Occupancy.MAY_BOARD, open_since=10.0)
SENT_ON = BoardingProgress(sent_on=True)


# -- what readings tell


@each_row(
    ("before", "after"),
    [
        (OUTSIDE, replace(MAY_BOARD, open_since=20.0)),
        (SENT_ON, replace(MAY_BOARD, open_since=20.0, sent_on=True)),
        (MAY_BOARD, MAY_BOARD),
        (replace(MAY_BOARD, open_since=None), replace(MAY_BOARD, open_since=20.0)),
        (ABOARD, ABOARD),
        (EXITED, EXITED),
    ],
)
def test_a_robot_outside_may_board_once_the_car_has_stood_open_for_it(
    before: BoardingProgress, after: BoardingProgress
) -> None:
    assert occupancy.stands_open_to_enter(before, 20.0) == after


@each_row(
    ("before", "after"), [(ABOARD, replace(ABOARD, may_leave_at="L3")), (MAY_BOARD, MAY_BOARD), (OUTSIDE, OUTSIDE)]
)
def test_only_a_robot_aboard_can_leave(before: BoardingProgress, after: BoardingProgress) -> None:
    assert occupancy.stands_open_to_leave(before, "L3") == after


@each_row(
    ("floor", "under_way", "stays"),
    [(None, False, True), ("L3", False, True), ("L2", False, False), ("L3", True, False), (None, True, False)],
)
def test_where_the_door_stood_open_counts_until_the_car_is_seen_elsewhere_or_under_way(
    floor: str | None, *, under_way: bool, stays: bool
) -> None:
    before = replace(ABOARD, may_leave_at="L3")
    assert occupancy.car_observed_at(before, floor, under_way=under_way) == (before if stays else ABOARD)


# -- what requests tell


@each_row(
    ("before", "floor", "word", "stop", "site", "after"),
    [
        (OUTSIDE, "L3", None, UNDER_WAY, SPOKEN, OUTSIDE),
        (MAY_BOARD, "L1", None, OPEN, INFERRED, MAY_BOARD),
        (MAY_BOARD, "L3", IN_PLACE, OPEN, SPOKEN, ABOARD),
        (MAY_BOARD, "L1", IN_PLACE, OPEN, SPOKEN, ABOARD),
        (MAY_BOARD, "L3", IN_PLACE, UNDER_WAY, SPOKEN, ABOARD),
        (OUTSIDE, "L3", IN_PLACE, None, SPOKEN, ABOARD),
        (MAY_BOARD, "L3", None, None, SPOKEN, BoardingProgress(Occupancy.MAY_BOARD, sent_on=True)),
        (MAY_BOARD, "L3", None, OPEN, INFERRED, ABOARD),
        (MAY_BOARD, "L3", None, OPEN, BLIND, SENT_ON),
        (replace(ABOARD, may_leave_at="L1"), "L3", None, OPEN, SPOKEN, ABOARD),
        (MAY_BOARD, "L1", LEFT, OPEN, SPOKEN, EXITED),
        (MAY_BOARD, "L3", LEFT, OPEN, SPOKEN, OUTSIDE),
        (MAY_BOARD, "L3", LEFT, OPEN, BLIND, OUTSIDE),
        (OUTSIDE, "L1", LEFT, OPEN, SPOKEN, OUTSIDE),
        (replace(ABOARD, may_leave_at="L1"), "L1", LEFT, OPEN, SPOKEN, EXITED),
    ],
)
def test_a_request_settles_where_the_robot_is(
    before: BoardingProgress,
    floor: str,
    word: RobotWord | None,
    stop: Stop | None,
    site: LiftConfig,
    after: BoardingProgress,
) -> None:
    assert occupancy.boarding_by_request(before, floor, word, stop, site, 15.0) == after


@each_row(
    ("before", "word", "stop", "site", "now", "texts"),
    [
        (OUTSIDE, IN_PLACE, UNDER_WAY, SPOKEN, 15.0, ("has not arrived at L1",)),
        (MAY_BOARD, None, OPEN, SPOKEN, 100.0, ("report that the robot is in place", "infer_occupancy")),
        (MAY_BOARD, None, OPEN, INFERRED, 14.9, ("4.9 s", "after 5 s")),
        (MAY_BOARD, None, replace(OPEN, is_open=False), INFERRED, 100.0, ("does not stand open",)),
        (MAY_BOARD, None, UNDER_WAY, INFERRED, 100.0, ("does not stand open",)),
        (ABOARD, LEFT, OPEN, SPOKEN, 15.0, ("has not stood open",)),
    ],
)
def test_a_request_that_cannot_be_believed_says_why(
    before: BoardingProgress, word: RobotWord | None, stop: Stop, site: LiftConfig, now: float, texts: tuple[str, ...]
) -> None:
    why = occupancy.boarding_by_request(before, "L3", word, stop, site, now)
    assert isinstance(why, str)
    assert all(text in why for text in texts)


@each_row(
    ("boarding", "floor", "word", "target", "site", "exited"),
    [
        (replace(ABOARD, may_leave_at="L3"), "L3", None, "L3", INFERRED, True),
        (replace(ABOARD, may_leave_at="L3"), "L3", None, "L3", SPOKEN, False),
        (replace(ABOARD, may_leave_at="L3"), "L3", None, "L4", INFERRED, False),
        (ABOARD, "L3", None, "L3", INFERRED, False),
        (replace(ABOARD, may_leave_at="L1"), "L1", LEFT, "L3", SPOKEN, True),
        (ABOARD, "L1", LEFT, "L3", SPOKEN, False),
        (replace(MAY_BOARD, may_leave_at="L1"), "L1", LEFT, "L1", INFERRED, False),
    ],
)
def test_a_release_means_exited_with_the_word_where_the_door_stood_open_or_at_the_target_where_that_may_be_inferred(
    boarding: BoardingProgress, floor: str, word: RobotWord | None, target: str, site: LiftConfig, *, exited: bool
) -> None:
    assert occupancy.has_exited(boarding, floor, word, target, site) is exited


# -- who counts as aboard


@each_row("state", Occupancy)
def test_on_a_lift_that_has_to_know_a_robot_is_aboard_only_once_that_is_known(state: Occupancy) -> None:
    assert occupancy.is_aboard(BoardingProgress(state), HANDSHAKE) is (state is Occupancy.ABOARD)


@each_row(
    ("state", "aboard"),
    [
        (Occupancy.OUTSIDE, None),
        (Occupancy.MAY_BOARD, None),
        (Occupancy.ABOARD, True),
        (Occupancy.EXITED, False),
    ],
)
def test_on_another_lift_nobody_says_unless_the_robot_did(state: Occupancy, aboard: bool | None) -> None:
    assert occupancy.is_aboard(BoardingProgress(state), PLAIN) is aboard


@each_row("command", ["call", "go", "robot_in_place", "robot_left"])
def test_each_command_of_the_handshake_makes_it_matter_who_is_aboard(command: str) -> None:
    assert occupancy.occupancy_matters(replace(PLAIN, commands=frozenset({"go_to", command})))
    assert occupancy.occupancy_matters(replace(PLAIN, needs_occupancy=True))
    assert not occupancy.occupancy_matters(PLAIN)


@each_row(
    ("boarding", "may_be_in_car", "reported"),
    [
        (OUTSIDE, False, Occupancy.OUTSIDE),
        (SENT_ON, True, Occupancy.MAY_BOARD),
        (MAY_BOARD, True, Occupancy.MAY_BOARD),
        (ABOARD, True, Occupancy.ABOARD),
        (EXITED, False, Occupancy.EXITED),
    ],
)
def test_a_robot_that_was_sent_on_unheard_may_be_inside(
    boarding: BoardingProgress, *, may_be_in_car: bool, reported: Occupancy
) -> None:
    assert (boarding.may_be_in_car, boarding.reported) == (may_be_in_car, reported)


# -- the doubt that a session leaves


@each_row(
    ("boarding", "released", "arrived", "otherwise"),
    [
        (OUTSIDE, False, False, False),
        (MAY_BOARD, False, False, True),
        (replace(MAY_BOARD, sent_on=True), False, True, True),
        (SENT_ON, False, True, True),
        (ABOARD, True, True, True),
        (EXITED, False, False, False),
    ],
)
def test_a_doubt_remains_after(boarding: BoardingProgress, *, released: bool, arrived: bool, otherwise: bool) -> None:
    ends = ((True, False), (False, True), (False, False))
    doubts = [
        occupancy.leaves_doubt(boarding, released=by_holder, word=None, arrived=there, has_words=False, let_out=True)
        for by_holder, there in ends
    ]
    assert doubts == [released, arrived, otherwise]


@each_row(
    ("boarding", "let_out", "doubt"),
    [
        (OUTSIDE, False, False),
        (MAY_BOARD, False, False),
        (SENT_ON, False, True),
        (SENT_ON, True, False),
        (replace(MAY_BOARD, sent_on=True), False, True),
        (replace(MAY_BOARD, sent_on=True), True, False),
        (ABOARD, True, True),
        (EXITED, False, False),
    ],
)
def test_the_end_of_a_holder_without_words_leaves_a_doubt_until_the_door_stood_open_for_a_robot_that_was_sent_on(
    boarding: BoardingProgress, *, let_out: bool, doubt: bool
) -> None:
    leaves = occupancy.leaves_doubt(boarding, released=True, word=None, arrived=False, has_words=False, let_out=let_out)
    assert leaves is doubt


@each_row("let_out", [False, True])
@each_row(("boarding", "word", "doubt"), [(MAY_BOARD, None, True), (MAY_BOARD, LEFT, False), (OUTSIDE, None, False)])
def test_a_holder_with_words_has_to_say_that_its_robot_left(
    boarding: BoardingProgress, word: RobotWord | None, *, let_out: bool, doubt: bool
) -> None:
    leaves = occupancy.leaves_doubt(boarding, released=True, word=word, arrived=False, has_words=True, let_out=let_out)
    assert leaves is doubt
