"""What counts as the effect of a call, by what the lift says before and after."""

import pytest

from drivers.modbus.confirm import Expectation, proof
from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Motion, Side

FLOORS = ("L1", "L2", "L3")
SHUT = {Side.FRONT: Door.CLOSED}


def effect(target: str, before: LiftValues | None, now: LiftValues) -> bool:
    expected = Expectation(Command(CommandKind.GO_TO, target), ("effect",), before, FLOORS)
    return proof(expected, now, read_back=False) is Proof.EFFECT


@pytest.mark.parametrize("motion", [Motion.UP, Motion.DOWN, Motion.MOVING])
def test_a_car_that_leaves_the_floor_it_is_called_to_has_not_come(motion: Motion) -> None:
    there = LiftValues(floor="L2", motion=motion)
    assert not effect("L2", there, there)


def test_a_car_that_stands_where_it_is_called_to_is_there() -> None:
    assert effect("L2", LiftValues(floor="L2", motion=Motion.UP), LiftValues(floor="L2", motion=Motion.STOPPED))
    assert effect("L2", None, LiftValues(floor="L2"))


def test_without_a_word_about_motion_a_shut_car_may_be_leaving_and_an_open_one_is_there() -> None:
    before = LiftValues(floor="L2", doors=SHUT)
    assert not effect("L2", before, before)
    assert effect("L2", before, LiftValues(floor="L2", doors={Side.FRONT: Door.OPENING}))


def test_a_car_that_comes_to_its_floor_from_another_one_has_come_even_before_it_stands() -> None:
    assert effect("L2", LiftValues(floor="L1", motion=Motion.UP), LiftValues(floor="L2", motion=Motion.UP))


def test_a_car_that_sets_out_the_right_way_has_taken_the_call_and_one_that_goes_the_other_way_has_not() -> None:
    before = LiftValues(floor="L2", motion=Motion.STOPPED)
    assert effect("L3", before, LiftValues(floor="L2", motion=Motion.UP))
    assert not effect("L3", before, LiftValues(floor="L2", motion=Motion.DOWN))
    assert effect("L1", before, LiftValues(floor=None, doors=SHUT))
