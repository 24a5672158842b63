"""Rides through the whole spine: what callers ask, what the lift does, what is published on the way."""

import asyncio

import pytest

from lift_manager.lift.observation import RobotDoor
from lift_manager.lift.refusals import Refusal
from lift_manager.lift.state import Quality
from register_maps.words import Door, Mode, Motion, Side, Table
from simulator.controller import Inputs
from simulator.modes import Key
from tests.support.spine import OTHER, Spine, on_spine
from tests.support.virtual_time import elapse

MAPS = ["generic-registers", "two-stop-agv"]


def test_an_idle_lift_says_where_it_is_and_touches_nothing() -> None:
    async def check(made: Spine) -> None:
        state = made.state
        assert (state.quality, state.floor, state.destination) == (Quality.LIVE, "L1", "L1")
        assert (state.robot_door, state.motion, state.mode) == (RobotDoor.CLOSED, Motion.STOPPED, Mode.NORMAL)
        await elapse(20)
        assert made.device.writes == []

    on_spine(check)


@pytest.mark.parametrize("map_name", MAPS)
def test_a_request_brings_the_car_and_holds_its_door(map_name: str) -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        picture = made.face.picture
        assert picture.door_open_floor == 1
        assert made.state.floor == "L2"
        await elapse(20)  # a door that nobody holds closes after three
        assert made.state.robot_door is RobotDoor.OPEN
        assert made.face.picture.doors[Side.FRONT] is Door.OPEN

    on_spine(check, map_name)


@pytest.mark.parametrize("map_name", MAPS)
def test_the_destination_is_not_the_current_floor_before_the_car_stands_there(map_name: str) -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        while made.state.floor != "L2":
            assert made.state.robot_door is not RobotDoor.OPEN
            assert made.state.destination == "L2"
            await elapse(0.01)
        assert made.face.picture.level_floor == 1

    on_spine(check, map_name)


@pytest.mark.parametrize("map_name", MAPS)
def test_a_call_without_a_hold_ends_its_session_on_arrival(map_name: str) -> None:
    async def check(made: Spine) -> None:
        made.accept("L2", hold=False)
        await made.until(lambda state: state.holder is None and state.floor == "L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN) if map_name != "two-stop-agv" else None
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        await elapse(1)
        assert made.state.mode is (Mode.ROBOT if map_name == "two-stop-agv" else Mode.NORMAL)
        assert made.driver.capabilities.commands

    on_spine(check, map_name)


def test_robot_mode_is_asked_for_before_the_call_and_dropped_after_the_session() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.mode is Mode.ROBOT)
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        asked, called = made.presses(18)[0][0], made.presses(16)[0][0]
        assert asked < called
        made.accept("L2", hold=False)
        await made.until(lambda state: state.mode is Mode.NORMAL)
        assert made.state.holder is None

    on_spine(check)


def test_repeats_of_a_request_press_nothing_more() -> None:
    async def check(made: Spine) -> None:
        for _ in range(40):
            made.accept("L3")
            await elapse(0.5)
        assert made.state.robot_door is RobotDoor.OPEN
        assert [value for _, value in made.presses()] == [3]

    on_spine(check)


def test_a_new_floor_on_the_way_is_the_new_destination() -> None:
    async def check(made: Spine) -> None:
        made.accept("L3")
        await made.until(lambda state: state.motion is Motion.UP)
        made.accept("L2")
        assert made.state.destination == "L2"
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L2")
        assert [value for _, value in made.presses()] == [3, 2]

    on_spine(check)


def test_a_request_for_the_floor_where_the_car_stands_opens_and_holds_without_a_call() -> None:
    async def check(made: Spine) -> None:
        made.accept("L1")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        assert made.presses() == []

    on_spine(check)


def test_asking_not_to_hold_the_door_where_the_car_stands_lets_go_and_moves_nothing() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.accept("L2", hold=False)
        assert made.state.holder is None
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        assert made.face.picture.level_floor == 1
        assert [value for _, value in made.presses()] == [2]

    on_spine(check)


def test_an_idle_workshop_adapter_leaves_the_lift_free_for_people() -> None:
    async def check(made: Spine) -> None:
        for _ in range(60):
            made.accept(made.state.floor or "L1", hold=False)
            await elapse(1)
        assert made.state.holder is None
        assert made.device.writes == []

    on_spine(check)


def test_a_slow_idle_client_does_not_call_back_a_lift_that_people_move() -> None:
    async def check(made: Spine) -> None:
        for floor in (2, 0, 1):
            made.people(Inputs(landing_buttons=frozenset({floor})))
            for _ in range(12):
                believed = made.state.floor
                await elapse(1.5)
                if believed is not None:
                    made.accept(believed, hold=False)
            made.people(Inputs())
            await elapse(1)
        assert made.device.writes == []

    on_spine(check)


def test_another_caller_is_told_who_holds_the_lift() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2", holder=OTHER)
        refused = made.refuse("L3")
        assert refused.code is Refusal.HELD
        assert "rmf:fleet/robot1" in refused.message
        assert made.refuse("L1", hold=False).code is Refusal.HELD
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN and state.floor == "L2")

    on_spine(check)


def test_the_lease_runs_from_the_door_standing_open_and_then_the_lift_goes_back_to_people() -> None:
    async def check(made: Spine) -> None:
        made.accept("L3")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        waited = await made.until(lambda state: state.holder is None, within_s=60)
        assert waited == pytest.approx(30, abs=1)
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)

    on_spine(check, lease_s=30)


