"""Whatever happens to it, the controller keeps its promises."""

from hypothesis import given
from hypothesis import strategies as st

from register_maps.words import Door, Motion, Side
from simulator import handshake
from simulator.controller import Inputs, Parameters, SameFloorCall
from simulator.modes import Key
from tests.simulator.bench import BUILDING, SCAN_S, Lift, all_closed, floors
from tests.support.examples import examples

some_floors = st.frozensets(st.integers(0, 4), max_size=3)
some_sides = st.frozensets(st.sampled_from(Side))
some_commands = st.dictionaries(st.sampled_from(["go_to", "call", "go"]), st.integers(0, 4)) | st.dictionaries(
    st.sampled_from(["robot_in_place", "robot_left", "robot_mode", "hold_door.front", "close_door.rear"]), st.just(1)
)
any_inputs = st.builds(
    Inputs,
    car_buttons=some_floors,
    landing_buttons=some_floors,
    hold_door=some_sides,
    close_door=some_sides,
    obstruction=some_sides,
    robot_mode_request=st.booleans(),
    key=st.sampled_from([Key.NORMAL, *Key]),
    fire=st.sampled_from([False, False, False, True]),
    emergency=st.sampled_from([False, False, False, True]),
    overload=st.sampled_from([False, False, False, True]),
    fault=st.sampled_from([False, False, False, True]),
    commands=some_commands,
    signs_of_life=st.integers(0, 2),
)
scripts = st.lists(st.tuples(any_inputs, st.floats(0.01, 8.0)), min_size=1, max_size=8)
any_parameters = st.builds(
    Parameters,
    shaft=st.just(BUILDING),
    speed=st.sampled_from([0.5, 1.0, 7.0]),
    scan_s=st.sampled_from([0.02, 0.05, 0.3]),
    hold_watchdog_s=st.sampled_from([None, 2.0]),
    watched=st.sampled_from([frozenset(), frozenset({"hold_door.front", "robot_mode"})]),
    robot_mode_only=st.sampled_from([frozenset(), frozenset({"go_to"})]),
    drops_stuck_button_s=st.sampled_from([None, 1.5]),
    needs_edge_s=st.sampled_from([None, 0.4]),
    handshake=st.sampled_from([None, handshake.Rules(), handshake.Rules(lasting=frozenset({"call", "go"}))]),
    same_floor_call=st.sampled_from(SameFloorCall),
    fire_floor=st.integers(0, 4),
)
QUICK = examples(8)


@given(parameters=any_parameters, script=scripts)
@QUICK
def test_whatever_happens_the_car_does_not_jump_and_doors_open_only_where_they_may(
    parameters: Parameters, script: list[tuple[Inputs, float]]
) -> None:
    lift = Lift(parameters)
    scan_s = parameters.scan_s * parameters.speed
    before = lift.see()
    for inputs, duration_s in script:
        lift.inputs = inputs
        for _ in range(int(duration_s / parameters.scan_s)):
            after = lift.run(parameters.scan_s)
            assert abs(after.speed_m_s - before.speed_m_s) <= 0.8 * scan_s + 1e-9
            assert abs(after.position_m - before.position_m) <= 1.0 * scan_s + 1e-5
            ajar = {side for side, door in after.doors.items() if door is not Door.CLOSED}
            if ajar:
                assert after.motion is Motion.STOPPED
                assert after.level_floor is not None
                assert ajar <= parameters.doors_at[after.level_floor]
            before = after


@given(parameters=any_parameters, script=scripts, slices=st.lists(st.integers(1, 30), min_size=8, max_size=8))
@QUICK
def test_it_does_not_matter_how_time_is_sliced(
    parameters: Parameters, script: list[tuple[Inputs, float]], slices: list[int]
) -> None:
    whole, sliced = Lift(parameters), Lift(parameters)
    for (inputs, duration_s), parts in zip(script, slices, strict=False):
        whole.inputs = sliced.inputs = inputs
        whole.run(duration_s)
        for _ in range(parts):
            sliced.run(duration_s / parts)
        assert sliced.see() == whole.see()


@given(
    start=st.integers(0, 4),
    presses=st.lists(st.tuples(some_floors, some_floors, st.integers(0, 40)), min_size=1, max_size=6),
    same_floor_call=st.sampled_from(SameFloorCall),
)
@QUICK
def test_every_call_registered_in_normal_mode_is_served(
    start: int, presses: list[tuple[frozenset[int], frozenset[int], int]], same_floor_call: SameFloorCall
) -> None:
    lift = Lift(Parameters(shaft=BUILDING, same_floor_call=same_floor_call), at=start)
    owed: set[int] = set()
    for car, landing, pause in [*presses, (floors(), floors(), 600)]:
        lift.run(2 * SCAN_S, car_buttons=car, landing_buttons=landing)
        for _ in range(pause):
            picture = lift.run(4 * SCAN_S, car_buttons=floors(), landing_buttons=floors())
            owed |= picture.car_calls | picture.landing_calls
            owed.discard(-1 if picture.door_open_floor is None else picture.door_open_floor)
    assert not owed
    assert lift.see().destination is None
    assert all_closed(lift.see())
