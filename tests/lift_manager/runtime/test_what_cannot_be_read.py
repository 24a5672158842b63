"""A lift that cannot be read, whole or in part: nothing is pressed on what nobody knows, and letting go needs no reading."""

from dataclasses import replace

import pytest

from drivers.modbus.reading import lift_values
from lift_manager.lift.occupancy import RobotWord
from lift_manager.lift.refusals import Refusal
from register_maps.words import Door, Mode
from tests.lift_manager.runtime.scripted import PERMITTING, PLAIN, ROBOT, Bench, on_bench
from tests.support.virtual_time import elapse

WITH_MODE = replace(
    PLAIN,
    commands=PLAIN.commands | {"robot_mode"},
    signals=PLAIN.signals | {"robot_mode_on"},
    held_commands=PLAIN.held_commands | {"robot_mode"},
)
KEYED = replace(PLAIN, signals=PLAIN.signals | {"robots_allowed"})


async def under_way(made: Bench) -> None:
    """Robot mode is granted, and the car moves to L1."""
    made.accept("L1")
    await elapse(1)
    made.driver.values = replace(made.driver.values, floor=None, flags={"robot_mode_on": True})
    await elapse(1)
    assert "robot_mode" in made.driver.on


def test_a_key_switch_that_cannot_be_read_refuses_a_request() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, unknown={"robots_allowed": 7})
        await elapse(0.5)
        answer = made.refuse("L1")
        assert answer.code is Refusal.MODE
        assert "its signal robots_allowed reads 7, which its map does not list" in answer.message
        assert made.driver.log == []

    on_bench(check, KEYED)


def test_a_key_switch_that_can_no_longer_be_read_lets_the_door_go() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, floor="L1", doors={}, flags={"robots_allowed": True})
        await elapse(1.5)
        made.accept("L1")
        await elapse(1)
        assert made.driver.on == {"hold_door.front"}
        made.driver.values = replace(made.driver.values, flags={})
        await elapse(0.5)
        assert made.driver.on == set()
        assert made.state.holder == ROBOT

    on_bench(check, replace(KEYED, signals=KEYED.signals - {"may_enter", "may_leave"}))


def test_robot_mode_is_let_go_at_once_when_a_session_ends_unread_with_the_car_last_seen_at_rest() -> None:
    async def check(made: Bench) -> None:
        made.driver.values = replace(made.driver.values, flags={"robot_mode_on": True})
        made.accept("L1")
        await elapse(2)
        made.driver.silent = True
        await elapse(5)
        assert "robot_mode" in made.driver.on
        made.accept("L2", hold=False)
        assert made.state.holder is None
        assert "robot_mode" not in made.driver.on

    on_bench(check, WITH_MODE)


def test_robot_mode_is_let_go_when_the_lease_runs_out_unread() -> None:
    async def check(made: Bench) -> None:
        made.accept("L1")
        await elapse(1)
        made.driver.silent = True
        await elapse(28)
        assert "robot_mode" in made.driver.on
        await elapse(4)
        assert made.state.holder is None
        assert "robot_mode" not in made.driver.on

    on_bench(check, WITH_MODE, lease_s=30)


def test_robot_mode_outlasts_a_session_that_ends_unread_under_way_by_one_trip_at_most() -> None:
    async def check(made: Bench) -> None:
        await under_way(made)
        made.driver.silent = True
        await elapse(5)
        made.accept("L1", RobotWord.LEFT, hold=False)
        assert made.state.holder is None
        await elapse(WITH_MODE.arrive_within_s - 1)
        assert "robot_mode" in made.driver.on
        await elapse(1 + 2 * WITH_MODE.max_age_s)
        assert "robot_mode" not in made.driver.on
        assert [text for text in await made.alarms() if "nobody has seen the car come to rest for 120 s" in text]

    on_bench(check, WITH_MODE)


def test_a_lift_that_can_no_longer_be_read_after_its_session_keeps_robot_mode_for_one_trip_at_most() -> None:
    async def check(made: Bench) -> None:
        await under_way(made)
        made.accept("L1", RobotWord.LEFT, hold=False)
        await elapse(5)
        assert "robot_mode" in made.driver.on
        made.driver.silent = True
        await elapse(WITH_MODE.arrive_within_s - 6)
        assert "robot_mode" in made.driver.on
        await elapse(1 + 2 * WITH_MODE.max_age_s)
        assert "robot_mode" not in made.driver.on

    on_bench(check, WITH_MODE)


def test_a_hold_of_robot_mode_is_not_renewed_while_the_lift_cannot_be_read() -> None:
    async def check(made: Bench) -> None:
        await under_way(made)
        made.driver.silent = True
        await elapse(5)
        renewed = made.driver.renewed["robot_mode"]
        made.accept("L1", RobotWord.LEFT, hold=False)
        await elapse(20)
        assert made.driver.renewed["robot_mode"] == renewed

    on_bench(check, WITH_MODE)


def test_a_call_that_waits_for_the_robots_leaving_is_let_go_when_the_lift_cannot_be_told_of_it() -> None:
    async def check(made: Bench) -> None:
        await made.called_to("L1")
        made.accept("L3", RobotWord.IN_PLACE)
        await elapse(1)
        await made.ridden_to("L3")
        assert made.driver.on == {"go"}
        made.driver.silent = True
        await elapse(3)
        made.accept("L3", RobotWord.LEFT, hold=False)
        await elapse(3)
        assert made.driver.on == set()
        made.driver.silent = False
        await elapse(1)
        assert made.presses[-1] == "robot_left"

    on_bench(check, PERMITTING)


@pytest.mark.parametrize("fire", [{"flags": {"fire": True}}, {"flags": {"fireman": True}}, {"fire_word": True}])
def test_fire_during_an_inspection_is_kept_in_mind(fire: dict[str, object]) -> None:
    async def check(made: Bench) -> None:
        told = made.driver.values
        made.driver.values = replace(told, mode=Mode.INSPECTION, **fire)  # type: ignore[arg-type]  # fields by name
        await elapse(1)
        made.driver.values = replace(told, mode=Mode.NORMAL)
        await elapse(1)
        assert made.refuse("L1").code is Refusal.FIRE_LATCHED
        assert [text for text in await made.alarms() if text.startswith("fire:")]

    on_bench(check, PLAIN)


def test_an_inspection_without_a_fire_is_forgotten() -> None:
    async def check(made: Bench) -> None:
        await made.mode(Mode.INSPECTION)
        await made.mode(Mode.NORMAL)
        made.accept("L1")

    on_bench(check, PLAIN)


def test_a_mode_word_that_says_fire_is_heard_under_a_flag_that_says_inspection() -> None:
    outranked = lift_values({"mode": Mode.FIRE, "inspection": True, "door.front": Door.OPEN}, {}, {})
    assert (outranked.mode, outranked.fire_word) == (Mode.INSPECTION, True)
    assert not lift_values({"mode": Mode.FIRE}, {}, {}).fire_word
    assert not lift_values({"mode": Mode.ROBOT, "inspection": True}, {}, {}).fire_word
