"""Wishes that change while a write is on its way: nothing stays on that nobody wants, nothing is pressed twice."""

import asyncio
from collections.abc import Callable

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.runtime.errors import RequestRefused
from register_maps.frames import Request
from register_maps.words import Table
from simulator.controller import Inputs
from simulator.modes import Key
from tests.support.refusals import reply
from tests.support.spine import CALL, Spine, on_spine
from tests.support.virtual_time import elapse

AT_REST = [0, 0, 0, 0]
MAPS = ["generic-registers", "two-stop-agv"]


def outputs(made: Spine) -> list[int]:
    """The four command cells of either map."""
    now = asyncio.get_running_loop().time()
    if made.driver.capabilities.map_name == "two-stop-agv":
        return made.face.read(Table.COIL, 0, 4, now)
    return made.face.read(Table.HOLDING, CALL, 4, now)


async def written(made: Spine, fits: Callable[[Request], bool]) -> None:
    """Wait until a write that fits has reached the controller; its answer is still on the way."""
    seen = len(made.device.writes)
    async with asyncio.timeout(60):
        while not any(fits(request) for _, request in made.device.writes[seen:]):
            await elapse(0.001)


def test_a_hold_released_while_its_press_is_on_its_way_is_let_go() -> None:
    async def check(made: Spine) -> None:
        made.device.delay_s = 0.2
        await elapse(3)
        made.accept("L1")
        await written(made, lambda request: request.values[2:3] == (1,))
        made.accept("L1", hold=False)
        await elapse(10)
        assert outputs(made) == AT_REST

    on_spine(check, "two-stop-agv")


@pytest.mark.parametrize("delay_s", [0.004, 0.08])
@pytest.mark.parametrize("map_name", MAPS)
def test_stopping_at_any_instant_of_a_ride_leaves_nothing_on(map_name: str, delay_s: float) -> None:
    for step in range(0, 240, 16):

        async def check(made: Spine, step: int = step) -> None:
            made.device.delay_s = delay_s
            await elapse(0.5)
            made.accept("L1" if step % 32 else "L2")
            await elapse(0.007 * step)
            await made.life.stop()
            assert outputs(made) == AT_REST, step

        on_spine(check, map_name)


def test_commands_that_exclude_each_other_are_never_on_together() -> None:
    async def check(made: Spine) -> None:
        made.device.delay_s = 0.05
        await elapse(3)
        made.accept("L1")
        await written(made, lambda request: request.values[2:3] == (1,))
        made.accept("L2")
        await elapse(15)
        assert all(sum(request.values) <= 1 for _, request in made.device.writes)
        assert made.state.floor == "L2"

    on_spine(check, "two-stop-agv")


def test_a_new_floor_while_the_old_call_is_on_its_way_is_where_the_car_goes() -> None:
    async def check(made: Spine) -> None:
        made.device.delay_s = 0.05
        made.accept("L3")
        await written(made, lambda request: request.address == CALL and request.values == (3,))
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L2")
        assert [value for _, value in made.presses()] == [3, 2]

    on_spine(check)


def test_no_press_leaves_after_the_answer_that_tells_of_a_fire() -> None:
    refused = []
    for hundredth in range(12):

        async def check(made: Spine, hundredth: int = hundredth) -> None:
            made.device.delay_s = 0.05
            await elapse(2 + 0.01 * hundredth)
            made.people(Inputs(fire=True))
            await elapse(0.02 * hundredth)
            refused.append(isinstance(reply(made.accept, "L2"), RequestRefused))
            fire_told_at = asyncio.get_running_loop().time() + 0.25
            await elapse(2)
            assert not [request for at, request in made.device.writes if at > fire_told_at and any(request.values)]
            assert outputs(made) == AT_REST

        on_spine(check, poll_s=0.1)
    assert set(refused) == {True, False}, "the request comes before and after the answer"


def test_letting_go_forgets_a_press_that_waits_behind_a_release() -> None:
    async def check(made: Spine) -> None:
        made.device.delay_s = 0.05
        made.accept("L3")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        await elapse(0.5)
        made.accept("L3", hold=False)
        await elapse(0.02)
        made.accept("L1")
        await elapse(0.01)
        before = len(made.device.writes)
        made.accept("L3", hold=False)
        await elapse(10)
        assert not [request for _, request in made.device.writes[before:] if any(request.values)]

    on_spine(check)


@pytest.mark.parametrize("gap_s", [0, 0.05, 0.1, 0.2])
def test_a_call_right_after_a_release_waits_for_robot_mode_and_is_then_pressed(gap_s: float) -> None:
    async def check(made: Spine) -> None:
        made.accept("L1")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.device.delay_s = 0.05
        await elapse(2)
        made.accept("L1", hold=False)
        await elapse(gap_s)
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L2")

    on_spine(check)


def test_a_hold_goes_when_what_it_requires_is_taken_away() -> None:
    async def check(made: Spine) -> None:
        await elapse(2)
        made.accept("L1")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.people(Inputs(key=Key.NORMAL))
        await elapse(1)
        assert outputs(made) == AT_REST

    on_spine(check, "two-stop-agv")


def test_a_held_call_that_the_controller_forgot_is_pressed_again_on_a_repeat() -> None:
    async def check(made: Spine) -> None:
        await elapse(2)
        made.accept("L2")
        await made.until(lambda state: state.floor is None)
        made.face.write(Table.COIL, 0, AT_REST, asyncio.get_running_loop().time())
        for wire in made.device.wires:
            wire.drop()
        await elapse(1)
        for _ in range(15):
            reply(made.accept, "L2")
            await elapse(1)
        assert made.state.floor == "L2"

    on_spine(check, "two-stop-agv")


def test_a_controller_that_says_no_to_a_hold_is_not_asked_at_the_pace_of_the_polls() -> None:
    async def check(made: Spine) -> None:
        made.device.refuses = True
        made.accept("L2")
        await elapse(20)
        assert 1 < made.device.refused < 30

    on_spine(check)
