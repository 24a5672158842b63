"""What robots are told when people come first, and when nobody knows whether a robot is in the car."""

from collections.abc import Mapping

import pytest

from lift_manager.domain import boarding as boardings
from lift_manager.domain.asking import Ask, RobotWord
from lift_manager.domain.boarding import Boarding, Rules, Stop, Who
from lift_manager.domain.service import Advice, advise, how_to_acknowledge, how_to_end_lockout
from lift_manager.domain.state import Holder
from register_maps.words import Door, Side

HOLDER = Holder("rmf", "fleet/robot1")
FRONT, REAR = Side.FRONT, Side.REAR
SHUT = {FRONT: Door.CLOSED}
NOT_SHUT = sorted(set(Door) - {Door.CLOSED})


def test_a_robot_that_may_be_aboard_behind_a_shut_door_stays_there() -> None:
    assert advise(SHUT, may_be_aboard=True) is Advice.STAY_ABOARD
    assert advise({FRONT: Door.CLOSED, REAR: Door.CLOSED}, may_be_aboard=True) is Advice.STAY_ABOARD


def test_a_robot_that_cannot_be_aboard_keeps_out() -> None:
    assert advise(SHUT, may_be_aboard=False) is Advice.CLEAR_DOORWAY


@pytest.mark.parametrize(
    "doors",
    [*({FRONT: door} for door in NOT_SHUT), {FRONT: Door.CLOSED, REAR: Door.OPEN}, {}, None],
)
@pytest.mark.parametrize("may_be_aboard", [True, False])
def test_a_door_that_is_not_seen_to_be_shut_is_kept_clear(
    doors: Mapping[Side, Door] | None, *, may_be_aboard: bool
) -> None:
    assert advise(doors, may_be_aboard=may_be_aboard) is Advice.CLEAR_DOORWAY


@pytest.mark.parametrize(
    ("boarding", "released", "arrived", "otherwise"),
    [
        (Boarding(), False, False, False),
        (Boarding(Who.MAY_BOARD), False, False, True),
        (Boarding(Who.MAY_BOARD, sent_on=True), False, True, True),
        (Boarding(sent_on=True), False, True, True),
        (Boarding(Who.ABOARD), True, True, True),
        (Boarding(Who.LEFT), False, False, False),
    ],
)
def test_doubt_remains_after(boarding: Boarding, *, released: bool, arrived: bool, otherwise: bool) -> None:
    word = Ask("lift", HOLDER, "L1", hold_door=False)
    ends: dict[str, tuple[Ask | None, bool]] = {
        "released": (word, False),
        "arrived": (None, True),
        "otherwise": (None, False),
    }
    doubts = {
        end: boardings.leaves_doubt(boarding, release, arrived=there, has_words=False)
        for end, (release, there) in ends.items()
    }
    assert doubts == {"released": released, "arrived": arrived, "otherwise": otherwise}


def test_a_holder_that_has_words_for_it_has_to_say_that_its_robot_left() -> None:
    may_be_inside = Boarding(Who.MAY_BOARD)
    silent, said = (Ask("lift", HOLDER, "L1", hold_door=False, robot=word) for word in (None, RobotWord.LEFT))
    assert boardings.leaves_doubt(may_be_inside, silent, arrived=False, has_words=True)
    assert not boardings.leaves_doubt(may_be_inside, said, arrived=False, has_words=True)
    assert not boardings.leaves_doubt(Boarding(), silent, arrived=False, has_words=True)


def test_a_robot_that_said_it_is_outside_leaves_no_doubt_and_one_that_was_sent_on_does() -> None:
    rules = Rules(matters=False, infer=False, board_min_s=5.0)
    stop = Stop("L1", arrived=True, open=True)
    entered = boardings.open_to_enter(Boarding(), 1.0)
    sent_on = boardings.hear(entered, Ask("lift", HOLDER, "L3", hold_door=True), stop, rules, 9.0)
    outside = boardings.hear(entered, Ask("lift", HOLDER, "L3", True, RobotWord.LEFT), stop, rules, 9.0)
    assert isinstance(sent_on, Boarding)
    assert isinstance(outside, Boarding)
    assert (boardings.possible(sent_on), boardings.rode(sent_on)) == (True, True)
    assert boardings.rode(boardings.open_to_enter(sent_on, 20.0))
    assert not boardings.possible(outside)


def test_the_advice_to_a_person_can_be_pasted_into_a_shell() -> None:
    assert how_to_acknowledge("east wing") == "`lift-manager ack 'east wing' --by NAME`"
    assert how_to_end_lockout("east") == "`lift-manager lockout east --by NAME --end`"
