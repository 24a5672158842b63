"""Whatever fails, in whatever mixture, the interlocks of the machine hold."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from register_maps.words import Door, Mode, Motion, Side
from simulator.controller import Inputs, Parameters, ShownState
from simulator.faults import (
    CallsCancelled,
    Homing,
    InMode,
    MachineFault,
    NudgingDoor,
    Overload,
    Relevelling,
    ReopeningDoor,
    RobotModeWithdrawn,
    StuckDoor,
    WrongFloor,
)
from simulator.people import People, Traffic
from tests.simulator.bench import Lift
from tests.simulator.test_controller_properties import any_inputs, any_parameters
from tests.support.examples import examples

HEIGHTS = [0.0, 3.2, 6.4, 9.6, 12.8]
TOP_M_S, CREEP_M_S, BRAKES_M_S2 = 1.0, 0.1, 0.8
SINKS_MOST_M = 0.1
"""Half the door zone."""

sides = st.sampled_from(Side)
any_fault: st.SearchStrategy[MachineFault] = st.one_of(
    st.builds(StuckDoor, sides),
    st.builds(ReopeningDoor, sides),
    st.just(NudgingDoor()),
    st.builds(WrongFloor, st.sampled_from([1, -1, 3])),
    st.builds(Relevelling, st.sampled_from([0.1, 1.0]), st.sampled_from([0.012, 0.08, 1.0])),
    st.just(Homing()),
    st.just(CallsCancelled()),
    st.just(RobotModeWithdrawn()),
    st.builds(InMode, st.sampled_from([Mode.FIRE, Mode.EMERGENCY, Mode.INSPECTION, Mode.INDEPENDENT])),
    st.just(Overload()),
)
failing_inputs = st.builds(
    lambda inputs, faults: replace(inputs, faults=faults), any_inputs, st.frozensets(any_fault, max_size=4)
)
scripts = st.lists(st.tuples(failing_inputs, st.floats(0.01, 8.0)), min_size=1, max_size=8)
SOME = examples(10)


def check(before: ShownState, after: ShownState, parameters: Parameters) -> None:
    """What holds between any two scans."""
    scan_s = parameters.scan_s * parameters.speed
    assert abs(after.speed_m_s) <= TOP_M_S + 1e-9
    assert abs(after.speed_m_s - before.speed_m_s) <= BRAKES_M_S2 * scan_s + 1e-9
    assert abs(after.position_m - before.position_m) <= TOP_M_S * scan_s + 1e-5
    assert HEIGHTS[0] - SINKS_MOST_M <= after.position_m + 1e-9
    assert after.position_m <= HEIGHTS[-1] + 1e-9
    ajar = {side for side, door in after.doors.items() if door is not Door.CLOSED}
    if ajar:
        assert after.in_door_zone
        assert ajar <= parameters.doors_at[after.floor]
        assert abs(after.position_m - HEIGHTS[after.floor]) <= SINKS_MOST_M + 1e-9
        assert abs(after.speed_m_s) <= CREEP_M_S + 1e-9
    if after.door_open_floor is not None or after.may_enter or after.may_leave:
        assert after.motion is Motion.STOPPED
        assert abs(after.position_m - HEIGHTS[after.floor]) <= 0.005


@given(parameters=any_parameters, script=scripts)
@SOME
def test_the_car_never_travels_with_an_open_door_and_opens_in_the_door_zone_only(
    parameters: Parameters, script: list[tuple[Inputs, float]]
) -> None:
    lift = Lift(parameters)
    before = lift.see()
    for inputs, duration_s in script:
        lift.inputs = inputs
        for _ in range(int(duration_s / parameters.scan_s)):
            after = lift.run(parameters.scan_s)
            check(before, after, parameters)
            before = after


@given(parameters=any_parameters, script=scripts)
@SOME
def test_a_car_that_is_never_made_to_sink_never_moves_with_an_open_door(
    parameters: Parameters, script: list[tuple[Inputs, float]]
) -> None:
    lift = Lift(parameters)
    for inputs, duration_s in script:
        lift.inputs = replace(
            inputs, faults=frozenset(fault for fault in inputs.faults if not isinstance(fault, Relevelling))
        )
        for _ in range(int(duration_s / parameters.scan_s)):
            picture = lift.run(parameters.scan_s)
            if any(door is not Door.CLOSED for door in picture.doors.values()):
                assert picture.motion is Motion.STOPPED
                assert picture.level_floor is not None


@given(
    parameters=any_parameters,
    script=scripts,
    slices=st.lists(st.integers(1, 30), min_size=8, max_size=8),
)
@SOME
def test_it_does_not_matter_how_time_is_sliced_while_things_fail(
    parameters: Parameters, script: list[tuple[Inputs, float]], slices: list[int]
) -> None:
    whole, sliced = Lift(parameters), Lift(parameters)
    for (inputs, duration_s), parts in zip(script, slices, strict=False):
        whole.inputs = sliced.inputs = inputs
        whole.run(duration_s)
        for _ in range(parts):
            sliced.run(duration_s / parts)
        assert sliced.see() == whole.see()


@given(script=scripts)
@SOME
def test_a_lift_gets_over_everything_once_it_is_over(script: list[tuple[Inputs, float]]) -> None:
    lift = Lift()
    for inputs, duration_s in script:
        lift.inputs = inputs
        lift.run(duration_s)
    lift.inputs = Inputs()
    lift.run(120)
    lift.press(car=frozenset({3}))
    assert 3 in lift.stops(40)
    assert lift.see().mode is Mode.NORMAL


@given(script=scripts, seed=st.integers(0, 1000))
@examples(4)
def test_people_do_not_change_what_the_interlocks_promise(script: list[tuple[Inputs, float]], seed: int) -> None:
    lift, people = Lift(), People(seed, 5, Traffic(per_minute=30.0))
    before, now, inputs = lift.see(), 0.0, Inputs()
    for given_inputs, duration_s in script:
        inputs = replace(inputs, faults=given_inputs.faults, commands=given_inputs.commands)
        for n in range(int(duration_s / 0.05)):
            if n % 5 == 0:
                inputs = people.act(now, lift.see(), inputs)
            lift.inputs = inputs
            after = lift.run(0.05)
            check(before, after, lift.parameters)
            before, now = after, now + 0.05
            assert people.counts.riding <= people.traffic.load
