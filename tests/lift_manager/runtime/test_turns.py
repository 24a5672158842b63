"""People get a turn between two robots, and the hours of the day that are theirs."""

import asyncio
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import pytest

from lift_manager.lift.hours import RobotHours, read_hours
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.session import Holder
from lift_manager.runtime.recorder import MemoryRecorder
from register_maps.words import Door, Motion
from simulator.controller import Inputs
from tests.lift_manager.runtime.phases import door_held, outputs, travelling
from tests.lift_manager.runtime.scripted import OTHER as NEXT
from tests.lift_manager.runtime.scripted import PERMITTING, Bench, boarded, on_bench
from tests.lift_manager.runtime.test_what_cannot_be_read import WITH_MODE
from tests.support.spine import OTHER, WORKSHOP, Spine, on_spine, spine
from tests.support.virtual_time import elapse, run_virtual

REST_S = 5.0
WAITS = "people, whose turn it is for 5 s after each robot"


def now() -> float:
    return asyncio.get_running_loop().time()


@pytest.mark.parametrize("holder", [WORKSHOP, OTHER])
def test_a_session_right_after_another_is_accepted_and_presses_nothing_until_people_had_their_turn(
    holder: Holder,
) -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        made.accept("L2", hold=False)
        ended_at = now()
        made.accept("L3", holder=holder)
        assert made.state.holder == holder
        assert made.state.restrictions.waiting_for == WAITS
        calls = len(made.presses())
        while now() < ended_at + REST_S - 0.1:
            assert made.state.robot_door is not RobotDoor.OPEN
            await elapse(0.1)
            made.accept("L3", holder=holder)
        assert outputs(made) == [0, 0, 0, 0]
        assert not made.face.picture.robot_mode_on
        await made.until(lambda state: state.restrictions.waiting_for != WAITS)
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L3")
        (at, _), *more = made.presses()[calls:]
        assert not more
        assert at >= ended_at + REST_S

    on_spine(check, between_sessions_s=REST_S, poll_s=0.2)


def test_people_really_get_the_car_between_two_robots() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        made.people(Inputs(landing_buttons=frozenset({0})))
        made.accept("L2", hold=False)
        made.accept("L3")
        await made.until(lambda state: state.floor == "L1" and Door.OPEN in state.doors.values())
        made.people(Inputs())
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L3")

    on_spine(check, between_sessions_s=REST_S)


def test_the_lease_does_not_suffer_from_the_rest() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        made.accept("L2", hold=False)
        made.accept("L2")
        await elapse(39)
        assert made.state.holder == WORKSHOP
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)

    on_spine(check, between_sessions_s=40, lease_s=30)


def test_the_first_session_and_one_after_a_session_that_pressed_nothing_need_no_rest() -> None:
    async def check(made: Spine) -> None:
        made.people(Inputs(landing_buttons=frozenset({1})))
        await elapse(0.2)
        made.people(Inputs())
        start = now()
        await door_held(made)
        assert now() - start < 30
        made.accept("L2", hold=False)
        made.accept("L3")
        made.accept("L3", hold=False)  # another floor: it is no release
        assert waits(made)
        await elapse(REST_S - 1)
        made.accept("L2", hold=False)
        assert not waits(made)
        await elapse(1)
        made.accept("L3")
        assert not waits(made)

    on_spine(check, between_sessions_s=REST_S, poll_s=0.2)


def test_robot_mode_of_the_session_before_is_still_kept_under_way_during_the_rest() -> None:
    async def check(made: Spine) -> None:
        await travelling(made)
        await made.until(lambda state: state.floor is not None)
        made.accept(made.state.floor or "", hold=False)
        made.accept("L1")
        while made.face.picture.motion is not Motion.STOPPED:
            assert made.face.picture.robot_mode_on
            await elapse(0.05)
        await elapse(1)
        assert not made.face.picture.robot_mode_on
        assert made.state.restrictions.waiting_for.startswith("people, whose turn it is")

    on_spine(check, between_sessions_s=20)


def test_the_lift_is_told_during_the_rest_that_the_robot_before_left() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", RobotWord.LEFT, hold=False)
        made.accept("L1")
        await elapse(2)
        assert made.presses[-1] == "robot_left"
        assert made.driver.on == set()
        await elapse(4)
        assert made.presses[-1] == "call L1"

    on_bench(check, PERMITTING, between_sessions_s=REST_S)


def waits(made: Spine) -> bool:
    """Whether a session holds the lift and waits for people to have their turn."""
    return made.state.holder == WORKSHOP and made.state.restrictions.waiting_for == WAITS


