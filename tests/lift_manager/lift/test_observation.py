"""What readings establish: opening is believed slowly, closing at once."""

from dataclasses import replace

import pytest

from drivers.model import Capabilities, LiftReading, LiftValues
from lift_manager.lift.inhibits import barred_by
from lift_manager.lift.modes import is_on_fire
from lift_manager.lift.observation import (
    Observation,
    RobotDoor,
    door_by_signals,
    has_departed,
    observe,
    permissions_needed,
)
from register_maps.words import ROBOT_FORBIDDEN_MODES, Door, Mode, Motion, Side
from tests.lift_manager.lift.test_call import ABLE
from tests.support.rows import each_row

OPEN = LiftValues(floor="L2", motion=Motion.STOPPED, mode=Mode.ROBOT, doors={Side.FRONT: Door.OPEN})
CLOSED = replace(OPEN, doors={Side.FRONT: Door.CLOSED})
SPLIT = replace(ABLE, one_block=False)
STABLE = replace(ABLE, evidence="position_stable", evidence_for_s=1.0)
LEVEL = replace(ABLE, evidence="level")


def read(
    before: Observation | None, values: LiftValues, at: float, able: Capabilities, *, epoch: int = 1, gap_s: float = 0.1
) -> Observation:
    return observe(before, LiftReading(at, epoch, values), able, gap_s=gap_s, apart_s=0.075)


def door(observation: Observation, here: tuple[Side, ...] = (Side.FRONT,)) -> RobotDoor:
    return door_by_signals(observation, here, frozenset())


def test_one_whole_reading_is_enough_when_it_came_in_one_piece() -> None:
    assert door(read(None, OPEN, 0.0, ABLE)) is RobotDoor.OPEN


def test_a_reading_in_several_pieces_opens_only_with_a_second_one_that_agrees() -> None:
    first = read(None, OPEN, 0.0, SPLIT)
    assert door(first) is RobotDoor.MOVING
    assert door(read(first, OPEN, 0.1, SPLIT)) is RobotDoor.OPEN


def test_readings_of_one_moment_of_a_gateway_are_one_reading() -> None:
    first = read(None, OPEN, 0.0, SPLIT)
    soon = read(first, OPEN, 0.05, SPLIT)
    assert door(soon) is RobotDoor.MOVING
    assert not soon.is_settled
    assert door(read(soon, OPEN, 0.1, SPLIT)) is RobotDoor.OPEN


def test_closing_is_believed_on_the_first_reading_whatever_its_pieces() -> None:
    first = read(read(None, OPEN, 0.0, SPLIT), OPEN, 0.1, SPLIT)
    assert door(read(first, CLOSED, 0.2, SPLIT)) is RobotDoor.CLOSED


def test_two_readings_do_not_agree_across_a_gap_or_a_new_connection() -> None:
    first = read(None, OPEN, 0.0, SPLIT)
    assert door(read(first, OPEN, 1.5, SPLIT, gap_s=1.5)) is RobotDoor.MOVING
    assert door(read(first, OPEN, 0.1, SPLIT, epoch=2)) is RobotDoor.MOVING


def test_a_position_counts_only_after_it_has_stood_still_long_enough() -> None:
    still = replace(OPEN, motion=None)
    observation = read(None, still, 0.0, STABLE)
    for tenth in range(1, 10):
        observation = read(observation, still, tenth / 10, STABLE)
        assert door(observation) is RobotDoor.MOVING
    assert door(read(observation, still, 1.0, STABLE)) is RobotDoor.OPEN


def test_a_car_has_left_when_it_is_seen_elsewhere_or_moving_but_not_while_it_levels_at_an_open_door() -> None:
    def seen(values: LiftValues) -> Observation:
        return read(None, values, 0.0, STABLE)

    nowhere = replace(OPEN, floor=None, motion=None)
    assert has_departed(seen(OPEN), "L1")
    assert has_departed(seen(replace(CLOSED, motion=Motion.UP)), "L2")
    assert has_departed(seen(replace(nowhere, motion=Motion.DOWN)), "L2")
    for values in (OPEN, CLOSED, nowhere, replace(CLOSED, motion=None), replace(OPEN, motion=Motion.UP)):
        assert not has_departed(seen(values), "L2")


def test_an_observation_is_settled_only_when_another_reading_would_tell_nothing_new() -> None:
    still = replace(OPEN, motion=None)
    assert read(None, OPEN, 0.0, ABLE).is_settled
    assert not read(None, OPEN, 0.0, SPLIT).is_settled
    waiting = read(None, still, 0.0, STABLE)
    assert not waiting.is_settled
    assert read(waiting, still, 1.0, STABLE).is_settled
    assert read(None, replace(still, floor=None), 0.0, STABLE).is_settled


