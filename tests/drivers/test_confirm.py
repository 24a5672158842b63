"""What counts as the effect of a call, by what the lift says before and after."""

from dataclasses import replace

from drivers.modbus.confirm import Expectation, find_proof
from drivers.modbus.standstill import STILL_S, StandstillEvidence
from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.schema import Evidence
from register_maps.words import Door, Motion, Side
from tests.support.rows import each_row

FLOORS = ("L1", "L2", "L3")
SHUT = {Side.FRONT: Door.CLOSED}
DOOR_OPEN = Evidence(kind="door_open")


def effect(target: str, before: LiftValues | None, now: LiftValues, *, stood: bool = False) -> bool:
    expected = Expectation(Command(CommandKind.GO_TO, target), ("effect",), before, FLOORS, stood)
    return find_proof(expected, now, read_back=False) is Proof.EFFECT


@each_row("motion", [Motion.UP, Motion.DOWN, Motion.MOVING])
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


def test_a_car_that_set_out_from_another_floor_has_come_even_before_it_stands() -> None:
    assert effect(
        "L2", LiftValues(floor="L1", motion=Motion.STOPPED), LiftValues(floor="L2", motion=Motion.UP), stood=True
    )


def test_a_car_that_was_under_way_already_has_come_once_it_stands_or_is_at_an_end_of_its_shaft() -> None:
    up = LiftValues(floor="L1", motion=Motion.UP)
    assert not effect("L2", up, LiftValues(floor="L2", motion=Motion.UP))
    assert effect("L2", up, LiftValues(floor="L2", motion=Motion.STOPPED))
    assert effect("L3", up, LiftValues(floor="L3", motion=Motion.UP))
    shut = LiftValues(floor="L1", doors=SHUT)
    assert not effect("L2", shut, replace(shut, floor="L2"))
    assert effect("L2", shut, LiftValues(floor="L2", doors={Side.FRONT: Door.OPENING}))


def test_a_car_that_sets_out_the_right_way_has_taken_the_call_and_one_that_goes_the_other_way_has_not() -> None:
    before = LiftValues(floor="L2", motion=Motion.STOPPED)
    assert effect("L3", before, LiftValues(floor="L2", motion=Motion.UP), stood=True)
    assert not effect("L3", before, LiftValues(floor="L2", motion=Motion.DOWN), stood=True)
    shut = LiftValues(floor="L2", doors=SHUT)
    assert effect("L3", shut, LiftValues(floor="L3", doors=SHUT), stood=True)
    assert effect("L3", replace(shut, floor="L1"), shut, stood=True)
    assert not effect("L1", shut, LiftValues(floor="L3", doors=SHUT), stood=True)


def test_a_car_that_was_under_way_already_goes_on_for_somebody_else() -> None:
    up = LiftValues(floor="L1", motion=Motion.UP)
    assert not effect("L3", up, up)
    assert not effect("L3", up, LiftValues(floor="L2", motion=Motion.UP))
    assert not effect("L3", LiftValues(floor="L1", doors=SHUT), LiftValues(floor="L2", doors=SHUT))


def test_a_car_that_left_its_floor_without_a_word_which_way_can_only_go_one_way_from_an_end_of_its_shaft() -> None:
    between = LiftValues(floor=None, doors=SHUT)
    assert effect("L3", LiftValues(floor="L1", doors=SHUT), between, stood=True)
    assert effect("L1", LiftValues(floor="L3", doors=SHUT), between, stood=True)
    assert not effect("L1", LiftValues(floor="L2", doors=SHUT), between, stood=True)


def test_a_motion_that_never_tells_its_direction_is_all_that_can_be_seen() -> None:
    stood = LiftValues(floor="L2", motion=Motion.STOPPED)
    assert effect("L1", stood, LiftValues(floor=None, motion=Motion.MOVING), stood=True)
    assert not effect("L1", LiftValues(floor="L2", motion=Motion.MOVING), LiftValues(motion=Motion.MOVING))


@each_row(
    ("values", "stands"),
    [
        (LiftValues(floor="L2", motion=Motion.STOPPED, doors=SHUT), True),
        (LiftValues(floor="L2", doors={Side.FRONT: Door.CLOSING}), True),
        (LiftValues(floor="L2", motion=Motion.MOVING, doors=SHUT), False),
        (LiftValues(floor="L2", motion=Motion.UNKNOWN, doors=SHUT), False),
        (LiftValues(floor="L2", doors=SHUT), False),
        (LiftValues(floor=None, doors=SHUT), False),
        (LiftValues(floor="L2", doors={Side.FRONT: Door.UNKNOWN}), False),
    ],
)
def test_a_car_stands_where_motion_or_an_open_door_says_so(values: LiftValues, stands: bool) -> None:
    standing = StandstillEvidence(DOOR_OPEN)
    standing.update(values, 1.0)
    assert standing.is_standing(1.0) is stands


def test_a_shut_car_without_a_word_about_motion_stands_once_it_has_told_one_floor_for_long_enough() -> None:
    standing = StandstillEvidence(DOOR_OPEN)
    standing.update(LiftValues(floor="L2", doors={Side.FRONT: Door.CLOSING}), 1.0)
    standing.update(LiftValues(floor="L2", doors=SHUT), 2.0)
    standing.update(LiftValues(floor="L2", doors=SHUT, flags={"fire": False}), 8.0)
    assert not standing.is_standing(1.9 + STILL_S)
    assert standing.is_standing(2.0 + STILL_S)
    standing.update(LiftValues(floor="L3", doors=SHUT), 20.0)
    assert not standing.is_standing(20.0)
    standing.update(LiftValues(floor=None, doors=SHUT), 50.0)
    assert not standing.is_standing(90.0)
    standing.update(LiftValues(floor="L3", doors=SHUT), 100.0)
    standing.reset()
    assert not standing.is_standing(200.0)


def test_what_the_map_calls_standing_is_enough() -> None:
    shut = LiftValues(floor="L2", doors=SHUT)
    stable = StandstillEvidence(Evidence(kind="position_stable", for_s=2.0))
    stable.update(shut, 1.0)
    assert (stable.is_standing(2.9), stable.is_standing(3.0)) == (False, True)
    level = StandstillEvidence(Evidence(kind="level"))
    level.update(replace(shut, flags={"level": True}), 1.0)
    assert level.is_standing(1.0)
    level.update(replace(shut, flags={"level": False}), 2.0)
    assert not level.is_standing(2.0)
