"""OPEN is withdrawn some time before the manager releases a door by itself, and states count down to that."""

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.runtime.bus import StateChanged
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door
from tests.lift_manager.runtime.heard import heard, only
from tests.lift_manager.runtime.rmf_words import open_for_it
from tests.lift_manager.runtime.scripted import PLAIN, ROBOT, Bench, on_bench
from tests.lift_manager.runtime.test_session_restart import open_at_l1
from tests.support.session_calls import saved
from tests.support.virtual_time import elapse


def test_the_timer_withdraws_open_between_two_polls_and_the_output_stays_on_until_the_end() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        left_s = made.state.releases_in_s
        assert left_s is not None
        with made.bus.listen(100) as listener:
            await elapse(left_s - 10.0 + 1e-3)
            (withdrawn,) = [event.state for event in only(await heard(listener), StateChanged)]
        assert withdrawn.robot_door is RobotDoor.MOVING
        assert withdrawn.doors == made.state.doors
        assert withdrawn.releases_in_s == pytest.approx(10.0, abs=1e-6)
        assert made.driver.on
        await elapse(9.99)
        assert made.driver.on
        await elapse(0.02)
        assert made.driver.on == set()

    # no poll falls on the moment of the withdrawal
    on_bench(check, PLAIN, lease_s=60.0, poll_s=0.17)


def test_a_renewal_restores_open_at_once_and_moves_the_countdown() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        await elapse(52)
        assert made.robot_door() is RobotDoor.MOVING
        made.accept("L1")
        assert made.robot_door() is RobotDoor.OPEN
        assert made.state.releases_in_s == pytest.approx(60.0)
        await elapse(49)
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, PLAIN, lease_s=60.0, poll_s=0.2)


def test_a_renewal_changes_nothing_where_another_limit_comes_first() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        for _ in range(55):
            made.accept("L1")
            await elapse(1)
        left_s = made.state.releases_in_s
        assert left_s is not None
        assert left_s < 10
        made.accept("L1")
        assert made.state.releases_in_s == pytest.approx(left_s)
        assert made.robot_door() is RobotDoor.MOVING

    on_bench(check, PLAIN, max_session_hold_s=60.0, poll_s=0.2)


def test_a_lift_that_nobody_holds_counts_down_to_nothing() -> None:
    async def check(made: Bench) -> None:
        assert made.state.releases_in_s is None
        made.accept("L1")
        assert made.state.releases_in_s == pytest.approx(300.0)

    on_bench(check, PLAIN)


def test_a_session_of_rmf_has_its_open_withdrawn_sooner_and_no_lease() -> None:
    async def check(made: Bench) -> None:
        await open_for_it(made)
        await elapse(35)
        left_s = made.state.releases_in_s
        assert left_s is not None
        assert left_s > 30
        assert made.robot_door() is RobotDoor.OPEN
        await elapse(left_s - 29.9)
        assert made.robot_door() is RobotDoor.MOVING
        assert made.driver.on

    on_bench(check, PLAIN, lease_s=30.0, max_session_hold_s=75.0)


def test_the_limit_of_a_hold_ends_it_though_the_lift_cannot_be_read() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        left_s = made.state.releases_in_s
        assert left_s is not None
        made.driver.silent = True
        await elapse(left_s - 0.1)
        assert made.driver.on == {"hold_door.front"}
        await elapse(0.2)
        assert made.driver.on == set()
        assert made.state.holder == ROBOT

    on_bench(check, PLAIN, max_session_hold_s=60.0, poll_s=0.2)


def test_a_hold_begins_from_the_beginning_once_the_car_has_left_and_come_back() -> None:
    memory = MemoryRecorder()

    async def check(made: Bench) -> None:
        await open_at_l1(made)
        await elapse(40)
        await made.car("L2", Door.CLOSED)
        await elapse(1)
        assert made.driver.on == set()
        assert made.state.releases_in_s == pytest.approx(300.0, abs=60.0)
        kept = saved(memory).session
        # a restart would look for the hold, and where a call excludes it let go of the call
        assert kept is not None
        assert kept.holding_since is None
        await elapse(3)
        made.accept("L1")
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(1)
        assert made.driver.on == {"hold_door.front"}
        assert made.state.releases_in_s == pytest.approx(60.0, abs=3.0)

    on_bench(check, PLAIN, max_session_hold_s=60.0, recorder=memory, poll_s=0.2)
