"""The robot at lifts that misbehave. No test sleeps: it waits for what it wants to see."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from robot import STEPS, Robot

from lift_manager.lab.bench import LiftSimulator, LiftSite, ModbusFaults
from lift_manager.lift.refusals import Refused


class ModelWheels:
    """Counts steps, and lets a test do something at one of them."""

    def __init__(self) -> None:
        self.at = 0
        """How many steps the robot is away from where it began."""
        self.farthest = 0
        self.then: dict[int, Callable[[], object]] = {}

    def forward(self) -> None:
        """Drive one step on."""
        self.at += 1
        self.farthest = max(self.farthest, self.at)
        self.then.pop(self.at, lambda: None)()

    def back(self) -> None:
        """Drive one step back."""
        self.at -= 1


@pytest.fixture
def wheels() -> ModelWheels:
    return ModelWheels()


@pytest.fixture
def my_robot(wheels: ModelWheels) -> Robot:
    return Robot(wheels, patience_s=15.0, step_s=0.0)


@pytest.fixture
def hurried_robot(wheels: ModelWheels) -> Robot:
    """For rides that must fail: its patience is short."""
    return Robot(wheels, patience_s=1.0, step_s=0.0)


@pytest.fixture
def robot_thread() -> Iterator[ThreadPoolExecutor]:
    """A thread for a robot, so that a test continues while it rides."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_the_robot_rides_from_floor_to_floor_and_gives_the_lift_back(
    lift_site: LiftSite, lift_simulator: LiftSimulator, my_robot: Robot, wheels: ModelWheels
) -> None:
    assert my_robot.ride(lift_site.url, "lift", "L1", "L2") == "arrived"
    assert wheels.at == 2 * STEPS
    assert lift_simulator.truth.at == "L2"
    assert lift_site.state().holder is None
    lift_simulator.wait_for(lambda truth: truth.doors_shut)


def test_robot_stays_out_of_a_lift_it_cannot_trust(
    lift_site: LiftSite, modbus_faults: ModbusFaults, hurried_robot: Robot
) -> None:
    modbus_faults.silence()
    assert hurried_robot.ride(lift_site.url, "lift", "L1", "L2") == "gave up"


def test_the_robot_gives_up_when_there_is_a_fire_while_it_waits(
    lift_site: LiftSite,
    lift_simulator: LiftSimulator,
    my_robot: Robot,
    wheels: ModelWheels,
    robot_thread: ThreadPoolExecutor,
) -> None:
    ended = robot_thread.submit(my_robot.ride, lift_site.url, "lift", "L4", "L1")
    lift_simulator.wait_for(lambda truth: not truth.standing)
    lift_simulator.set_fire(True)
    lift_site.wait_for_event(lambda event: isinstance(event, Refused))
    my_robot.patience_s = 0.0
    assert ended.result(10) == "gave up"
    assert wheels.farthest == 0
    lift_simulator.set_fire(False)
    lift_site.wait_for(lambda state: state.mode == "normal")
    assert lift_site.state().restrictions.fire_latched
    lift_site.acknowledge(by="the caretaker")
    my_robot.patience_s = 15.0
    assert my_robot.ride(lift_site.url, "lift", "L1", "L2") == "arrived"


def test_the_robot_leaves_the_doorway_when_the_cable_is_pulled_out(
    lift_site: LiftSite, modbus_faults: ModbusFaults, my_robot: Robot, wheels: ModelWheels
) -> None:
    def pull_the_cable() -> None:
        modbus_faults.cut()
        lift_site.wait_for(lambda state: state.quality == "offline")

    wheels.then[3] = pull_the_cable
    assert my_robot.ride(lift_site.url, "lift", "L1", "L2") == "gave up"
    assert (wheels.farthest, wheels.at) == (3, 0)


def test_the_robot_does_not_wait_endlessly_for_a_stuck_door(
    lift_site: LiftSite, lift_simulator: LiftSimulator, hurried_robot: Robot, my_robot: Robot, wheels: ModelWheels
) -> None:
    with lift_simulator.fault("stuck_door"):
        assert hurried_robot.ride(lift_site.url, "lift", "L2", "L1") == "gave up"
        assert lift_simulator.truth.doors_shut
    assert wheels.farthest == 0
    assert my_robot.ride(lift_site.url, "lift", "L2", "L1") == "arrived"


def test_the_robot_waits_until_another_robot_has_finished_with_the_lift(
    lift_site: LiftSite, my_robot: Robot, wheels: ModelWheels, robot_thread: ThreadPoolExecutor
) -> None:
    with lift_site.held("L3", by="cleaner 7"):
        ended = robot_thread.submit(my_robot.ride, lift_site.url, "lift", "L1", "L2")
        lift_site.wait_for_event(lambda event: isinstance(event, Refused))
        assert wheels.farthest == 0
    assert ended.result(20) == "arrived"
    assert {refused.code for refused in lift_site.refusals} == {"held"}


def test_late_answers_do_not_mislead_the_robot(
    lift_site: LiftSite, lift_simulator: LiftSimulator, modbus_faults: ModbusFaults, my_robot: Robot
) -> None:
    modbus_faults.add("late_answer", seconds=0.7, times=2)
    assert my_robot.ride(lift_site.url, "lift", "L1", "L2") == "arrived"
    assert lift_simulator.truth.at == "L2"
    assert len(modbus_faults.struck) == 2


@pytest.mark.lift("west")
@pytest.mark.lift("east")
def test_the_robot_takes_the_other_lift_when_one_is_silent(
    lift_site: LiftSite, hurried_robot: Robot, my_robot: Robot
) -> None:
    lift_site.modbus_faults("west").silence()
    assert hurried_robot.ride(lift_site.url, "west", "L1", "L2") == "gave up"
    assert my_robot.ride(lift_site.url, "east", "L1", "L2") == "arrived"
