"""Car and doors: they move as a lift does, and the interlocks hold whatever is ordered."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from register_maps.words import Door, Motion, Side
from simulator import shaft
from simulator.shaft import Orders, Parameters, State
from tests.support.examples import examples
from tests.support.rows import each_row

FRONT, REAR = frozenset({Side.FRONT}), frozenset({Side.REAR})
BOTH = FRONT | REAR
BUILDING = Parameters(doors_at=(FRONT, BOTH, REAR, FRONT))
HEIGHTS = BUILDING.heights_m
SAMPLE_S = 0.04


def to(floor: int) -> Orders:
    return Orders(target_m=HEIGHTS[floor])


def samples(state: State, orders: Orders, duration_s: float, parameters: Parameters = BUILDING) -> list[State]:
    seen = [state]
    for _ in range(round(duration_s / SAMPLE_S)):
        seen.append(shaft.step(seen[-1], orders, SAMPLE_S, parameters))
    return seen


def moving_up(*, for_s: float) -> State:
    return shaft.step(shaft.at_floor(0, BUILDING), to(3), for_s, BUILDING)


# -- the car


def test_the_car_arrives_exactly_at_its_target_and_stays() -> None:
    state = shaft.step(shaft.at_floor(0, BUILDING), to(3), 60, BUILDING)
    assert (state.position_m, state.speed_m_s, state.floor) == (HEIGHTS[3], 0.0, 3)
    assert shaft.level_floor(state, BUILDING) == 3
    assert shaft.step(state, to(3), 60, BUILDING) == state


def test_a_long_trip_takes_the_time_of_a_trapezoid_and_the_creep() -> None:
    accelerating_s = braking_s = 1.0 / 0.8
    cruising_s = (9.6 - 1.0 * accelerating_s - 0.05) / 1.0
    creeping_s = 0.05 / 0.1
    trip_s = accelerating_s + cruising_s + braking_s + creeping_s
    assert not shaft.step(shaft.at_floor(0, BUILDING), to(3), trip_s - 0.01, BUILDING).standing
    assert shaft.step(shaft.at_floor(0, BUILDING), to(3), trip_s + 0.01, BUILDING).standing


def test_the_car_reaches_top_speed_on_a_long_trip_and_never_exceeds_it() -> None:
    speeds = [state.speed_m_s for state in samples(shaft.at_floor(3, BUILDING), to(0), 15)]
    assert min(speeds) == pytest.approx(-1.0)
    assert max(speeds) == 0.0


def test_the_last_centimetres_are_travelled_at_creep_speed() -> None:
    approach = [s for s in samples(shaft.at_floor(0, BUILDING), to(1), 15) if 0.01 < HEIGHTS[1] - s.position_m < 0.055]
    assert len(approach) > 10
    assert all(state.speed_m_s <= 0.1 + 1e-9 for state in approach)


def test_a_correction_of_a_centimetre_is_made_at_no_more_than_creep_speed() -> None:
    below = shaft.at_floor(1, BUILDING)._replace(position_m=HEIGHTS[1] - 0.01)
    assert shaft.level_floor(below, BUILDING) is None
    run = samples(below, to(1), 2)
    assert 0 < max(state.speed_m_s for state in run) <= 0.1
    assert run[-1].position_m == HEIGHTS[1]


def test_a_standing_car_without_a_target_stays_where_it_is() -> None:
    state = shaft.at_floor(2, BUILDING)
    assert shaft.step(state, Orders(), 100, BUILDING) == state


def test_a_moving_car_without_a_target_brakes_between_floors() -> None:
    state = shaft.step(moving_up(for_s=3), Orders(), 10, BUILDING)
    assert state.standing
    assert shaft.zone_floor(state, BUILDING) is None
    assert shaft.level_floor(state, BUILDING) is None


def test_the_car_diverts_to_a_nearer_floor_that_it_can_still_stop_at() -> None:
    state = moving_up(for_s=2)
    assert shaft.can_stop_at(state, 1, BUILDING)
    positions = [s.position_m for s in samples(state, to(1), 20)]
    assert positions == sorted(positions)
    assert positions[-1] == HEIGHTS[1]


def test_a_floor_too_near_to_stop_at_is_passed_and_the_car_comes_back() -> None:
    state = moving_up(for_s=3.5)
    assert state.position_m < HEIGHTS[1]
    assert not shaft.can_stop_at(state, 1, BUILDING)
    run = samples(state, to(1), 20)
    assert max(s.position_m for s in run) > HEIGHTS[1] + 0.1
    for duration_s in (1, 2, 3):
        in_one_step = shaft.step(state, to(1), duration_s, BUILDING)
        assert in_one_step.position_m == pytest.approx(run[round(duration_s / SAMPLE_S)].position_m)
    assert run[-1].position_m == HEIGHTS[1]


def test_the_nearest_stop_of_a_moving_car_lies_ahead_and_within_braking_distance() -> None:
    state = moving_up(for_s=3.5)
    assert shaft.nearest_floor(state, BUILDING) == 1
    assert shaft.nearest_stop(state, BUILDING) == 2


def test_the_floor_changes_when_the_next_door_zone_is_reached_and_not_before() -> None:
    for state in samples(shaft.at_floor(0, BUILDING), to(3), 15):
        reached = [floor for floor in BUILDING.floors if HEIGHTS[floor] - 0.2 <= state.position_m]
        assert state.floor == reached[-1]


def test_a_floor_passed_within_one_large_step_is_not_forgotten() -> None:
    state = shaft.step(shaft.at_floor(0, BUILDING), to(3), 6, BUILDING)
    assert HEIGHTS[1] + 0.2 < state.position_m < HEIGHTS[2] - 0.2
    assert state.floor == 1


def test_motion_is_told_by_the_direction_of_travel() -> None:
    assert moving_up(for_s=1).motion is Motion.UP
    assert shaft.step(shaft.at_floor(2, BUILDING), to(0), 1, BUILDING).motion is Motion.DOWN
    assert shaft.at_floor(2, BUILDING).motion is Motion.STOPPED


def test_a_target_outside_the_shaft_is_its_end() -> None:
    state = shaft.step(shaft.at_floor(0, BUILDING), Orders(target_m=1000), 60, BUILDING)
    assert state.position_m == HEIGHTS[-1]


# -- the doors


def word(state: State, side: Side = Side.FRONT) -> Door:
    return state.doors[side].word


def test_a_door_opens_and_closes_in_its_own_time() -> None:
    state = shaft.at_floor(0, BUILDING)
    assert word(state) is Door.CLOSED
    state = shaft.step(state, Orders(open_doors=FRONT), 1.9, BUILDING)
    assert word(state) is Door.OPENING
    state = shaft.step(state, Orders(open_doors=FRONT), 0.1, BUILDING)
    assert word(state) is Door.OPEN
    state = shaft.step(state, Orders(), 2.4, BUILDING)
    assert word(state) is Door.CLOSING
    state = shaft.step(state, Orders(), 0.1, BUILDING)
    assert word(state) is Door.CLOSED


def test_a_closing_door_turns_round_where_it_is() -> None:
    state = shaft.step(shaft.at_floor(0, BUILDING), Orders(open_doors=FRONT), 2, BUILDING)
    state = shaft.step(state, Orders(), 1.25, BUILDING)
    assert state.doors[Side.FRONT].fraction == pytest.approx(0.5)
    state = shaft.step(state, Orders(open_doors=FRONT), 0.5, BUILDING)
    assert state.doors[Side.FRONT].fraction == pytest.approx(0.75)
    assert word(state) is Door.OPENING


def test_each_door_opens_only_at_floors_that_have_it() -> None:
    for floor, doors in enumerate(BUILDING.doors_at):
        state = shaft.step(shaft.at_floor(floor, BUILDING), Orders(open_doors=BOTH), 5, BUILDING)
        assert {side for side in Side if word(state, side) is Door.OPEN} == doors


def test_no_door_opens_between_floors() -> None:
    stuck = shaft.step(moving_up(for_s=3), Orders(), 10, BUILDING)
    assert shaft.step(stuck, Orders(open_doors=BOTH), 10, BUILDING).doors_closed


def test_a_car_with_a_door_ajar_waits_until_it_has_closed_and_then_leaves() -> None:
    ajar = shaft.step(shaft.at_floor(1, BUILDING), Orders(open_doors=BOTH), 1, BUILDING)
    waiting = shaft.step(ajar, to(2), 1.2, BUILDING)
    assert (waiting.position_m, waiting.standing) == (HEIGHTS[1], True)
    gone = shaft.step(ajar, to(2), 1.3, BUILDING)
    assert gone.doors_closed
    assert gone.motion is Motion.UP


def test_an_opening_door_goes_before_a_departing_car() -> None:
    both = Orders(target_m=HEIGHTS[3], open_doors=FRONT)
    state = shaft.step(shaft.at_floor(0, BUILDING), both, 30, BUILDING)
    assert (word(state), state.position_m) == (Door.OPEN, HEIGHTS[0])


def test_a_door_ordered_open_while_travelling_opens_once_the_car_has_arrived() -> None:
    state = shaft.step(shaft.at_floor(0, BUILDING), to(1), 2, BUILDING)
    orders = Orders(target_m=HEIGHTS[1], open_doors=FRONT)
    state = shaft.step(state, orders, 30, BUILDING)
    assert (word(state), state.position_m) == (Door.OPEN, HEIGHTS[1])


# -- the building


@each_row(
    "wrong",
    [
        {"heights_m": (0.0,)},
        {"heights_m": (0.0, 3.2, 3.3)},
        {"heights_m": (3.2, 0.0)},
        {"doors_at": (FRONT,)},
        {"doors_at": (FRONT, frozenset(), FRONT, FRONT)},
        {"top_speed_m_s": 0.0},
        {"creep_speed_m_s": 2.0},
        {"creep_distance_m": -0.1},
        {"level_tolerance_m": 0.3},
    ],
)
def test_a_building_that_cannot_be_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Parameters(**wrong)


def test_time_does_not_run_backwards() -> None:
    with pytest.raises(ValueError, match="backwards"):
        shaft.step(shaft.at_floor(0, BUILDING), Orders(), -0.1, BUILDING)


# -- whatever is ordered

targets = st.one_of(
    st.none(),
    st.sampled_from(HEIGHTS),
    st.floats(-1, 11, allow_nan=False),
    st.sampled_from(HEIGHTS).map(lambda h: h + 0.1),
)
# a tuple has its fields drawn by type where they are not given: nothing is wrong with this lift
any_orders = st.tuples(targets, st.frozensets(st.sampled_from(Side))).map(lambda drawn: Orders(*drawn))
scripts = st.lists(st.tuples(any_orders, st.floats(0.0, 6.0)), min_size=1, max_size=12)
floors = st.integers(0, 3)


def sampled_script(floor: int, script: list[tuple[Orders, float]]) -> list[State]:
    seen = [shaft.at_floor(floor, BUILDING)]
    for orders, duration_s in script:
        seen += samples(seen[-1], orders, duration_s)[1:]
    return seen


@given(floor=floors, script=scripts)
@examples(10)
def test_whatever_is_ordered_the_car_never_moves_with_a_door_open(
    floor: int, script: list[tuple[Orders, float]]
) -> None:
    for before, after in pairwise(sampled_script(floor, script)):
        assert after.standing or after.doors_closed
        if not after.doors_closed and not before.doors_closed:
            assert after.position_m == before.position_m


@given(floor=floors, script=scripts)
@examples(10)
def test_whatever_is_ordered_a_door_is_open_only_in_the_door_zone_of_a_floor_that_has_it(
    floor: int, script: list[tuple[Orders, float]]
) -> None:
    for state in sampled_script(floor, script):
        ajar = {side for side, leaf in state.doors.items() if leaf.fraction > 0}
        if ajar:
            here = shaft.zone_floor(state, BUILDING)
            assert here is not None
            assert ajar <= BUILDING.doors_at[here]


@given(floor=floors, script=scripts)
@examples(10)
def test_whatever_is_ordered_speed_and_position_do_not_jump_and_stay_within_limits(
    floor: int, script: list[tuple[Orders, float]]
) -> None:
    for before, after in pairwise(sampled_script(floor, script)):
        assert abs(after.speed_m_s - before.speed_m_s) <= 0.8 * SAMPLE_S + 1e-9
        assert abs(after.position_m - before.position_m) <= 1.0 * SAMPLE_S + 1e-5
        assert abs(after.speed_m_s) <= 1.0 + 1e-9
        assert HEIGHTS[0] - 1e-5 <= after.position_m <= HEIGHTS[-1] + 1e-5


@given(floor=floors, script=scripts, slices=st.integers(2, 40))
@examples(20)
def test_it_does_not_matter_how_time_is_sliced(floor: int, script: list[tuple[Orders, float]], slices: int) -> None:
    whole = sliced = shaft.at_floor(floor, BUILDING)
    for orders, duration_s in script:
        whole = shaft.step(whole, orders, duration_s, BUILDING)
        for _ in range(slices):
            sliced = shaft.step(sliced, orders, duration_s / slices, BUILDING)
    # a rounding of 1e-6 m in the last braking is worth at most the square root of it in speed
    assert sliced.position_m == pytest.approx(whole.position_m, abs=1e-4)
    assert sliced.speed_m_s == pytest.approx(whole.speed_m_s, abs=2e-3)
    for side, leaf in whole.doors.items():
        assert sliced.doors[side].fraction == pytest.approx(leaf.fraction, abs=1e-3)


@given(floor=floors, script=scripts, goal=floors)
@examples(10)
def test_from_any_state_the_car_can_be_brought_level_to_any_floor(
    floor: int, script: list[tuple[Orders, float]], goal: int
) -> None:
    state = sampled_script(floor, script)[-1]
    assert shaft.level_floor(shaft.step(state, to(goal), 60, BUILDING), BUILDING) == goal
