"""The manager is killed and started again in the middle of a ride: what the lift itself is asked for, by the whole program."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from lift_manager.lab.virtual_time import elapse
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.events import SessionEnded, SessionRestored
from lift_manager.lift.session import EndReason, Holder
from lift_manager.lift.state import LiftState
from register_maps.words import Motion
from tests.lift_manager.lab.test_world import Recorder, in_world, is_open_at, until

ROBOT, OTHER = Holder("rmf", "fleet/r1"), Holder("workshop", "workshop")
HELD = {"robot_mode", "hold_door.front"}


def ask(world: World, floor: str, holder: Holder = ROBOT, *, hold: bool = True) -> None:
    assert world.request(FloorRequest("lift", holder, floor, hold)) is None


async def door_held(world: World) -> None:
    await elapse(2)
    ask(world, "L2")
    await until(world, is_open_at("L2"))


async def under_way(world: World) -> None:
    await elapse(2)
    ask(world, "L3")
    await until(world, lambda state: state.motion is Motion.UP)


def state(world: World) -> LiftState:
    return world.site.state("lift")


def in_a_restart(
    before: Callable[[World], Awaitable[None]], after: Callable[[World], Awaitable[None]]
) -> tuple[Recorder, float]:
    """Return what was seen, and when the manager was killed."""
    killed: list[float] = []

    async def check(world: World) -> None:
        await before(world)
        killed.append(asyncio.get_running_loop().time())
        await world.restart()
        await after(world)

    return in_world(check), killed[0]


def presses_after(seen: Recorder, at: float) -> list[frozenset[str]]:
    return [commands for when, commands in seen.presses if when > at]


def commands_during(seen: Recorder, since: float, until_at: float) -> list[frozenset[str]]:
    return [truth.commands for at, truth in seen.truths if since <= at < until_at]


def test_a_door_that_is_held_stays_held_and_robot_mode_on() -> None:
    async def after(world: World) -> None:
        await elapse(30)
        assert state(world).holder == ROBOT
        assert is_open_at("L2")(state(world))

    seen, killed = in_a_restart(door_held, after)
    assert all(commands >= HELD for commands in commands_during(seen, killed, killed + 29))
    assert presses_after(seen, killed) == []
    assert [event.holder for event in seen.events if isinstance(event, SessionRestored)] == [ROBOT]


def test_a_car_under_way_arrives_and_its_door_is_held_once_the_holder_is_heard() -> None:
    async def after(world: World) -> None:
        await until(world, lambda state: state.floor == "L3" and state.standing)
        await elapse(3)
        assert not is_open_at("L3")(state(world))
        ask(world, "L3")
        await until(world, is_open_at("L3"))

    seen, killed = in_a_restart(under_way, after)
    assert all("robot_mode" in commands for commands in commands_during(seen, killed, killed + 5))
    assert presses_after(seen, killed) == [frozenset({"hold_door.front"})]


@pytest.mark.parametrize("before", [door_held, under_way])
def test_the_holder_lets_go_after_the_restart_as_before_it(before: Callable[[World], Awaitable[None]]) -> None:
    async def after(world: World) -> None:
        await until(world, lambda state: state.standing and state.floor in ("L2", "L3"))
        ask(world, state(world).floor or "", hold=False)
        await elapse(5)
        assert world.lifts["lift"].face.commands == {}

    seen, _ = in_a_restart(before, after)
    assert [event.reason for event in seen.events if isinstance(event, SessionEnded)] == [EndReason.RELEASED]


def test_another_caller_that_is_heard_first_gets_the_lift_and_the_car_is_not_moved_before() -> None:
    async def after(world: World) -> None:
        await until(world, lambda state: state.floor == "L3" and state.standing)
        ask(world, "L1", OTHER)
        assert state(world).holder == OTHER
        await until(world, is_open_at("L1"))

    seen, _ = in_a_restart(under_way, after)
    assert next(event for event in seen.events if isinstance(event, SessionEnded)).reason is EndReason.UNCLAIMED