def test_a_position_that_went_away_in_between_begins_again() -> None:
    still = replace(OPEN, motion=None)
    observation = read(None, still, 0.0, STABLE)
    observation = read(observation, replace(still, floor=None), 0.5, STABLE)
    observation = read(observation, still, 0.9, STABLE)
    assert not read(observation, still, 1.5, STABLE).is_standing


@each_row("motion", [Motion.UP, Motion.DOWN, Motion.MOVING, Motion.UNKNOWN])
def test_a_door_is_never_open_for_robots_while_the_car_may_be_moving(motion: Motion) -> None:
    moving = replace(OPEN, motion=motion, flags={"level": True})
    assert all(door(read(None, moving, 0.0, able)) is RobotDoor.MOVING for able in (ABLE, LEVEL, STABLE))


def test_level_evidence_needs_the_level_signal() -> None:
    assert door(read(None, OPEN, 0.0, LEVEL)) is RobotDoor.MOVING
    assert door(read(None, replace(OPEN, flags={"level": True}), 0.0, LEVEL)) is RobotDoor.OPEN


def test_nobody_is_invited_in_where_no_floor_is_known() -> None:
    assert door(read(None, replace(OPEN, floor=None), 0.0, ABLE)) is RobotDoor.MOVING


@each_row("mode", sorted(ROBOT_FORBIDDEN_MODES))
def test_nobody_is_invited_in_while_the_mode_forbids_robots(mode: Mode) -> None:
    values = replace(OPEN, mode=mode)
    assert door(read(None, values, 0.0, ABLE)) is RobotDoor.MOVING
    assert barred_by(values, ABLE) == f"its mode is {mode}"


@each_row("state", [Door.FAULT, Door.UNKNOWN, Door.OPENING, Door.CLOSING, Door.MOVING])
def test_anything_but_fully_open_is_not_open(state: Door) -> None:
    assert door(read(None, replace(OPEN, doors={Side.FRONT: state}), 0.0, ABLE)) is RobotDoor.MOVING


def test_with_two_doors_only_those_of_this_floor_have_to_be_open_and_all_have_to_be_closed() -> None:
    both = (Side.FRONT, Side.REAR)
    front = read(None, replace(OPEN, doors={Side.FRONT: Door.OPEN, Side.REAR: Door.CLOSED}), 0.0, ABLE)
    assert door(front) is RobotDoor.OPEN
    assert door(front, (Side.REAR,)) is RobotDoor.MOVING
    assert door(front, both) is RobotDoor.MOVING
    assert door(front, ()) is RobotDoor.MOVING


@pytest.mark.parametrize(("flag", "words"), [("robots_allowed", "key switch"), ("ready", "not ready")])
def test_a_lift_that_says_no_takes_no_robot(flag: str, words: str) -> None:
    assert words in str(barred_by(replace(OPEN, flags={flag: False}), ABLE))
    assert barred_by(replace(OPEN, flags={flag: True}), ABLE) is None


def test_a_module_whose_watchdog_has_tripped_takes_no_press() -> None:
    assert barred_by(replace(OPEN, flags={"watchdog_tripped": False}), ABLE) is None
    tripped = barred_by(replace(OPEN, flags={"watchdog_tripped": True}), ABLE)
    assert tripped == "its module watchdog has tripped, so its outputs are not ours"


@each_row("flag", ["robots_allowed", "ready", "watchdog_tripped"])
def test_a_signal_of_the_map_that_cannot_be_read_takes_no_robot(flag: str) -> None:
    able = replace(ABLE, signals=ABLE.signals | {flag})
    check = "check its wiring and its entry in the map"
    assert barred_by(OPEN, able) == f"its signal {flag} cannot be read; {check}"
    unlisted = replace(OPEN, unknown={flag: 7})
    assert barred_by(unlisted, able) == f"its signal {flag} reads 7, which its map does not list; {check}"
    assert barred_by(replace(OPEN, flags={flag: flag != "watchdog_tripped"}), able) is None
    assert barred_by(OPEN, ABLE) is None


