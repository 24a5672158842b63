"""What the end of a session or of a hold leaves behind on a virtual site: doors, the outcome of a call, and rows."""

from collections.abc import Awaitable, Callable

from drivers.model import Result
from lift_manager.config.load import LoadedSite
from lift_manager.lab.virtual_time import elapse, run_virtual
from lift_manager.lab.world.witness import FloorRequest
from lift_manager.lab.world.world import World
from lift_manager.lift.events import CommandEnded, SessionEnded
from lift_manager.lift.journal import RowKind
from lift_manager.lift.observation import RobotDoor
from register_maps.words import Door
from simulator.wire_faults import HalfOpen
from tests.campaigns.playing import LIFT, loaded_site
from tests.lift_manager.lab.test_world import ROBOT, Recorder, is_open_at, site, until

HOLD = "hold_door.front"


def seen_in(loaded: LoadedSite, check: Callable[[World], Awaitable[None]]) -> tuple[Recorder, World]:
    seen = Recorder()
    world = World(loaded, (seen,))

    async def main() -> None:
        async with world.running():
            await elapse(4)
            await check(world)

    run_virtual(main)
    return seen, world


def request(floor: str) -> FloorRequest:
    return FloorRequest(LIFT, ROBOT, floor, hold_door=True)


def test_a_door_that_was_still_opening_when_its_session_ended_invites_nobody_before_it_has_shut() -> None:
    async def check(world: World) -> None:
        world.request(request("L2"))
        await until(world, lambda state: state.floor == "L2" and Door.OPENING in state.doors.values())
        while HOLD not in world.lifts[LIFT].truth.commands:
            await elapse(0.05)
        assert Door.OPENING in world.site.state(LIFT).doors.values()
        world.site.force_release(LIFT, "the guard", "needed", at_once=True)
        await until(world, lambda state: Door.CLOSED in state.doors.values())

    seen, _ = seen_in(site(LIFT), check)
    over = [state for _, state in seen.states if state.holder is None and state.floor == "L2"]
    assert any(Door.OPEN in state.doors.values() for state in over)
    assert not any(state.robot_door is RobotDoor.OPEN for state in over)


def test_a_call_whose_pulse_is_over_is_followed_beyond_its_session() -> None:
    async def check(world: World) -> None:
        world.request(request(world.lifts[LIFT].floors[1]))
        while "go_to" not in world.lifts[LIFT].truth.commands:
            await elapse(0.05)
        while "go_to" in world.lifts[LIFT].truth.commands:
            await elapse(0.05)
        await elapse(0.1)
        world.site.force_release(LIFT, "the guard", "needed", at_once=True)
        await elapse(30)

    seen, _ = seen_in(loaded_site("wago-750", 900.0, 300.0, 0.0), check)
    ended = [event for event in seen.events if isinstance(event, SessionEnded | CommandEnded)]
    assert [type(event) for event in ended] == [SessionEnded, CommandEnded]
    assert isinstance(ended[1], CommandEnded)
    assert ended[1].outcome.result is Result.CONFIRMED


def test_what_is_released_as_the_manager_ends_is_written_down_for_the_session_that_rests() -> None:
    async def check(world: World) -> None:
        world.request(request("L2"))
        await until(world, is_open_at("L2"))

    _, world = seen_in(site(LIFT), check)
    released = [row for row in world.disk.rows if row.kind is RowKind.WRITE and row.data["what"] == "release"]
    assert {row.data["command"] for row in released} >= {HOLD}
    assert {row.caller for row in released} == {str(ROBOT)}


def test_a_hold_that_falls_while_the_lift_cannot_be_read_begins_again_once_it_is_read() -> None:
    async def check(world: World) -> None:
        world.request(request("L2"))
        await until(world, is_open_at("L2"))
        world.begin_wire_fault("plc", HalfOpen())
        for _ in range(40):  # longer than the map lets a door be held
            await elapse(1)
            world.request(request("L2"))
        world.end_wire_fault("plc", HalfOpen())
        await until(world, is_open_at("L2"))

    seen, _ = seen_in(site(LIFT), check)
    presses = [at for at, commands in seen.presses if HOLD in commands]
    assert len(presses) == 2
    assert presses[1] - presses[0] > 40