def test_a_repeat_renews_the_lease_but_no_hold_lasts_longer_than_the_site_allows() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        for _ in range(29):
            await elapse(1)
            made.accept("L2")
            assert made.face.picture.doors[Side.FRONT] is Door.OPEN
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        assert made.state.holder is not None

    on_spine(check, max_session_hold_s=30)


def test_a_hold_that_was_spent_begins_again_at_a_repeat_once_the_door_was_shut_and_people_had_their_turn() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        await made.until(lambda state: state.robot_door is RobotDoor.CLOSED)
        held = made.state.holder
        for _ in range(18):
            made.accept("L2")
            await elapse(0.25)
            assert made.face.picture.doors[Side.FRONT] is Door.CLOSED
        await elapse(1)
        assert (
            made.face.picture.doors[Side.FRONT] is Door.CLOSED
        )  # nothing is pressed before the holder repeats its request
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        assert made.state.holder == held
        await elapse(12)
        assert made.state.robot_door is RobotDoor.OPEN  # a whole hold, and not the rest of the one before

    on_spine(check, max_session_hold_s=20, clear_s=3, between_sessions_s=5, poll_s=0.2)


def test_a_lost_pulse_is_pressed_again_only_on_a_repeat_and_only_after_a_pause() -> None:
    async def check(made: Spine) -> None:
        made.device.ignores_calls = True
        made.accept("L2")
        await elapse(3.5)
        assert len(made.presses()) == 1
        made.accept("L2")
        await elapse(20)
        assert len(made.presses()) == 1
        made.device.ignores_calls = False
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        assert len(made.presses()) == 2

    on_spine(check)


@pytest.mark.parametrize("key", [Key.INSPECTION, Key.OUT_OF_SERVICE, Key.INDEPENDENT])
def test_no_robot_is_taken_while_the_key_says_otherwise(key: Key) -> None:
    async def check(made: Spine) -> None:
        made.people(Inputs(key=key))
        await elapse(1)
        refused = made.refuse("L2")
        assert refused.code is Refusal.MODE
        assert key.value in refused.message
        assert made.device.writes == []

    on_spine(check)


def test_fire_lets_everything_go_at_once_and_no_door_invites_a_robot_in() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.people(Inputs(fire=True))
        await made.until(lambda state: state.mode is Mode.FIRE, within_s=0.5)
        for _ in range(100):
            assert made.state.robot_door is not RobotDoor.OPEN
            await elapse(0.1)
        assert made.state.holder is None
        assert made.face.picture.door_open_floor == 0
        assert made.face.read(Table.HOLDING, 16, 4, asyncio.get_running_loop().time()) == [0, 0, 0, 0]
        made.people(Inputs())
        await elapse(2)
        assert made.refuse("L2").code is Refusal.FIRE_LATCHED

    on_spine(check, poll_s=0.2)


def test_a_silent_controller_makes_the_lift_offline_within_its_age_limit_and_it_heals_alone() -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        made.device.silent = True
        waited = await made.until(lambda state: state.quality is Quality.OFFLINE)
        assert waited <= 1.05
        state = made.state
        assert state.robot_door is not RobotDoor.OPEN
        assert state.floor is None
        assert "nothing newer within 1 s" in state.reason
        assert made.refuse("L3").code is Refusal.OFFLINE
        await elapse(10)
        made.device.silent = False
        # the longest time-out of a link in doubt, and a beat of the heartbeat
        assert await made.until(lambda state: state.quality is Quality.LIVE) <= 2.6

    on_spine(check)


def test_a_monitored_lift_refuses_calls_but_not_releases() -> None:
    async def check(made: Spine) -> None:
        assert made.refuse("L2").code is Refusal.MONITOR_ONLY
        made.accept("L1", hold=False)
        await elapse(10)
        assert made.device.writes == []

    on_spine(check, control=False)


def test_an_unknown_floor_is_refused_with_the_floors_there_are() -> None:
    async def check(made: Spine) -> None:
        assert made.refuse("L9").message.endswith("its floors are L1, L2, L3")

    on_spine(check)


@pytest.mark.parametrize("map_name", MAPS)
def test_stopping_lets_everything_go_and_verifies_it(map_name: str) -> None:
    async def check(made: Spine) -> None:
        made.accept("L2")
        await made.until(lambda state: state.robot_door is RobotDoor.OPEN)
        start = asyncio.get_running_loop().time()
        await made.life.stop()
        assert asyncio.get_running_loop().time() - start < 1
        assert made.refuse("L1").code is Refusal.STOPPING
        _, last = made.device.writes[-1]
        assert not any(last.values)

    on_spine(check, map_name)


def test_a_release_under_way_keeps_robot_mode_until_the_car_stands() -> None:
    async def check(made: Spine) -> None:
        made.accept("L3")
        await made.until(lambda state: state.motion is Motion.UP and state.floor is not None)
        made.accept(made.state.floor or "", hold=False)
        assert made.state.holder is None
        while made.face.picture.motion is not Motion.STOPPED:
            assert made.face.picture.robot_mode_on
            await elapse(0.1)
        await made.until(lambda state: state.mode is Mode.NORMAL)

    on_spine(check, poll_s=0.2)