@each_row(
    ("values", "burns"),
    [
        (OPEN, False),
        (replace(OPEN, mode=Mode.FIRE), True),
        (replace(OPEN, mode=Mode.INSPECTION), False),
        (replace(OPEN, mode=Mode.INSPECTION, fire_word=True), True),
        (replace(OPEN, mode=Mode.INSPECTION, flags={"fire": True}), True),
        (replace(OPEN, mode=Mode.INSPECTION, flags={"fire": False, "fireman": True}), True),
        (replace(OPEN, flags={"fire": False, "fireman": False}), False),
    ],
)
def test_fire_is_believed_from_any_signal_that_tells_of_it(values: LiftValues, *, burns: bool) -> None:
    assert is_on_fire(values) is burns


@each_row(("watchdog_s", "allowed"), [(0.0, False), (5.0, True), (None, True)])
def test_a_hold_that_relies_on_a_watchdog_needs_it_switched_on(watchdog_s: float | None, *, allowed: bool) -> None:
    values = replace(OPEN, watchdog_s=watchdog_s)
    assert (barred_by(values, replace(ABLE, watched=True)) is None) is allowed
    assert barred_by(values, ABLE) is None


def test_the_open_limit_of_a_floor_is_evidence_enough_and_goes_with_the_door() -> None:
    limit = replace(ABLE, evidence="door_limit")
    still = replace(OPEN, motion=None)
    assert door(read(None, still, 0.0, limit)) is RobotDoor.OPEN
    shut = replace(still, floor=None, doors={Side.FRONT: Door.CLOSED})
    assert not read(None, shut, 0.0, limit).is_standing


PERMITTED = replace(ABLE, signals=ABLE.signals | {"may_enter", "may_leave"})
ENTER, LEAVE = {"may_enter": True, "may_leave": False}, {"may_enter": False, "may_leave": True}
NEITHER = {"may_enter": False, "may_leave": False}


@each_row(
    ("aboard", "flags", "word"),
    [
        (False, ENTER, RobotDoor.OPEN),
        (False, LEAVE, RobotDoor.MOVING),
        (True, ENTER, RobotDoor.MOVING),
        (True, LEAVE, RobotDoor.OPEN),
        (None, ENTER, RobotDoor.OPEN),
        (None, LEAVE, RobotDoor.OPEN),
        (None, NEITHER, RobotDoor.MOVING),
        (None, {}, RobotDoor.MOVING),
    ],
)
def test_an_open_door_needs_the_permission_for_where_the_robot_is(
    aboard: bool | None, flags: dict[str, bool], word: RobotDoor
) -> None:
    observation = read(None, replace(OPEN, flags=flags), 0.0, PERMITTED)
    assert door_by_signals(observation, (Side.FRONT,), permissions_needed(PERMITTED, aboard=aboard)) is word


@each_row("aboard", [True, False, None])
def test_a_map_without_permissions_needs_none(aboard: bool | None) -> None:
    assert permissions_needed(ABLE, aboard=aboard) == frozenset()


def test_a_door_told_by_its_open_contact_alone_moves_for_as_long_as_it_may_take_to_close() -> None:
    able = replace(ABLE, open_contacts=frozenset({Side.FRONT}), door_closes_within_s=5.0)
    observation = read(read(None, OPEN, 0.0, able), CLOSED, 0.1, able)
    assert (observation.doors, door(observation)) == ({Side.FRONT: Door.MOVING}, RobotDoor.MOVING)
    assert not observation.is_settled
    observation = read(observation, CLOSED, 5.0, able)
    assert door(observation) is RobotDoor.MOVING
    observation = read(observation, CLOSED, 5.1, able)
    assert (observation.doors, door(observation)) == ({Side.FRONT: Door.CLOSED}, RobotDoor.CLOSED)
    assert observation.is_settled
    again = read(read(observation, OPEN, 5.2, able), CLOSED, 5.3, able)
    assert door(again) is RobotDoor.MOVING


def test_how_long_such_a_door_has_not_been_open_is_unknown_at_the_start_and_after_a_gap() -> None:
    able = replace(ABLE, open_contacts=frozenset({Side.FRONT}), door_closes_within_s=5.0)
    first = read(None, CLOSED, 0.0, able)
    assert door(first) is RobotDoor.MOVING
    closed = read(first, CLOSED, 5.0, able)
    assert door(closed) is RobotDoor.CLOSED
    assert door(read(closed, CLOSED, 9.0, able, gap_s=4.0)) is RobotDoor.MOVING
    assert door(read(closed, CLOSED, 5.1, able, epoch=2)) is RobotDoor.MOVING


def test_a_car_that_moves_does_not_stand_whatever_its_level_flag_says() -> None:
    passing = replace(OPEN, motion=Motion.UP, flags={"level": True})
    assert door(read(None, passing, 0.0, LEVEL)) is RobotDoor.MOVING
