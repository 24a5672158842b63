"""The robot handshake, on a bench: who is aboard, who may pass, and when the car goes on."""

from dataclasses import replace

import pytest

from register_maps.words import Mode
from simulator import shaft
from simulator.controller import Parameters, SameFloorCall
from simulator.handshake import Rules
from tests.simulator.bench import FRONT, PLAIN, SCAN_S, Lift, all_closed, floors

NOTHING: dict[str, int] = {}
IN_PLACE, LEFT = {"robot_in_place": 1}, {"robot_left": 1}
LEVELS = replace(PLAIN, handshake=Rules(lasting=frozenset({"call", "go"})))
PULSES = replace(PLAIN, handshake=Rules())
TWO_STOPS = Parameters(
    shaft=shaft.Parameters(heights_m=shaft.even_heights(2)),
    handshake=Rules(lasting=frozenset({"call"}), in_place_sends_on=True, in_place_is_occupied=True),
)


def called(floor: int) -> dict[str, int]:
    return {"call": floor}


def sent(floor: int) -> dict[str, int]:
    return {"go": floor}


def waiting_at(floor: int, parameters: Parameters = LEVELS) -> Lift:
    """A lift that was called and stands open."""
    lift = Lift(parameters)
    assert lift.run(30, commands=called(floor)).may_enter
    assert lift.see().door_open_floor == floor
    return lift


def aboard_at(floor: int, parameters: Parameters = LEVELS) -> Lift:
    """A lift with a robot aboard and its door closed."""
    lift = waiting_at(floor, parameters)
    lift.run(SCAN_S, commands=called(floor) | IN_PLACE)
    assert all_closed(lift.run(20, commands=NOTHING))
    assert lift.see().occupied
    return lift


def test_a_trip_call_enter_go_leave() -> None:
    lift = Lift(LEVELS)
    coming = lift.run(3, commands=called(2))
    assert (coming.destination, coming.may_enter) == (2, False)
    there = lift.run(600)
    assert (there.door_open_floor, there.may_enter, there.may_leave) == (2, True, False), "it waits, however long"
    inside = lift.run(SCAN_S, commands=called(2) | IN_PLACE)
    assert (inside.may_enter, inside.occupied) == (False, True)
    lift.run(1, commands=sent(4))
    assert lift.stops(20) == [4]
    arrived = lift.run(600)
    assert (arrived.door_open_floor, arrived.may_leave, arrived.may_enter) == (4, True, False)
    out = lift.run(SCAN_S, commands=sent(4) | LEFT)
    assert (out.may_leave, out.occupied) == (False, False)
    assert all_closed(lift.run(10, commands=NOTHING))


def test_a_permission_is_given_only_while_the_door_stands_fully_open_at_that_floor() -> None:
    lift = Lift(LEVELS)
    lift.inputs = replace(lift.inputs, commands=called(3), car_buttons=floors(1))
    stops = set()
    for picture in lift.watch(30):
        assert picture.may_enter == (picture.door_open_floor == 3)
        stops.add(picture.door_open_floor)
    assert stops == {None, 1, 3}


def test_a_call_for_an_occupied_car_moves_nothing() -> None:
    lift = aboard_at(1)
    for picture in lift.watch(10, commands=called(4)):
        assert picture.destination is None
        assert not picture.may_enter


def test_a_go_for_an_empty_car_moves_nothing() -> None:
    lift = Lift(LEVELS)
    for picture in lift.watch(10, commands=sent(4)):
        assert picture.destination is None


def test_a_go_that_came_a_moment_before_the_robot_was_in_place_counts() -> None:
    lift = waiting_at(1)
    lift.run(1, commands=called(1) | sent(3))
    lift.run(1, commands=sent(3) | IN_PLACE)
    assert lift.stops(20) == [3]