@dataclass
class WallClock:
    """A building's clock that follows virtual time."""

    start: datetime

    def __call__(self) -> datetime:
        return self.start + timedelta(seconds=now())


NIGHTS = RobotHours((read_hours("Mon-Fri 20:00-06:00"),))
MONDAY = datetime(2026, 3, 2, tzinfo=UTC)


def test_outside_its_hours_a_lift_takes_no_new_robot_and_says_when_it_does() -> None:
    async def check(made: Spine) -> None:
        refused = made.refuse("L2")
        assert refused.code is Refusal.OUTSIDE_HOURS
        assert refused.message == (
            "lift takes robots Mon-Fri 20:00-06:00, and here it is Mon 19:59; robots may begin again Mon 20:00"
        )
        made.accept("L1", hold=False)
        await elapse(10)
        assert made.device.writes == []
        made.accept("L2")

    on_spine(check, robot_hours=NIGHTS, clock=WallClock(MONDAY.replace(hour=19, minute=59, second=50)))


def test_a_robot_under_way_when_its_hours_end_finishes_its_ride() -> None:
    async def check(made: Spine) -> None:
        await door_held(made)
        await elapse(10)
        made.accept("L3")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L3")
        made.accept("L3", hold=False)
        assert made.refuse("L1").code is Refusal.OUTSIDE_HOURS

    on_spine(check, robot_hours=NIGHTS, clock=WallClock(MONDAY.replace(day=3, hour=5, minute=59, second=50)))


def test_a_robot_that_may_be_inside_gets_out_at_any_hour_also_after_a_restart() -> None:
    async def main() -> None:
        memory = MemoryRecorder()
        async with spine(recorder=memory) as made:
            await door_held(made)
        noon = MONDAY.replace(hour=12)
        async with spine(recorder=memory, robot_hours=NIGHTS, clock=lambda: noon) as made:
            assert made.refuse("L1", holder=OTHER).code is Refusal.HELD
            made.accept("L1")
            made.accept("L1", hold=False)
            assert made.refuse("L1", holder=OTHER).code is Refusal.OUTSIDE_HOURS
            assert made.refuse("L1").code is Refusal.OUTSIDE_HOURS

    run_virtual(main)


def test_what_the_lift_is_told_of_the_robot_before_gives_people_no_second_turn() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", RobotWord.LEFT, hold=False)
        made.accept("L1")
        await elapse(REST_S - 1)
        assert made.presses[-1] == "robot_left"
        made.accept("L3", hold=False)
        await elapse(1)
        made.accept("L1")
        assert made.state.restrictions.waiting_for == ""

    on_bench(check, PERMITTING, between_sessions_s=REST_S)


def test_an_open_door_invites_no_robot_that_waits_for_people_to_have_their_turn() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L1", hold=False)
        made.accept("L1", holder=NEXT)
        while made.state.restrictions.waiting_for:
            assert made.state.robot_door is RobotDoor.MOVING
            await elapse(0.1)
        await elapse(0.5)
        assert made.state.robot_door is RobotDoor.OPEN

    on_bench(check, PERMITTING, between_sessions_s=REST_S, poll_s=0.2)


def test_people_have_their_turn_from_when_robot_mode_has_fallen() -> None:
    async def check(made: Spine) -> None:
        await travelling(made)
        await made.until(lambda state: state.floor is not None)
        made.accept(made.state.floor or "", hold=False)
        made.people(Inputs(landing_buttons=frozenset({1})))
        made.accept("L1", holder=OTHER)
        calls, off_s = len(made.presses()), 0.0
        while len(made.presses()) == calls:
            off_s += 0.0 if made.face.picture.robot_mode_on else 0.05
            await elapse(0.05)
        assert off_s >= REST_S

    on_spine(check, between_sessions_s=REST_S, poll_s=0.2)


def test_a_session_that_pressed_nothing_asks_for_no_robot_mode_when_it_ends_during_the_rest() -> None:
    async def check(made: Bench) -> None:
        made.grants_robot_mode()
        await made.called_to("L1")
        made.accept("L1", hold=False)
        assert "robot_mode" not in made.driver.on
        made.accept("L3", holder=NEXT)
        made.driver.values = replace(made.driver.values, floor=None, motion=Motion.UP)
        await elapse(0.5)
        made.accept("L3", RobotWord.LEFT, hold=False, holder=NEXT)
        await elapse(0.5)
        assert "robot_mode" not in made.driver.on

    on_bench(check, WITH_MODE, between_sessions_s=REST_S)
