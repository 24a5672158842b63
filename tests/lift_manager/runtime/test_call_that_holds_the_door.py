"""What keeps the door open for a robot: a call that stays on until it is in place, or a hold that a restart finds on."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from drivers.model import Capabilities, LiftValues
from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.occupancy import RobotWord
from register_maps.words import Door, Mode, Motion
from tests.lift_manager.runtime.scripted import FRONT, OTHER, PERMITTING, PLAIN, TWO_STOP, Bench, boarded, on_bench
from tests.lift_manager.runtime.test_session_restart import CALL, HOLD, OPEN_AT_L1, open_at_l1, restarted
from tests.support.virtual_time import elapse

BY_DOOR = replace(PERMITTING, evidence="door_open", same_floor_call=True)
"""An open door is the evidence that the car stands, and the call keeps it open (elevator-interfaces 1.1)."""
STABLE = replace(PLAIN, signals=PLAIN.signals - {"destination", "call_accepted"}, evidence_for_s=2.0)
"""Two seconds have to pass before the car is known to stand."""
OFF = "the call that keeps the door open is off"


def drop(made: Bench) -> None:
    """Let the controller forget every output, as when it is switched off and on."""
    made.driver.on.clear()


async def stopped(made: Bench) -> None:
    await open_at_l1(made)
    await made.life.stop()
    assert made.driver.on == set()


def test_a_call_that_the_controller_dropped_at_the_open_door_is_pressed_again_by_the_next_request() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        drop(made)
        await elapse(0.3)
        assert made.robot_door() is RobotDoor.MOVING
        assert OFF in made.state.restrictions.waiting_for
        assert made.state.floor == "L1"
        await elapse(10)
        assert made.presses == ["call L1"]
        made.accept("L1")
        await elapse(0.5)
        assert made.presses == ["call L1"] * 2
        assert made.state.restrictions.waiting_for == ""
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, BY_DOOR, poll_s=0.2)


def test_a_call_that_is_dropped_each_time_is_pressed_more_and_more_rarely() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        for _ in range(120):
            if made.driver.on and made.robot_door() is RobotDoor.OPEN:
                drop(made)
            made.accept("L1")
            await elapse(0.5)
        assert 5 <= len(made.presses) <= 7

    on_bench(check, BY_DOOR, poll_s=0.2)


def test_a_call_for_the_robot_aboard_is_pressed_again_where_it_gets_out() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        assert made.robot_door() is RobotDoor.OPEN
        drop(made)
        await made.car("L3", Door.CLOSED)
        await elapse(2)
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(5)
        assert made.presses[-2:] == ["go L3"] * 2

    on_bench(check, BY_DOOR, poll_s=0.2)


def test_a_call_that_was_let_go_because_its_time_has_come_is_not_missed() -> None:
    async def check(made: Bench) -> None:
        await boarded(made)
        await made.ridden_to("L3")
        made.accept("L3", RobotWord.LEFT)
        await elapse(1)
        assert made.driver.on == set()
        for _ in range(20):
            made.accept("L3", RobotWord.LEFT)
            await elapse(0.5)
        assert made.presses[-1] == "robot_left"

    on_bench(check, BY_DOOR)


def test_a_call_whose_hold_is_spent_is_not_missed() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        await elapse(11)
        assert made.driver.on == set()
        for _ in range(20):
            made.accept("L1")
            await elapse(0.5)
        assert made.presses == ["call L1"]
        assert made.state.restrictions.waiting_for == ""
        assert made.robot_door() is RobotDoor.MOVING

    on_bench(check, BY_DOOR, max_session_hold_s=10.0, clear_s=3.0, poll_s=0.2)


def test_a_call_that_a_key_switch_let_go_of_is_pressed_again_once_robots_may_come() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        made.granted = {"robots_allowed": False}
        await made.car("L1", Door.OPEN, enter=True)
        assert made.driver.on == set()
        made.refuse("L1")
        made.granted = {"robots_allowed": True}
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(2)
        made.accept("L1")
        await elapse(0.5)
        assert made.presses == ["call L1"] * 2

    on_bench(check, BY_DOOR, poll_s=0.2)


@pytest.mark.parametrize("able", [BY_DOOR, PERMITTING], ids=["call opens", "stands long enough"])
def test_at_a_door_that_people_opened_the_call_is_pressed_all_the_same(able: Capabilities) -> None:
    async def check(made: Bench) -> None:
        await made.car("L1", Door.OPEN, enter=True)
        made.accept("L1")
        assert made.robot_door() is not RobotDoor.OPEN
        await elapse(0.5)
        assert made.presses == ["call L1"]
        assert made.robot_door() is RobotDoor.OPEN

    on_bench(check, able, poll_s=0.2)


def test_a_door_that_shut_on_a_waiting_robot_is_opened_again_by_its_next_request() -> None:
    async def check(made: Bench) -> None:
        await open_at_l1(made)
        made.driver.values = replace(made.driver.values, doors={FRONT: Door.CLOSED})
        await elapse(0.5)
        assert made.driver.on == {"call"}
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(1)
        assert made.driver.on == {"call"}
        await made.car("L1", Door.CLOSED)
        await elapse(4)
        made.accept("L1")
        await elapse(4)
        assert made.presses == ["call L1"] * 2

    on_bench(check, BY_DOOR, poll_s=0.2)


@pytest.mark.parametrize("able", [BY_DOOR, PERMITTING, TWO_STOP], ids=["door open", "stable", "two stops"])
def test_after_an_orderly_stop_the_open_door_is_no_invitation_before_the_call_is_on_again(able: Capabilities) -> None:
    async def after(made: Bench) -> None:
        await elapse(3)
        assert made.driver.log == []
        assert made.robot_door() is RobotDoor.MOVING
        assert "to send another request" in made.state.restrictions.waiting_for
        made.accept("L1")
        assert made.robot_door() is RobotDoor.MOVING
        await elapse(0.5)
        assert made.presses == ["call L1"]
        assert made.robot_door() is RobotDoor.OPEN

    restarted(stopped, after, able)


def test_after_a_stop_the_door_that_shut_meanwhile_is_opened_again_by_the_next_request() -> None:
    async def after(made: Bench) -> None:
        await elapse(5)
        assert made.driver.log == []
        made.accept("L1")
        await elapse(4)
        assert made.presses == ["call L1"]

    restarted(stopped, after, BY_DOOR, found=replace(OPEN_AT_L1, doors={FRONT: Door.CLOSED}))


def test_a_call_that_a_restart_finds_on_holds_the_door_on() -> None:
    async def after(made: Bench) -> None:
        await elapse(3)
        assert made.driver.log == []
        assert made.robot_door() is RobotDoor.OPEN
        made.accept("L1")
        await elapse(5)
        assert made.driver.log == []

    restarted(open_at_l1, after, BY_DOOR, left_on=frozenset({CALL}))


async def nothing_said(made: Bench) -> None:
    await elapse(5)


async def asked_at_once(made: Bench) -> None:
    for _ in range(5):
        made.accept("L1")
        await elapse(1)


async def stood(made: Bench) -> None:
    await made.called_to("L1")
    await elapse(3)
    assert made.robot_door() is RobotDoor.OPEN


@pytest.mark.parametrize("said", [nothing_said, asked_at_once])
@pytest.mark.parametrize("floor", ["L1", None])
def test_a_hold_that_a_restart_finds_on_waits_until_the_car_is_known_to_stand(
    said: Callable[[Bench], Awaitable[None]], floor: str | None
) -> None:
    async def after(made: Bench) -> None:
        await said(made)
        await made.car("L1", Door.OPEN, enter=True)
        await elapse(3)
        assert made.driver.log == []
        assert made.driver.renewed[HOLD] > 7
        assert made.robot_door() is RobotDoor.OPEN

    restarted(stood, after, STABLE, found=replace(OPEN_AT_L1, floor=floor), left_on=frozenset({HOLD}))


@pytest.mark.parametrize(
    "seen",
    [
        replace(OPEN_AT_L1, floor="L2"),
        replace(OPEN_AT_L1, floor=None, motion=Motion.UP),
        replace(OPEN_AT_L1, floor=None, flags={"robots_allowed": False}),
        replace(OPEN_AT_L1, floor=None, mode=Mode.INSPECTION),
    ],
    ids=["elsewhere", "moving", "key switch", "mode"],
)
def test_a_hold_that_waits_for_the_car_falls_as_soon_as_something_speaks_against_it(seen: LiftValues) -> None:
    async def after(made: Bench) -> None:
        assert made.driver.on == {HOLD}
        made.driver.values = seen
        await elapse(0.5)
        assert made.driver.log == [f"let go {HOLD}"]
        made.driver.values = OPEN_AT_L1
        await elapse(5)
        assert made.driver.log == [f"let go {HOLD}"]

    restarted(stood, after, STABLE, found=replace(OPEN_AT_L1, floor=None), left_on=frozenset({HOLD}))


def test_a_hold_that_waits_for_the_car_has_its_limit_and_goes_with_another_floor() -> None:
    async def spent(made: Bench) -> None:
        await elapse(8)
        assert made.driver.on == set()
        assert [text for text in await made.alarms() if "the door was held for 10 s" in text]

    async def elsewhere(made: Bench) -> None:
        made.accept("L2")
        await elapse(0.5)
        assert made.driver.log[0] == f"let go {HOLD}"
        assert HOLD not in made.driver.on

    nowhere, on = replace(OPEN_AT_L1, floor=None), frozenset({HOLD})
    restarted(stood, spent, STABLE, found=nowhere, left_on=on, max_session_hold_s=10.0)
    restarted(stood, elsewhere, STABLE, found=nowhere, left_on=on)


def test_nobody_else_is_held_a_door_that_a_restart_found_held() -> None:
    async def after(made: Bench) -> None:
        made.site.force_release("lift", "M. Weber", "nobody comes", at_once=True)
        await elapse(0.5)
        assert made.driver.on == set()
        made.site.acknowledge("lift", "M. Weber")
        made.accept("L2", holder=OTHER)
        await elapse(1)
        assert HOLD not in made.driver.on

    restarted(stood, after, STABLE, found=replace(OPEN_AT_L1, floor=None), left_on=frozenset({HOLD}))
