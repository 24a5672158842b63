"""No robot is invited on a reading from before the door was held: the door may have begun to close by its own timer since."""

from dataclasses import replace

from drivers.model import CommandKind
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.robot_door import OBEYS_WITHIN_S
from register_maps.words import Door
from tests.lift_manager.runtime.scripted import FRONT, PLAIN, Bench, on_bench
from tests.support.virtual_time import elapse

POLL_S = 0.4
HOLD = f"{CommandKind.HOLD_DOOR}.front"


def test_a_door_read_open_before_it_was_held_is_not_open_for_a_robot() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L2")
        await made.car(None, Door.CLOSED)
        flags = {"may_enter": True, "may_leave": True}
        made.driver.values = replace(made.driver.values, floor="L2", doors={FRONT: Door.OPEN}, flags=flags)
        while HOLD not in made.driver.on:
            assert made.robot_door() is not RobotDoor.OPEN
            await elapse(0.01)
        held_at = made.life.polls()["lift"]
        while made.life.polls()["lift"] == held_at:
            assert made.robot_door() is RobotDoor.MOVING
            await elapse(0.01)
        await elapse(2 * POLL_S)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN, poll_s=POLL_S)


def test_a_lift_has_time_to_obey_a_hold_that_reads_back_at_once() -> None:
    async def check(made: Bench) -> None:
        await made.car("L2", Door.OPEN, enter=True)
        made.accept("L2")
        while HOLD not in made.driver.on:
            await elapse(0.005)
        held_at = made.life.polls()["lift"]
        await elapse(OBEYS_WITHIN_S - 0.01)
        assert made.life.polls()["lift"] > held_at + 2
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(0.1)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN, poll_s=0.03)


def test_a_hold_that_falls_and_comes_back_needs_another_reading() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        await elapse(2 * POLL_S)
        assert made.robot_door() is RobotDoor.OPEN
        made.driver.unseen = True
        assert made.robot_door() is RobotDoor.MOVING
        made.driver.unseen = False
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(2 * POLL_S)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN, poll_s=POLL_S)
