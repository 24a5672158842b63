"""A door that is held without robot mode invites no robot, and keeps the lift from people."""

from dataclasses import replace

from lift_manager.lift.doors import UNGRANTED_S
from lift_manager.lift.observation import RobotDoor
from register_maps.words import Door
from tests.lift_manager.runtime.rmf_words import HOLD, WITH_MODE, open_for_it, wants
from tests.lift_manager.runtime.scripted import PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse


def grant(made: Bench, *, on: bool) -> None:
    flags = {**made.driver.values.flags, "robot_mode_on": on}
    made.driver.values = replace(made.driver.values, flags=flags)


def invites(made: Bench) -> bool:
    return made.state.robot_door is RobotDoor.OPEN


async def ask_for(made: Bench, seconds: float) -> None:
    for _ in range(round(seconds)):
        wants(made, "L1")
        await elapse(1.0)


def test_a_door_is_let_go_of_once_robot_mode_was_missing_for_long_and_held_again_when_it_is_back() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await open_for_it(made)
        assert invites(made)
        grant(made, on=False)
        await ask_for(made, UNGRANTED_S - 2)
        assert HOLD in made.driver.on
        assert not invites(made)
        await ask_for(made, 4)
        assert HOLD not in made.driver.on
        assert "robot_mode_on, which the lift has not granted for 30 s" in made.state.restrictions.waiting_for
        grant(made, on=True)
        await ask_for(made, 2)
        assert HOLD in made.driver.on
        assert invites(made)
        assert made.state.restrictions.waiting_for == ""

    on_bench(check, WITH_MODE, poll_s=0.2)


def test_a_mode_that_is_back_in_time_changes_nothing_and_the_time_begins_anew() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await open_for_it(made)
        for _ in range(3):
            grant(made, on=False)
            await ask_for(made, UNGRANTED_S - 5)
            grant(made, on=True)
            await ask_for(made, 2)
            assert HOLD in made.driver.on

    on_bench(check, WITH_MODE)


def test_where_no_signal_tells_of_robot_mode_the_door_is_held() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await ask_for(made, 2 * UNGRANTED_S)
        assert HOLD in made.driver.on

    on_bench(check, PLAIN)


def test_a_door_that_opens_although_its_session_is_over_invites_nobody() -> None:
    async def check(made: Bench) -> None:
        made.accept("L2")
        await elapse(0.5)
        assert made.driver.log[-1] == "hold hold_door.front"
        made.accept("L2", hold=False)
        assert made.state.holder is None
        await made.car("L2", Door.OPEN, enter=True)
        assert not invites(made)
        await made.car("L2", Door.CLOSED)
        await made.car("L2", Door.OPEN, enter=True)
        assert invites(made)

    on_bench(check, PLAIN)
