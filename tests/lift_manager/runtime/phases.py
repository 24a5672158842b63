"""Where a ride can be when people come first."""

import asyncio
from collections.abc import Awaitable, Callable

from lift_manager.lift.observation import RobotDoor
from register_maps.words import Motion, Table
from simulator.controller import Inputs
from tests.support.spine import Spine
from tests.support.virtual_time import elapse

Phase = Callable[[Spine], Awaitable[None]]


async def idle(made: Spine) -> None:
    await elapse(1)


async def just_accepted(made: Spine) -> None:
    made.accept("L2")


async def robot_mode_awaited(made: Spine) -> None:
    """People's call is served first."""
    made.people(Inputs(landing_buttons=frozenset({2})))
    await elapse(0.5)
    made.accept("L2")
    await elapse(2)
    assert made.presses() == []
    assert "robot_mode_on for go_to" in made.state.restrictions.waiting_for


async def travelling(made: Spine) -> None:
    made.accept("L3")
    await made.until(lambda state: state.motion is Motion.UP)
    assert made.state.restrictions.waiting_for == ""


async def door_held(made: Spine) -> None:
    made.accept("L2")
    await made.until(lambda state: state.robot_door is RobotDoor.OPEN)


async def released_under_way(made: Spine) -> None:
    await travelling(made)
    await made.until(lambda state: state.floor is not None)
    made.accept(made.state.floor or "", hold=False)
    assert made.face.picture.robot_mode_on


PHASES: list[Phase] = [idle, just_accepted, robot_mode_awaited, travelling, door_held, released_under_way]


def outputs(made: Spine) -> list[int]:
    return list(made.face.read(Table.HOLDING, 16, 4, asyncio.get_running_loop().time()))
