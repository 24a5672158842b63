"""A controller that lets the held door go by itself after a time, however often the hold is written again."""

import asyncio
from dataclasses import dataclass, field

from lift_manager.lift.observation import RobotDoor
from register_maps.codec import compile_map
from register_maps.load import MapChanges, load
from tests.support.rows import each_row
from tests.support.trip import Trip, on_trip
from tests.support.trip_simulator import SimulatedPlant
from tests.support.trip_sites import Site, site_of
from tests.support.virtual_time import elapse

CLEAR_S = 30.0
"""`clear_s` of RMF, whose robot is on the trip."""
LIMIT_S = 3 * CLEAR_S
LOOK_S = 0.05


def site_with(name: str, limit_s: float | None) -> Site:
    """Return the site of a shipped map whose controller lets go of every door after this time; None: of none."""
    plain = site_of(name)
    holds = [command for command in plain.codec.map.commands if command.startswith("hold_door.")]
    override = {} if limit_s is None else {"commands": {hold: {"released_after_s": limit_s} for hold in holds}}
    return Site(name, compile_map(load(name, changes=MapChanges({}, override)).map), plain.floors)


@dataclass
class Watched:
    """What a stop of a robot that keeps its door was."""

    opened_at: float = 0.0
    withdrawn_at: float = 0.0
    fell_at: float = 0.0
    """When the lift's door was no longer fully open."""
    doors: list[tuple[float, RobotDoor]] = field(default_factory=list)


async def kept_at(made: Trip, floor: str, watched: Watched) -> None:
    """Call the lift, and hold its door there with a request in every second until it has shut."""
    loop = asyncio.get_running_loop()
    made.ask(floor)
    await made.until(lambda state: state.robot_door is RobotDoor.OPEN, asking=floor)
    watched.opened_at = asked_at = loop.time()
    while made.plant.truth(loop.time()).open_at is not None:
        if made.state.robot_door is not RobotDoor.OPEN and not watched.withdrawn_at:
            watched.withdrawn_at = loop.time()
        if loop.time() >= asked_at + 1:
            asked_at = loop.time()
            made.ask(floor)
        await elapse(LOOK_S)
    watched.fell_at = loop.time()


@each_row("name", ["generic-registers", "generic-coils", "two-stop-agv"])
def test_open_is_withdrawn_clear_s_before_the_controller_lets_the_door_go_and_a_repeat_holds_it_again(
    name: str,
) -> None:
    site, watched = site_with(name, LIMIT_S), Watched()

    async def check(made: Trip) -> None:
        floor = next(iter(site.floors))
        await kept_at(made, floor, watched)
        assert made.state.holder is not None
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED, asking=floor)
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN, asking=floor)
        assert any(
            f"the door was held for {LIMIT_S:g} s, as long as the controller allows" in one for one in made.alarms
        )
        assert made.wrong == []

    on_trip(check, site, SimulatedPlant(site))
    assert watched.withdrawn_at - watched.opened_at > LIMIT_S - CLEAR_S - 10
    assert watched.fell_at - watched.withdrawn_at >= CLEAR_S


def test_a_manager_that_does_not_know_the_time_invites_its_robot_until_the_door_falls() -> None:
    unaware, watched = site_with("generic-registers", None), Watched()

    async def check(made: Trip) -> None:
        await kept_at(made, next(iter(unaware.floors)), watched)

    on_trip(check, unaware, SimulatedPlant(site_with("generic-registers", LIMIT_S)))
    assert watched.withdrawn_at == 0.0
    assert LIMIT_S - 10 < watched.fell_at - watched.opened_at < LIMIT_S + 1