@pytest.mark.parametrize("parameters", [LEVELS, PULSES])
def test_a_call_that_is_kept_on_after_the_acknowledgement_opens_no_more_doors(parameters: Parameters) -> None:
    lift = waiting_at(2, parameters)
    lift.run(1, commands=called(2) | IN_PLACE)
    lift.run(1, commands=called(2) | sent(0))
    assert lift.stops(20) == [0]
    lift.run(1, commands=called(2) | sent(0) | LEFT)
    assert all_closed(lift.run(5, commands=called(2) | sent(0)))
    for picture in lift.watch(60):
        assert all_closed(picture)
        assert picture.level_floor == 0
    # and once it is another one it is a call again
    lift.run(1, commands=called(3))
    assert lift.stops(20) == [3]


def test_a_call_that_was_let_go_may_come_again_for_the_same_floor() -> None:
    lift = aboard_at(2)
    lift.run(1, commands=LEFT)
    lift.run(1, commands=NOTHING)
    assert lift.run(5, commands=called(2)).may_enter


def test_a_level_call_that_is_taken_back_lets_the_car_close() -> None:
    lift = waiting_at(2)
    assert not lift.run(SCAN_S, commands=NOTHING).may_enter
    assert all_closed(lift.run(6))


def test_a_pulse_call_that_ends_is_not_taken_back() -> None:
    lift = Lift(PULSES)
    lift.run(0.5, commands=called(2))
    assert lift.run(600, commands=NOTHING).may_enter


def test_a_call_for_another_floor_goes_before_the_first() -> None:
    lift = waiting_at(2)
    assert not lift.run(SCAN_S, commands=called(4)).may_enter
    assert lift.stops(30) == [4]
    assert lift.run(60).may_enter


@pytest.mark.parametrize("answer", SameFloorCall)
def test_a_call_for_the_floor_it_stands_at_opens_the_door(answer: SameFloorCall) -> None:
    lift = Lift(replace(LEVELS, same_floor_call=answer), at=1)
    assert lift.run(60, commands=called(1)).may_enter


def test_the_close_button_does_not_shut_out_the_robot_that_is_waited_for() -> None:
    lift = waiting_at(2)
    assert lift.run(30, close_door=FRONT).may_enter


def test_a_hold_keeps_the_door_open_after_the_acknowledgement() -> None:
    lift = waiting_at(2)
    held = lift.run(60, commands=IN_PLACE | {"hold_door.front": 1})
    assert (held.door_open_floor, held.may_enter, held.occupied) == (2, False, True)


def test_fire_withdraws_the_permission_and_does_not_forget_who_is_aboard() -> None:
    lift = waiting_at(2)
    assert not lift.run(SCAN_S, fire=True).may_enter
    assert lift.stops(30) == [0]
    after = lift.run(30, fire=False)
    assert (after.mode, after.may_enter) == (Mode.NORMAL, False), "the call from before the fire is spent"
    robot = aboard_at(2)
    robot.run(30, fire=True)
    assert robot.run(30, fire=False).occupied
    robot.run(1, commands=sent(3))
    assert robot.stops(30) == [3]


# -- a lift of two stops that a robot in place sends on


def test_a_robot_in_place_sends_the_car_to_the_other_stop_and_letting_go_says_that_it_left() -> None:
    lift = Lift(TWO_STOPS)
    assert lift.run(20, commands=called(1)).may_enter
    lift.run(SCAN_S, commands=IN_PLACE)
    assert lift.stops(20) == [0]
    arrived = lift.run(600)
    assert (arrived.door_open_floor, arrived.may_leave, arrived.occupied) == (0, True, True)
    out = lift.run(SCAN_S, commands=NOTHING)
    assert (out.may_leave, out.occupied) == (False, False)
    assert all_closed(lift.run(10))


def test_of_more_than_two_stops_a_robot_in_place_names_none() -> None:
    lift = waiting_at(1, replace(TWO_STOPS, shaft=PLAIN.shaft))
    resting = lift.run(30, commands=IN_PLACE)
    assert (resting.occupied, resting.level_floor, resting.destination) == (True, 1, None)


# -- without a handshake


def test_without_a_handshake_call_and_go_are_car_calls() -> None:
    lift = Lift()
    lift.run(1, commands=called(2))
    assert lift.stops(20) == [2]
    lift.run(1, commands=sent(0))
    assert lift.stops(20) == [0]
    assert all_closed(lift.run(10))
    assert not lift.see().may_leave
